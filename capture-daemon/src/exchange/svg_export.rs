//! Blades → SVG: outline and midrib of each, pressed flat, in millimetres.

use std::fmt::Write;

use common::blade::Blade;
use glam::Vec2;

use super::pressed::press;

/// Around and between blades, millimetres.
const MARGIN_MM: f32 = 5.0;

/// An SVG drawing of blades side by side, their roots on one line, true to scale: a unit is a millimetre.
///
/// Each blade is a group with its name: its closed outline, then its midrib from root to tip, whose id begins with
/// `midrib`. [`super::svg_import::read`] makes blades of it again. Curves run smoothly through the knots.
pub fn write(blades: &[&Blade]) -> String {
    let mut body = String::new();
    let (mut x_mm, mut above_mm, mut below_mm) = (MARGIN_MM, 0.0_f32, 0.0_f32);
    for (index, blade) in blades.iter().enumerate() {
        let flat = press(blade);
        let mm = |point: Vec2| Vec2::new(point.x, -point.y) * 1e3;
        let left: Vec<Vec2> = flat.iter().map(|at| mm(at.left)).collect();
        let right: Vec<Vec2> = flat.iter().map(|at| mm(at.right)).collect();
        let mids: Vec<Vec2> = flat.iter().map(|at| mm(at.mid)).collect();
        let all = || left.iter().chain(&right).chain(&mids);
        let low = all().copied().reduce(Vec2::min).unwrap_or_default();
        let high = all().copied().reduce(Vec2::max).unwrap_or_default();
        let to = Vec2::new(x_mm - low.x, 0.0);
        let placed = |points: &[Vec2]| points.iter().map(|point| *point + to).collect::<Vec<Vec2>>();
        let (left, right, mids) = (placed(&left), placed(&right), placed(&mids));

        let mut outline = format!("M{}", number(right[0]));
        curve(&mut outline, &right);
        let back: Vec<Vec2> = left.iter().rev().copied().collect();
        let _ = write!(outline, " L{}", number(back[0]));
        curve(&mut outline, &back);
        let mut midrib = format!("M{}", number(mids[0]));
        curve(&mut midrib, &mids);
        let name = escaped(blade.name());
        let _ = write!(
            body,
            "  <g id=\"{name}\">\n    <path id=\"outline-{index}\" d=\"{outline} Z\" fill=\"#6d9f45\"/>\n    \
             <path id=\"midrib-{index}\" d=\"{midrib}\" fill=\"none\" stroke=\"#d9e8b8\" stroke-width=\"0.3\"/>\n  </g>\n"
        );
        x_mm += high.x - low.x + MARGIN_MM;
        (above_mm, below_mm) = (above_mm.min(low.y), below_mm.max(high.y));
    }
    let height_mm = below_mm - above_mm + 2.0 * MARGIN_MM;
    let top_mm = above_mm - MARGIN_MM;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{x_mm:.3}mm\" height=\"{height_mm:.3}mm\" \
         viewBox=\"0 {top_mm:.3} {x_mm:.3} {height_mm:.3}\">\n{body}</svg>\n"
    )
}

fn number(point: Vec2) -> String {
    format!("{:.3} {:.3}", point.x, point.y)
}

/// Cubic Bézier segments from the first of some points through all others: each has the slope there of the parabola
/// through it and its neighbours.
fn curve(path: &mut String, points: &[Vec2]) {
    let n = points.len();
    let slope = |k: usize| {
        let chord = |a: usize, b: usize| {
            let length = points[a].distance(points[b]).max(1e-6);
            ((points[b] - points[a]) / length, length)
        };
        match k {
            0 => chord(0, 1).0,
            k if k + 1 == n => chord(k - 1, k).0,
            k => {
                let ((before, from), (after, to)) = (chord(k - 1, k), chord(k, k + 1));
                (before * to + after * from) / (from + to)
            }
        }
    };
    for k in 1..n {
        let third = points[k - 1].distance(points[k]) / 3.0;
        let (out, into) = (points[k - 1] + slope(k - 1) * third, points[k] - slope(k) * third);
        let _ = write!(path, " C{} {} {}", number(out), number(into), number(points[k]));
    }
}

/// Text as it may stand in an attribute.
fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            c if c.is_control() => safe.push(' '),
            c => safe.push(c),
        }
    }
    safe
}

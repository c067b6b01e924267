//! The way of a blade from its base behind what hides all of it.

use glam::Vec2;

use super::mask::Mask;
use super::ray::Ray;
use super::ribbon::{End, Ribbon, RibbonParams, Section};
use super::section::Expected;
use super::tuft::is_open;

/// A root so far from all others, pixels, is none that they share; and a base lies at least so much lower.
const APART_PX: f32 = 15.0;

/// Leads ribbons that end behind something, far above the roots of others, to where one of these has its root,
/// if it can be their way; `attached`: more that have theirs. O(ribbons² · length · width).
pub(super) fn lead(mask: &Mask, ribbons: &mut [Ribbon], attached: &[Ribbon], params: &RibbonParams) {
    if mask.has_hand() {
        return;
    }
    let roots: Vec<(Vec2, f32)> = ribbons
        .iter()
        .chain(attached)
        .map(|ribbon| (ribbon.sections[0].expected.mid, ribbon.sections[0].expected.depth_m))
        .collect();
    let [x0, y0, x1, y1] = mask.region.map(|edge| edge as f32);
    let hangs = |i: usize| {
        let (ribbon, (root, _)) = (&ribbons[i], roots[i]);
        let from_border = (root.x - x0).min(root.y - y0).min(x1 - 1.0 - root.x).min(y1 - 1.0 - root.y);
        let led = ribbon.sections[0].anchor >= 1.0;
        let mut others = roots.iter().enumerate().filter(|(k, _)| *k != i);
        let lowest = roots.iter().map(|(other, _)| other.dot(params.down)).fold(f32::MIN, f32::max);
        ribbon.root != End::Free
            && !led
            && from_border > APART_PX
            && root.dot(params.down) < lowest - APART_PX
            && others.all(|(_, (other, _))| other.distance(root) > APART_PX)
    };
    let hang: Vec<bool> = (0..ribbons.len()).map(hangs).collect();
    for (ribbon, _) in ribbons.iter_mut().zip(&hang).filter(|(_, hangs)| **hangs) {
        let root = ribbon.sections[0].expected.mid;
        let bases =
            roots.iter().enumerate().filter(|(i, _)| hang.get(*i) != Some(&true)).map(|(_, base)| base);
        let mut ways: Vec<Vec<Section>> = bases
            .filter(|(base, _)| (*base - root).dot(params.down) > APART_PX)
            .filter_map(|(base, base_m)| {
                let here = roots.iter().filter(|(other, _)| other.distance(*base) < APART_PX).count();
                way(mask, &ribbon.sections, (*base, *base_m), here > 1)
            })
            .collect();
        ways.sort_by_key(Vec::len);
        if let Some(mut led) = ways.into_iter().next() {
            led.extend_from_slice(&ribbon.sections);
            (ribbon.sections, ribbon.root, ribbon.unsure) = (led, End::Shared, 0);
        }
    }
}

/// Sections from a base at a point, so deep, to the first one of `sections`, which are those that are seen, from
/// there on; `None` where it would be seen if it were there, or would have to turn. `shared`: whether several grow
/// there, and one more may by less of it, or by a way that bows. O(length · width).
fn way(mask: &Mask, sections: &[Section], (from, from_m): (Vec2, f32), shared: bool) -> Option<Vec<Section>> {
    /// Longest way, in lengths of what is seen; and cosine of the largest angle between both.
    const MAX_HIDDEN: f32 = 4.0;
    const STRAIGHT: f32 = 0.6;
    /// What the guessed way counts beside what is seen of it.
    const WEIGHT: f32 = 0.01;
    /// Four times how far it may lie beside the straight way in its middle, in lengths of it.
    const BOWS: [f32; 5] = [0.0, 0.3, -0.3, 0.6, -0.6];
    let inward = sections.iter();
    let ray = if shared { Ray::guessed(inward) } else { Ray::of(inward) }?;
    let like = sections.first()?;
    let length = from.distance(ray.from);
    let ahead = (from - ray.from).dot(ray.along);
    if length < 1.0
        || length > MAX_HIDDEN * sections.len() as f32
        || ahead < STRAIGHT * length
        || from_m <= 0.0
    {
        return None;
    }
    // As it leads on at its end; where it cannot run there, as straight as it can.
    let steps = length.ceil() as usize;
    let aside = (from - ray.from).perp();
    let bowed = BOWS.iter().filter(|_| shared).map(|bow| from + aside * *bow);
    std::iter::once(ray.from + ray.along * ahead).chain(bowed).find_map(|led_on| {
        let place = |t: f32| {
            let mid = ray.from + (led_on - ray.from) * t + (from - led_on) * t * t;
            (mid, ray.depth_m + (from_m - ray.depth_m) * t)
        };
        let section = |k: usize| {
            let t = 1.0 - k as f32 / steps as f32;
            let (mid, depth_m) = place(t);
            let up = (place(t - 0.5 / steps as f32).0 - mid).normalize_or(-ray.along);
            let across = Vec2::new(-up.y, up.x);
            let expected = Expected { mid, across, depth_m, half_px: ray.half_px, ..like.expected };
            Section::led(mask, expected, if k == 0 { 1.0 } else { WEIGHT })
        };
        let led: Vec<Section> = (0..steps).map(section).collect();
        let open = led.iter().filter(|section| is_open(mask, section)).count();
        (open as f32 <= 3.0 + 0.15 * length).then_some(led)
    })
}

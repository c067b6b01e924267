//! Ribbon → how its outline looks, and what lies beyond it: what tells a blade from a ragged stretch of
//! something larger.

use glam::Vec2;

use super::mask::{Mask, depth_step_m};
use super::ribbon::{Ribbon, Section};
use super::section::{Expected, Middle};

/// How a blade's outline looks where the blade itself is seen: neither hidden nor led.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Share of its cross-sections that show both edges, 0..=1.
    pub both: f32,
    /// Share of the edges that are none in space, 0..=1: there its surface leaves the depth window or the
    /// region, or goes on beyond a gap without readings.
    pub cut: f32,
    /// Share of the edges that lie so near to the nearest or farthest depth that counts, 0..=1, that its
    /// surface may go on there; they are among those that are cut.
    pub at_window: [f32; 2],
    /// Share of the edges at the border of the region, 0..=1.
    pub at_border: f32,
    /// Whether its root lies at the border of the region.
    pub from_border: bool,
    /// Share of the edges beyond which nothing can be seen, 0..=1.
    pub unseen: f32,
    /// How far an edge is from where the smooth blade has it, pixels, mean.
    pub waver_px: f32,
    /// How much its midrib turns while it advances by half of its width, radians, mean: at 1 its
    /// cross-sections meet.
    pub turning: f32,
}

/// How much the edges of a broad leaf wave, of its width.
const WAVER: f32 = 0.05;

impl Margins {
    /// How little an outline is that of a blade, from 0: the sum of the squares of what is odd about it,
    /// each over what blades hardly show. The less there is of an outline (`length_px`: of the midrib; `aspect`: length over width), the better it has to be.
    pub fn oddity(&self, length_px: f32, aspect: f32) -> f32 {
        self.oddity_but(self.cut, length_px, aspect)
    }

    /// Near to which end of the depth window it is odd, and only there: 0 the nearest, 1 the farthest.
    pub fn odd_at_window(&self, most: f32, length_px: f32, aspect: f32) -> Option<usize> {
        let [near, far] = self.at_window;
        let end = usize::from(far > near);
        let is_odd = self.oddity(length_px, aspect) > most;
        (is_odd && self.oddity_but(self.cut - near - far, length_px, aspect) <= most).then_some(end)
    }

    fn oddity_but(&self, cut: f32, length_px: f32, aspect: f32) -> f32 {
        let width_px = length_px / aspect.max(f32::MIN_POSITIVE);
        let odd = [
            self.waver_px / (WAVER * width_px).clamp(0.6, 1.0),
            self.turning / 0.25,
            cut / 0.4,
            self.unseen / 0.8,
            (1.0 - self.both) / 0.6,
            2.5 / aspect.max(f32::MIN_POSITIVE),
            20.0 / length_px.max(f32::MIN_POSITIVE),
        ];
        odd.iter().map(|odd| odd * odd).sum()
    }
}

/// What lies beyond an edge.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Beyond {
    /// Something farther or nearer.
    Apart,
    /// The border of the region.
    Border,
    /// What is not within the window, whose nearest depth (or farthest, 1) it is near to.
    Window(usize),
    /// The same surface, or it would be if we had not cut it there.
    Level,
    /// Nothing that can be seen.
    Unseen,
}

/// Looks at the edges of a ribbon and beyond them. `window_m`: nearest and farthest depth that count,
/// metres. O(sections).
///
/// # Source
/// Ours. A leaf is a surface with a contour in space: its edges are smooth, and what is beyond them is
/// not at its depth but for a band without readings (the shadow of a stereo camera, the mixed pixels of a
/// time-of-flight one). What a depth window or missing readings cut out of something larger has no such
/// edges.
pub fn look(mask: &Mask, ribbon: &Ribbon, window_m: [f32; 2]) -> Margins {
    const APART: usize = 4;
    /// A root so near to the border comes in from there.
    const ROOT_PX: f32 = 4.0;
    let own = |section: &Section| section.guide_px.is_none() && section.measured.middle == Middle::Blade;
    let [mut sections, mut both, mut edges, mut level, mut unseen, mut waver, mut border] = [0.0_f32; 7];
    let mut at_window = [0.0_f32; 2];
    for section in ribbon.sections.iter().filter(|section| own(section)) {
        let (expected, measured) = (&section.expected, &section.measured);
        sections += 1.0;
        both += if section.edges_seen() == 2 { 1.0 } else { 0.0 };
        for (edge, side) in [(measured.left_px, -1.0), (measured.right_px, 1.0)] {
            let Some(edge) = edge else { continue };
            edges += 1.0;
            waver += (side * edge - expected.half_px).abs();
            match beyond(mask, expected, edge, side, window_m) {
                Beyond::Apart => {}
                Beyond::Level => level += 1.0,
                Beyond::Border => border += 1.0,
                Beyond::Window(end) => at_window[end] += 1.0,
                Beyond::Unseen => unseen += 1.0,
            }
        }
    }
    let (mut turning, mut turns) = (0.0, 0.0);
    for pair in ribbon.sections.windows(APART + 1).filter(|pair| own(&pair[0])) {
        let (from, to) = (&pair[0].expected, &pair[APART].expected);
        turning += from.across.angle_to(to.across).abs() / APART as f32 * from.half_px;
        turns += 1.0;
    }
    let share = |part: f32, all: f32| part / f32::max(all, 1.0);
    let [x0, y0, x1, y1] = mask.region.map(|edge| edge as f32);
    let at_border =
        |mid: Vec2| (mid.x - x0).min(mid.y - y0).min(x1 - 1.0 - mid.x).min(y1 - 1.0 - mid.y) < ROOT_PX;
    Margins {
        both: share(both, sections),
        cut: share(level + border + at_window[0] + at_window[1], edges),
        at_window: at_window.map(|count| share(count, edges)),
        at_border: share(border, edges),
        from_border: ribbon.sections.first().is_some_and(|root| at_border(root.expected.mid)),
        unseen: share(unseen, edges),
        waver_px: share(waver, edges),
        turning: share(turning, turns),
    }
}

/// What is beyond an edge at `edge_px`, to one side (−1 left, 1 right).
fn beyond(mask: &Mask, expected: &Expected, edge_px: f32, side: f32, [near, far]: [f32; 2]) -> Beyond {
    const REACH_PX: i32 = 12;
    // An edge is smeared over so many pixels, whose depth is between that of both sides.
    const SMEAR_PX: i32 = 3;
    let depth = expected.depth_at(edge_px);
    let limit = depth_step_m(depth);
    let at_limit = if depth > far - limit { Some(1) } else { (depth < near + limit).then_some(0) };
    let [x0, y0, x1, y1] = mask.region.map(|edge| edge as f32);
    for k in 1..=REACH_PX {
        let point = expected.mid + expected.across * (edge_px + side * k as f32);
        if point.x < x0 || point.y < y0 || point.x > x1 - 1.0 || point.y > y1 - 1.0 {
            return Beyond::Border;
        }
        let Some(index) = mask.index_at(point) else { return Beyond::Border };
        let seen = mask.depth_m[index];
        if seen <= 0.0 || mask.occupancy[index] < 0.3 {
            if mask.unseen[index] {
                continue;
            }
            // A reading outside of the window.
            return at_limit.map_or(Beyond::Apart, Beyond::Window);
        }
        let alike = (seen - depth).abs() <= expected.tolerance_m;
        if k > SMEAR_PX || !alike && seen < depth {
            return if alike { Beyond::Level } else { Beyond::Apart };
        }
    }
    Beyond::Unseen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{CameraModel, DepthFrame};
    use crate::stages::accumulate::Accumulation;
    use crate::stages::mask::{self, MaskParams};
    use crate::stages::ribbon::{ANCHOR, End};
    use crate::stages::section::Fold;

    /// A strip 11 pixels wide at 0.5 m, its edges moved by `waver` pixels here and there, before `behind`
    /// (depth in millimetres at each pixel).
    fn margins(waver: i32, behind: impl Fn(i32, i32) -> u16) -> Margins {
        let (width, height) = (80, 100);
        let half = |y: i32| 5 + if y / 3 % 2 == 0 { waver } else { 0 };
        let depth = |x: i32, y: i32| if (x - 40).abs() <= half(y) { 500 } else { behind(x, y) };
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let frame = DepthFrame {
            width: width as usize,
            height: height as usize,
            depth: pixels.map(|(x, y)| depth(x, y)).collect(),
            depth_unit_m: 0.001,
            timestamp_ns: 0,
            camera: CameraModel { fx: 570.0, fy: 570.0, cx: 40.0, cy: 50.0 },
        };
        let params = MaskParams::default();
        let mut accumulation = Accumulation::like(&frame);
        accumulation.add(&frame, &params);
        let mask = mask::extract(&accumulation, &params);
        let section = |y: i32| {
            let expected = Expected {
                mid: Vec2::new(40.0, y as f32),
                across: Vec2::X,
                half_px: 5.5,
                depth_m: 0.5,
                slope_m: 0.0,
                fold: Fold::default(),
                tolerance_m: 0.004,
                search_px: 4.0,
            };
            Section { expected, measured: expected.measure(&mask), anchor: ANCHOR, guide_px: None }
        };
        let sections = (10..90).rev().map(section).collect();
        let ribbon = Ribbon { sections, root: End::Free, tip: End::Free, unsure: 0 };
        look(&mask, &ribbon, [params.near_m as f32, params.far_m as f32])
    }

    #[test]
    fn a_blade_before_a_wall_is_not_odd() {
        let free = margins(0, |_, _| 1500);
        assert_eq!((free.both, free.cut, free.unseen, free.turning), (1.0, 0.0, 0.0, 0.0));
        assert!(free.waver_px < 0.6 && free.oddity(80.0, 8.0) < 1.0, "{free:?}");
    }

    #[test]
    fn a_band_without_readings_beside_it_is_a_shadow() {
        let shadowed = margins(0, |x, _| if (31..50).contains(&x) { 0 } else { 1500 });
        assert_eq!((shadowed.cut, shadowed.unseen), (0.0, 0.0), "{shadowed:?}");
    }

    #[test]
    fn a_surface_that_goes_on_beyond_a_gap_has_no_edge_there() {
        let holed = margins(0, |x, _| if (29..52).contains(&x) { 0 } else { 500 });
        assert!(holed.cut > 0.9 && holed.oddity(80.0, 8.0) > 3.0, "{holed:?}");
    }

    #[test]
    fn ragged_edges_are_odd() {
        let (even, ragged) = (margins(0, |_, _| 0), margins(3, |_, _| 0));
        assert_eq!(even.unseen, 1.0, "nothing is seen beside it");
        assert!(ragged.waver_px > even.waver_px + 0.8, "{ragged:?}");
        assert!(even.oddity(80.0, 8.0) < 2.0, "a dark room makes no blade odd: {even:?}");
        assert!(ragged.oddity(80.0, 8.0) > even.oddity(80.0, 8.0) + 2.0, "{ragged:?}");
    }

    #[test]
    fn a_broad_leaf_may_wave_more() {
        let wavy = Margins { waver_px: 0.85, ..margins(0, |_, _| 1500) };
        let odd = |width_px: f32| wavy.oddity(100.0, 100.0 / width_px);
        assert!(odd(8.0) - odd(17.0) > 0.8, "{} and {}", odd(8.0), odd(17.0));
    }
}

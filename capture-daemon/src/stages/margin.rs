//! Ribbon → how its outline looks, and what lies beyond it: what tells a blade from a ragged stretch of
//! something larger.

use glam::Vec2;

use super::confidence::Evidence;
use super::mask::{Mask, depth_step_m};
use super::ribbon::{End, Ribbon, Section};
use super::section::{Expected, Middle};

/// How a blade's outline looks where the blade itself is seen: neither hidden nor led.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Share of its cross-sections that show both edges, or one of them and what hides the other, 0..=1.
    pub both: f32,
    /// Share of the edges that are none in space, 0..=1: there its surface leaves the depth window or the
    /// region, or goes on beyond a gap without readings.
    pub cut: f32,
    /// Share of the edges that lie so near to the nearest or farthest depth that counts, 0..=1, that its
    /// surface may go on there, unless what is read beyond is far off; they are among those that are cut.
    pub at_window: [f32; 2],
    /// Share of the edges at the border of the region, 0..=1.
    pub at_border: f32,
    /// Whether its root lies at the border of the region.
    pub from_border: bool,
    /// Share of the edges beyond which nothing can be seen, 0..=1.
    pub unseen: f32,
    /// Whether nothing can be seen beyond its tip.
    pub tip_unseen: bool,
    /// How far an edge is from where the smooth blade has it, pixels, mean.
    pub waver_px: f32,
    /// How much its midrib turns while it advances by half of its width, radians, mean: at 1 its
    /// cross-sections meet.
    pub turning: f32,
    /// The largest angle that its midrib has turned by in the image between two of its points, radians: more
    /// than π where it curls back.
    pub turned: f32,
}

/// Share of its edges near an end of the depth window from which on all of it lies there.
const AT_END: f32 = 0.9;
/// How much the edges of a broad leaf wave, of its width.
const WAVER: f32 = 0.05;

impl Margins {
    /// How little it is that of a blade, from 0: the sum of the squares of what is odd about it, each over what
    /// blades hardly show. The less there is of it, the better it has to be.
    pub fn oddity(&self, evidence: &Evidence) -> f32 {
        self.oddity_but(self.cut, evidence)
    }

    /// Near to which end of the depth window it is odd, and only there: 0 the nearest, 1 the farthest.
    pub fn odd_at_window(&self, most: f32, evidence: &Evidence) -> Option<usize> {
        let [near, far] = self.at_window;
        let end = usize::from(far > near);
        let is_odd = self.oddity(evidence) > most;
        (is_odd && self.oddity_but(self.cut - near - far, evidence) <= most).then_some(end)
    }

    fn oddity_but(&self, cut: f32, evidence: &Evidence) -> f32 {
        let Evidence { length_px, pixels_across, tip, tip_blunt, hidden, steepness, .. } = *evidence;
        let aspect = evidence.length_m / evidence.max_width_m.max(f32::MIN_POSITIVE);
        // What the border cuts off has no tip.
        let shows_its_tip = tip_blunt * pixels_across >= SHOWN_PX && tip != End::Shared;
        // What narrows to a point ends there, whatever is beyond.
        let is_lost = tip == End::Lost && self.tip_unseen && tip_blunt > 0.2;
        let width_px = length_px / aspect.max(f32::MIN_POSITIVE);
        let odd = [
            self.waver_px / (WAVER * width_px).clamp(0.6, 1.0),
            self.turning / 0.25,
            self.turned / 4.5,
            cut / 0.4,
            self.unseen / 0.8,
            (1.0 - self.both) / 0.6,
            hidden / 0.6,
            steepness / 1.5,
            if shows_its_tip { tip_blunt / 0.8 } else { 0.0 },
            if is_lost { 0.4 } else { 0.0 },
            2.5 / aspect.max(f32::MIN_POSITIVE),
            20.0 / length_px.max(f32::MIN_POSITIVE),
        ];
        odd.iter().map(|odd| odd * odd).sum()
    }
}

/// Of what is narrower it cannot be told whether it ends in a point, pixels across.
pub(super) const SHOWN_PX: f32 = 6.0;

/// What lies beyond an edge.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Beyond {
    /// Something farther or nearer.
    Apart,
    /// The border of the region.
    Border,
    /// What is not within the window, whose nearest depth (or farthest, 1) it is near to.
    Window(usize),
    /// The same, but what is read there is far off.
    Behind(usize),
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
    let [mut at_window, mut behind] = [[0.0_f32; 2]; 2];
    for section in ribbon.sections.iter().filter(|section| own(section)) {
        let (expected, measured) = (&section.expected, &section.measured);
        sections += 1.0;
        let told = match (measured.left_px, measured.right_px) {
            (Some(_), Some(_)) => true,
            (Some(_), None) => is_beyond(mask, expected, 1.0) || is_hidden(mask, expected, 1.0),
            (None, Some(_)) => is_beyond(mask, expected, -1.0) || is_hidden(mask, expected, -1.0),
            (None, None) => is_beyond(mask, expected, 1.0) && is_beyond(mask, expected, -1.0),
        };
        both += if told { 1.0 } else { 0.0 };
        for (edge, side) in [(measured.left_px, -1.0), (measured.right_px, 1.0)] {
            let Some(edge) = edge else {
                if is_beyond(mask, expected, side) {
                    (edges, border) = (edges + 1.0, border + 1.0);
                }
                continue;
            };
            edges += 1.0;
            waver += (side * edge - expected.half_px).abs();
            let from = expected.mid + expected.across * edge;
            let surface = Surface { depth_m: expected.depth_at(edge), tolerance_m: expected.tolerance_m };
            match beyond(mask, from, expected.across * side, surface, window_m) {
                Beyond::Apart => {}
                Beyond::Level => level += 1.0,
                Beyond::Border => border += 1.0,
                Beyond::Window(end) => at_window[end] += 1.0,
                Beyond::Behind(end) => behind[end] += 1.0,
                Beyond::Unseen => unseen += 1.0,
            }
        }
    }
    // What lies there as a whole is held too near or too far off, whatever is beyond.
    for (at_window, behind) in at_window.iter_mut().zip(behind) {
        if *at_window + behind > AT_END * edges {
            *at_window += behind;
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
    let beyond_tip = beyond_tip(mask, ribbon, window_m);
    Margins {
        tip_unseen: beyond_tip == [Beyond::Unseen; 3],
        both: share(both, sections),
        cut: share(level + border + at_window[0] + at_window[1], edges),
        at_window: at_window.map(|count| share(count, edges)),
        at_border: share(border, edges),
        from_border: ribbon.sections.first().is_some_and(|root| at_border(root.expected.mid)),
        unseen: share(unseen, edges),
        waver_px: share(waver, edges),
        turning: share(turning, turns),
        turned: turned(&ribbon.sections),
    }
}

/// Whether the border of the region cuts off one of the edges of a cross-section.
pub(super) fn is_cut_off(mask: &Mask, expected: &Expected) -> bool {
    is_beyond(mask, expected, -1.0) || is_beyond(mask, expected, 1.0)
}

/// Whether the edge of a cross-section to one side (−1 left, 1 right) lies beyond the border of the region.
fn is_beyond(mask: &Mask, expected: &Expected, side: f32) -> bool {
    // As near as an edge is taken for the border's own.
    const NEAR_PX: f32 = 1.5;
    let edge = expected.mid + expected.across * side * (expected.half_px + NEAR_PX);
    let [x0, y0, x1, y1] = mask.region.map(|edge| edge as f32 - 0.5);
    edge.x < x0 || edge.y < y0 || edge.x >= x1 || edge.y >= y1
}

/// Whether something nearer hides the edge of a cross-section to one side (−1 left, 1 right).
fn is_hidden(mask: &Mask, expected: &Expected, side: f32) -> bool {
    const REACH_PX: i32 = 5;
    let seen = |t: f32| {
        let index = mask.index_at(expected.mid + expected.across * side * t)?;
        (mask.depth_m[index] > 0.0).then(|| mask.depth_m[index] - expected.depth_at(side * t))
    };
    let reach = expected.half_px as i32 + REACH_PX;
    let mut off_m = (0..=reach).filter_map(|t| seen(t as f32));
    off_m.find(|off_m| off_m.abs() > expected.tolerance_m).is_some_and(|off_m| off_m < 0.0)
}

/// The largest angle between two of its directions, followed along it; radians.
fn turned(sections: &[Section]) -> f32 {
    const PLACES: usize = 32;
    let last = sections.len().saturating_sub(1);
    let places: Vec<Vec2> =
        (0..=PLACES.min(last)).map(|k| sections[k * last / PLACES.min(last).max(1)].expected.mid).collect();
    let (mut heading, mut least, mut most) = (0.0_f32, 0.0_f32, 0.0_f32);
    for place in places.windows(3) {
        heading += (place[1] - place[0]).angle_to(place[2] - place[1]);
        (least, most) = (least.min(heading), most.max(heading));
    }
    most - least
}

/// What is beyond the tip of a ribbon, in its middle and to both sides of it.
fn beyond_tip(mask: &Mask, ribbon: &Ribbon, window_m: [f32; 2]) -> [Beyond; 3] {
    const BACK: usize = 12;
    let sections = &ribbon.sections;
    let tip = &sections[sections.len() - 1].expected;
    let before = &sections[sections.len().saturating_sub(BACK + 1)].expected;
    let way = (tip.mid - before.mid).normalize_or(tip.along());
    [-0.5, 0.0, 0.5].map(|share| {
        let aside = share * tip.half_px;
        let surface = Surface { depth_m: tip.depth_at(aside), tolerance_m: tip.tolerance_m };
        beyond(mask, tip.mid + tip.across * aside, way, surface, window_m)
    })
}

/// The depth of a surface at its edge, metres, and how far a reading of it may lie from that.
#[derive(Clone, Copy)]
struct Surface {
    depth_m: f32,
    tolerance_m: f32,
}

/// What is beyond an edge of a surface at a place in the image, on a way outward, a unit vector.
fn beyond(mask: &Mask, from: Vec2, way: Vec2, surface: Surface, [near, far]: [f32; 2]) -> Beyond {
    const REACH_PX: i32 = 12;
    // An edge is smeared over so many pixels, whose depth is between that of both sides.
    const SMEAR_PX: i32 = 3;
    let Surface { depth_m, tolerance_m } = surface;
    let limit = depth_step_m(depth_m);
    let at_limit = if depth_m > far - limit { Some(1) } else { (depth_m < near + limit).then_some(0) };
    let [x0, y0, x1, y1] = mask.region.map(|edge| edge as f32);
    for k in 1..=REACH_PX {
        let point = from + way * k as f32;
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
            let outside_m = mask.outside_m.get(index).copied().filter(|outside_m| *outside_m > 0.0);
            let is_far_off = outside_m.is_some_and(|outside_m| (outside_m - depth_m).abs() > 2.0 * limit);
            let beyond = if is_far_off { Beyond::Behind } else { Beyond::Window };
            return at_limit.map_or(Beyond::Apart, beyond);
        }
        let alike = (seen - depth_m).abs() <= tolerance_m;
        if k > SMEAR_PX || !alike && seen < depth_m {
            return if alike { Beyond::Level } else { Beyond::Apart };
        }
    }
    Beyond::Unseen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::drawn::{mask_of, section_along_row};
    use crate::stages::mask::MaskParams;
    use crate::stages::ribbon::ANCHOR;
    use crate::stages::section::{Fold, Measured};

    /// A strip 11 pixels wide at 0.5 m, its edges moved by `waver` pixels here and there, before `behind`
    /// (depth in millimetres at each pixel).
    fn margins(waver: i32, behind: impl Fn(i32, i32) -> u16) -> Margins {
        let half = |y: i32| 5 + if y / 3 % 2 == 0 { waver } else { 0 };
        let depth_m =
            |x: i32, y: i32| if (x - 40).abs() <= half(y) { 0.5 } else { 1e-3 * f32::from(behind(x, y)) };
        let mask = mask_of((80, 100), depth_m);
        let section = |y: i32| section_along_row(&mask, Vec2::new(40.0, y as f32), 5.5);
        let params = MaskParams::default();
        let sections = (10..90).rev().map(section).collect();
        let ribbon = Ribbon { sections, root: End::Free, tip: End::Free, unsure: 0 };
        look(&mask, &ribbon, [params.near_m as f32, params.far_m as f32])
    }

    /// Its oddity, were it 80 pixels long and 10 wide.
    fn oddity(margins: &Margins) -> f32 {
        margins.oddity(&Evidence { length_px: 80.0, length_m: 0.08, max_width_m: 0.01, ..Evidence::good() })
    }

    #[test]
    fn a_blade_before_a_wall_is_not_odd() {
        let free = margins(0, |_, _| 1500);
        assert_eq!((free.both, free.cut, free.unseen, free.turning), (1.0, 0.0, 0.0, 0.0));
        assert!(free.waver_px < 0.6 && oddity(&free) < 1.0, "{free:?}");
    }

    #[test]
    fn a_band_without_readings_beside_it_is_a_shadow() {
        let shadowed = margins(0, |x, _| if (31..50).contains(&x) { 0 } else { 1500 });
        assert_eq!((shadowed.cut, shadowed.unseen), (0.0, 0.0), "{shadowed:?}");
    }

    #[test]
    fn a_surface_that_goes_on_beyond_a_gap_has_no_edge_there() {
        let holed = margins(0, |x, _| if (29..52).contains(&x) { 0 } else { 500 });
        assert!(holed.cut > 0.9 && oddity(&holed) > 3.0, "{holed:?}");
    }

    #[test]
    fn an_edge_behind_something_nearer_is_not_odd_and_one_that_runs_into_its_like_is() {
        let beside = |depth: u16| margins(0, move |x, _| if x > 45 { depth } else { 1500 });
        let (hidden, merged) = (beside(450), beside(500));
        assert_eq!((hidden.both, merged.both), (1.0, 0.0), "{hidden:?} {merged:?}");
        assert!(oddity(&hidden) < 1.0 && oddity(&merged) > 2.4, "{hidden:?} {merged:?}");
    }

    #[test]
    fn at_the_end_of_the_window_a_leaf_before_a_wall_has_edges_and_a_surface_that_goes_on_has_none() {
        let edges = |near_px: i32, behind_m: f32| {
            let depth_at = |y: i32| if y < near_px { 0.8 } else { 0.895 };
            let depth_m = |x: i32, y: i32| if (x - 40).abs() <= 5 { depth_at(y) } else { behind_m };
            let mask = mask_of((80, 100), depth_m);
            let section = |y: i32| {
                let like = section_along_row(&mask, Vec2::new(40.0, y as f32), 5.5);
                let expected = Expected { depth_m: depth_at(y), ..like.expected };
                Section { expected, measured: expected.measure(&mask), ..like }
            };
            let sections = (10..90).rev().map(section).collect();
            let ribbon = Ribbon { sections, root: End::Free, tip: End::Free, unsure: 0 };
            let params = MaskParams::default();
            look(&mask, &ribbon, [params.near_m as f32, params.far_m as f32]).at_window
        };
        assert_eq!(edges(50, 0.91), [0.0, 0.5]);
        assert_eq!(edges(50, 1.5), [0.0, 0.0]);
        assert_eq!(edges(0, 1.5), [0.0, 1.0], "all of it is too far off");
    }

    #[test]
    fn ragged_edges_are_odd() {
        let (even, ragged) = (margins(0, |_, _| 0), margins(3, |_, _| 0));
        assert_eq!(even.unseen, 1.0, "nothing is seen beside it");
        assert!(ragged.waver_px > even.waver_px + 0.8, "{ragged:?}");
        assert!(oddity(&even) < 2.0, "a dark room makes no blade odd: {even:?}");
        assert!(oddity(&ragged) > oddity(&even) + 2.0, "{ragged:?}");
    }

    #[test]
    fn what_ends_as_broad_as_it_is_where_nothing_is_seen_is_odd() {
        let margins = margins(0, |_, _| 1500);
        let piece = Evidence { tip: End::Lost, tip_blunt: 1.0, ..Evidence::good() };
        let [clear, lost] = [false, true].map(|tip_unseen| Margins { tip_unseen, ..margins }.oddity(&piece));
        let pointed = margins.oddity(&Evidence::good());
        assert!(clear > pointed + 1.0 && lost > clear + 0.1, "{pointed} {clear} {lost}");
        // Who holds up a cut leaf may.
        assert!(clear < 2.4, "{clear}");
        let thin = Evidence { pixels_across: 4.0, ..piece };
        assert!(margins.oddity(&thin) < pointed + 0.1, "of a thin blade that cannot be told");
    }

    #[test]
    fn a_midrib_that_curls_back_has_turned_by_more_than_half_a_circle() {
        let section = |angle: f32| {
            let expected = Expected {
                mid: 20.0 * Vec2::from_angle(angle),
                across: Vec2::from_angle(angle),
                half_px: 3.0,
                depth_m: 0.5,
                slope_m: 0.0,
                fold: Fold::default(),
                tolerance_m: 0.004,
                search_px: 4.0,
            };
            let measured = Measured::nothing(Middle::Unseen);
            Section { expected, measured, anchor: ANCHOR, guide_px: None }
        };
        let arc =
            |angle: f32| -> Vec<Section> { (0..=90).map(|k| section(angle * k as f32 / 90.0)).collect() };
        for angle in [0.5, 2.0, 4.5] {
            assert!((turned(&arc(angle)) - angle).abs() < 0.1 * angle, "{} for {angle}", turned(&arc(angle)));
        }
        assert_eq!(turned(&arc(1.0)[..1]), 0.0);
    }

    #[test]
    fn a_broad_leaf_may_wave_more() {
        let wavy = Margins { waver_px: 0.85, ..margins(0, |_, _| 1500) };
        let odd = |width_px: f32| {
            let wide = Evidence {
                length_px: 100.0,
                length_m: 0.1,
                max_width_m: 0.001 * width_px,
                ..Evidence::good()
            };
            wavy.oddity(&wide)
        };
        assert!(odd(8.0) - odd(17.0) > 0.8, "{} and {}", odd(8.0), odd(17.0));
    }
}

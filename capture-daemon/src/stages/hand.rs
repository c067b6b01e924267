//! The hand and forearm that hold the blades: told from them by their thickness and by their way to
//! the border of the picture.

use super::components::{self, Component};
use super::mask::{self, Mask};

/// What is a hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandParams {
    /// Half of the width, metres, that a hand and its forearm have at least and a leaf has not.
    pub min_radius_m: f32,
    /// How far fingers stand out from what is that thick, metres.
    pub finger_m: f32,
    /// How large what is that far from all its edges is at least, square metres.
    pub min_core_m2: f32,
    /// Smaller pieces can be knuckles, square metres.
    pub min_piece_m2: f32,
    /// Most of a knuckle lies no farther from the rest of the hand, metres.
    pub knuckle_m: f32,
    /// How far its sides stand back from its middle at least, metres.
    pub min_relief_m: f32,
    /// What reaches farther out than this from what is thick is a blade, metres.
    pub blade_m: f32,
    /// Width, metres, that a forearm has at least where it leaves the picture.
    pub min_border_m: f32,
}

impl Default for HandParams {
    fn default() -> Self {
        Self {
            min_radius_m: 0.021,
            finger_m: 0.010,
            min_core_m2: 6.0e-4,
            min_piece_m2: 3.0e-4,
            knuckle_m: 0.006,
            min_relief_m: 0.002,
            blade_m: 0.035,
            min_border_m: 0.035,
        }
    }
}

/// Finds the pixels of hands. None where there is no hand. O(pixels).
///
/// What is connected without a large step in depth is a body. Its thick parts, where these reach the
/// border of the region and are large and round there, and what stands out from them by no more than a finger, are hand. Pieces tell
/// what belongs together: a piece that lies mostly there is hand as a whole, knuckles and all, unless
/// something long grows out of it; one that lies mostly elsewhere is a blade that the hand grips, but for a
/// round fist that many blades are of one piece with.
pub(super) fn find(mask: &Mask, focal_px: f32, params: &HandParams) -> Vec<bool> {
    let view = View { mask, focal_px };
    if view.border_m() < params.min_border_m {
        return Vec::new();
    }
    let bodies = view.bodies();
    let Thick { thick, core, depth_in } = view.thick(&bodies, params);
    if !thick.contains(&true) {
        return Vec::new();
    }
    let mut hand = vec![false; mask.depth_m.len()];
    let from_thick = chamfer(mask, |index| thick[index]);
    let beside = |index: usize, metres: f32| from_thick[index] as f32 <= 12.0 * metres * view.px_per_m(index);
    let (pieces, count) = view.parted_pieces();
    // Of each piece: its pixels, their area, those near to what is thick, and whether one is far off.
    let mut seen = vec![Seen::default(); count + 1];
    for index in view.pixels() {
        let piece = &mut seen[pieces[index] as usize];
        piece.pixels += 1;
        piece.area_m2 += view.px_per_m(index).powi(-2);
        piece.near += u32::from(beside(index, params.finger_m));
        piece.long |= !beside(index, params.blade_m);
        if core[index] && thick[index] {
            piece.cores.push(index);
        }
    }
    let verdict = |piece: &Seen| {
        let mostly = piece.near as f32 > MOSTLY * piece.pixels as f32;
        let core_m2: f32 = piece.cores.iter().map(|index| view.px_per_m(*index).powi(-2)).sum();
        // A fist that many blades are of one piece with is round all the same.
        let fist = || {
            core_m2 >= params.min_core_m2
                && view.relief_m(&piece.cores, &depth_in, &bodies) >= params.min_relief_m
        };
        match (mostly, piece.long) {
            (true, false) => Verdict::Hand,
            (true, true) => Verdict::Both,
            (false, _) if fist() => Verdict::Both,
            (false, _) => Verdict::Blade,
        }
    };
    let mut decided: Vec<Verdict> = seen.iter().map(verdict).collect();
    decided[0] = Verdict::Blade;
    // A small piece beside a hand can be a knuckle, or the base of a blade between two others.
    let small = |label: u32| seen[label as usize].area_m2 < params.min_piece_m2;
    let of_hand = |index: usize| {
        let label = pieces[index];
        label != 0 && !small(label) && decided[label as usize] != Verdict::Blade
    };
    let from_hand = chamfer(mask, of_hand);
    let mut close = vec![0_u32; count + 1];
    for index in view.pixels() {
        let reach = 12.0 * params.knuckle_m * view.px_per_m(index);
        close[pieces[index] as usize] += u32::from(from_hand[index] as f32 <= reach);
    }
    for label in (1..=count).filter(|label| small(*label as u32)) {
        if 2 * close[label] < seen[label].pixels {
            decided[label] = Verdict::Blade;
        }
    }
    let mut both = vec![false; hand.len()];
    if decided.contains(&Verdict::Both) {
        for index in view.pixels() {
            both[index] = decided[pieces[index] as usize] == Verdict::Both;
        }
        // Held against the palm, a blade is of one piece with the hand: only thickness tells them apart.
        let is_blade = |index: usize| pieces[index] != 0 && decided[pieces[index] as usize] == Verdict::Blade;
        let depth_in = chamfer(mask, |index| view.inside(index) && (bodies[index] == 0 || is_blade(index)));
        let core = |index: usize| {
            both[index] && depth_in[index] as f32 >= 12.0 * params.min_radius_m * view.px_per_m(index)
        };
        let from_core = chamfer(mask, core);
        let reach = params.min_radius_m + 0.5 * params.finger_m;
        for index in view.pixels() {
            hand[index] = both[index] && from_core[index] as f32 <= 12.0 * reach * view.px_per_m(index);
        }
    }
    let is_blade = |index: usize| pieces[index] != 0 && decided[pieces[index] as usize] == Verdict::Blade;
    for index in view.pixels() {
        hand[index] |= match decided[pieces[index] as usize] {
            _ if pieces[index] == 0 => {
                // Crumbs between the pieces.
                bodies[index] != 0 && beside(index, params.finger_m) && !view.around(index).any(is_blade)
            }
            verdict => verdict == Verdict::Hand,
        };
    }
    drop_crumbs(mask, &mut hand);
    hand
}

/// Leaves the large parts of a hand: what is left over between blades is none.
fn drop_crumbs(mask: &Mask, hand: &mut [bool]) {
    const SHARE: f32 = 0.05;
    let parts = components::find(mask, |index| hand[index], |_, _| true);
    let largest = parts.iter().map(Component::area_px).max().unwrap_or(0);
    for part in parts.iter().filter(|part| (part.area_px() as f32) < SHARE * largest as f32) {
        part.runs().for_each(|run| hand[run].fill(false));
    }
}

/// A piece, as far as it tells what it is.
#[derive(Clone, Default)]
struct Seen {
    pixels: u32,
    area_m2: f32,
    /// Pixels in and beside what is thick.
    near: u32,
    /// Whether one is far from all that is thick.
    long: bool,
    /// Pixels far from all edges of the body.
    cores: Vec<usize>,
}

/// What is thick.
struct Thick {
    /// What is thick and goes on thick to the border of the region.
    thick: Vec<bool>,
    /// What is far from the edges of its body.
    core: Vec<bool>,
    /// How far each pixel is from the edges of its body, twelfths of a pixel.
    depth_in: Vec<u32>,
}

/// What a piece is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Hand,
    Blade,
    /// A hand, and a blade that cannot be told from it by depth.
    Both,
}

/// Neighbours of one body differ by less in depth, metres: a fist stands out so far from its wrist.
const BODY_STEP_M: f32 = 0.06;
/// A piece of which more than this share lies in and beside what is thick is of the hand.
const MOSTLY: f32 = 0.7;
/// Half the width of a neck between two pieces, twelfths of a pixel.
const NECK: u32 = 30;

struct View<'a> {
    mask: &'a Mask,
    focal_px: f32,
}

impl View<'_> {
    fn px_per_m(&self, index: usize) -> f32 {
        self.focal_px / self.mask.depth_m[index].max(0.1)
    }

    fn inside(&self, index: usize) -> bool {
        let [x0, y0, x1, y1] = self.mask.region;
        let (x, y) = (index % self.mask.width, index / self.mask.width);
        (x0..x1).contains(&x) && (y0..y1).contains(&y)
    }

    fn pixels(&self) -> impl Iterator<Item = usize> + use<> {
        self.mask.pixels_seen()
    }

    fn around(&self, index: usize) -> impl Iterator<Item = usize> + '_ {
        mask::neighbours(index, self.mask.width, self.mask.region)
    }

    /// The mask's pieces, parted where they hang together by a few pixels only: the label of each pixel,
    /// 0 for none, and how many there are.
    fn parted_pieces(&self) -> (Vec<u32>, usize) {
        let (mask, pieces) = (self.mask, &self.mask.pieces.of);
        let edge = |index: usize| {
            pieces[index] == 0 || self.around(index).any(|other| pieces[other] != pieces[index])
        };
        let depth_in = chamfer(mask, |index| self.inside(index) && edge(index));
        let inner = |index: usize| pieces[index] != 0 && depth_in[index] >= NECK;
        let found = components::find(mask, inner, |a, b| pieces[a] == pieces[b]);
        let mut parts = vec![0; pieces.len()];
        let mut front: Vec<usize> = Vec::new();
        for (component, label) in found.iter().zip(1..) {
            component.runs().for_each(|run| parts[run].fill(label));
            front.extend(component.pixels());
        }
        // Back out to the edges, each from all sides alike.
        let mut next = 0;
        while next < front.len() {
            let index = front[next];
            next += 1;
            for other in self.around(index) {
                if parts[other] == 0 && pieces[other] == pieces[index] {
                    parts[other] = parts[index];
                    front.push(other);
                }
            }
        }
        (parts, found.len())
    }

    /// Which body each pixel is of, from 1; 0 for none.
    fn bodies(&self) -> Vec<u16> {
        let mask = self.mask;
        let near = |a: usize, b: usize| (mask.depth_m[a] - mask.depth_m[b]).abs() <= BODY_STEP_M;
        let found = components::find(mask, |index| mask.occupancy[index] >= mask::BODY_OCCUPANCY, near);
        let mut bodies = vec![0; mask.depth_m.len()];
        for (component, label) in found.iter().zip(1..=u16::MAX) {
            component.runs().for_each(|run| bodies[run].fill(label));
        }
        bodies
    }

    /// Width, metres, of all that is seen at the border of the region.
    fn border_m(&self) -> f32 {
        let (mask, [x0, y0, x1, y1]) = (self.mask, self.mask.region);
        let [left, top, right, bottom] = mask.seen;
        let row = |y: usize| (left..right).map(move |x| y * mask.width + x);
        let column = |x: usize| (top..bottom).map(move |y| y * mask.width + x);
        let rows = [(y0, top == y0), (y1.saturating_sub(1), bottom == y1)];
        let columns = [(x0, left == x0), (x1.saturating_sub(1), right == x1)];
        let border = rows
            .into_iter()
            .filter(|(_, seen)| *seen)
            .flat_map(|(y, _)| row(y))
            .chain(columns.into_iter().filter(|(_, seen)| *seen).flat_map(|(x, _)| column(x)));
        let bodies = border.filter(|index| mask.occupancy[*index] >= mask::BODY_OCCUPANCY);
        bodies.map(|index| 1.0 / self.px_per_m(index)).sum()
    }

    /// What is thick, and goes on thick to the border of the region.
    fn thick(&self, bodies: &[u16], params: &HandParams) -> Thick {
        let mask = self.mask;
        // A body goes on beyond the border as far as we know.
        let outside = |index: usize| {
            let body = bodies[index];
            self.inside(index)
                && (body == 0 || self.around(index).any(|other| bodies[other] != 0 && bodies[other] != body))
        };
        let depth_in = chamfer(mask, outside);
        let (mut core, mut thick) = (vec![false; bodies.len()], vec![false; bodies.len()]);
        let mut any = false;
        for index in self.pixels().filter(|index| bodies[*index] != 0) {
            core[index] = depth_in[index] as f32 >= 12.0 * params.min_radius_m * self.px_per_m(index);
            any |= core[index];
        }
        if !any {
            return Thick { thick, core, depth_in };
        }
        let from_core = chamfer(mask, |index| core[index]);
        let admits = |index: usize| {
            bodies[index] != 0 && from_core[index] as f32 <= 12.0 * params.min_radius_m * self.px_per_m(index)
        };
        // Each connected part has to reach the border by itself.
        let [x0, y0, x1, y1] = mask.region;
        for part in components::find(mask, admits, |a, b| bodies[a] == bodies[b]) {
            let on_border = |index: &usize| {
                let (x, y) = (index % mask.width, index / mask.width);
                x == x0 || y == y0 || x + 1 == x1 || y + 1 == y1
            };
            let border_m: f32 = part.pixels().filter(on_border).map(|index| 1.0 / self.px_per_m(index)).sum();
            let round = border_m >= params.min_border_m && {
                let cores: Vec<usize> = part.pixels().filter(|index| core[*index]).collect();
                let core_m2: f32 = cores.iter().map(|index| self.px_per_m(*index).powi(-2)).sum();
                core_m2 >= params.min_core_m2
                    && self.relief_m(&cores, &depth_in, bodies) >= params.min_relief_m
            };
            if round {
                part.runs().for_each(|run| thick[run].fill(true));
            }
        }
        Thick { thick, core, depth_in }
    }

    /// How far what lies around the middle of something stands back from it, metres: of a forearm a fifth
    /// of its radius, of a leaf, however broad, next to nothing. Median over some of its `cores`.
    fn relief_m(&self, cores: &[usize], depth_in: &[u32], bodies: &[u16]) -> f32 {
        const SAMPLES: usize = 400;
        /// Of the way to its edge.
        const SHARE: f32 = 0.85;
        let mask = self.mask;
        let relief = |index: usize| {
            let reach = SHARE * depth_in[index] as f32 / 12.0;
            let around =
                [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)].map(|(x, y)| {
                    let direction = glam::Vec2::new(x as f32, y as f32).normalize();
                    let other = mask.index_at(mask.pixel(index) + direction * reach);
                    let same = other.filter(|other| self.inside(*other) && bodies[*other] == bodies[index]);
                    // Beyond the border it goes on as it is.
                    same.map_or(mask.depth_m[index], |other| mask.depth_m[other])
                });
            around.iter().sum::<f32>() / 8.0 - mask.depth_m[index]
        };
        let step = cores.len().div_ceil(SAMPLES).max(1);
        let mut reliefs: Vec<f32> = cores.iter().step_by(step).map(|index| relief(*index)).collect();
        reliefs.sort_by(f32::total_cmp);
        reliefs.get(reliefs.len() / 2).copied().unwrap_or(0.0)
    }
}

/// Distance of each pixel to the nearest one that is a `seed`, twelfths of a pixel (12 straight, 17
/// diagonal), in two passes; only in and around what is seen.
pub(super) fn chamfer(mask: &Mask, seed: impl Fn(usize) -> bool) -> Vec<u32> {
    const FAR: u32 = u32::MAX / 2;
    let ([x0, y0, x1, y1], width) = (mask.seen, mask.width);
    // A pixel more all around, for what is beside the outermost ones.
    let (x0, y0) = (x0.saturating_sub(1), y0.saturating_sub(1));
    let (x1, y1) = ((x1 + 1).min(width), (y1 + 1).min(mask.height));
    let mut distance = vec![0; width * mask.height];
    let near = |distance: &[u32], index: usize, [aside, before]: [isize; 2], [first, last]: [bool; 2]| {
        // `before`: the row that is done; `aside`: the pixel of this row that is.
        let at = |offset: isize| distance[index.wrapping_add_signed(offset)];
        let mut best = FAR;
        if !first {
            best = best.min(at(aside) + 12).min(if before == 0 { FAR } else { at(before + aside) + 17 });
        }
        if before != 0 {
            best = best.min(at(before) + 12);
            if !last {
                best = best.min(at(before - aside) + 17);
            }
        }
        best
    };
    let down = width as isize;
    for y in y0..y1 {
        for x in x0..x1 {
            let index = y * width + x;
            let before = if y > y0 { -down } else { 0 };
            let best = near(&distance, index, [-1, before], [x == x0, x + 1 == x1]);
            distance[index] = if seed(index) { 0 } else { best };
        }
    }
    for y in (y0..y1).rev() {
        for x in (x0..x1).rev() {
            let index = y * width + x;
            let before = if y + 1 < y1 { down } else { 0 };
            let best = near(&distance, index, [1, before], [x + 1 == x1, x == x0]);
            distance[index] = distance[index].min(best);
        }
    }
    distance
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::stages::accumulate::Accumulation;
    use crate::stages::drawn::mask_of;
    use crate::stages::mask::{MaskParams, extract};
    use crate::synth::{Clip, ClipParams, Family, Scene};

    /// The mask of a few frames, and where the midribs of what is seen of the blades run in it.
    fn seen(family: Family, seed: u64) -> (Mask, Vec<Vec<usize>>) {
        let scene = Scene::new(family, seed);
        let clip = ClipParams { frames: scene.frames(), ..ClipParams::default() };
        let clip = Clip::new(scene, clip).expect("valid");
        let start = clip.visits().first().map_or(0, |visit| visit.held.start);
        let first = clip.frame(start);
        let (params, mut frames) = (MaskParams::default(), Accumulation::like(&first));
        (start..start + 8).for_each(|index| frames.add(&clip.frame(index), &params));
        let mask = extract(&frames, &params);
        let pixel = |center: glam::DVec3| {
            let (u, v) = first.camera.project(center.as_vec3());
            v.round() as usize * first.width + u.round() as usize
        };
        let midrib = |blade: &crate::synth::SyntheticBlade| {
            blade.sections.iter().map(|section| pixel(section.center)).collect()
        };
        let midribs = clip.scene().blades.iter().map(midrib).collect();
        (mask, midribs)
    }

    #[test]
    fn a_hand_is_all_hand_and_blades_are_none_of_it() {
        for seed in [21, 22, 23, 24] {
            let (mask, _) = seen(Family::Hand, seed);
            assert!(mask.hand.contains(&true) && mask.blobs.regions.is_empty(), "hand {seed}");
            let (mask, midribs) = seen(Family::Held, seed);
            for midrib in midribs {
                // The root is where the hand ends: near to it either may be said.
                let above = &midrib[midrib.len() / 10..];
                let taken = above.iter().filter(|index| mask.hand[**index]).count();
                assert!(50 * taken <= above.len(), "held {seed}: {taken} of {}", above.len());
            }
        }
    }

    #[test]
    fn without_a_hand_nothing_is_hand() {
        for family in [Family::Single, Family::Row, Family::Fan, Family::Crossing] {
            assert!(!seen(family, 7).0.hand.contains(&true), "{family:?}");
        }
    }

    /// The mask of something as round and thick as a fist, 0.1 m across and half a metre away, of which the lower
    /// border of the picture cuts off a chord so wide.
    fn fist(chord_m: f32) -> Mask {
        const RADIUS_PX: f32 = 57.0;
        const PX_PER_M: f32 = 570.0 / 0.53;
        let half_chord_px = 0.5 * chord_m * PX_PER_M;
        let middle = Vec2::new(100.0, 149.5 - (RADIUS_PX.powi(2) - half_chord_px.powi(2)).sqrt());
        mask_of((200, 150), |x, y| {
            let away = Vec2::new(x as f32, y as f32).distance(middle) / RADIUS_PX;
            if away < 1.0 { 0.5 + 0.03 * away * away } else { 1.5 }
        })
    }

    #[test]
    fn what_hardly_touches_the_border_is_no_hand_that_comes_in_from_there() {
        let least_m = HandParams::default().min_border_m;
        let is_hand = |chord_m: f32| fist(chord_m).hand.contains(&true);
        assert!(!is_hand(0.8 * least_m) && is_hand(1.2 * least_m));
    }
}

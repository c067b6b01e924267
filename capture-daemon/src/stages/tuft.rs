//! Blades that grow from one base: where it is, and their way to it through what they share.

use std::ops::Range;

use glam::{Mat2, Vec2};

use super::components;
use super::hand;
use super::mask::{self, Mask};
use super::ray::Ray;
use super::ribbon::{End, Ribbon, RibbonParams, Section};
use super::rootward::{Course, Rootward};
use super::section::Expected;

/// A blade as far as it is sure, seen from its tip.
struct Blade {
    /// Which ribbon.
    ribbon: usize,
    /// The end of its sure part.
    ray: Ray,
    /// What its way to the root is told from.
    course: Course,
    /// Whether a longer one follows the same blade.
    echo: bool,
}

/// Where blades grow from.
struct Hub {
    at: Vec2,
    depth_m: f32,
}

/// A base is no smaller than this, pixels.
const NEAR_PX: f32 = 15.0;
/// What reaches farther beyond its base is another blade's.
const BELOW_PX: f32 = 5.0;
/// How far roots lie from their hub, one standard deviation: pixels and metres of depth.
const ROOTS_PX: f32 = 4.0;
const ROOTS_M: f32 = 0.006;
/// A width does not gain more than this many times itself on the way to a root.
const MOST_GROWTH: f32 = 5.0;
/// Blades that must lead to a hub, each counting less the farther it misses it.
const LEAST_SUPPORT: f32 = 1.3;

/// More than this are clutter: the longest are looked at. All pairs may meet in a base, and all others may
/// lead there.
const MOST_BLADES: usize = 64;

/// Leads the ribbons that grow from one base down to it: to a base that is seen, or into the hand that
/// grips them, where they end.
pub(super) fn gather(mask: &Mask, ribbons: &mut [Ribbon], ground: &Ground, params: &RibbonParams) {
    let mut blades = longest_first(ribbons.iter().enumerate().filter_map(blade));
    while let Some(hub) = hub(mask, &blades, ground, params.down) {
        let before = blades.len();
        blades.retain(|blade| {
            let ribbon = &mut ribbons[blade.ribbon];
            let led = hub.is_reached_by(&blade.ray)
                && match ground {
                    Ground::Lowest(_) => lead(mask, ribbon, blade, &hub),
                    Ground::Hand(from_hand) => lead_into_hand(mask, ribbon, blade, &hub, from_hand),
                };
            !led && blade.leads_to(hub.at) == 0.0
        });
        // Its place is a compromise: it can be one that none of them leads to.
        if blades.len() == before {
            break;
        }
    }
    if let Ground::Hand(from_hand) = ground {
        // Those that lead to no common grip are gripped where they lead to.
        for blade in &blades {
            if let Some(hub) = blade.grip(mask) {
                lead_into_hand(mask, &mut ribbons[blade.ribbon], blade, &hub, from_hand);
            }
        }
    }
}

/// The share of the blades on a blob that lead to one base, each counting less the farther it misses it.
pub(super) fn share(
    mask: &Mask,
    ribbons: &[Ribbon],
    label: u16,
    ground: &Ground,
    params: &RibbonParams,
) -> f32 {
    let on_blob =
        |blade: &Blade| mask.index_at(blade.ray.from).is_some_and(|index| mask.blobs.of[index] == label);
    let blades = longest_first(ribbons.iter().enumerate().filter_map(blade).filter(on_blob));
    let hub = hub(mask, &blades, ground, params.down);
    // What runs where a longer one does shares more with it than a base.
    let own = || blades.iter().filter(|blade| !blade.echo);
    let leading = |hub: Hub| own().map(|blade| blade.leads_to(hub.at)).sum::<f32>();
    hub.map_or(0.0, leading) / blades.len().max(1) as f32
}

/// Blades in the order of what is sure of them, those that follow one before them marked.
fn longest_first(blades: impl Iterator<Item = Blade>) -> Vec<Blade> {
    let mut blades: Vec<Blade> = blades.collect();
    blades.sort_by_key(|blade| std::cmp::Reverse(blade.ray.length));
    blades.truncate(MOST_BLADES);
    for i in 0..blades.len() {
        blades[i].echo = blades[..i].iter().any(|longer| longer.is_echoed_by(&blades[i]));
    }
    blades
}

/// What blades can grow from.
pub(super) enum Ground {
    /// The lower end of what is connected.
    Lowest(Lowest),
    /// A hand: how far each pixel is from one, twelfths of a pixel.
    Hand(Vec<u32>),
}

impl Ground {
    pub(super) fn of(mask: &Mask, down: Vec2) -> Self {
        if mask.has_hand() {
            Self::Hand(hand::chamfer(mask, |index| mask.is_hand(index)))
        } else {
            Self::Lowest(Lowest::of(mask, down))
        }
    }

    fn has(&self, mask: &Mask, point: Vec2, bottom: impl Fn(Vec2) -> Option<Vec2>, down: Vec2) -> bool {
        match self {
            Self::Lowest(lowest) => {
                let bottom = bottom(point).filter(|bottom| bottom.distance(point) < 25.0);
                let index = bottom.and_then(|bottom| mask.index_at(bottom));
                index.is_some_and(|index| {
                    lowest.at(mask, index).is_none_or(|lowest| lowest - point.dot(down) < 25.0)
                })
            }
            Self::Hand(from_hand) => is_beside(mask, point, from_hand, 20),
        }
    }
}

/// Whether a point is in a hand or no farther from it than some pixels.
fn is_beside(mask: &Mask, point: Vec2, from_hand: &[u32], px: u32) -> bool {
    let [x0, y0, x1, y1] = mask.seen.map(|edge| edge as f32);
    let seen = point.x >= x0 && point.y >= y0 && point.x < x1 - 1.0 && point.y < y1 - 1.0;
    seen && mask.index_at(point).is_some_and(|index| from_hand[index] <= 12 * px)
}

/// Leads one ribbon towards where a hand grips it, if it does not end at the hand already; whether the
/// hand holds it.
fn lead_into_hand(mask: &Mask, ribbon: &mut Ribbon, blade: &Blade, hub: &Hub, from_hand: &[u32]) -> bool {
    if ribbon.unsure == 0 && is_beside(mask, ribbon.sections[0].expected.mid, from_hand, 5) {
        return true;
    }
    let before = ribbon.clone();
    if !lead(mask, ribbon, blade, hub) {
        return false;
    }
    let in_hand =
        |section: &Section| mask.index_at(section.expected.mid).is_some_and(|index| mask.is_hand(index));
    let gripped = ribbon.sections.iter().rposition(in_hand).map_or(0, |last| last + 1);
    if gripped + 8 > ribbon.sections.len() {
        *ribbon = before;
        return false;
    }
    ribbon.sections.drain(..gripped);
    true
}

/// How far down what is connected to a pixel reaches; shadows without readings connect.
pub(super) struct Lowest {
    /// Runs of connected pixels, ascending, each with how far down what it is a part of reaches, pixels.
    runs: Vec<(Range<usize>, f32)>,
}

impl Lowest {
    fn of(mask: &Mask, down: Vec2) -> Self {
        let all = components::find(mask, |index| is_held(mask, index) || mask.unseen[index], |_, _| true);
        let mut runs = Vec::new();
        for component in all {
            let bottom_of = |run: Range<usize>| {
                // Along a row it is one of the outermost ones.
                let mut held = run.filter(|index| is_held(mask, *index));
                let (first, last) = (held.next(), held.next_back());
                let down = |index| mask.pixel(index).dot(down);
                first.map_or(f32::MIN, down).max(last.map_or(f32::MIN, down))
            };
            let bottom = component.runs().map(bottom_of).fold(f32::MIN, f32::max);
            runs.extend(component.runs().map(|run| (run, bottom)));
        }
        runs.sort_unstable_by_key(|(run, _)| run.start);
        Self { runs }
    }

    /// How far down it reaches from a pixel, pixels; `None` where nothing is held.
    fn at(&self, mask: &Mask, index: usize) -> Option<f32> {
        let (run, bottom) = self.runs[..self.runs.partition_point(|(run, _)| run.start <= index)].last()?;
        (run.contains(&index) && is_held(mask, index)).then_some(*bottom)
    }
}

fn is_held(mask: &Mask, index: usize) -> bool {
    mask.blobs.of[index] != 0 || mask.occupancy[index] >= mask::BODY_OCCUPANCY
}

fn blade((index, ribbon): (usize, &Ribbon)) -> Option<Blade> {
    let sure = &ribbon.sections[ribbon.unsure..];
    let ray = Ray::of(sure.iter())?;
    Some(Blade { ribbon: index, ray, course: Course::of(sure), echo: false })
}

impl Blade {
    /// 1 for a point that it leads to, down to 0.
    fn leads_to(&self, point: Vec2) -> f32 {
        let (ahead, aside) = self.ray.to(point);
        let limit = 5.0 + 0.12 * ahead.max(0.0);
        let back = 20.0 + self.ray.half_px;
        if ahead < -back || ahead > 1.5 * self.ray.length as f32 + 20.0 || aside > limit {
            return 0.0;
        }
        1.0 - (aside / limit).powi(2)
    }

    /// Its way to the place nearest to a point, and how long that is, pixels.
    fn way_to(&self, point: Vec2) -> Option<(Rootward, f32)> {
        let mut length = self.ray.to(point).0;
        let mut way = Rootward::of(&self.course, length)?;
        for _ in 0..2 {
            length += (point - way.at(0.0).0).dot(way.along());
            way = Rootward::of(&self.course, length)?;
        }
        Some((way, length))
    }

    /// Where it runs into a hand, straight on.
    fn grip(&self, mask: &Mask) -> Option<Hub> {
        const DEEP_PX: f32 = 10.0;
        let ray = &self.ray;
        let farthest = (1.5 * ray.length as f32) as usize;
        let in_hand = |at: &Vec2| mask.index_at(*at).is_some_and(|index| mask.is_hand(index));
        let first = (1..farthest).map(|k| ray.from + ray.along * k as f32).find(in_hand)?;
        let at = first + ray.along * DEEP_PX;
        Some(Hub { at, depth_m: ray.depth_at(at) })
    }

    fn is_echoed_by(&self, other: &Blade) -> bool {
        let (ray, other) = (&self.ray, &other.ray);
        let (ahead, aside) = ray.to(other.from);
        let beside = aside < ray.half_px.max(2.0) && ahead.abs() < ray.length as f32;
        let near = (ray.depth_at(other.from) - other.depth_m).abs() < 0.01;
        beside && near && ray.along.dot(other.along) > 0.97
    }
}

impl Hub {
    /// Whether a blade's depth leads there too.
    fn is_reached_by(&self, ray: &Ray) -> bool {
        let (ahead, _) = ray.to(self.at);
        (ray.depth_at(self.at) - self.depth_m).abs() < 0.020 + 1.5e-4 * ahead.max(0.0)
    }
}

/// The base that most blades lead to.
fn hub(mask: &Mask, blades: &[Blade], ground: &Ground, down: Vec2) -> Option<Hub> {
    let inside = |point: Vec2| mask.index_at(point).is_some_and(|index| mask.blobs.of[index] != 0);
    // The lower end of what is seen below a point, or a little above it.
    let bottom = |point: Vec2| {
        let at = |k: i32| point + down * k as f32;
        let first = (-25..=0).rev().find(|k| inside(at(*k)))?;
        let last = (first..40).take_while(|k| (0..=3).any(|gap| inside(at(k + gap)))).last()?;
        Some(at(last))
    };
    let mut best: Option<(f32, Vec2)> = None;
    for (i, a) in blades.iter().enumerate() {
        for b in &blades[..i] {
            let (a, b) = (&a.ray, &b.ray);
            let turn = a.along.perp_dot(b.along);
            if turn.abs() < 0.1 {
                continue;
            }
            let point = a.from + a.along * ((b.from - a.from).perp_dot(b.along) / turn);
            let support = support(blades, point).map_or(0.0, |(support, _)| support);
            if support > LEAST_SUPPORT
                && best.is_none_or(|(most, _)| support > most)
                && ground.has(mask, point, bottom, down)
            {
                best = Some((support, point));
            }
        }
    }
    let (_, mut at) = best?;
    let mut depth_m = 0.0;
    for _ in 0..4 {
        // The point closest to where all of them lead.
        let (mut matrix, mut vector) = (Mat2::ZERO, Vec2::ZERO);
        let (mut depth, mut total) = (0.0, 0.0);
        let (_, median_m) = support(blades, at)?;
        let so_far = Hub { at, depth_m: median_m };
        for blade in blades.iter().filter(|blade| so_far.is_reached_by(&blade.ray)) {
            let leads = blade.leads_to(at);
            if leads == 0.0 || blade.echo {
                continue;
            }
            let Some((way, _)) = blade.way_to(at) else { continue };
            let weight = leads / (way.sigma_px.powi(2) + ROOTS_PX * ROOTS_PX);
            let across = way.along().perp();
            let projector = Mat2::from_cols(across * across.x, across * across.y) * weight;
            let (root, root_m) = way.at(0.0);
            matrix += projector;
            vector += projector * root;
            let weight = leads / (way.sigma_m.powi(2) + ROOTS_M * ROOTS_M);
            (depth, total) = (depth + weight * root_m, total + weight);
        }
        if matrix.determinant() < 1e-9 {
            return None;
        }
        at = matrix.inverse() * vector;
        depth_m = depth / total;
    }
    support(blades, at).filter(|(support, _)| *support > LEAST_SUPPORT)?;
    if let Ground::Hand(_) = ground {
        return ground.has(mask, at, bottom, down).then_some(Hub { at, depth_m });
    }
    // Roots end across the blades, some lower than others.
    Some(Hub { at: at + down * ((bottom(at)? - at).dot(down) - 2.5), depth_m })
}

/// How many blades lead to a point, and at which depth.
fn support(blades: &[Blade], point: Vec2) -> Option<(f32, f32)> {
    let leading = || blades.iter().filter(|blade| !blade.echo).map(|it| (&it.ray, it.leads_to(point)));
    let mut depths: Vec<f32> =
        leading().filter(|(_, leads)| *leads > 0.0).map(|(ray, _)| ray.depth_at(point)).collect();
    depths.sort_by(f32::total_cmp);
    let hub = Hub { at: point, depth_m: *depths.get(depths.len() / 2)? };
    let sum = leading().filter(|(ray, _)| hub.is_reached_by(ray)).map(|(_, leads)| leads).sum();
    Some((sum, hub.depth_m))
}

/// Leads one ribbon to the hub if it can grow from there; whether it does.
fn lead(mask: &Mask, ribbon: &mut Ribbon, blade: &Blade, hub: &Hub) -> bool {
    let ray = &blade.ray;
    let (ahead, _) = ray.to(hub.at);
    // It ends by itself, before all others.
    if ribbon.root == End::Free && ribbon.unsure == 0 && (-BELOW_PX..NEAR_PX).contains(&ahead) {
        return true;
    }
    let Some((way, length)) = blade.way_to(hub.at) else { return false };
    let (root, root_m) = way.at(0.0);
    let of_hub = |sigma: f32, roots: f32| sigma * sigma / (sigma * sigma + roots * roots);
    let beside = way.along().perp();
    let bend = beside * (hub.at - root).dot(beside) * of_hub(way.sigma_px, ROOTS_PX);
    let target = root + bend;
    let gap = target - ray.from;
    if ahead < 1.0 {
        let beyond = ribbon.sections.iter().take_while(|s| (s.expected.mid - target).dot(ray.along) > 0.0);
        let beyond = beyond.count();
        if blade.leads_to(hub.at) > 0.0 && beyond + 8 < ribbon.sections.len() {
            ribbon.sections.drain(..beyond);
            ribbon.root = End::Shared;
            return true;
        }
        return false;
    }
    if length < 1.0 || gap.dot(ray.along) < 0.85 * gap.length() {
        return false;
    }
    let sure = &ribbon.sections[ribbon.unsure..];
    let bow_m = (hub.depth_m - root_m) * of_hub(way.sigma_m, ROOTS_M);
    let growth = (ray.curved_taper * length / ray.curved_half_px).clamp(-0.5, MOST_GROWTH);
    let half_at = |s: f32| ray.curved_half_px * unseen_width(s / length, growth);
    let steps = length.ceil() as usize;
    let place = |t: f32| {
        let (mid, depth_m) = way.at(length * (1.0 - t));
        (mid + bend * t * t, depth_m + bow_m * t * t)
    };
    let mut led: Vec<Section> = (1..=steps)
        .map(|k| {
            let t = k as f32 / steps as f32;
            let (mid, depth_m) = place(t);
            let direction = (place(t - 0.5 / steps as f32).0 - mid).normalize_or(-ray.along);
            let expected = Expected {
                mid,
                across: Vec2::new(-direction.y, direction.x),
                half_px: half_at(length * t),
                depth_m,
                ..sure[0].expected
            };
            let anchor = if k == steps { 1.0 } else { 0.01 };
            Section::led(mask, expected, anchor)
        })
        .collect();
    let open = led.iter().filter(|section| is_open(mask, section)).count();
    if open as f32 > 3.0 + 0.15 * length {
        return false;
    }
    led.reverse();
    led.extend_from_slice(sure);
    ribbon.sections = led;
    ribbon.root = End::Shared;
    ribbon.unsure = 0;
    true
}

/// The width of a blade that is not seen any more, over the last that was seen, at a part of the way from
/// there to its root. `growth`: what it gains towards the root at first, over the whole way.
///
/// Blades are widest somewhere above their root: what the width gains at first it loses again. How wide they
/// get was fitted to outlines of Fan & Sheng, figure 10, in synthetic fans of the seeds 600001 to 600180 and
/// 630001 to 630080: of blades more than half of which is hidden, a 15th is off by more than 14 %.
fn unseen_width(t: f32, growth: f32) -> f32 {
    // Over the last that was seen, the largest is about 1 more than a quarter of this.
    let bulge = if growth > 0.0 { 4.3 * ((0.14 + 0.009 * growth) * growth).exp_m1() } else { growth };
    1.0 + bulge * t * (1.0 - t) - 0.4 * t * t * t
}

/// Whether a blade that passed there would be seen, and is not.
pub(super) fn is_open(mask: &Mask, section: &Section) -> bool {
    let Some(index) = mask.index_at(section.expected.mid) else { return true };
    let nothing = mask.depth_m[index] <= 0.0 || mask.occupancy[index] < 0.3;
    let behind = mask.depth_m[index] > section.expected.depth_m + 0.02;
    (nothing || behind) && !mask.unseen[index]
}

#[cfg(test)]
mod tests;

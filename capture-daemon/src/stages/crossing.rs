//! Fragments of one blade on both sides of what hides its middle, put together again.

use glam::Vec2;

use super::mask::Mask;
use super::ray::Ray;
use super::ribbon::{End, Ribbon, Section, reverse};
use super::section::Expected;
use super::tuft::is_open;

/// Longest stretch that is hidden, pixels: a blade crossed at 25° is hidden for more than twice the
/// width of what is before it.
const LONGEST_PX: f32 = 150.0;
/// What the guessed way counts beside what is seen of it.
const ANCHOR: f32 = 0.01;

/// One end of a fragment.
#[derive(Clone, Copy)]
struct Tail {
    ribbon: usize,
    at_tip: bool,
    ray: Ray,
}

/// Two ends that go together, of two fragments, the earlier one first.
struct Pair {
    cost: f32,
    ends: [Tail; 2],
}

/// Joins fragments whose ends point at each other behind something nearer, the best pair first.
/// O(fragments²) pairs.
pub(super) fn join(mask: &Mask, ribbons: &mut Vec<Ribbon>) {
    let mut tails: Vec<Tail> = ribbons.iter().enumerate().flat_map(tails_of).collect();
    let mut pairs: Vec<Pair> = Vec::new();
    for (i, a) in tails.iter().enumerate() {
        pairs.extend(tails[i + 1..].iter().filter_map(|b| pair(mask, ribbons, a, b)));
    }
    while let Some(best) = pairs.iter().min_by(|a, b| a.cost.total_cmp(&b.cost)) {
        let [from, to] = best.ends;
        let mut tail = ribbons[to.ribbon].clone();
        let mut head = ribbons[from.ribbon].clone();
        if !from.at_tip {
            turn(&mut head);
        }
        if to.at_tip {
            turn(&mut tail);
        }
        head.sections.extend(way(mask, &from.ray, &to.ray, &head.sections[head.sections.len() - 1].expected));
        head.sections.extend(tail.sections);
        head.tip = tail.tip;
        if head.tip == End::Shared {
            turn(&mut head);
        }
        ribbons[from.ribbon] = head;
        ribbons.remove(to.ribbon);
        // Only what either was a part of is looked at anew.
        let gone = |tail: &Tail| tail.ribbon == from.ribbon || tail.ribbon == to.ribbon;
        let renumber = |tail: &mut Tail| tail.ribbon -= usize::from(tail.ribbon > to.ribbon);
        tails.retain(|tail| !gone(tail));
        pairs.retain(|pair| !pair.ends.iter().any(gone));
        tails.iter_mut().for_each(renumber);
        pairs.iter_mut().flat_map(|pair| &mut pair.ends).for_each(renumber);
        let joined: Vec<Tail> = tails_of((from.ribbon, &ribbons[from.ribbon])).collect();
        for (a, b) in joined.iter().flat_map(|a| tails.iter().map(move |b| (a, b))) {
            pairs.extend(pair(mask, ribbons, a, b));
        }
        tails.extend(joined);
    }
}

fn turn(ribbon: &mut Ribbon) {
    reverse(&mut ribbon.sections);
    std::mem::swap(&mut ribbon.root, &mut ribbon.tip);
}

fn tails_of((ribbon, it): (usize, &Ribbon)) -> impl Iterator<Item = Tail> + use<> {
    let tail = |at_tip, ray: Option<Ray>| ray.map(|ray| Tail { ribbon, at_tip, ray });
    let tip = tail(true, Ray::of(it.sections.iter().rev()));
    // A blade that was cut from others at its base has its root there.
    let root = (it.root != End::Shared).then(|| tail(false, Ray::of(it.sections.iter())));
    [tip, root.flatten()].into_iter().flatten()
}

fn pair(mask: &Mask, ribbons: &[Ribbon], a: &Tail, b: &Tail) -> Option<Pair> {
    let ends = if a.ribbon < b.ribbon { [*a, *b] } else { [*b, *a] };
    let cost = (a.ribbon != b.ribbon).then(|| cost(mask, ribbons, &ends[0], &ends[1]))??;
    Some(Pair { cost, ends })
}

/// How badly two ends go together, 0 for ends that fit; `None` where they do not.
fn cost(mask: &Mask, ribbons: &[Ribbon], a: &Tail, b: &Tail) -> Option<f32> {
    let (a_ray, b_ray) = (&a.ray, &b.ray);
    let gap = b_ray.from - a_ray.from;
    let length = gap.length();
    let shorter = a_ray.length.min(b_ray.length) as f32;
    if length > LONGEST_PX.min(6.0 * shorter) || a_ray.along.dot(-b_ray.along) < 0.75 {
        return None;
    }
    let ((ahead_a, aside_a), (ahead_b, aside_b)) = (a_ray.to(b_ray.from), b_ray.to(a_ray.from));
    let aside = aside_a.max(aside_b) / (3.0 + 0.18 * length);
    let middle = 0.5 * length;
    let reach = |ray: &Ray| ray.depth_m + ray.climb_m * middle;
    let depth = (reach(a_ray) - reach(b_ray)).abs() / (0.008 + 1.5e-4 * length);
    let width = |ray: &Ray| (ray.half_px + 0.5 * ray.taper * middle).max(0.3 * ray.half_px);
    let (wide_a, wide_b) = (width(a_ray), width(b_ray));
    let width = (wide_a - wide_b).abs() / (0.4 * wide_a.max(wide_b) + 1.5);
    if ahead_a < 0.0 || ahead_b < 0.0 || aside > 1.0 || depth > 1.0 || width > 1.0 {
        return None;
    }
    let like = &ribbons[a.ribbon].sections[0].expected;
    let open = way(mask, a_ray, b_ray, like).iter().filter(|section| is_open(mask, section)).count();
    (open as f32 <= 2.0 + 0.1 * length)
        .then_some(aside * aside + depth * depth + width * width + length / LONGEST_PX)
}

/// Sections about a pixel apart from the one end to the other.
fn way(mask: &Mask, from: &Ray, to: &Ray, like: &Expected) -> Vec<Section> {
    let length = from.from.distance(to.from);
    let steps = length.ceil() as usize;
    (1..steps)
        .map(|k| {
            let t = k as f32 / steps as f32;
            // Cubic Hermite: value and slope at both ends.
            let (t2, t3) = (t * t, t * t * t);
            let [a, b] = [2.0 * t3 - 3.0 * t2 + 1.0, 3.0 * t2 - 2.0 * t3];
            let [c, d] = [(t3 - 2.0 * t2 + t) * length, (t3 - t2) * length];
            let [da, dc] = [6.0 * (t2 - t), (3.0 * t2 - 4.0 * t + 1.0) * length];
            let dd = (3.0 * t2 - 2.0 * t) * length;
            let along = (from.from - to.from) * da + from.along * dc - to.along * dd;
            let along = along.normalize_or(from.along);
            let expected = Expected {
                mid: from.from * a + to.from * b + from.along * c - to.along * d,
                across: Vec2::new(-along.y, along.x),
                half_px: from.half_px + (to.half_px - from.half_px) * t,
                depth_m: from.depth_m * a + to.depth_m * b + from.climb_m * c - to.climb_m * d,
                ..*like
            };
            Section::led(mask, expected, ANCHOR)
        })
        .collect()
}

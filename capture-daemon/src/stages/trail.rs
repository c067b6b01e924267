//! Tips that go on: where a leaf is too thin or too steep for a reading it leaves a trail of pixels without
//! one, and beyond lie crumbs of it.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use glam::Vec2;

use super::mask::{BODY_OCCUPANCY, Mask, depth_step_m, neighbours};
use super::ribbon::{ANCHOR, End, Ribbon, RibbonParams, Section, tolerance_m};
use super::section::{Expected, Measured, Middle};
use super::settle::across_at;

/// Fewest pixels of a crumb, and its least length in pixels: less is a stray reading.
const MIN_AREA: usize = 4;
const MIN_LENGTH: usize = 3;
/// A crumb shorter than this, pixels, is no blade of its own though it was followed as one; and in lengths
/// of the blade that it carries on.
const MAX_LENGTH: usize = 40;
const MAX_SHARE: f32 = 0.5;
/// And of no more pixels.
const MAX_AREA: usize = 1000;
/// A gap may be so much longer, pixels, than so many lengths of what lies beyond it.
const SHORT_GAP_PX: f32 = 4.0;
const GAP_LENGTHS: f32 = 2.0;
/// The way to a crumb starts from pixels of the blade so near to the edge of its last section's circle, pixels.
const NEAR_PX: f32 = 3.0;
/// A trail shows where the blade runs if it is no broader than the blade and so much to either side, pixels.
const MARGIN_PX: f32 = 3.0;
/// Metres of depth that a blade gains at most for a metre across the picture, and what its readings may be off.
const MAX_STEEPNESS: f32 = 3.0;
const OFF_M: f32 = 0.03;
/// Cosine of the largest angle between a blade and where a trail leads, and of that where nothing but the
/// direction tells of it.
const TURNED: f32 = -0.2;
const STRAIGHT: f32 = 0.9;
/// What lies beyond no wider a gap, pixels, may be the tip of a leaf that is folded over: cosine of the largest angle.
const TOUCHING_PX: f32 = 1.0;
const FOLDED: f32 = -0.6;

/// Carries ribbons whose tip is not shared on to crumbs of the same leaf: what no ribbon lies on, is as narrow
/// as the ribbon, and is reached from its tip over pixels without readings only. A gap is as long as
/// [`RibbonParams::unseen_px`] at most. O(pixels held + ribbons · area around a tip).
///
/// # Source
/// Ours. A time-of-flight camera has no reading where a pixel shows a leaf and what is far behind it: of a
/// leaf thinner than two pixels just these are left, and they lead to where it can be read again.
pub(super) fn follow(mask: &Mask, ribbons: &mut [Ribbon], params: &RibbonParams) {
    const ROUNDS: usize = 4;
    for _ in 0..ROUNDS {
        let owners = Owners::of(mask, ribbons, params);
        let mut found: Vec<(usize, Crumb)> = with_open_tips(ribbons)
            .filter_map(|(i, ribbon)| Some((i, Crumb::beyond(mask, &owners, i, ribbon, params)?)))
            .collect();
        if found.is_empty() {
            break;
        }
        found.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        let mut used: Vec<usize> = Vec::new();
        for (i, crumb) in found {
            if !crumb.pixels().any(|index| used.contains(&index)) {
                used.extend(crumb.pixels());
                crumb.carry_on(mask, &mut ribbons[i]);
            }
        }
    }
}

fn with_open_tips(ribbons: &[Ribbon]) -> impl Iterator<Item = (usize, &Ribbon)> {
    ribbons.iter().enumerate().filter(|(_, ribbon)| ribbon.tip != End::Shared)
}

/// The ribbon that each pixel is of, and one more; 0 for none.
struct Owners(Vec<u32>);

impl Owners {
    /// Ribbons that may be crumbs own nothing.
    /// Only as far from a tip as crumbs are looked for.
    fn of(mask: &Mask, ribbons: &[Ribbon], params: &RibbonParams) -> Self {
        const BESIDE_PX: f32 = 1.5;
        let tips: Vec<Expected> = with_open_tips(ribbons)
            .filter_map(|(_, ribbon)| Some(ribbon.sections.last()?.expected))
            .collect();
        let away_px = NEAR_PX + (params.unseen_px + MAX_LENGTH + 4) as f32;
        let mut of = vec![0; mask.depth_m.len()];
        let longest = ribbons.iter().map(|ribbon| ribbon.sections.len()).max().unwrap_or(0);
        let blobs = |ribbon: &Ribbon| -> BTreeSet<u16> {
            let places = ribbon.sections.iter().filter_map(|section| mask.index_at(section.expected.mid));
            places.map(|index| mask.blobs.of[index]).filter(|label| *label != 0).collect()
        };
        for (i, ribbon) in ribbons.iter().enumerate() {
            let length = ribbon.sections.len();
            let is_short = length < MAX_LENGTH && (length as f32) < MAX_SHARE * longest as f32;
            let alone = || {
                let own = blobs(ribbon);
                ribbons.iter().enumerate().all(|(other, it)| other == i || blobs(it).is_disjoint(&own))
            };
            if is_short && ribbon.root != End::Shared && alone() {
                continue;
            }
            for (k, Section { expected, .. }) in ribbon.sections.iter().enumerate() {
                let reach_px = |tip: &Expected| away_px + tip.half_px + 2.0 * (expected.half_px + BESIDE_PX);
                if !tips.iter().any(|tip| (tip.mid - expected.mid).abs().max_element() < reach_px(tip)) {
                    continue;
                }
                // Beyond its last section there is a little more of a tip.
                let ahead = if k + 1 == length { 2 + expected.half_px as i32 } else { 0 };
                let along = Vec2::new(expected.across.y, -expected.across.x);
                let reach = (2.0 * (expected.half_px + BESIDE_PX)) as i32;
                for (ahead, k) in (0..=ahead).flat_map(|ahead| (-reach..=reach).map(move |k| (ahead, k))) {
                    let aside = 0.5 * k as f32;
                    let point = expected.mid + expected.across * aside + along * ahead as f32;
                    let Some(index) = mask.index_at(point) else { continue };
                    if of[index] == i as u32 + 1 {
                        continue;
                    }
                    let off_m = (mask.depth_m[index] - expected.depth_at(aside)).abs();
                    if is_held(mask, index) && off_m < 3.0 * tolerance_m(mask) {
                        of[index] = i as u32 + 1;
                    }
                }
            }
        }
        Self(of)
    }

    fn is_crumb(&self, mask: &Mask, index: usize) -> bool {
        self.0[index] == 0 && is_held(mask, index)
    }
}

fn is_held(mask: &Mask, index: usize) -> bool {
    mask.depth_m[index] > 0.0 && mask.occupancy[index] >= BODY_OCCUPANCY && !mask.is_hand(index)
}

/// What lies beyond a tip.
struct Crumb {
    /// Pixels without readings, but for specks, from the tip to it.
    gap: Vec<usize>,
    /// The last pixel with a reading before it, and how many pixels that is back.
    from: (usize, usize),
    /// Its own, by their distance from there.
    levels: Vec<Vec<usize>>,
    /// How badly it fits.
    cost: f32,
}

impl Crumb {
    /// The best one beyond the tip of a ribbon.
    fn beyond(
        mask: &Mask,
        owners: &Owners,
        ribbon: usize,
        Ribbon { sections, .. }: &Ribbon,
        params: &RibbonParams,
    ) -> Option<Self> {
        let last = sections.last()?;
        let (tip, start) = (last.expected, mask.index_at(last.expected.mid)?);
        let near_px = tip.half_px + NEAR_PX;
        // The way over pixels without readings: how many of them to each, and the one before.
        let mut ways: BTreeMap<usize, (usize, usize)> = BTreeMap::from([(start, (0, start))]);
        let mut front = VecDeque::from([start]);
        let mut best: Option<Self> = None;
        let (mut looked_at, mut specks): (BTreeSet<usize>, BTreeSet<usize>) = Default::default();
        while let Some(index) = front.pop_front() {
            let (length, _) = ways[&index];
            for next in neighbours(index, mask.width, mask.region) {
                if ways.contains_key(&next) {
                    continue;
                }
                let own = owners.0[next] == ribbon as u32 + 1;
                if own && mask.pixel(next).distance(tip.mid) < near_px {
                    ways.insert(next, (0, next));
                    front.push_front(next);
                } else if owners.is_crumb(mask, next) && !looked_at.contains(&next) {
                    let Some(levels) = levels(mask, owners, next, &mut looked_at) else { continue };
                    if is_speck(&levels) {
                        specks.extend(levels.into_iter().flatten());
                        ways.insert(next, (length + 1, index));
                        front.push_back(next);
                        continue;
                    }
                    let mut gap = vec![index];
                    while ways[&gap[gap.len() - 1]].0 > 0 {
                        gap.push(ways[&gap[gap.len() - 1]].1);
                    }
                    gap.reverse();
                    let from = gap.iter().rposition(|index| is_held(mask, *index)).unwrap_or(0);
                    let from = (gap.len() - from, gap[from]);
                    gap.remove(0);
                    let crumb = Self { gap, from, levels, cost: 0.0 };
                    let cost = crumb.cost(mask, owners, ribbon, sections, params);
                    let better = |cost: &f32| best.as_ref().is_none_or(|best| *cost < best.cost);
                    if let Some(cost) = cost.filter(better) {
                        best = Some(Self { cost, ..crumb });
                    }
                } else if (specks.contains(&next) || mask.unseen[next] && !is_held(mask, next))
                    && length < params.unseen_px
                {
                    ways.insert(next, (length + 1, index));
                    front.push_back(next);
                }
            }
        }
        best
    }

    fn pixels(&self) -> impl Iterator<Item = usize> + '_ {
        self.levels.iter().flatten().copied()
    }

    fn middle(mask: &Mask, pixels: &[usize]) -> Vec2 {
        pixels.iter().map(|index| mask.pixel(*index)).sum::<Vec2>() / pixels.len().max(1) as f32
    }

    /// `None` where it is not of the same leaf.
    fn cost(
        &self,
        mask: &Mask,
        owners: &Owners,
        ribbon: usize,
        sections: &[Section],
        params: &RibbonParams,
    ) -> Option<f32> {
        let n = sections.len();
        let (area, length, gap) = (self.pixels().count(), self.levels.len(), self.gap.len() as f32);
        let tip = sections[n - 1].expected;
        let widest = sections[2 * n / 3..].iter().map(|it| it.expected.half_px).fold(0.0, f32::max);
        let is_alike = area as f32 <= (2.0 * widest + 2.0) * length as f32;
        let is_long = length as f32 > 2.0 * tip.half_px;
        let is_short = (length as f32) < MAX_SHARE * n as f32;
        let is_near = gap <= SHORT_GAP_PX + GAP_LENGTHS * length as f32;
        if !is_alike || !is_long || !is_short || !is_near {
            return None;
        }
        // It stands clear of all but the very tip.
        let far = |index: usize| {
            let owner = owners.0[index];
            let own = owner == ribbon as u32 + 1;
            owner != 0 && !(own && mask.pixel(index).distance(tip.mid) < 2.0 * tip.half_px + 5.0)
        };
        let touches = |index: usize| {
            neighbours(index, mask.width, mask.region).any(|other| {
                far(other)
                    && (mask.depth_m[index] - mask.depth_m[other]).abs() < depth_step_m(mask.depth_m[index])
            })
        };
        let touching = self.pixels().filter(|index| touches(*index)).count();
        if 8 * touching > area {
            return None;
        }
        let first = Self::middle(mask, &self.levels[0]);
        // A trail may turn on its way.
        let toward = match self.gap.get(self.gap.len() / 2) {
            Some(middle) if gap >= SHORT_GAP_PX => mask.pixel(*middle),
            _ => Self::middle(mask, &self.pixels().collect::<Vec<_>>()),
        };
        let away = toward - tip.mid;
        let outward = (tip.mid - sections[n - 1 - 10.min(n - 1)].expected.mid).normalize_or_zero();
        let ahead = away.normalize_or_zero().dot(outward);
        let entry_m = mask.depth_m[*self.levels[0].first()?];
        let (back, from) = self.from;
        let from_m = if is_held(mask, from) { mask.depth_m[from] } else { tip.depth_m };
        let across_m = back as f32 * from_m / params.focal_px;
        let off_m = (entry_m - from_m).abs();
        let turned = if gap <= TOUCHING_PX { FOLDED } else { TURNED };
        if ahead < turned || off_m > OFF_M + MAX_STEEPNESS * across_m {
            return None;
        }
        let narrow = self
            .gap
            .iter()
            .filter(|index| mask.unseen[**index])
            .all(|index| is_narrow(mask, *index, tip.half_px + MARGIN_PX));
        let onward = Self::middle(mask, &self.levels[length - 1]) - first;
        let straight = (first - tip.mid).normalize_or_zero().dot(outward) > STRAIGHT
            && onward.normalize_or_zero().dot(outward) > STRAIGHT;
        (narrow || straight).then_some(gap + 5.0 * (1.0 - ahead) + off_m / OFF_M)
    }

    /// Puts sections along the gap and the crumb after those of a ribbon.
    fn carry_on(self, mask: &Mask, ribbon: &mut Ribbon) {
        /// What a pixel of the gap counts beside an edge that is seen.
        const WEIGHT: f32 = 0.05;
        let sections = &mut ribbon.sections;
        // The very last sections lean into the corners of what was taken for the end.
        let lean = (sections[sections.len() - 1].expected.half_px as usize).min(4).min(sections.len() / 8);
        sections.truncate(sections.len() - lean);
        let n = sections.len();
        let last = sections[n - 1];
        let depth_m = |pixels: &[usize]| {
            pixels.iter().map(|index| mask.depth_m[*index]).sum::<f32>() / pixels.len() as f32
        };
        let half_px = |pixels: &[usize]| 0.5 * pixels.len() as f32;
        let entry = &self.levels[..self.levels.len().min(3)];
        let (entry_m, entry_px) = (depth_m(&entry.concat()), half_px(&entry.concat()) / entry.len() as f32);
        let steps = (self.gap.len() + 1) as f32;
        let mut mids: Vec<Vec2> = sections.iter().map(|section| section.expected.mid).collect();
        for (k, index) in self.gap.iter().enumerate() {
            let t = (k + 1) as f32 / steps;
            let expected = Expected {
                mid: mask.pixel(*index),
                half_px: last.expected.half_px + (entry_px - last.expected.half_px) * t,
                depth_m: last.expected.depth_m + (entry_m - last.expected.depth_m) * t,
                ..last.expected
            };
            let measured = Measured::nothing(Middle::Unseen);
            mids.push(expected.mid);
            sections.push(Section { expected, measured, anchor: WEIGHT, guide_px: None });
        }
        for level in &self.levels {
            let expected = Expected {
                mid: Self::middle(mask, level),
                half_px: half_px(level).max(0.5),
                depth_m: depth_m(level),
                ..last.expected
            };
            mids.push(expected.mid);
            sections.push(Section { expected, measured: last.measured, anchor: ANCHOR, guide_px: None });
        }
        for (i, section) in sections.iter_mut().enumerate().skip(n) {
            section.expected.across = across_at(&mids, i);
            if i >= n + self.gap.len() {
                section.measured = section.expected.measure(mask);
            }
        }
    }
}

fn is_speck(levels: &[Vec<usize>]) -> bool {
    levels.len() < MIN_LENGTH || levels.iter().map(Vec::len).sum::<usize>() < MIN_AREA
}

/// The pixels of the crumb that one is of, by their distance from it; `None` where they are too many for one.
fn levels(
    mask: &Mask,
    owners: &Owners,
    from: usize,
    looked_at: &mut BTreeSet<usize>,
) -> Option<Vec<Vec<usize>>> {
    let mut levels = vec![vec![from]];
    let mut reached = BTreeSet::from([from]);
    let is_crumb = loop {
        let mut next = Vec::new();
        for index in &levels[levels.len() - 1] {
            let depth_m = mask.depth_m[*index];
            for other in neighbours(*index, mask.width, mask.region) {
                let near = (mask.depth_m[other] - depth_m).abs() < depth_step_m(depth_m);
                if near && owners.is_crumb(mask, other) && reached.insert(other) {
                    next.push(other);
                }
            }
        }
        // What was looked at and is met again was too large.
        if levels.len() > MAX_LENGTH || reached.len() > MAX_AREA || !looked_at.is_disjoint(&reached) {
            break false;
        }
        if next.is_empty() {
            break true;
        }
        levels.push(next);
    };
    looked_at.append(&mut reached);
    is_crumb.then_some(levels)
}

/// Whether something can be seen within `reach_px` of a pixel to both sides of some line through it, and not but
/// here and there.
fn is_narrow(mask: &Mask, index: usize, reach_px: f32) -> bool {
    let middle = mask.pixel(index);
    let sees = |along: Vec2| {
        let seen = |k: i32| mask.index_at(middle + along * k as f32).is_some_and(|index| !mask.unseen[index]);
        (1..=reach_px as i32).any(|k| seen(k) && seen(k + 1))
    };
    let diagonal = std::f32::consts::FRAC_1_SQRT_2;
    [Vec2::X, Vec2::Y, Vec2::splat(diagonal), Vec2::new(diagonal, -diagonal)]
        .into_iter()
        .any(|along| sees(along) && sees(-along))
}

//! Leaves along a stem: where each of them leaves it, and the way there through what they share.

use glam::Vec2;

use super::blob::Field;
use super::buckets::Buckets;
use super::chamfer;
use super::mask::{Mask, fine_step_m, neighbours};
use super::ribbon::{End, Ribbon, RibbonParams, Section, reverse, unsure};
use super::section::Expected;
use super::tuft::{self, Ground};

/// Fewest leaves that tell where a stem is.
const MIN_LEAVES: usize = 3;
/// A stem is at least this many times as long as it is wide, from its root to its uppermost leaf: what
/// blades of one tuft share at their base is shorter.
const MIN_SLENDERNESS: f32 = 4.0;
/// And at least this share of its leaves' median length: else it is a crumb of clutter.
const MIN_STEM: f32 = 0.33;
/// At most this share of its leaves lead to one place: those of a tuft do.
const MAX_TUFT: f32 = 0.5;
/// What runs on the stem with more than this share of its length is the stem.
const OF_STEM: f32 = 0.6;
/// A leaf's base is led no farther than this, in lengths of what is seen of the leaf.
const MAX_LED: f32 = 3.0;

/// Takes the ribbons that grow along a stem out of `ribbons`, each led to where it leaves the stem.
/// `fields`: distance from its root for each blob, by label. O(pixels of the blobs · log).
///
/// From each leaf runs a way to the root of its blob: amid what is seen, and without a step in depth where
/// there is a way without. The longest stretch that ways share is the stem, if it is slender; a leaf begins
/// where it, or its way, joins the stem.
///
/// # Source
/// Neubert et al. 2007 trace particles down to the base of a trunk, merging into branches; here there is
/// one for each blade, on the surface that is seen, by the shortest way (Dijkstra 1959).
pub(super) fn attach(
    mask: &Mask,
    ribbons: &mut Vec<Ribbon>,
    fields: &[Field],
    ground: &Ground,
    params: &RibbonParams,
) -> Vec<Ribbon> {
    let mut attached = Vec::new();
    if mask.has_hand() {
        return attached;
    }
    let on_blob = on_each_blob(mask, ribbons);
    for (region, field) in mask.blobs.regions.iter().zip(fields) {
        if on_blob[usize::from(region.label)] < MIN_LEAVES {
            continue;
        }
        let grows = |ribbon: &Ribbon| rooted(mask, ribbon, region.label).is_some();
        let count = ribbons.iter().filter(|ribbon| ribbon.root != End::Free && grows(ribbon)).count();
        if count < MIN_LEAVES || tuft::share(mask, ribbons, region.label, ground, params) > MAX_TUFT {
            continue;
        }
        let mut ways = Ways::of(mask, region.label, region.bounds, field);
        let mut leaves: Vec<Ribbon> = ribbons.iter().filter(|ribbon| grows(ribbon)).cloned().collect();
        leaves.iter_mut().for_each(|leaf| ways.turn(leaf, mask));
        if let Some(mut left) = ways.lead(mask, &mut leaves) {
            ribbons.retain(|ribbon| !grows(ribbon));
            ribbons.append(&mut left);
            attached.append(&mut leaves);
        }
    }
    attached
}

/// How many ribbons pass over each blob, by its label: of many blobs few have to be looked at more closely.
fn on_each_blob(mask: &Mask, ribbons: &[Ribbon]) -> Vec<usize> {
    let most = mask.blobs.regions.iter().map(|region| region.label).max().unwrap_or(0);
    let mut counts = vec![0; usize::from(most) + 1];
    for ribbon in ribbons {
        let indices = ribbon.sections.iter().filter_map(|section| mask.index_at(section.expected.mid));
        let mut labels: Vec<u16> = indices.map(|index| mask.blobs.of[index]).collect();
        labels.sort_unstable();
        labels.dedup();
        labels.into_iter().for_each(|label| counts[usize::from(label)] += 1);
    }
    counts
}

/// The first section from the root on that stands clear on a blob: beyond it the blade may run into what it
/// shares with others, or out on the far side of the stem.
fn rooted(mask: &Mask, ribbon: &Ribbon, label: u16) -> Option<usize> {
    const CLEAR: usize = 6;
    let clear = |section: &Section| {
        let on_blob = mask.index_at(section.expected.mid).is_some_and(|index| mask.blobs.of[index] == label);
        on_blob && section.edges_seen() == 2 && section.guide_px.is_none()
    };
    let first = ribbon.sections.windows(CLEAR).position(|window| window.iter().all(clear))?;
    (3 * first < 2 * ribbon.sections.len()).then_some(first)
}

/// The ways from the pixels of a blob to its root. All is by place: the pixels of the blob's bounds with a
/// margin of one all around, row by row, which spares the question whether a neighbour is within.
struct Ways {
    /// The blob's.
    label: u16,
    /// Of the places, in the image; they begin a pixel before it.
    bounds: [usize; 4],
    columns: usize,
    places: Vec<Place>,
    /// How far the blob's border is from each, pixels.
    depth_px: Vec<f32>,
    /// Places from where on the ways are not known yet. No step is shorter than 1, and none is longer than
    /// √2·(1 + 6 + 25).
    front: Buckets<48>,
}

#[derive(Clone, Copy)]
struct Place {
    /// Cost of the way from the root; infinite outside of the blob and where no way was looked for.
    cost: f32,
    /// The next place towards the root; itself at the root.
    next: u32,
    /// What a pixel of the way costs here but for steps in depth; infinite outside of the blob.
    dear: f32,
    /// Depth, in steps that divide a blob.
    steps: f32,
}

impl Ways {
    /// Over a blob's pixels. A pixel near the border, or beyond a step in depth, is dear.
    fn of(mask: &Mask, label: u16, bounds: [usize; 4], field: &Field) -> Self {
        const RIM: f32 = 6.0;
        let [x0, y0, x1, y1] = bounds;
        let columns = x1 - x0 + 2;
        let depth_px = depth_px(mask, label, bounds);
        let outside = Place { cost: f32::INFINITY, next: u32::MAX, dear: f32::INFINITY, steps: 0.0 };
        let mut places = vec![outside; depth_px.len()];
        let steps_per_m = 1.0 / fine_step_m(mask.depth_noise_m);
        let mut front = Buckets::default();
        for y in y0..y1 {
            let row = (y - y0 + 1) * columns + 1;
            for x in (x0..x1).filter(|x| mask.blobs.of[y * mask.width + x] == label) {
                let place = row + x - x0;
                let it = &mut places[place];
                it.dear = 1.0 + RIM / (depth_px[place] * depth_px[place]).max(1.0);
                it.steps = mask.depth_m[y * mask.width + x] * steps_per_m;
                if field.is_root(x, y) {
                    (it.cost, it.next) = (0.0, place as u32);
                    front.push(0, place);
                }
            }
        }
        Self { label, bounds, columns, places, depth_px, front }
    }

    /// Looks for the ways from these points, and from all nearer ones (Dijkstra).
    fn look(&mut self, mask: &Mask, points: impl Iterator<Item = Vec2>) {
        let indices = points.filter_map(|point| mask.index_at(point));
        let mut wanted: Vec<usize> = indices.filter_map(|index| self.place_in_bounds(mask, index)).collect();
        wanted.retain(|place| self.places[*place].dear.is_finite());
        let diagonal = std::f32::consts::SQRT_2;
        let columns = self.columns;
        let around = [(1, 1.0), (columns - 1, diagonal), (columns, 1.0), (columns + 1, diagonal)];
        let places = &mut self.places;
        loop {
            // What is nearer than all that waits has its way.
            wanted.retain(|place| places[*place].cost >= self.front.nearest() as f32);
            if wanted.is_empty() {
                break;
            }
            let Some((nearest, reached)) = self.front.next() else { break };
            for at in reached.iter().map(|place| *place as usize) {
                let Place { cost, steps, .. } = places[at];
                if (cost as usize) < nearest {
                    continue;
                }
                for (offset, length) in around {
                    for other in [at - offset, at + offset] {
                        let there = &mut places[other];
                        let jump = steps - there.steps;
                        let cost = cost + length * (there.dear + (jump * jump).min(25.0));
                        if cost < there.cost {
                            (there.cost, there.next) = (cost, at as u32);
                            self.front.push(cost as usize, other);
                        }
                    }
                }
            }
            self.front.give_back(nearest, reached);
        }
    }

    /// The place of a pixel of the image, if its way is known.
    fn place(&self, mask: &Mask, index: usize) -> Option<usize> {
        self.place_in_bounds(mask, index).filter(|place| self.places[*place].cost.is_finite())
    }

    fn place_in_bounds(&self, mask: &Mask, index: usize) -> Option<usize> {
        let ([x0, y0, x1, y1], x, y) = (self.bounds, index % mask.width, index / mask.width);
        let inside = x >= x0 && y >= y0 && x < x1 && y < y1;
        inside.then(|| (y - y0 + 1) * self.columns + x - x0 + 1)
    }

    fn cost_at(&self, mask: &Mask, point: Vec2) -> Option<f32> {
        let place = self.place(mask, mask.index_at(point)?)?;
        Some(self.places[place].cost)
    }

    /// Turns a leaf that both ends lead on from: its root is the one nearer to the stem's.
    fn turn(&mut self, leaf: &mut Ribbon, mask: &Mask) {
        if leaf.tip == End::Free {
            return;
        }
        // Its very ends may lie beside the blob.
        let on_blob =
            |point: &Vec2| mask.index_at(*point).is_some_and(|index| mask.blobs.of[index] == self.label);
        let mut points = leaf.sections.iter().map(|section| section.expected.mid).filter(on_blob);
        let (Some(first), Some(last)) = (points.next(), points.next_back()) else { return };
        self.look(mask, [first, last].into_iter());
        let [Some(root), Some(tip)] = [first, last].map(|end| self.cost_at(mask, end)) else { return };
        if tip < root {
            reverse(&mut leaf.sections);
            std::mem::swap(&mut leaf.root, &mut leaf.tip);
            leaf.unsure = unsure(&leaf.sections);
        }
    }

    /// The pixels from a point to the root; `None` outside of the blob.
    fn way(&self, mask: &Mask, point: Vec2) -> Option<Vec<usize>> {
        let [x0, y0, ..] = self.bounds;
        let mut place = self.place(mask, mask.index_at(point)?)?;
        let mut way = Vec::new();
        loop {
            let (x, y) = (x0 + place % self.columns - 1, y0 + place / self.columns - 1);
            way.push(y * mask.width + x);
            let next = self.places[place].next as usize;
            if next == place {
                return Some(way);
            }
            place = next;
        }
    }

    /// The longest stretch that ways to the root share, down to the root, each pixel counting once for each way
    /// beyond the first; if it is slender.
    fn stem<'a>(&self, mask: &Mask, ways: &'a [Vec<usize>]) -> Option<&'a [usize]> {
        let mut shared = vec![0_u16; self.places.len()];
        for place in ways.iter().flatten().filter_map(|index| self.place(mask, *index)) {
            shared[place] += 1;
        }
        let is_shared = |index: &usize| self.place(mask, *index).is_some_and(|place| shared[place] >= 2);
        let stretch = |way: &'a Vec<usize>| Some(&way[way.iter().position(is_shared)?..]);
        let places = |stretch: &'a [usize]| stretch.iter().filter_map(|index| self.place(mask, *index));
        let together =
            |stretch: &&'a [usize]| places(stretch).map(|place| u32::from(shared[place]) - 1).sum::<u32>();
        let longest = ways.iter().filter_map(stretch).max_by_key(together)?;
        let mut widths: Vec<f32> = places(longest).map(|place| 2.0 * self.depth_px[place]).collect();
        widths.sort_by(f32::total_cmp);
        (longest.len() as f32 > MIN_SLENDERNESS * widths[widths.len() / 2]).then_some(longest)
    }

    /// Sections of the longest leaf that each pixel of the bounds lies on; 0 for none.
    fn longest(&self, mask: &Mask, leaves: &[Ribbon]) -> Vec<usize> {
        let mut longest = vec![0; self.places.len()];
        for leaf in leaves {
            let length = leaf.sections.len();
            // Near the stem it may run on what it shares.
            let outer = leaf.sections.iter().skip(length / 3);
            for Section { expected, .. } in outer.filter(|section| section.edges_seen() == 2) {
                let reach = (0.8 * expected.half_px) as i32;
                let points = (-reach..=reach).map(|k| expected.mid + expected.across * k as f32);
                let indices = points.filter_map(|point| mask.index_at(point));
                for place in indices.filter_map(|index| self.place(mask, index)) {
                    longest[place] = length.max(longest[place]);
                }
            }
        }
        longest
    }

    /// Leads leaves to their stem, and takes away stretches of the stem itself; gives back those to whose base no way
    /// was found, and `None` where they share no stem.
    fn lead(&mut self, mask: &Mask, leaves: &mut Vec<Ribbon>) -> Option<Vec<Ribbon>> {
        let roots: Vec<usize> =
            leaves.iter().map(|leaf| rooted(mask, leaf, self.label).unwrap_or(0)).collect();
        let mut ways_from = |starts: &[usize]| -> Vec<Vec<usize>> {
            let points = || leaves.iter().zip(starts).map(|(leaf, start)| leaf.sections[*start].expected.mid);
            self.look(mask, points());
            points().map(|point| self.way(mask, point).unwrap_or_default()).collect()
        };
        let ways = ways_from(&roots);
        // Of a leaf that was followed down the stem already the way from farther out shows where it runs.
        let outer = |((leaf, root), from_root): ((&Ribbon, &usize), &Vec<usize>)| {
            let own = leaf.sections.len() - root;
            if 4 * from_root.len() < own { root + own * 3 / 4 } else { *root }
        };
        let outside: Vec<usize> = leaves.iter().zip(&roots).zip(&ways).map(outer).collect();
        let from_outside = ways_from(&outside);
        let stem_way = self.stem(mask, &from_outside)?;
        let mut lengths: Vec<usize> = leaves.iter().map(|leaf| leaf.sections.len()).collect();
        lengths.sort_unstable();
        if (stem_way.len() as f32) < MIN_STEM * lengths[lengths.len() / 2] as f32 {
            return None;
        }
        let mut on_stem = vec![false; self.places.len()];
        stem_way.iter().filter_map(|index| self.place(mask, *index)).for_each(|place| on_stem[place] = true);
        let stem = |index: usize| self.place(mask, index).is_some_and(|place| on_stem[place]);
        let near_stem = |section: &Section| {
            let Some(index) = mask.index_at(section.expected.mid) else { return false };
            stem(index) || neighbours(index, mask.width, mask.region).any(stem)
        };
        // Where the stem is broad a leaf begins before its middle.
        let joins_at = |index: usize| {
            let reach = |place: usize| 0.6 * self.depth_px[place];
            let along = stem_way.iter().filter_map(|of_stem| Some((*of_stem, self.place(mask, *of_stem)?)));
            let near = |(of_stem, place)| mask.pixel(of_stem).distance(mask.pixel(index)) <= reach(place);
            along.into_iter().any(near)
        };
        let joins: Vec<Option<usize>> =
            ways.iter().map(|way| way.iter().position(|index| joins_at(*index))).collect();
        // A longer leaf that lies on the way is another one, a shorter one may be a fragment of this.
        let longest = self.longest(mask, leaves);
        let others =
            |index: usize, own: usize| self.place(mask, index).is_some_and(|place| longest[place] > own);
        let runs_on_it = |leaf: &Ribbon| leaf.sections.iter().filter(|section| near_stem(section)).count();
        // What makes up most of it may be a leaf that was taken for it.
        let is_stem = |leaf: &Ribbon| {
            let length = leaf.sections.len();
            2 * length < stem_way.len() && runs_on_it(leaf) as f32 > OF_STEM * length as f32
        };
        let are_leaves: Vec<bool> = leaves.iter().map(|leaf| !is_stem(leaf)).collect();
        let each = leaves.iter_mut().zip(roots).zip(ways.iter().zip(&joins));
        for ((leaf, root), (way, join)) in each {
            let length = leaf.sections.len();
            let own = length - root;
            // A leaf may touch the stem again far out.
            let runs_on_stem =
                |i: &usize| 2 * leaf.sections[..*i].iter().filter(|it| near_stem(it)).count() > *i;
            let on_stem = leaf.sections.iter().rposition(near_stem);
            if let Some(on_stem) = on_stem.filter(|i| 2 * i < own || runs_on_stem(i) && i + 12 < length) {
                leaf.sections.drain(..on_stem);
            } else if leaf.root == End::Free {
                continue;
            } else if let Some(join) = join.filter(|join| *join as f32 <= MAX_LED * own as f32)
                && 3 * way[..join].iter().filter(|index| others(**index, length)).count() <= join
            {
                leaf.sections.drain(..root);
                let wide = |index: usize| self.place(mask, index).map_or(0.0, |place| self.depth_px[place]);
                lead_along(mask, leaf, &way[..=join], wide);
            } else {
                leaf.root = End::Lost;
                continue;
            }
            (leaf.root, leaf.unsure) = (End::Shared, 0);
        }
        let mut are_leaves = are_leaves.into_iter();
        leaves.retain(|_| are_leaves.next() == Some(true));
        Some(leaves.extract_if(.., |leaf| leaf.root == End::Lost).collect())
    }
}

/// How far the border of a blob is from each place of its [`Ways`], pixels.
fn depth_px(mask: &Mask, label: u16, [x0, y0, x1, y1]: [usize; 4]) -> Vec<f32> {
    let columns = x1 - x0 + 2;
    let mut twelfths = vec![0_u32; columns * (y1 - y0 + 2)];
    let within = |u: usize, v: usize| u > 0 && v > 0 && u <= mask.width && v <= mask.height;
    for (row, v) in twelfths.chunks_mut(columns).zip(y0..) {
        for (twelfths, u) in row.iter_mut().zip(x0..) {
            // Beyond the image the blob may go on. Far, but some steps more are no overflow.
            let of_it = !within(u, v) || mask.blobs.of[(v - 1) * mask.width + u - 1] == label;
            *twelfths = if of_it { u32::MAX / 2 } else { 0 };
        }
    }
    chamfer::spread(&mut twelfths, columns);
    twelfths.into_iter().map(|twelfths| twelfths as f32 / 12.0).collect()
}

/// Puts sections along a way before the first one of a leaf.
fn lead_along(mask: &Mask, leaf: &mut Ribbon, way: &[usize], depth_px: impl Fn(usize) -> f32) {
    const AHEAD: usize = 4;
    // What a pixel's path counts beside an edge that is seen.
    const WEIGHT: f32 = 0.05;
    let like = leaf.sections[0];
    let mut led: Vec<Section> = Vec::with_capacity(way.len());
    for (k, index) in way.iter().enumerate().skip(1) {
        let (from, to) = (way[k.saturating_sub(AHEAD)], way[(k + AHEAD).min(way.len() - 1)]);
        let up = (mask.pixel(from) - mask.pixel(to)).normalize_or(Vec2::NEG_Y);
        let seen = mask.depth_m[*index];
        let expected = Expected {
            mid: mask.pixel(*index),
            across: Vec2::new(-up.y, up.x),
            depth_m: if seen > 0.0 { seen } else { like.expected.depth_m },
            half_px: like.expected.half_px.min((depth_px(*index) - 0.5).max(1.0)),
            ..like.expected
        };
        let anchor = if k + 1 == way.len() { 1.0 } else { WEIGHT };
        led.push(Section::led(mask, expected, anchor));
    }
    led.reverse();
    led.append(&mut leaf.sections);
    leaf.sections = led;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::drawn::mask_of;
    use crate::stages::{contour, partition, ribbon};

    const ROOT: Vec2 = Vec2::new(120.0, 239.0);

    /// What is seen of strokes that narrow from `half` pixels to a tip, each bowed upward, half a metre away:
    /// the mask, its distances from the root and its ribbons.
    fn seen(strokes: &[(Vec2, Vec2, f32)], stem: bool) -> (Mask, Vec<Field>, Vec<Ribbon>) {
        let on_stroke = |point: Vec2, (from, to, half): &(Vec2, Vec2, f32)| {
            (0..=100).map(|k| k as f32 / 100.0).any(|t| {
                let bow = Vec2::new(0.0, -120.0 * t * (1.0 - t));
                point.distance(from.lerp(*to, t) + bow) < half * (1.0 - t).sqrt()
            })
        };
        let depth_m = |x: i32, y: i32| {
            let point = Vec2::new(x as f32, y as f32);
            let on_stem = stem && (point.x - ROOT.x).abs() < 4.5 && point.y > 70.0;
            if on_stem || strokes.iter().any(|stroke| on_stroke(point, stroke)) { 0.5 } else { 1.5 }
        };
        let mask = mask_of((240, 240), depth_m);
        let params = partition::PartitionParams::default();
        let outlines = contour::trace(&mask, &mask.pieces);
        let parts: Vec<_> = outlines
            .iter()
            .flat_map(|outline| partition::flow(&mask, &mask.pieces, outline, &params))
            .collect();
        let fields: Vec<Field> = contour::trace(&mask, &mask.blobs)
            .iter()
            .map(|outline| partition::root_distance(&mask, &mask.blobs, outline, &params))
            .collect();
        let ribbons = ribbon::grow(&mask, &parts, &fields, &RibbonParams::default());
        (mask, fields, ribbons)
    }

    fn root(ribbon: &Ribbon) -> Vec2 {
        ribbon.sections[0].expected.mid
    }

    #[test]
    fn leaves_begin_at_their_stem() {
        let leaf = |height: f32, to_x: f32| (Vec2::new(ROOT.x, height), Vec2::new(to_x, height + 15.0), 6.0);
        let leaves = [leaf(190.0, 20.0), leaf(160.0, 220.0), leaf(130.0, 25.0), leaf(100.0, 215.0)];
        let (_, _, ribbons) = seen(&leaves, true);
        for (from, to, _) in leaves {
            let tip = |ribbon: &&Ribbon| ribbon.sections[ribbon.sections.len() - 1].expected.mid.distance(to);
            let found = ribbons.iter().min_by(|a, b| tip(a).total_cmp(&tip(b))).expect("there are ribbons");
            assert!(tip(&found) < 10.0, "no tip at {to}");
            let root = root(found);
            // Above the last leaf but one the stem is the last one's.
            let height = from.y.max(130.0);
            assert!((root.x - ROOT.x).abs() < 6.0 && (root.y - height).abs() < 20.0, "{root} is not {from}");
        }
    }

    #[test]
    fn a_tuft_has_no_stem() {
        let blade = |x: f32| (ROOT, Vec2::new(x, 60.0), 6.0);
        let (mask, fields, mut ribbons) =
            seen(&[blade(20.0), blade(90.0), blade(150.0), blade(220.0)], false);
        let before = ribbons.clone();
        assert!(before.len() >= 4, "{} ribbons", before.len());
        let params = RibbonParams::default();
        let ground = Ground::of(&mask, params.down);
        assert!(attach(&mask, &mut ribbons, &fields, &ground, &params).is_empty());
        assert_eq!(ribbons, before);
    }
}

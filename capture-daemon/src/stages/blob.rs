//! One blob's pixels, its ends, and distances within it.

use std::cmp::Reverse;

use glam::{Vec2, Vec4};

use super::buckets::Buckets;
use super::mask::{Labels, Mask};

/// A blob that touches the border of the region with fewer pixels than this ends there by chance.
pub(super) const MIN_BORDER_PX: usize = 3;

/// The body pixels of one blob, as indices into its bounding box.
pub(super) struct Blob {
    pub(super) bounds: [usize; 4],
    pub(super) width: usize,
    pub(super) body: Vec<bool>,
}

/// Distance from the root to each body pixel of a blob, within the blob.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Field {
    bounds: [usize; 4],
    /// Twelfths of a pixel; `u32::MAX` outside of the blob.
    twelfths: Vec<u32>,
}

impl Field {
    /// Distance at a point, pixels: over the nearest pixel of the region, 0 far from all.
    pub fn at(&self, point: Vec2) -> f32 {
        let [x0, y0, x1, y1] = self.bounds.map(|bound| bound as isize);
        let (x, y) = (point.x.floor() as isize, point.y.floor() as isize);
        if x > x0 && y > y0 && x + 2 < x1 && y + 2 < y1 {
            return self.at_inner(point, (x - x0 - 1) as usize, (y - y0 - 1) as usize);
        }
        let columns = (x - 1).max(x0)..(x + 3).min(x1);
        let mut best = f32::INFINITY;
        if columns.is_empty() {
            return 0.0;
        }
        for v in (y - 1).max(y0)..(y + 3).min(y1) {
            let start = (v - y0) * (x1 - x0) - x0;
            let row = &self.twelfths[(start + columns.start) as usize..(start + columns.end) as usize];
            for (u, twelfths) in columns.clone().zip(row) {
                let over = *twelfths as f32 / 12.0;
                // Far beyond all that can be where there is none.
                if over < best {
                    best = best.min(over + Vec2::new(u as f32, v as f32).distance(point));
                }
            }
        }
        if best < FAR_PX { best } else { 0.0 }
    }

    /// The same where all four by four pixels around the point, whose first is at column and row `x`, `y`, are
    /// within the bounds: those of a row are reckoned with together.
    fn at_inner(&self, point: Vec2, x: usize, y: usize) -> f32 {
        let [x0, y0, x1, _] = self.bounds;
        let columns = Vec4::from_array([0, 1, 2, 3].map(|k| (x0 + x + k) as f32)) - point.x;
        let mut best = Vec4::INFINITY;
        for v in y..y + 4 {
            let start = v * (x1 - x0) + x;
            let twelfths: [u32; 4] = std::array::from_fn(|k| self.twelfths[start..start + 4][k]);
            let down = (y0 + v) as f32 - point.y;
            let away = columns * columns + down * down;
            let away = Vec4::from_array(away.to_array().map(f32::sqrt));
            best = best.min(Vec4::from_array(twelfths.map(|it| it as f32)) / 12.0 + away);
        }
        let best = best.min_element();
        if best < FAR_PX { best } else { 0.0 }
    }

    /// Whether a pixel of the image is one of the root's.
    pub(super) fn is_root(&self, x: usize, y: usize) -> bool {
        let [x0, y0, x1, y1] = self.bounds;
        let inside = x >= x0 && y >= y0 && x < x1 && y < y1;
        inside && self.twelfths[(y - y0) * (x1 - x0) + x - x0] == 0
    }

    /// Distance of a pixel of the bounding box, pixels; infinite where none is known.
    pub(super) fn of_pixel(&self, index: usize) -> f32 {
        let twelfths = self.twelfths[index];
        if twelfths == u32::MAX { f32::INFINITY } else { twelfths as f32 / 12.0 }
    }

    /// The pixel that is farthest from the root, the first of several.
    fn farthest(&self) -> Option<usize> {
        let reached = |twelfths: &u32| twelfths.wrapping_add(1);
        let most = self.twelfths.iter().map(reached).max().filter(|most| *most > 0)?;
        self.twelfths.iter().position(|twelfths| reached(twelfths) == most)
    }
}

/// Farther than any pixel is from another within a picture, pixels.
const FAR_PX: f32 = 1e8;

impl Blob {
    pub(super) fn of(mask: &Mask, labels: &Labels, label: u16) -> Option<Self> {
        let bounds = labels.regions.iter().find(|region| region.label == label)?.bounds;
        let [x0, y0, x1, y1] = bounds;
        let mut body = Vec::with_capacity((x1 - x0) * (y1 - y0));
        for y in y0..y1 {
            let row = y * mask.width + x0..y * mask.width + x1;
            let pixels = labels.of[row.clone()].iter().zip(&mask.occupancy[row]);
            body.extend(pixels.map(|(of, occupancy)| (*of == label) & (*occupancy >= 0.5)));
        }
        Some(Self { bounds, width: x1 - x0, body })
    }

    /// The pixels that touch what is `other` in the image.
    pub(super) fn beside(&self, other: impl Fn(usize) -> bool, image_width: usize) -> Vec<usize> {
        let [x0, y0, x1, y1] = self.bounds;
        let columns = x0.saturating_sub(2)..(x1 + 2).min(image_width);
        let rows = y0.saturating_sub(2)..y1 + 2;
        if !rows.into_iter().any(|v| columns.clone().any(|u| other(v * image_width + u))) {
            return Vec::new();
        }
        let touches = |index: &usize| {
            let (x, y) = (x0 + index % self.width, y0 + index / self.width);
            (y.saturating_sub(2)..=y + 2)
                .any(|v| (x.saturating_sub(2)..=x + 2).any(|u| u < image_width && other(v * image_width + u)))
        };
        (0..self.body.len()).filter(|index| self.body[*index]).filter(touches).collect()
    }

    /// Where a pixel is in an image of so many columns.
    pub(super) fn in_image(&self, index: usize, image_width: usize) -> usize {
        (self.bounds[1] + index / self.width) * image_width + self.bounds[0] + index % self.width
    }

    /// Whether a pixel of the body is at the edge of it.
    pub(super) fn is_rim(&self, index: usize) -> bool {
        let x = index % self.width;
        let of_it = |there: usize| self.body.get(there) == Some(&true);
        x == 0
            || x + 1 == self.width
            || index < self.width
            || !of_it(index - 1)
            || !of_it(index + 1)
            || !of_it(index - self.width)
            || !of_it(index + self.width)
    }

    pub(super) fn distance_from(&self, roots: &[usize]) -> Field {
        Field { bounds: self.bounds, twelfths: distances(&self.body, self.width, roots) }
    }

    fn height_below(&self, index: usize, down: Vec2) -> f32 {
        Vec2::new((index % self.width) as f32, (index / self.width) as f32).dot(down)
    }

    pub(super) fn lowest(&self, down: Vec2) -> Option<usize> {
        let mut lowest: Option<(f32, usize)> = None;
        for (y, row) in self.body.chunks(self.width).enumerate() {
            // Along a row it is one of the outermost ones.
            let ends = [row.iter().position(|body| *body), row.iter().rposition(|body| *body)];
            for x in ends.into_iter().flatten() {
                let below = Vec2::new(x as f32, y as f32).dot(down);
                if lowest.is_none_or(|(most, _)| below >= most) {
                    lowest = Some((below, y * self.width + x));
                }
            }
        }
        lowest.map(|(_, index)| index)
    }

    /// Distances from the lower one of the two pixels that are farthest apart within the blob, of which
    /// those from one pixel, `start`, are known.
    pub(super) fn distance_from_lower_end(&self, start: usize, from_start: &Field, down: Vec2) -> Field {
        let one = from_start.farthest().unwrap_or(start);
        let from_one = self.distance_from(&[one]);
        let other = from_one.farthest().unwrap_or(one);
        if self.height_below(one, down) > self.height_below(other, down) {
            from_one
        } else if other == start {
            from_start.clone()
        } else {
            self.distance_from(&[other])
        }
    }

    /// Where the blob leaves the region: the run of pixels along the border that is nearest to all of it
    /// within it, of those in its lower half if there are any. A leaf that droops out of the picture is farther
    /// from the others than their stem, and what is cut off above has its root below all the same.
    pub(super) fn border(&self, region: [usize; 4], down: Vec2) -> Option<Vec<usize>> {
        const MOST: usize = 8;
        let mut runs = self.border_runs(region);
        runs.retain(|run| run.len() >= MIN_BORDER_PX);
        runs.sort_by_key(|run| (Reverse(run.len()), run.iter().min().copied()));
        runs.truncate(MOST);
        if runs.len() < 2 {
            return runs.pop();
        }
        let body = self.body.iter().enumerate().filter(|(_, body)| **body);
        let (sum, count) = body
            .fold((0.0, 0.0), |(sum, count), (index, _)| (sum + self.height_below(index, down), count + 1.0));
        let is_low = |run: &Vec<usize>| self.height_below(run[run.len() / 2], down) * count > sum;
        let total = |run: &Vec<usize>| {
            let distance = distances(&self.body, self.width, run);
            distance.into_iter().filter(|it| *it != u32::MAX).map(u64::from).sum::<u64>()
        };
        runs.into_iter().min_by_key(|run| (!is_low(run), total(run)))
    }

    /// The connected runs of pixels along the border of the region.
    fn border_runs(&self, region: [usize; 4]) -> Vec<Vec<usize>> {
        let [x0, y0, x1, y1] = self.bounds;
        if x0 > region[0] && y0 > region[1] && x1 < region[2] && y1 < region[3] {
            return Vec::new();
        }
        let on_border = |index: &usize| {
            let (x, y) = (x0 + index % self.width, y0 + index / self.width);
            x == region[0] || y == region[1] || x + 1 == region[2] || y + 1 == region[3]
        };
        let touches = |a: usize, b: usize| {
            let (dx, dy) =
                ((a % self.width).abs_diff(b % self.width), (a / self.width).abs_diff(b / self.width));
            dx <= 1 && dy <= 1
        };
        let mut left: Vec<usize> =
            (0..self.body.len()).filter(|index| self.body[*index]).filter(on_border).collect();
        let mut runs = Vec::new();
        while let Some(first) = left.pop() {
            let mut run = vec![first];
            let mut next = 0;
            while next < run.len() {
                let at = run[next];
                next += 1;
                run.extend(left.extract_if(.., |other| touches(at, *other)));
            }
            runs.push(run);
        }
        runs
    }
}

/// Chamfer distances (12 straight, 17 diagonal) within `body` from `seeds`; `u32::MAX` where none leads.
pub(super) fn distances(body: &[bool], width: usize, seeds: &[usize]) -> Vec<u32> {
    // A margin all around spares the question whether a neighbour is within. Nothing is shorter than 0:
    // what is not of the body is never reached.
    let padded = width + 2;
    let at = |index: usize| (index / width + 1) * padded + index % width + 1;
    let mut distance = vec![0; (body.len() / width + 2) * padded];
    for (row, body) in distance[padded..].chunks_mut(padded).zip(body.chunks(width)) {
        row[1..]
            .iter_mut()
            .zip(body)
            .for_each(|(distance, body)| *distance = if *body { u32::MAX } else { 0 });
    }
    let around = [(padded + 1, 17), (padded, 12), (padded - 1, 17), (1, 12)];
    // No step is longer than 17.
    let mut front = Buckets::<18>::default();
    for seed in seeds {
        distance[at(*seed)] = 0;
        front.push(0, at(*seed));
    }
    while let Some((so_far, places)) = front.next() {
        for place in places.iter().map(|place| *place as usize) {
            if distance[place] as usize != so_far {
                continue;
            }
            for (offset, step) in around {
                let reached = so_far as u32 + step;
                for other in [place - offset, place + offset] {
                    if reached < distance[other] {
                        distance[other] = reached;
                        front.push(reached as usize, other);
                    }
                }
            }
        }
        front.give_back(so_far, places);
    }
    let mut unpadded = Vec::with_capacity(body.len());
    for (row, body) in distance[padded..].chunks(padded).zip(body.chunks(width)) {
        let pixels = row[1..].iter().zip(body);
        unpadded.extend(pixels.map(|(distance, body)| if *body { *distance } else { u32::MAX }));
    }
    unpadded
}

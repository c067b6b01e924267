//! Connected components of a mask's pixels.

use std::ops::Range;

use super::mask::Mask;

/// Pixels that are connected, as runs along rows, in the order of the rows.
pub(super) struct Component {
    runs: Vec<Range<u32>>,
}

impl Component {
    /// Number of its pixels.
    pub(super) fn area_px(&self) -> usize {
        self.runs.iter().map(ExactSizeIterator::len).sum()
    }

    /// Indices of its pixels, ascending.
    pub(super) fn pixels(&self) -> impl Iterator<Item = usize> + use<'_> {
        self.runs().flatten()
    }

    /// The same as runs, each within a row.
    pub(super) fn runs(&self) -> impl Iterator<Item = Range<usize>> + use<'_> {
        self.runs.iter().map(|run| run.start as usize..run.end as usize)
    }
}

/// Connected components of the pixels seen that `admits` lets in, over those of their up to eight
/// neighbours that are `connected`; in the order of their first pixels. O(pixels seen).
///
/// # Source
/// Runs instead of pixels in the two passes of Rosenfeld & Pfaltz 1966, as He et al. 2008 do; the sets of
/// equivalent labels are a forest (Tarjan 1975).
pub(super) fn find(
    mask: &Mask,
    admits: impl Fn(usize) -> bool,
    connected: impl Fn(usize, usize) -> bool,
) -> Vec<Component> {
    let [x0, y0, x1, y1] = mask.seen;
    let mut forest = Forest::default();
    let mut above = 0..0;
    for row in (y0..y1).map(|y| y * mask.width + x0..y * mask.width + x1) {
        let first = forest.runs.len();
        let mut at = row.start;
        while let Some(start) = (at..row.end).find(|index| admits(*index)) {
            let goes_on = |index: &usize| admits(*index) && connected(index - 1, *index);
            at = (start + 1..row.end).find(|index| !goes_on(index)).unwrap_or(row.end);
            forest.push(start as u32..at as u32);
        }
        let mut near = above.start;
        for run in first..forest.runs.len() {
            let Range { start, end } = forest.run_above(run, mask.width);
            // Half open, and diagonal neighbours count: runs touch that end where others begin.
            while near < above.end && (forest.runs[near].end as isize) < start {
                near += 1;
            }
            let mut other = near;
            while other < above.end && forest.runs[other].start as isize <= end {
                forest.join_if(run, other, |runs| touch(runs, mask.width, &connected));
                other += 1;
            }
        }
        above = first..forest.runs.len();
    }
    forest.components()
}

/// Whether a pixel of a run is connected with one of a run in the row above it.
fn touch([upper, lower]: [Range<usize>; 2], width: usize, connected: impl Fn(usize, usize) -> bool) -> bool {
    let first = (upper.start + width).max(lower.start.saturating_sub(1));
    let last = (upper.end + width).min(lower.end + 1);
    (first..last).any(|below| {
        [below, below - 1, below + 1]
            .into_iter()
            .any(|index| lower.contains(&index) && connected(below - width, index))
    })
}

/// Runs, and which of them are connected: each knows an earlier one, the first of all knows itself.
#[derive(Default)]
struct Forest {
    runs: Vec<Range<u32>>,
    earlier: Vec<u32>,
}

impl Forest {
    fn push(&mut self, run: Range<u32>) {
        self.earlier.push(self.runs.len() as u32);
        self.runs.push(run);
    }

    /// Where a run would be in the row above.
    fn run_above(&self, run: usize, width: usize) -> Range<isize> {
        let Range { start, end } = self.runs[run];
        start as isize - width as isize..end as isize - width as isize
    }

    fn first_of(&mut self, mut run: usize) -> usize {
        while self.earlier[run] as usize != run {
            self.earlier[run] = self.earlier[self.earlier[run] as usize];
            run = self.earlier[run] as usize;
        }
        run
    }

    /// Joins what two runs are of, if it is not the same yet and `they_touch`.
    fn join_if(&mut self, lower: usize, upper: usize, they_touch: impl Fn([Range<usize>; 2]) -> bool) {
        let (a, b) = (self.first_of(lower), self.first_of(upper));
        let pixels = |run: &Range<u32>| run.start as usize..run.end as usize;
        if a != b && they_touch([&self.runs[upper], &self.runs[lower]].map(pixels)) {
            self.earlier[a.max(b)] = a.min(b) as u32;
        }
    }

    fn components(mut self) -> Vec<Component> {
        let mut found: Vec<Component> = Vec::new();
        let mut component_of = vec![0_u32; self.runs.len()];
        for run in 0..self.runs.len() {
            let first = self.first_of(run);
            if first == run {
                component_of[run] = found.len() as u32;
                found.push(Component { runs: Vec::new() });
            }
            found[component_of[first] as usize].runs.push(self.runs[run].clone());
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::mask::{Labels, neighbours};

    /// A mask of `width` columns that is seen but for a margin of a pixel.
    fn mask(width: usize, height: usize) -> Mask {
        let pixels = width * height;
        let none = Labels { of: vec![0; pixels], regions: Vec::new() };
        Mask {
            width,
            height,
            region: [0, 0, width, height],
            seen: [1, 1, width - 1, height - 1],
            frames: 1,
            occupancy: vec![1.0; pixels],
            unseen: vec![false; pixels],
            depth_m: vec![0.5; pixels],
            outside_m: Vec::new(),
            depth_noise_m: 0.0,
            hand: vec![false; pixels],
            blobs: none.clone(),
            pieces: none,
        }
    }

    /// One pixel after the other.
    fn flooded(
        mask: &Mask,
        admits: impl Fn(usize) -> bool,
        connected: impl Fn(usize, usize) -> bool,
    ) -> Vec<Vec<usize>> {
        let mut left: Vec<usize> = mask.pixels_seen().filter(|index| admits(*index)).collect();
        let mut found = Vec::new();
        while !left.is_empty() {
            let mut front = vec![left.remove(0)];
            let mut next = 0;
            while next < front.len() {
                let index = front[next];
                next += 1;
                let around: Vec<usize> = neighbours(index, mask.width, mask.seen).collect();
                front.extend(left.extract_if(.., |other| around.contains(other) && connected(index, *other)));
            }
            front.sort_unstable();
            found.push(front);
        }
        found
    }

    #[test]
    fn runs_find_what_a_flood_finds() {
        let mask = mask(23, 17);
        let mut random = 1_u32;
        for round in 0..200 {
            let values: Vec<u32> = (0..mask.depth_m.len())
                .map(|_| {
                    random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (random >> 16) % 10
                })
                .collect();
            let admits = |index: usize| values[index] > round % 7;
            let connected = |a: usize, b: usize| values[a].abs_diff(values[b]) <= 1 + round % 4;
            let found = find(&mask, admits, connected);
            let pixels: Vec<Vec<usize>> = found.iter().map(|it| it.pixels().collect()).collect();
            assert_eq!(pixels, flooded(&mask, admits, connected), "round {round}");
            assert!(found.iter().zip(&pixels).all(|(found, pixels)| found.area_px() == pixels.len()));
        }
    }
}

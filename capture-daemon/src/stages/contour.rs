//! Mask → the outline of each blob, ordered and below a pixel.

use glam::Vec2;

use super::mask::{Labels, Mask, Region, few};

/// The outer border of one region.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// The region's label.
    pub label: u16,
    /// A closed polyline in image pixels (x right, y down, pixel centres at integers), the first
    /// point not repeated; the blob lies to its right as the image is seen (clockwise).
    pub points: Vec<Vec2>,
}

/// Traces the outer border of every region where its occupancy passes one half. Holes are left out.
/// O(pixels of the regions' bounding boxes).
///
/// # Source
/// Fan & Sheng §4.1 masks by depth and takes the blob's edge; the edge below a pixel by marching
/// squares (Lorensen & Cline's in the plane) on the occupancy over the held frames is ours. In
/// ambiguous cells diagonal pixels are connected, as they are in the mask.
pub fn trace(mask: &Mask, labels: &Labels) -> Vec<Outline> {
    labels.regions.iter().filter_map(|region| outer_border(mask, labels, region)).collect()
}

const LEVEL: f32 = 0.5;

/// Edge of a grid from a node to its right (`down`: lower) neighbour.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    row: usize,
    column: usize,
    down: bool,
}

/// Where the border passes an edge.
#[derive(Clone, Copy)]
struct Crossing {
    at: Edge,
    point: Vec2,
    /// The next crossing along the border, `u32::MAX` when it was walked on to.
    next: u32,
}

impl Crossing {
    /// The next one along the border, the first time it is asked for.
    fn go_on(&mut self) -> Option<usize> {
        let next = std::mem::replace(&mut self.next, u32::MAX);
        (next != u32::MAX).then_some(next as usize)
    }
}

/// Crossing points of the level on the edges of a grid over the blob's bounding box with a margin of
/// one pixel, linked into loops.
struct Grid<'a> {
    mask: &'a Mask,
    labels: &'a Labels,
    label: u16,
    /// Image position of the grid's first node.
    origin: [isize; 2],
    columns: usize,
    rows: usize,
}

impl Grid<'_> {
    fn value(&self, column: usize, row: usize) -> f32 {
        let (x, y) = (self.origin[0] + column as isize, self.origin[1] + row as isize);
        let inside = x >= 0 && y >= 0 && x < self.mask.width as isize && y < self.mask.height as isize;
        let index = if inside { y as usize * self.mask.width + x as usize } else { return 0.0 };
        if self.labels.of[index] == self.label { self.mask.occupancy[index] } else { 0.0 }
    }

    fn crossing(&self, Edge { row, column, down }: Edge) -> Vec2 {
        let here = self.value(column, row);
        let there = self.value(column + usize::from(!down), row + usize::from(down));
        let t = if here == there { 0.5 } else { (LEVEL - here) / (there - here) };
        let start =
            Vec2::new((self.origin[0] + column as isize) as f32, (self.origin[1] + row as isize) as f32);
        start + if down { Vec2::Y } else { Vec2::X } * t.clamp(0.0, 1.0)
    }

    /// Which nodes of a row lie within the border.
    fn find_inside(&self, row: usize, inside: &mut [bool]) {
        inside.fill(false);
        // The margin is outside of the blob's bounding box, and may be outside of the image.
        if row == 0 || row + 1 == self.rows {
            return;
        }
        let start =
            (self.origin[1] + row as isize) as usize * self.mask.width + (self.origin[0] + 1) as usize;
        let pixels = start..start + self.columns - 2;
        let (of, occupancy) = (&self.labels.of[pixels.clone()], &self.mask.occupancy[pixels]);
        for ((inside, label), occupancy) in inside[1..].iter_mut().zip(of).zip(occupancy) {
            *inside = (*label == self.label) & (*occupancy >= LEVEL);
        }
    }

    /// All crossings, linked. Of the row of cells above only those on the edges between both rows are still
    /// looked for.
    fn crossings(&self) -> Vec<Crossing> {
        let mut crossings: Vec<Crossing> = Vec::new();
        let [mut upper, mut lower] = [(); 2].map(|()| vec![false; self.columns]);
        let [mut on_top, mut at_bottom] = [(); 2].map(|()| vec![u32::MAX; self.columns]);
        let mut mixed = vec![false; self.columns - 1];
        for row in 0..self.rows - 1 {
            std::mem::swap(&mut upper, &mut lower);
            std::mem::swap(&mut on_top, &mut at_bottom);
            self.find_inside(row + 1, &mut lower);
            // Most cells lie wholly within or without: this tells the others fastest.
            let nodes = upper.iter().zip(&upper[1..]).zip(lower.iter().zip(&lower[1..]));
            for (mixed, ((a, b), (c, d))) in mixed.iter_mut().zip(nodes) {
                *mixed = (a ^ b) | (a ^ c) | (a ^ d);
            }
            // The cell to the left of one whose left edge is crossed is mixed too, and was the last one.
            let mut right = u32::MAX;
            for column in few(&mixed) {
                let case = [upper[column], upper[column + 1], lower[column + 1], lower[column]];
                let (top, left) = (on_top[column], right);
                let mut cross = |at: Edge| {
                    crossings.push(Crossing { at, point: self.crossing(at), next: u32::MAX });
                    crossings.len() as u32 - 1
                };
                if case[1] != case[2] {
                    right = cross(Edge { row, column: column + 1, down: true });
                }
                if case[2] != case[3] {
                    at_bottom[column] = cross(Edge { row: row + 1, column, down: false });
                }
                let bottom = at_bottom[column];
                // From an edge where the border enters the cell to where it leaves, inside to its
                // right. Corners in the order upper left, upper right, lower right, lower left.
                let mut link = |from: u32, to: u32| crossings[from as usize].next = to;
                match case {
                    [true, true, true, true] | [false, false, false, false] => {}
                    [true, false, false, false] => link(top, left),
                    [false, true, false, false] => link(right, top),
                    [false, false, true, false] => link(bottom, right),
                    [false, false, false, true] => link(left, bottom),
                    [true, true, false, false] => link(right, left),
                    [false, true, true, false] => link(bottom, top),
                    [false, false, true, true] => link(left, right),
                    [true, false, false, true] => link(top, bottom),
                    [false, true, true, true] => link(left, top),
                    [true, false, true, true] => link(top, right),
                    [true, true, false, true] => link(right, bottom),
                    [true, true, true, false] => link(bottom, left),
                    [true, false, true, false] => {
                        link(top, right);
                        link(bottom, left);
                    }
                    [false, true, false, true] => {
                        link(left, top);
                        link(right, bottom);
                    }
                }
            }
        }
        crossings
    }
}

fn outer_border(mask: &Mask, labels: &Labels, region: &Region) -> Option<Outline> {
    let [x0, y0, x1, y1] = region.bounds;
    let grid = Grid {
        mask,
        labels,
        label: region.label,
        origin: [x0 as isize - 1, y0 as isize - 1],
        columns: x1 - x0 + 2,
        rows: y1 - y0 + 2,
    };
    let mut crossings = grid.crossings();
    let mut longest: Option<(f32, Edge, Vec<Vec2>)> = None;
    let mut around: Vec<Crossing> = Vec::new();
    for start in 0..crossings.len() {
        around.clear();
        let mut at = start;
        while let Some(next) = crossings[at].go_on() {
            around.push(crossings[at]);
            at = next;
        }
        // From its first edge on.
        let Some(first) = (0..around.len()).min_by_key(|index| around[*index].at) else { continue };
        let points: Vec<Vec2> =
            around[first..].iter().chain(&around[..first]).map(|crossing| crossing.point).collect();
        let (area, edge) = (signed_area(&points).abs(), around[first].at);
        let is_longest =
            longest.as_ref().is_none_or(|(most, at, _)| area > *most || area == *most && edge < *at);
        if points.len() >= 3 && is_longest {
            longest = Some((area, edge, points));
        }
    }
    longest.map(|(_, _, points)| Outline { label: region.label, points })
}

/// Twice the enclosed area would be the cross sum; positive for clockwise loops as the image is seen.
pub(crate) fn signed_area(points: &[Vec2]) -> f32 {
    let following = points.iter().cycle().skip(1);
    0.5 * points.iter().zip(following).map(|(a, b)| a.perp_dot(*b)).sum::<f32>()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mask of one blob from rows of digits: tenths of occupancy.
    fn mask(rows: &[&str]) -> Mask {
        let occupancy: Vec<f32> =
            rows.iter().flat_map(|row| row.bytes()).map(|b| f32::from(b - b'0') / 8.0).collect();
        let (width, height) = (rows[0].len(), rows.len());
        Mask {
            width,
            height,
            region: [0, 0, width, height],
            seen: [0, 0, width, height],
            frames: 8,
            depth_m: vec![0.5; occupancy.len()],
            hand: vec![false; occupancy.len()],
            unseen: vec![false; occupancy.len()],
            outside_m: Vec::new(),
            depth_noise_m: 0.0,
            blobs: one_region(&occupancy, width, height),
            pieces: one_region(&occupancy, width, height),
            occupancy,
        }
    }

    fn one_region(occupancy: &[f32], width: usize, height: usize) -> Labels {
        Labels {
            of: occupancy.iter().map(|o| u16::from(*o > 0.0)).collect(),
            regions: vec![Region { label: 1, area_px: 1, bounds: [0, 0, width, height] }],
        }
    }

    fn traced(mask: &Mask) -> Vec<Outline> {
        trace(mask, &mask.blobs)
    }

    #[test]
    fn a_rectangle_has_its_area_and_runs_clockwise() {
        let outlines = traced(&mask(&["00000", "08880", "08880", "00000"]));
        let [outline] = outlines.as_slice() else { panic!("{outlines:?}") };
        // 3×2 pixels, corners cut at half a pixel.
        assert!((signed_area(&outline.points) - (6.0 - 0.5)).abs() < 1e-4, "{outline:?}");
    }

    #[test]
    fn partial_occupancy_moves_the_edge_below_a_pixel() {
        let edge = |fringe: &str| {
            let rows = [fringe; 7];
            let outlines = traced(&mask(&rows));
            outlines[0].points.iter().map(|p| p.x).fold(f32::NEG_INFINITY, f32::max)
        };
        assert!((edge("88800") - 2.5).abs() < 1e-5);
        assert!((edge("88820") - (2.0 + 4.0 / 6.0)).abs() < 1e-5);
    }

    #[test]
    fn blobs_at_the_border_are_closed_and_holes_are_left_out() {
        let outlines = traced(&mask(&["888", "808", "888"]));
        assert!((signed_area(&outlines[0].points) - 8.5).abs() < 1.0, "{outlines:?}");
        assert!(outlines[0].points.iter().all(|p| p.x < 0.0 || p.y < 0.0 || p.x > 2.0 || p.y > 2.0));
    }

    #[test]
    fn diagonal_pixels_are_one_outline() {
        let outlines = traced(&mask(&["0000", "0800", "0080", "0000"]));
        assert!(signed_area(&outlines[0].points) > 1.0, "both pixels: {outlines:?}");
    }
}

//! How good depth is, from frames of whatever stands before the camera.

use crate::frame::DepthFrame;

/// Columns and rows of the tiles that planes are fitted to: small enough to be flat in most rooms, and with enough pixels
/// for a deviation known to a few per cent.
const TILE_PX: usize = 32;
/// Share of a tile's pixels that need a reading.
const FILLED: f64 = 0.9;
/// Share of them that need to lie near its plane: else there is an edge in it.
const FLAT: f64 = 0.95;
/// Readings farther from the plane than so many deviations are none of it.
const FAR_OUT: f64 = 4.0;
/// Most that depth may change across a tile, relative: steeper ones are mostly edges.
const STEEP: f64 = 0.15;
/// Fewest frames of which a deviation over time is told.
const FEWEST_FRAMES: u32 = 5;

/// What was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measured {
    /// Frames.
    pub frames: u64,
    /// Share of the pixels that have a reading, 0..=1.
    pub fill: f64,
    /// Distance of what is seen, metres: half of the tiles are nearer. `None`: no tile is flat.
    pub plane_distance_m: Option<f64>,
    /// Deviation of readings from a plane through their neighbours, in one frame, metres: that of half of the tiles.
    pub plane_noise_m: Option<f64>,
    /// The same as it would be at the working distance.
    pub plane_noise_at_work_m: Option<f64>,
    /// Deviation of a pixel's readings from frame to frame, metres: that of half of the pixels.
    pub temporal_noise_m: Option<f64>,
    /// The same as it would be at the working distance.
    pub temporal_noise_at_work_m: Option<f64>,
    /// Pixels across a blade of the given width at the working distance.
    pub pixels_across: f64,
}

/// Readings of one pixel (Welford's sums).
#[derive(Clone, Copy, Debug, Default)]
struct Pixel {
    count: u32,
    mean: f32,
    squares: f32,
}

/// Adds up frames of one size.
#[derive(Clone, Debug)]
pub struct Measure {
    region: [usize; 4],
    /// Distance at which blades are held up, metres.
    work_m: f64,
    size: [usize; 2],
    pixels: Vec<Pixel>,
    /// Deviation and distance of each flat tile, metres.
    tiles: Vec<(f64, f64)>,
    frames: u64,
    readings: u64,
    focal_px: f64,
}

impl Measure {
    /// Measures frames like the first. `region`: `[x0, y0, x1, y1]`, pixels, half open, within it; `work_m`: distance at
    /// which blades are held up, metres, above 0.
    pub fn new(first: &DepthFrame, region: [usize; 4], work_m: f64) -> Self {
        let size = [first.width, first.height];
        let pixels = vec![Pixel::default(); first.width * first.height];
        Self {
            region,
            work_m,
            size,
            pixels,
            tiles: Vec::new(),
            frames: 0,
            readings: 0,
            focal_px: first.camera.fx,
        }
    }

    /// Takes a frame; one of another size is passed over. O(pixels).
    pub fn push(&mut self, frame: &DepthFrame) {
        if [frame.width, frame.height] != self.size {
            return;
        }
        self.frames += 1;
        let [x0, y0, x1, y1] = self.region;
        for y in y0..y1 {
            let row = y * frame.width;
            for at in row + x0..row + x1 {
                if frame.depth[at] != 0 {
                    self.readings += 1;
                    self.pixels[at].add((f64::from(frame.depth[at]) * frame.depth_unit_m) as f32);
                }
            }
        }
        for y in (y0..y1).step_by(TILE_PX).filter(|y| y + TILE_PX <= y1) {
            for x in (x0..x1).step_by(TILE_PX).filter(|x| x + TILE_PX <= x1) {
                self.tiles.extend(tile(frame, [x, y]));
            }
        }
    }

    /// What it comes to. `width_m`: of a blade.
    pub fn finish(mut self, width_m: f64) -> Measured {
        let [x0, y0, x1, y1] = self.region;
        let seen = (self.frames * ((x1 - x0) * (y1 - y0)) as u64).max(1);
        let work_m = self.work_m;
        // What triangulates is the noisier the farther, with the square of the distance.
        let at_work = |(noise_m, distance_m): &(f64, f64)| noise_m * (work_m / distance_m).powi(2);
        let still: Vec<(f64, f64)> = self.pixels.iter().filter_map(Pixel::deviation).collect();
        Measured {
            frames: self.frames,
            fill: self.readings as f64 / seen as f64,
            plane_distance_m: median(self.tiles.iter().map(|tile| tile.1)),
            plane_noise_m: median(self.tiles.iter().map(|tile| tile.0)),
            plane_noise_at_work_m: median(self.tiles.drain(..).map(|tile| at_work(&tile))),
            temporal_noise_m: median(still.iter().map(|pixel| pixel.0)),
            temporal_noise_at_work_m: median(still.iter().map(at_work)),
            pixels_across: self.focal_px * width_m / work_m,
        }
    }
}

impl Pixel {
    fn add(&mut self, depth_m: f32) {
        self.count += 1;
        let off = depth_m - self.mean;
        self.mean += off / self.count as f32;
        self.squares += off * (depth_m - self.mean);
    }

    /// Standard deviation and mean, metres.
    fn deviation(&self) -> Option<(f64, f64)> {
        let variance = f64::from(self.squares) / f64::from(self.count.saturating_sub(1).max(1));
        (self.count >= FEWEST_FRAMES).then(|| (variance.sqrt(), f64::from(self.mean)))
    }
}

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Deviation from its plane and distance of a tile, metres; `None` where it is not flat.
///
/// A plane's inverse depth is affine in the pixel's position, whatever the camera: 1/z = a + b·x + c·y.
fn tile(frame: &DepthFrame, [x0, y0]: [usize; 2]) -> Option<(f64, f64)> {
    let middle = (TILE_PX as f64 - 1.0) / 2.0;
    let mut readings: Vec<[f64; 3]> = Vec::with_capacity(TILE_PX * TILE_PX);
    for (y, x) in (0..TILE_PX).flat_map(|y| (0..TILE_PX).map(move |x| (y, x))) {
        if let Some(z) = frame.depth_m(x0 + x, y0 + y) {
            readings.push([x as f64 - middle, y as f64 - middle, z]);
        }
    }
    let filled = readings.len();
    if (filled as f64) < FILLED * (TILE_PX * TILE_PX) as f64 {
        return None;
    }
    let mut plane = fit(&readings)?;
    // What lies far out goes, and the plane is fitted to the others.
    for _ in 0..2 {
        let far_m = FAR_OUT * deviation(&readings, &plane);
        readings.retain(|reading| residual_m(reading, &plane).abs() <= far_m);
        plane = fit(&readings)?;
    }
    let [a, b, c] = plane;
    let is_flat = readings.len() as f64 >= FLAT * filled as f64;
    let steep = (b.abs() + c.abs()) * TILE_PX as f64 / a;
    (is_flat && a > 0.0 && steep < STEEP).then(|| (deviation(&readings, &plane), 1.0 / a))
}

fn residual_m(&[x, y, z]: &[f64; 3], &[a, b, c]: &[f64; 3]) -> f64 {
    let inverse = a + b * x + c * y;
    // Not z - 1/inverse, which is the same but for what is far out.
    (inverse - 1.0 / z) * z * z
}

fn deviation(readings: &[[f64; 3]], plane: &[f64; 3]) -> f64 {
    let squares: f64 = readings.iter().map(|reading| residual_m(reading, plane).powi(2)).sum();
    (squares / (readings.len() as f64 - 3.0).max(1.0)).sqrt()
}

/// The plane through readings by least squares, as inverse depth.
fn fit(readings: &[[f64; 3]]) -> Option<[f64; 3]> {
    let mut normal = glam::DMat3::ZERO;
    let mut right = glam::DVec3::ZERO;
    for &[x, y, z] in readings {
        let row = glam::DVec3::new(1.0, x, y);
        normal += glam::DMat3::from_cols(row, row * x, row * y);
        right += row / z;
    }
    let is_plane = normal.determinant().abs() > 1e-6;
    is_plane.then(|| (normal.inverse() * right).to_array())
}

#[cfg(test)]
mod tests {
    use rand_pcg::Pcg32;
    use rand_pcg::rand_core::RngCore;

    use super::*;
    use crate::frame::CameraModel;

    const SIZE: [usize; 2] = [160, 128];
    const ALL: [usize; 4] = [0, 0, 160, 128];

    /// Frames at some depth by pixel, with a noise; every so many-th pixel has no reading.
    fn measured(depth_m: impl Fn(usize, usize) -> f64, noise_m: f64, gap: usize) -> Measured {
        let mut random = Pcg32::new(5, 0);
        let mut normal = || {
            let sum: f64 = (0..12).map(|_| f64::from(random.next_u32()) / f64::from(u32::MAX)).sum();
            sum - 6.0
        };
        let mut measure: Option<Measure> = None;
        for _ in 0..30 {
            let depth = (0..SIZE[0] * SIZE[1]).map(|at| {
                let z = depth_m(at % SIZE[0], at / SIZE[0]) + noise_m * normal();
                if at % gap == gap - 1 { 0 } else { (z / 0.0001).round() as u16 }
            });
            let frame = DepthFrame {
                width: SIZE[0],
                height: SIZE[1],
                depth: depth.collect(),
                depth_unit_m: 0.0001,
                timestamp_ns: 0,
                camera: CameraModel { fx: 285.0, fy: 285.0, cx: 79.5, cy: 63.5 },
            };
            measure.get_or_insert_with(|| Measure::new(&frame, ALL, 0.5)).push(&frame);
        }
        measure.expect("frames").finish(0.008)
    }

    fn assert_near(found: Option<f64>, expected: f64, relative: f64) {
        assert!(
            found.is_some_and(|found| (found / expected - 1.0).abs() < relative),
            "{found:?}, not {expected}"
        );
    }

    #[test]
    fn noise_is_found_as_it_is_on_a_wall_that_stands_aslant() {
        // 1/z = affine: a plane, at 1 m in the middle.
        let found =
            measured(|x, y| 1.0 / (1.0 + 0.001 * (x as f64 - 80.0) - 0.0005 * (y as f64 - 64.0)), 0.002, 50);
        assert_near(found.plane_noise_m, 0.002, 0.03);
        assert_near(found.temporal_noise_m, 0.002, 0.03);
        assert_near(found.plane_distance_m, 1.0, 0.05);
        // At half of the distance a quarter.
        assert_near(found.plane_noise_at_work_m, 0.0005, 0.1);
        assert_near(found.temporal_noise_at_work_m, 0.0005, 0.1);
        assert!((found.fill - 0.98).abs() < 1e-3, "{}", found.fill);
        assert_eq!(found.frames, 30);
        assert!((found.pixels_across - 285.0 * 0.008 / 0.5).abs() < 1e-9);
    }

    #[test]
    fn edges_and_what_stands_before_the_wall_are_no_noise() {
        let found = measured(|x, _| if (70..90).contains(&x) { 0.5 } else { 1.0 }, 0.001, 1000);
        assert_near(found.plane_noise_m, 0.001, 0.05);
    }

    #[test]
    fn still_waves_are_no_noise_in_time_but_no_plane_either() {
        let found = measured(|x, y| 1.0 + 0.003 * ((x + 2 * y) as f64).sin(), 0.0, 1000);
        assert!(found.temporal_noise_m.is_some_and(|noise| noise < 1e-5), "{found:?}");
        assert_near(found.plane_noise_m, 0.003 / 2f64.sqrt(), 0.05);
    }

    #[test]
    fn where_nothing_is_flat_or_read_that_is_said() {
        let found = measured(|x, y| if (x / 3 + y / 3) % 2 == 0 { 0.5 } else { 1.0 }, 0.0, 2);
        assert_eq!((found.plane_noise_m, found.plane_distance_m), (None, None));
        assert!((found.fill - 0.5).abs() < 1e-9);
        let nothing = measured(|_, _| 0.0, 0.0, 2);
        assert_eq!((nothing.fill, nothing.temporal_noise_m), (0.0, None));
    }
}

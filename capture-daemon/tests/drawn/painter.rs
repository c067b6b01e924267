//! Depth frames painted by hand: outlines filled at some depth, before a wall at 1.3 m. Nothing here is of
//! the synthetic sensor, whose scenes the stages were made with.

use capture_daemon::frame::{CameraModel, DepthFrame};
use capture_daemon::session::{Capture, Session, SessionParams};
use glam::DVec2;

pub(crate) const WIDTH: usize = 640;
pub(crate) const HEIGHT: usize = 480;
pub(crate) const FOCAL_PX: f64 = 570.0;
const WALL_MM: f64 = 1300.0;

pub(crate) const CAMERA: CameraModel = CameraModel { fx: FOCAL_PX, fy: FOCAL_PX, cx: 319.5, cy: 239.5 };
/// About the middle of the picture, between pixels.
pub(crate) const MIDDLE: DVec2 = DVec2::new(320.3, 240.2);

/// Something painted: the corners of its outline, pixels, and its depth at each place, millimetres; a
/// depth of 0 is none read.
pub(crate) struct Painted {
    pub(crate) outline: Vec<DVec2>,
    pub(crate) depth_mm: Box<dyn Fn(DVec2) -> f64>,
}

/// Flat, at one depth.
pub(crate) fn flat(outline: Vec<DVec2>, depth_mm: f64) -> Painted {
    Painted { outline, depth_mm: Box::new(move |_| depth_mm) }
}

/// The corners of an upright rectangle `[x0, y0, x1, y1]`, pixels.
pub(crate) fn rectangle([x0, y0, x1, y1]: [f64; 4]) -> Vec<DVec2> {
    [(x0, y0), (x1, y0), (x1, y1), (x0, y1)].map(|(x, y)| DVec2::new(x, y)).to_vec()
}

/// A straight blade: even up to 60 % of its length, then narrowing to a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strip {
    /// Middle of its root.
    pub(crate) root: DVec2,
    /// Where it points, radians to the right of upwards.
    pub(crate) lean: f64,
    pub(crate) length_px: f64,
    pub(crate) width_px: f64,
    /// How much its root is cut aslant, radians.
    pub(crate) slant: f64,
}

impl Strip {
    pub(crate) fn along(&self) -> DVec2 {
        DVec2::new(self.lean.sin(), -self.lean.cos())
    }

    pub(crate) fn outline(&self) -> Vec<DVec2> {
        let (along, right) = (self.along(), -self.along().perp());
        let half = 0.5 * self.width_px;
        let aslant = half * self.slant.tan();
        let at = |up: f64, aside: f64| self.root + along * up + right * aside;
        let shoulder = 0.6 * self.length_px;
        vec![
            at(-aslant, -half),
            at(shoulder, -half),
            at(self.length_px, 0.0),
            at(shoulder, half),
            at(aslant, half),
        ]
    }

    /// Its width at a distance from its root, pixels.
    pub(crate) fn width_at(&self, along_px: f64) -> f64 {
        let narrowing = (self.length_px - along_px) / (0.4 * self.length_px);
        self.width_px * narrowing.clamp(0.0, 1.0)
    }
}

/// A number that its arguments decide, evenly between 0 and 1.
fn random(index: usize, frame: usize, salt: u64) -> f64 {
    // SplitMix64.
    let mut z = (index as u64) << 20 ^ frame as u64 ^ salt << 56;
    z = z.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z >> 11) as f64 / (1_u64 << 53) as f64
}

fn holds(outline: &[DVec2], point: DVec2) -> bool {
    let next = outline.iter().cycle().skip(1);
    let crosses = |(a, b): (&DVec2, &DVec2)| {
        (a.y > point.y) != (b.y > point.y) && point.x < a.x + (b.x - a.x) * (point.y - a.y) / (b.y - a.y)
    };
    outline.iter().zip(next).filter(|edge| crosses(*edge)).count() % 2 == 1
}

/// Depths of one scene, the later ones painted over the earlier ones, without noise, millimetres.
fn paint(scene: &[Painted]) -> Vec<f64> {
    let mut depth = vec![WALL_MM; WIDTH * HEIGHT];
    for Painted { outline, depth_mm } in scene {
        let low = outline.iter().copied().reduce(DVec2::min).expect("an outline has corners");
        let high = outline.iter().copied().reduce(DVec2::max).expect("an outline has corners");
        let range = |low: f64, high: f64, size: usize| {
            low.floor().max(0.0) as usize..(high.ceil().max(-1.0) + 1.0).min(size as f64) as usize
        };
        for y in range(low.y, high.y, HEIGHT) {
            for x in range(low.x, high.x, WIDTH) {
                let point = DVec2::new(x as f64, y as f64);
                if holds(outline, point) {
                    depth[y * WIDTH + x] = depth_mm(point);
                }
            }
        }
    }
    depth
}

/// Frames that show the wall alone, before the scene is there.
const EMPTY: usize = 8;

/// What a session at default configuration makes of a scene that stands still: one capture, or none. The
/// depth of what is painted has noise of 1.2 mm, and 0.2 % of its readings are missing.
pub(crate) fn capture(scene: &[Painted]) -> Option<Capture> {
    capture_under(scene, SessionParams::default())
}

/// The same of the first frame that shows something, of blades that score so much at least.
pub(crate) fn capture_at_once(scene: &[Painted], min_score: f32) -> Option<Capture> {
    let mut params = SessionParams::default();
    params.pipeline.accept.min_score = min_score;
    params.station.hold_s = 0.0;
    capture_under(scene, params)
}

fn capture_under(scene: &[Painted], params: SessionParams) -> Option<Capture> {
    let painted = paint(scene);
    let mut session = Session::new(params);
    (0..48).find_map(|frame| {
        let noisy = |(index, depth_mm): (usize, &f64)| {
            if *depth_mm == WALL_MM || frame < EMPTY {
                return WALL_MM as u16;
            }
            if *depth_mm <= 0.0 || random(index, frame, 0) < 0.002 {
                return 0;
            }
            // The sum of twelve has a variance of 1.
            let normal = (1..=12).map(|salt| random(index, frame, salt)).sum::<f64>() - 6.0;
            (depth_mm + 1.2 * normal).round() as u16
        };
        session.push(&DepthFrame {
            width: WIDTH,
            height: HEIGHT,
            depth: painted.iter().enumerate().map(noisy).collect(),
            depth_unit_m: 0.001,
            timestamp_ns: 1_000_000_000 + frame as u64 * 33_333_333,
            camera: CAMERA,
        })
    })
}

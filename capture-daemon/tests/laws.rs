//! What must hold for whatever is held before the camera.

use capture_daemon::frame::{CameraModel, DepthFrame};
use capture_daemon::session::{Session, SessionParams};
use capture_daemon::station::StationParams;
use proptest::prelude::*;

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

/// An ellipse: middle, radii, turn, depth in millimetres, slope of depth in millimetres a pixel.
type Ellipse = (f64, f64, f64, f64, f64, u16, f64);

fn ellipse() -> impl Strategy<Value = Ellipse> {
    (0.0..160.0, 0.0..120.0, 2.0..60.0, 1.0..40.0, 0.0..3.2, 350_u16..850, -3.0..3.0)
}

/// Ellipses before each other and pixels of noise, which a hash of their place makes.
fn frame(ellipses: &[Ellipse], noise: u32) -> DepthFrame {
    let mut depth = vec![1300; WIDTH * HEIGHT];
    for (index, counts) in depth.iter_mut().enumerate() {
        let (x, y) = ((index % WIDTH) as f64, (index / WIDTH) as f64);
        for (cx, cy, a, b, turn, z, slope) in ellipses {
            let (dx, dy) = (x - cx, y - cy);
            let (u, v) = (dx * turn.cos() + dy * turn.sin(), dy * turn.cos() - dx * turn.sin());
            if (u / a).powi(2) + (v / b).powi(2) < 1.0 {
                *counts = (*counts).min((f64::from(*z) + slope * u) as u16);
            }
        }
        let hash = (index as u32).wrapping_mul(2_654_435_761) >> 16;
        match hash % 100 {
            0..4 if noise > 0 => *counts = 0,
            _ => *counts = counts.saturating_add((hash % (noise + 1)) as u16),
        }
    }
    let camera = CameraModel { fx: 150.0, fy: 150.0, cx: 79.5, cy: 59.5 };
    DepthFrame { width: WIDTH, height: HEIGHT, depth, depth_unit_m: 0.001, timestamp_ns: 1, camera }
}

fn session() -> Session {
    let station = StationParams { hold_s: 0.0, ..StationParams::default() };
    Session::new(SessionParams { station, ..SessionParams::default() })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn blades_lie_on_what_is_seen(ellipses in prop::collection::vec(ellipse(), 1..6), noise in 0_u32..12) {
        let frame = frame(&ellipses, noise);
        let Some(capture) = session().push(&frame) else { return Ok(()) };
        for blade in &capture.steps.blades {
            for knot in &blade.knots_in_camera {
                let (x, y) = frame.camera.project(knot.position);
                prop_assert!((-8.0..168.0).contains(&x) && (-8.0..128.0).contains(&y), "a knot at {x}, {y}");
                prop_assert!((0.25..1.0).contains(&knot.position.z), "a knot {} m away", knot.position.z);
                prop_assert!(knot.width() < 1.0, "{} m wide", knot.width());
            }
            // The picture is 1 m wide at 1 m; nothing in it winds about more than twice.
            prop_assert!(blade.blade.length_m() < 2.0, "{} m long", blade.blade.length_m());
        }
    }

    #[test]
    fn the_same_frame_gives_the_same_bits(ellipses in prop::collection::vec(ellipse(), 1..4)) {
        let frame = frame(&ellipses, 5);
        prop_assert_eq!(session().push(&frame), session().push(&frame));
    }
}

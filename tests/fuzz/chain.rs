//! Random depth through the whole chain, under random settings.

use std::path::Path;

use capture_daemon::config::load;
use capture_daemon::frame::{CameraModel, DepthFrame};
use capture_daemon::session::Session;

use tests::random::Random;

/// Settings within their ranges, some at their ends.
fn settings(random: &mut Random) -> Vec<String> {
    let mut sets = vec![format!("capture.hold_s={}", random.pick(&["0.0", "0.0", "0.05"]))];
    let mut maybe = |random: &mut Random, key: &str, value: String| {
        if random.once_in(3) {
            sets.push(format!("{key}={value}"));
        }
    };
    let near = random.within(0.0, 0.6);
    let far = near + random.within(0.01, 2.0);
    maybe(random, "mask", format!("{{near_m={near:.4}, far_m={far:.4}}}"));
    let value = random.below(64) + 1;
    maybe(random, "mask.min_area_px", value.to_string());
    let value = random.below(33);
    maybe(random, "mask.bridge_px", value.to_string());
    let (x, y) = (random.below(200), random.below(200));
    let (width, height) = (1 + random.below(200), 1 + random.below(200));
    maybe(random, "mask.roi", format!("[{x}, {y}, {}, {}]", x + width, y + height));
    let value = 2 + random.below(63);
    maybe(random, "refine.knots", value.to_string());
    let value = *random.pick(&["0.0", "0.5", "1.0"]);
    maybe(random, "refine.distance_weight", value.to_owned());
    let value = random.within(-1.6, 1.6);
    maybe(random, "camera.tilt_rad", format!("{value:.4}"));
    let value = random.within(-3.2, 3.2);
    maybe(random, "camera.roll_rad", format!("{value:.4}"));
    maybe(random, "blade.min_length_m", "0.001".to_owned());
    maybe(random, "blade.min_pixels_across", "0.5".to_owned());
    sets
}

/// Something drawn over the depth so far.
fn draw(frame: &mut DepthFrame, random: &mut Random) {
    let (width, height) = (frame.width, frame.height);
    let counts = *random.pick(&[300, 301, 450, 600, 899, 900]) + random.below(60) as u16;
    let (x0, y0) = (random.within(-5.0, width as f64 + 5.0), random.within(-5.0, height as f64 + 5.0));
    let (dx, dy) = (random.within(-1.0, 1.0), random.within(-1.0, 1.0));
    let size = random.within(0.3, 0.5 * width.max(height) as f64);
    let thin = random.within(0.3, 8.0);
    let slope = random.within(-4.0, 4.0);
    let noise = random.below(12) as u16;
    let kind = random.below(9);
    let mut hash = Random::new(random.number());
    for y in 0..height {
        for x in 0..width {
            let (u, v) = (x as f64 - x0, y as f64 - y0);
            let (along, across) = (u * dx + v * dy, u * dy - v * dx);
            let inside = match kind {
                // A disc, a stroke, a ring, an arc.
                0 => u.hypot(v) < 0.5 * size,
                1 | 2 => across.abs() < thin && along.abs() < size,
                3 => (u.hypot(v) - size).abs() < thin,
                4 => (v - u * u / size.max(1.0)).abs() < thin,
                // A comb, a checkerboard.
                5 => (x / (1 + thin as usize)).is_multiple_of(2) || y < 3,
                6 => (x / (1 + thin as usize) + y / (1 + thin as usize)).is_multiple_of(2),
                // Noise, everything.
                7 => hash.once_in(1 + thin as usize),
                _ => true,
            };
            if inside {
                let depth = f64::from(counts) + slope * along;
                let jitter = if noise > 0 { (hash.number() % u64::from(noise)) as u16 } else { 0 };
                frame.depth[y * width + x] = (depth as u16).saturating_add(jitter);
            }
        }
    }
    if random.once_in(3) {
        let rarely = 2 + random.below(200);
        let to = *random.pick(&[0, 0, 0, u16::MAX, 1]);
        frame.depth.iter_mut().filter(|_| hash.once_in(rarely)).for_each(|counts| *counts = to);
    }
}

fn frame(random: &mut Random) -> DepthFrame {
    let (width, height) = match random.below(400) {
        0 => (1280, 1024),
        1..10 => (320, 240),
        10..20 => (1 + random.below(4), 1 + random.below(4)),
        20..30 => (1, 1 + random.below(200)),
        30..40 => (1 + random.below(200), 1),
        _ => (16 + random.below(160), 16 + random.below(120)),
    };
    let background = *random.pick(&[0, 0, 1300, 1300, 500, u16::MAX]);
    let focal = *random.pick(&[100.0, 150.0, 570.0, 1.0, 100_000.0]);
    let camera = CameraModel { fx: focal, fy: focal, cx: 0.5 * width as f64, cy: 0.5 * height as f64 };
    let depth_unit_m = *random.pick(&[0.001, 0.001, 0.001, 0.0001, 1e-6, 0.1]);
    let depth = vec![background; width * height];
    let mut frame = DepthFrame { width, height, depth, depth_unit_m, timestamp_ns: 1, camera };
    for _ in 0..random.below(7) {
        draw(&mut frame, random);
    }
    frame
}

pub(crate) fn case(random: &mut Random, _folder: &Path) {
    let config = load(None, &settings(random)).expect("settings within their ranges");
    let mut session = Session::new(config.session_params());
    let mut again = Session::new(config.session_params());
    let mut frame = frame(random);
    let twice = random.once_in(4);
    for _ in 0..1 + random.below(4) {
        let capture = session.push(&frame);
        if twice {
            assert!(again.push(&frame) == capture, "the same frames give the same bits");
        }
        for blade in capture.iter().flat_map(|capture| &capture.steps.blades) {
            assert!((2..=64).contains(&blade.knots_in_camera.len()));
            assert!(blade.blade.length_m().is_finite() && blade.blade.length_m() > 0.0);
            assert!(blade.blade.max_width_m().is_finite() && blade.blade.max_width_m() >= 0.0);
            for knot in &blade.knots_in_camera {
                assert!(knot.position.is_finite() && knot.across.is_finite());
                assert!(knot.half_width_left >= 0.0 && knot.half_width_right >= 0.0);
            }
        }
        frame.timestamp_ns = match random.below(8) {
            0 => random.number(),
            1 => 0,
            _ => frame.timestamp_ns.saturating_add(33_333_333),
        };
        if random.once_in(16) {
            frame = self::frame(random);
        }
    }
}

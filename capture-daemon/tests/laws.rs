//! What must hold for whatever is held before the camera.

use std::collections::BTreeSet;

use capture_daemon::frame::{CameraModel, DepthFrame};
use capture_daemon::session::{Capture, Session, SessionParams};
use capture_daemon::stages::blade::CapturedBlade;
use capture_daemon::stages::cover::cover;
use capture_daemon::station::StationParams;
use common::blade::Knot;
use glam::{Vec2, Vec3};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

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

/// The same cases on every run; `SWARD_LAW_CASES` takes more of them.
fn config(cases: u32) -> ProptestConfig {
    let more = std::env::var("SWARD_LAW_CASES").ok().and_then(|cases| cases.parse().ok());
    ProptestConfig {
        cases: more.unwrap_or(cases),
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(7),
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(config(96))]

    #[test]
    fn blades_lie_on_what_is_seen(ellipses in prop::collection::vec(ellipse(), 1..6), noise in 0_u32..12) {
        let frame = frame(&ellipses, noise);
        let Some(capture) = session().push(&frame) else { return Ok(()) };
        for blade in &capture.steps.blades {
            for knot in &blade.knots_in_camera {
                let (x, y) = frame.camera.project(knot.position);
                prop_assert!((-8.0..168.0).contains(&x) && (-8.0..128.0).contains(&y), "a knot at {x}, {y}");
                prop_assert!((0.2..1.1).contains(&knot.position.z), "a knot {} m away", knot.position.z);
                prop_assert!(knot.width() < 1.0, "{} m wide", knot.width());
            }
            // The picture is 1 m wide at 1 m; nothing in it winds about more than twice.
            prop_assert!(blade.blade.length_m() < 2.0, "{} m long", blade.blade.length_m());
        }
    }

    #[test]
    fn no_blade_comes_back_over_itself(ellipses in prop::collection::vec(ellipse(), 1..9), noise in 0_u32..12) {
        let Some(capture) = session().push(&frame(&ellipses, noise)) else { return Ok(()) };
        for blade in &capture.steps.blades {
            let met = met_again(&blade.knots_in_camera);
            prop_assert!(met.is_none(), "{met:?} of {:?}", blade.knots_in_camera);
        }
    }

    #[test]
    fn the_same_frame_gives_the_same_bits(ellipses in prop::collection::vec(ellipse(), 1..4)) {
        let frame = frame(&ellipses, 5);
        prop_assert_eq!(session().push(&frame), session().push(&frame));
    }
}

/// Where a midrib lies on its own earlier part again, and on what: metres along it.
fn met_again(knots: &[Knot]) -> Option<[f32; 2]> {
    const STEPS: usize = 8;
    /// Between its knots a refined midrib cuts its corners.
    const SLACK: f32 = 0.7;
    let mut along_m = 0.0;
    let mut places: Vec<(f32, Vec3, f32)> = Vec::new();
    for pair in knots.windows(2) {
        let step_m = pair[0].position.distance(pair[1].position) / STEPS as f32;
        for share in (0..STEPS).map(|step| step as f32 / STEPS as f32) {
            let width_m = pair[0].width() + (pair[1].width() - pair[0].width()) * share;
            places.push((along_m, pair[0].position.lerp(pair[1].position, share), 0.5 * width_m));
            along_m += step_m;
        }
    }
    let meets = |earlier: &(f32, Vec3, f32), later: &(f32, Vec3, f32)| {
        let half_m = earlier.2.max(later.2);
        later.0 - earlier.0 > 5.0 * half_m && earlier.1.distance(later.1) < SLACK * half_m
    };
    places.iter().enumerate().find_map(|(index, earlier)| {
        let later = places[index..].iter().find(|later| meets(earlier, later))?;
        Some([earlier.0, later.0])
    })
}

/// A blade drawn into a picture: an arc from its root, tapered to its tip, lying in a plane.
#[derive(Clone, Copy, Debug)]
struct Drawn {
    /// Length, pixels.
    length: f64,
    /// Half of the width at its widest, pixels.
    half: f64,
    /// How far it bends to the right on its way, radians.
    bend: f64,
    /// Where it leans at its root, radians to the right of upwards.
    lean: f64,
    /// Depth at its root, millimetres.
    depth_mm: f64,
    /// Rise of depth towards its tip, millimetres a pixel.
    slope: f64,
}

fn drawn() -> impl Strategy<Value = Drawn> {
    (45.0..85.0, 3.0..6.0, -0.7..0.7, -0.25..0.25, 450.0..700.0, -0.5..0.5).prop_map(
        |(length, half, bend, lean, depth_mm, slope)| Drawn { length, half, bend, lean, depth_mm, slope },
    )
}

impl Drawn {
    /// Its midrib from its root at the origin, y up.
    fn midrib(&self) -> Vec<[f64; 2]> {
        const STEPS: usize = 60;
        let step = self.length / STEPS as f64;
        let (mut x, mut y) = (0.0, 0.0);
        let mut points = vec![[x, y]];
        for index in 0..STEPS {
            let angle = self.lean + self.bend * (index as f64 + 0.5) / STEPS as f64;
            (x, y) = (x + step * angle.sin(), y + step * angle.cos());
            points.push([x, y]);
        }
        points
    }

    /// Half of its width at a share of its length.
    fn half_at(&self, share: f64) -> f64 {
        self.half * (1.0 - share).powf(0.7) * (0.7 + 0.6 * share.min(0.5))
    }
}

/// Blades with their roots at these pixels, before a wall.
fn picture(width: usize, height: usize, blades: &[(Drawn, [f64; 2])]) -> DepthFrame {
    let mut depth = vec![1300_u16; width * height];
    for (blade, [root_x, root_y]) in blades {
        let midrib = blade.midrib();
        for (index, counts) in depth.iter_mut().enumerate() {
            let (x, y) = ((index % width) as f64 - root_x, root_y - (index / width) as f64);
            if x.hypot(y) > blade.length + blade.half {
                continue;
            }
            let of = |(step, point): (usize, &[f64; 2])| {
                let share = step as f64 / (midrib.len() - 1) as f64;
                ((x - point[0]).hypot(y - point[1]) - blade.half_at(share), share)
            };
            let (beyond, share) = midrib
                .iter()
                .enumerate()
                .map(of)
                .fold((1e9, 0.0), |best, found| if found.0 < best.0 { found } else { best });
            if beyond < 0.0 {
                *counts = (blade.depth_mm + blade.slope * share * blade.length) as u16;
            }
        }
    }
    let (cx, cy) = (0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0));
    let camera = CameraModel { fx: 200.0, fy: 200.0, cx, cy };
    DepthFrame { width, height, depth, depth_unit_m: 0.001, timestamp_ns: 1, camera }
}

/// The picture moved by whole pixels, with its camera.
fn shifted(frame: &DepthFrame, dx: isize, dy: isize) -> DepthFrame {
    let at = |index: usize| {
        let (x, y) = ((index % frame.width) as isize - dx, (index / frame.width) as isize - dy);
        let inside = x >= 0 && y >= 0 && x < frame.width as isize && y < frame.height as isize;
        if inside { frame.depth[y as usize * frame.width + x as usize] } else { 1300 }
    };
    let CameraModel { cx, cy, .. } = frame.camera;
    DepthFrame {
        depth: (0..frame.depth.len()).map(at).collect(),
        camera: CameraModel { cx: cx + dx as f64, cy: cy + dy as f64, ..frame.camera },
        ..frame.clone()
    }
}

/// The picture as in a mirror, with its camera.
fn mirrored(frame: &DepthFrame) -> DepthFrame {
    let rows = frame.depth.chunks(frame.width);
    let cx = frame.width as f64 - 1.0 - frame.camera.cx;
    DepthFrame {
        depth: rows.flat_map(|row| row.iter().rev().copied()).collect(),
        camera: CameraModel { cx, ..frame.camera },
        ..frame.clone()
    }
}

/// The picture with every pixel doubled both ways, with its camera.
fn doubled(frame: &DepthFrame) -> DepthFrame {
    let (width, height) = (2 * frame.width, 2 * frame.height);
    let at = |index: usize| frame.depth[index / width / 2 * frame.width + index % width / 2];
    let CameraModel { fx, fy, cx, cy } = frame.camera;
    DepthFrame {
        width,
        height,
        depth: (0..width * height).map(at).collect(),
        // Pixel centres are at integers.
        camera: CameraModel { fx: 2.0 * fx, fy: 2.0 * fy, cx: 2.0 * cx + 0.5, cy: 2.0 * cy + 0.5 },
        ..frame.clone()
    }
}

/// What the stages make of a picture.
fn capture(frame: &DepthFrame) -> Capture {
    session().push(frame).expect("something is there")
}

/// A blade's midrib in the camera frame, and its widths to the left and to the right; metres.
type Shape = Vec<(Vec3, [f32; 2])>;

fn shapes(capture: &Capture) -> Vec<Shape> {
    let shape = |blade: &CapturedBlade| {
        let of = |knot: &Knot| (knot.position, [knot.half_width_left, knot.half_width_right]);
        blade.knots_in_camera.iter().map(of).collect()
    };
    capture.steps.blades.iter().map(shape).collect()
}

fn length(shape: &Shape) -> f32 {
    shape.windows(2).map(|pair| pair[0].0.distance(pair[1].0)).sum()
}

/// The knots of a shape that are farther from its ends than a fifth of its length: a root that is drawn
/// round is as wide as the blade or runs out in its round, which a rounding can decide.
fn inner(shape: &Shape) -> Vec<(Vec3, [f32; 2])> {
    let all = length(shape);
    let mut along = 0.0;
    let mut knots = Vec::new();
    for (index, knot) in shape.iter().enumerate() {
        along += if index > 0 { knot.0.distance(shape[index - 1].0) } else { 0.0 };
        if (0.2..0.8).contains(&(along / all)) {
            knots.push(*knot);
        }
    }
    knots
}

/// Asserts that two lists of shapes have the same shapes, in whatever order: inner knots within
/// `tolerance` of the other's midrib, widths there within the same, and lengths within `ends`. Where
/// exactly a blade ends is a question of less than its width, which a rounding can decide otherwise.
fn same_shapes(one: &[Shape], other: &[Shape], tolerance: f32, ends: f32) -> Result<(), TestCaseError> {
    prop_assert_eq!(one.len(), other.len(), "blades");
    // Of the nearest place on a midrib, how far it is, and the widths there.
    let nearest = |point: Vec3, shape: &Shape| {
        let of = |pair: &[(Vec3, [f32; 2])]| {
            let ((a, from), (b, to)) = (pair[0], pair[1]);
            let along = ((point - a).dot(b - a) / (b - a).length_squared().max(1e-12)).clamp(0.0, 1.0);
            let width = [0, 1].map(|side| from[side] + (to[side] - from[side]) * along);
            (point.distance(a + (b - a) * along), width)
        };
        let nearer =
            |best: (f32, [f32; 2]), found: (f32, [f32; 2])| if found.0 < best.0 { found } else { best };
        shape.windows(2).map(of).fold((f32::MAX, [0.0; 2]), nearer)
    };
    let mut left: Vec<&Shape> = other.iter().collect();
    for shape in one {
        let knots = inner(shape);
        let off = |other: &Shape| knots.iter().map(|(point, _)| nearest(*point, other).0).fold(0.0, f32::max);
        let (index, distance) = left
            .iter()
            .map(|other| off(other))
            .enumerate()
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .expect("as many as there are");
        prop_assert!(distance <= tolerance, "a knot is {distance} off, {tolerance} are allowed");
        let other = left.swap_remove(index);
        let (long, expected) = (length(shape), length(other));
        prop_assert!((long - expected).abs() <= ends, "{long} long, expected {expected}");
        for (point, widths) in knots {
            let (_, expected) = nearest(point, other);
            for side in [0, 1] {
                let off = (widths[side] - expected[side]).abs();
                prop_assert!(off <= tolerance, "a half width is {off} off, {tolerance} are allowed");
            }
        }
    }
    Ok(())
}

/// Size of the pictures that blades are drawn into.
const SIZE: (usize, usize) = (372, 140);
/// A pixel at 0.7 m, metres.
const PIXEL_M: f32 = 0.0035;
/// Columns of roots that lie so far apart that no blades touch, nor the border when they are shifted: the
/// farthest that a blade reaches aside is 85 px · sin 0.6 and half of its width.
const SLOTS: [f64; 3] = [70.0, 186.0, 302.0];
const ROOT_Y: f64 = 118.0;

/// Blades side by side, some slots empty.
fn side_by_side(blades: &[Drawn]) -> DepthFrame {
    let placed: Vec<(Drawn, [f64; 2])> =
        blades.iter().zip(SLOTS).map(|(blade, x)| (*blade, [x, ROOT_Y])).collect();
    picture(SIZE.0, SIZE.1, &placed)
}

/// Whether a polygon holds a point, by the even–odd rule.
fn holds(polygon: &[Vec2], point: Vec2) -> bool {
    let mut inside = false;
    for index in 0..polygon.len() {
        let (a, b) = (polygon[index], polygon[(index + 1) % polygon.len()]);
        if (a.y > point.y) != (b.y > point.y) && point.x < a.x + (b.x - a.x) * (point.y - a.y) / (b.y - a.y) {
            inside = !inside;
        }
    }
    inside
}

/// Distance of a point from the border of a polygon.
fn from_border(polygon: &[Vec2], point: Vec2) -> f32 {
    let edges = (0..polygon.len()).map(|index| (polygon[index], polygon[(index + 1) % polygon.len()]));
    let to_edge = |(a, b): (Vec2, Vec2)| {
        let along = ((point - a).dot(b - a) / (b - a).length_squared().max(1e-12)).clamp(0.0, 1.0);
        point.distance(a + (b - a) * along)
    };
    edges.map(to_edge).fold(f32::MAX, f32::min)
}

proptest! {
    #![proptest_config(config(32))]

    #[test]
    fn what_is_shifted_gives_the_same_blades(
        blades in prop::collection::vec(drawn(), 1..4), dx in -12_isize..12, dy in -12_isize..12,
    ) {
        let frame = side_by_side(&blades);
        let here = capture(&frame);
        prop_assert_eq!(here.steps.blades.len(), blades.len());
        same_shapes(&shapes(&here), &shapes(&capture(&shifted(&frame, dx, dy))), 0.5 * PIXEL_M, 6.0 * PIXEL_M)?;
    }

    #[test]
    fn what_is_mirrored_gives_mirrored_blades(blades in prop::collection::vec(drawn(), 1..4)) {
        let frame = side_by_side(&blades);
        let mut reflected = shapes(&capture(&mirrored(&frame)));
        for (point, [left, right]) in reflected.iter_mut().flatten() {
            point.x = -point.x;
            std::mem::swap(left, right);
        }
        same_shapes(&shapes(&capture(&frame)), &reflected, 0.35 * PIXEL_M, 6.0 * PIXEL_M)?;
    }

    #[test]
    fn twice_the_resolution_gives_the_same_blades(blades in prop::collection::vec(drawn(), 1..4)) {
        let frame = side_by_side(&blades);
        same_shapes(&shapes(&capture(&frame)), &shapes(&capture(&doubled(&frame))), 0.6 * PIXEL_M, 8.0 * PIXEL_M)?;
    }

    #[test]
    fn other_places_of_the_same_blobs_give_the_same_blades(
        (blades, order) in prop::collection::vec(drawn(), 3)
            .prop_flat_map(|blades| (Just(blades), Just(vec![0, 1, 2]).prop_shuffle())),
    ) {
        // As far from the picture's middle the same blade is seen alike: shapes in pixels are compared.
        let in_pixels = |frame: &DepthFrame, slot_of: &dyn Fn(usize) -> usize| {
            let mut shapes = shapes(&capture(frame));
            for (slot, shape) in shapes.iter_mut().enumerate() {
                for (point, widths) in shape.iter_mut() {
                    let (x, y) = frame.camera.project(*point);
                    let scale = frame.camera.fx as f32 / point.z;
                    // The blade's own number is kept apart as a third coordinate.
                    let number = 1000.0 * slot_of(slot) as f32;
                    *point = Vec3::new((x - SLOTS[slot]) as f32, y as f32, number);
                    *widths = widths.map(|width| width * scale);
                }
            }
            shapes
        };
        let placed: Vec<Drawn> = order.iter().map(|index| blades[*index]).collect();
        let one = in_pixels(&side_by_side(&blades), &|slot| slot);
        let other = in_pixels(&side_by_side(&placed), &|slot| order[slot]);
        prop_assert_eq!(one.len(), 3);
        // A root seen from the side is a little wider: tilt of the ray, not of the blade.
        same_shapes(&one, &other, 0.5, 6.0)?;
    }

    #[test]
    fn a_skeleton_lies_inside_its_contour(blades in prop::collection::vec(drawn(), 1..4)) {
        let steps = capture(&side_by_side(&blades)).steps;
        prop_assert_eq!(steps.skeletons.len(), blades.len());
        for skeleton in &steps.skeletons {
            let count = skeleton.stations.len();
            for (index, station) in skeleton.stations.iter().enumerate() {
                prop_assert!(station.left_px >= 0.0 && station.right_px >= 0.0);
                let inside = steps.outlines.iter().any(|outline| holds(&outline.points, station.mid));
                let off = steps.outlines.iter().map(|outline| from_border(&outline.points, station.mid));
                let off = if inside { 0.0 } else { off.fold(f32::MAX, f32::min) };
                // A tip that is thinner than a pixel is carried on by its taper.
                let beside_an_end = index < count / 10 || index >= count - count / 10;
                let allowed = if beside_an_end { 0.1 * skeleton.length_px } else { 0.1 };
                prop_assert!(off <= allowed, "station {index} at {} is {off} px outside of a blade of {} px", station.mid, skeleton.length_px);
            }
        }
    }

    #[test]
    fn half_widths_are_not_negative(ellipses in prop::collection::vec(ellipse(), 1..6), noise in 0_u32..12) {
        let Some(capture) = session().push(&frame(&ellipses, noise)) else { return Ok(()) };
        for station in capture.steps.skeletons.iter().flat_map(|skeleton| &skeleton.stations) {
            prop_assert!(station.left_px >= 0.0 && station.right_px >= 0.0, "{station:?}");
        }
        for knot in capture.steps.blades.iter().flat_map(|blade| &blade.knots_in_camera) {
            prop_assert!(knot.half_width_left >= 0.0 && knot.half_width_right >= 0.0, "{knot:?}");
        }
    }

    #[test]
    fn partition_covers_a_blob_once(
        blades in prop::collection::vec(drawn(), 1..4), how in 0..3,
    ) {
        let middle = SLOTS[1];
        // `apart_mm`: how far each lies behind the one before it.
        let leaning = |apart: f64, apart_px: f64, apart_mm: f64| {
            let placed = blades.iter().enumerate().map(|(index, blade)| {
                let aside = index as f64 - 0.5 * (blades.len() - 1) as f64;
                let lean = apart * aside;
                let (bend, depth_mm, slope) = (0.3 * lean, 600.0 + apart_mm * index as f64, 0.0);
                (Drawn { lean, bend, depth_mm, slope, ..*blade }, [middle + apart_px * aside, ROOT_Y])
            });
            picture(SIZE.0, SIZE.1, &placed.collect::<Vec<_>>())
        };
        let frame = match how {
            0 => side_by_side(&blades),
            // From one root, leaning apart, so that they part above it.
            1 => leaning(0.55, 0.0, 0.0),
            // Rooted apart and leaning together, one before the other: they cross.
            _ => leaning(-0.6, 36.0, 40.0),
        };
        let steps = capture(&frame).steps;
        let of = cover(&steps.mask, &steps.parts);
        let polygons: Vec<Vec<Vec2>> = steps.parts.iter().map(|part| {
            part.left.points.iter().chain(part.right.points.iter().rev()).copied().collect()
        }).collect();
        let (blobs, pieces) = (&steps.mask.blobs.of, &steps.mask.pieces.of);
        let has_part: BTreeSet<u16> =
            (0..of.len()).filter(|index| of[*index] != 0).map(|index| blobs[index]).collect();
        let (mut within, mut all) = (0, 0);
        for (index, part) in of.iter().enumerate() {
            let pixel = Vec2::new((index % SIZE.0) as f32, (index / SIZE.0) as f32);
            if blobs[index] == 0 {
                prop_assert_eq!(*part, 0, "{} is of no blob", pixel);
                continue;
            }
            prop_assert!(has_part.contains(&blobs[index]), "{pixel} is of a blob without a part");
            prop_assert!(*part != 0, "{pixel} is of no part");
            let near_a_border = polygons.iter().any(|polygon| from_border(polygon, pixel) < 0.75);
            if pieces[index] == 0 || near_a_border {
                continue;
            }
            let of_piece = |index: &usize| steps.parts[*index].label == pieces[pixel.y as usize * SIZE.0 + pixel.x as usize];
            let holding: Vec<usize> =
                (0..polygons.len()).filter(of_piece).filter(|index| holds(&polygons[*index], pixel)).collect();
            prop_assert!(holding.len() <= 1, "{pixel} is in the parts {holding:?}");
            if let [only] = holding[..] {
                prop_assert_eq!(*part as usize, only + 1, "{} is in another part", pixel);
            }
            (within, all) = (within + holding.len(), all + 1);
        }
        // What is shared at a base is the smaller part.
        prop_assert!(2 * within > all, "{within} of {all} pixels lie between the sides of a part");
    }
}

//! Lens distortion, and undoing it in a depth image.

use crate::frame::{CameraModel, DepthFrame};

/// Why a distortion cannot be undone.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DistortionError {
    /// A model that is not known here.
    #[error(
        "the distortion model is {0:?}; expected plumb_bob or rational_polynomial, or coefficients that are all 0; record a rectified depth image"
    )]
    Model(String),
    /// Coefficients that do not fit the model.
    #[error("the distortion model {model} has {found} coefficients; expected {expected}")]
    Count {
        /// The model.
        model: &'static str,
        /// How many there are.
        found: usize,
        /// How many it has.
        expected: &'static str,
    },
    /// A coefficient that is no number.
    #[error("the distortion has a coefficient that is not a finite number")]
    NotFinite,
}

/// The distortion of a lens: where in the image the ray through (x, y, 1) of the camera frame falls.
#[derive(Clone, Debug, PartialEq)]
pub struct Distortion {
    model: &'static str,
    coefficients: Vec<f64>,
}

/// Radial and tangential coefficients; OpenCV's k1 k2 p1 p2 k3.
const PLUMB_BOB: &str = "plumb_bob";
/// The same with k4 k5 k6 of a denominator.
const RATIONAL_POLYNOMIAL: &str = "rational_polynomial";

impl Default for Distortion {
    fn default() -> Self {
        Self { model: PLUMB_BOB, coefficients: Vec::new() }
    }
}

impl Distortion {
    /// A distortion by its name and coefficients as in `sensor_msgs/msg/CameraInfo`. Whatever the name,
    /// no coefficients and zeros are no distortion.
    ///
    /// # Errors
    /// When it is not one that can be undone.
    pub fn new(model: &str, coefficients: &[f64]) -> Result<Self, DistortionError> {
        if coefficients.iter().all(|&coefficient| coefficient == 0.0) {
            return Ok(Self::default());
        }
        let (model, counts, expected): (_, &[usize], _) = match model {
            PLUMB_BOB => (PLUMB_BOB, &[4, 5], "4 or 5"),
            RATIONAL_POLYNOMIAL => (RATIONAL_POLYNOMIAL, &[4, 5, 8], "4, 5 or 8"),
            other => return Err(DistortionError::Model(other.to_owned())),
        };
        if !coefficients.iter().all(|coefficient| coefficient.is_finite()) {
            return Err(DistortionError::NotFinite);
        }
        // Some writers fill up with zeros: of a thin prism, of a tilted sensor.
        let used =
            coefficients.iter().rposition(|&coefficient| coefficient != 0.0).map_or(0, |last| last + 1);
        let most = counts.last().copied().unwrap_or(0);
        let filled_up = coefficients.len() > most && used <= most;
        if !(filled_up || counts.contains(&coefficients.len())) {
            return Err(DistortionError::Count { model, found: coefficients.len(), expected });
        }
        let coefficients = coefficients[..coefficients.len().min(most)].to_vec();
        Ok(Self { model, coefficients })
    }

    /// Its name in ROS.
    pub fn model(&self) -> &'static str {
        self.model
    }

    /// Its coefficients in OpenCV's order; none for a lens without distortion.
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }

    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        self.coefficients.is_empty()
    }

    /// k1 k2 p1 p2 k3 k4 k5 k6.
    fn all(&self) -> [f64; 8] {
        let mut all = [0.0; 8];
        all[..self.coefficients.len()].copy_from_slice(&self.coefficients);
        all
    }

    /// Where the ray through (`x`, `y`, 1) falls, for z = 1.
    ///
    /// # Source
    /// OpenCV, "Camera Calibration and 3D Reconstruction", detailed description; the Brown–Conrady model.
    fn distort(&self, x: f64, y: f64) -> (f64, f64) {
        let [_, _, p1, p2, ..] = self.all();
        let r2 = x * x + y * y;
        let radial = self.radial(r2);
        let distorted_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let distorted_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
        (distorted_x, distorted_y)
    }

    /// By how much a ray's distance from the axis is stretched; of its square.
    fn radial(&self, r2: f64) -> f64 {
        let [k1, k2, _, _, k3, k4, k5, k6] = self.all();
        (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    }

    /// Up to which distance from the axis a ray farther out falls farther out, at most `farthest`: what
    /// the polynomials say beyond is not what a lens does.
    fn valid_radius(&self, farthest: f64) -> f64 {
        const STEPS: usize = 2048;
        let mut before = 0.0;
        for step in 1..=STEPS {
            let radius = farthest * step as f64 / STEPS as f64;
            let distorted = radius * self.radial(radius * radius);
            // Not a number counts as falling back.
            if distorted.partial_cmp(&before) != Some(std::cmp::Ordering::Greater) {
                return farthest * (step - 1) as f64 / STEPS as f64;
            }
            before = distorted;
        }
        farthest
    }
}

/// For each pixel of an image without distortion, the pixel of the distorted one that is shown there.
///
/// Both have the same intrinsics and size. The nearest pixel is taken, so that depths are never mixed;
/// what the distorted image does not show has no reading.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rectifier {
    width: usize,
    height: usize,
    /// Index of the pixel, or [`NOWHERE`].
    from: Vec<u32>,
}

/// The distorted image does not show it.
const NOWHERE: u32 = u32::MAX;

impl Rectifier {
    /// For images of that size. O(pixels).
    pub(super) fn new(
        distortion: &Distortion,
        camera: &CameraModel,
        (width, height): (usize, usize),
    ) -> Self {
        let ray = |u: f64, v: f64| ((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
        let (right, bottom) = (width as f64 - 1.0, height as f64 - 1.0);
        let corners = [(0.0, 0.0), (right, 0.0), (0.0, bottom), (right, bottom)];
        let farthest =
            corners.map(|(u, v)| ray(u, v)).map(|(x, y)| x.hypot(y)).into_iter().fold(0.0, f64::max);
        let valid = distortion.valid_radius(farthest);
        let pixels = (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
        let from = pixels
            .map(|(u, v)| {
                let (x, y) = ray(u as f64, v as f64);
                if x.hypot(y) > valid {
                    return NOWHERE;
                }
                let (x, y) = distortion.distort(x, y);
                let (u, v) = ((x * camera.fx + camera.cx).round(), (y * camera.fy + camera.cy).round());
                let inside = (0.0..=right).contains(&u) && (0.0..=bottom).contains(&v);
                if inside { (v as usize * width + u as usize) as u32 } else { NOWHERE }
            })
            .collect();
        Self { width, height, from }
    }

    /// Whether it is for images of the size of `frame`.
    pub(super) fn fits(&self, frame: &DepthFrame) -> bool {
        (self.width, self.height) == (frame.width, frame.height)
    }

    /// Undoes the distortion of a frame that it fits.
    pub(super) fn rectify(&self, frame: &mut DepthFrame) {
        let reading = |&from: &u32| frame.depth.get(from as usize).copied().unwrap_or(0);
        frame.depth = self.from.iter().map(reading).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: CameraModel = CameraModel { fx: 200.0, fy: 190.0, cx: 80.3, cy: 61.0 };
    const SIZE: (usize, usize) = (160, 120);

    fn rectifier(model: &str, coefficients: &[f64]) -> Rectifier {
        Rectifier::new(&Distortion::new(model, coefficients).expect("known"), &CAMERA, SIZE)
    }

    /// Where `cv2.initUndistortRectifyMap(K, d, None, K, (160, 120), CV_32FC1)` of OpenCV looks.
    #[test]
    fn opencv_looks_at_the_same_places() {
        let check = |model, coefficients: &[f64], expected: &[(usize, usize, f64, f64)]| {
            let distortion = Distortion::new(model, coefficients).expect("known");
            let rectifier = Rectifier::new(&distortion, &CAMERA, SIZE);
            for &(u, v, expected_x, expected_y) in expected {
                let (x, y) = ((u as f64 - CAMERA.cx) / CAMERA.fx, (v as f64 - CAMERA.cy) / CAMERA.fy);
                let (x, y) = distortion.distort(x, y);
                let (x, y) = (x * CAMERA.fx + CAMERA.cx, y * CAMERA.fy + CAMERA.cy);
                assert!((x - expected_x).abs() < 1e-3 && (y - expected_y).abs() < 1e-3, "{u}, {v}: {x}, {y}");
                let nearest = expected_y.round() as usize * SIZE.0 + expected_x.round() as usize;
                assert_eq!(rectifier.from[v * SIZE.0 + u] as usize, nearest, "{u}, {v}");
            }
            assert!(!rectifier.from.contains(&NOWHERE));
        };
        check(
            "plumb_bob",
            &[-0.3, 0.1, 0.002, -0.001, 0.05],
            &[
                (0, 0, 5.717, 4.484),
                (159, 0, 153.287, 4.486),
                (0, 119, 5.329, 115.211),
                (159, 119, 153.673, 115.205),
                (80, 61, 80.000, 61.000),
                (40, 30, 40.791, 30.644),
                (130, 90, 128.758, 89.318),
                (5, 64, 7.955, 63.935),
            ],
        );
        check(
            "rational_polynomial",
            &[0.4, -0.2, 0.001, -0.002, 0.1, 0.6, -0.15, 0.05],
            &[
                (0, 0, 3.690, 2.934),
                (159, 0, 155.009, 3.062),
                (0, 119, 3.462, 116.475),
                (159, 119, 155.242, 116.351),
                (80, 61, 80.000, 61.000),
                (40, 30, 40.483, 30.405),
                (130, 90, 129.111, 89.517),
                (5, 64, 6.863, 63.950),
            ],
        );
    }

    #[test]
    fn a_point_that_a_lens_bends_is_put_back() {
        let distortion = Distortion::new("plumb_bob", &[-0.3, 0.1, 0.002, -0.001, 0.0]).expect("known");
        let rectifier = Rectifier::new(&distortion, &CAMERA, SIZE);
        // Each pixel holds what direction it is of: its own index.
        for (u, v) in [(5, 5), (80, 61), (150, 10), (20, 110)] {
            let (x, y) = ((u as f64 - CAMERA.cx) / CAMERA.fx, (v as f64 - CAMERA.cy) / CAMERA.fy);
            let (x, y) = distortion.distort(x, y);
            let from = rectifier.from[v * SIZE.0 + u] as usize;
            let (du, dv) = (from % SIZE.0, from / SIZE.0);
            assert!((x * CAMERA.fx + CAMERA.cx - du as f64).abs() <= 0.5, "{u}, {v}");
            assert!((y * CAMERA.fy + CAMERA.cy - dv as f64).abs() <= 0.5, "{u}, {v}");
        }
        // A barrel pulls inwards: the corner shows what was nearer to the middle.
        assert_ne!(rectifier.from[0], 0);
    }

    #[test]
    fn a_pincushion_has_no_reading_at_its_corners_and_mixes_no_depths() {
        let rectifier = rectifier("plumb_bob", &[0.4, 0.0, 0.0, 0.0]);
        let mut frame = DepthFrame {
            width: SIZE.0,
            height: SIZE.1,
            depth: (0..SIZE.0 * SIZE.1).map(|index| if index % 2 == 0 { 500 } else { 900 }).collect(),
            depth_unit_m: 0.001,
            timestamp_ns: 0,
            camera: CAMERA,
        };
        rectifier.rectify(&mut frame);
        assert_eq!(frame.depth[0], 0);
        assert!(frame.depth.iter().all(|depth| [0, 500, 900].contains(depth)));
        assert!(frame.depth.iter().filter(|&&depth| depth > 0).count() > 15_000);
    }

    #[test]
    fn what_polynomials_say_beyond_their_turn_is_not_believed() {
        // r·(1 − r²) turns at 0.577; the corners are at 0.51.
        assert_eq!(
            rectifier("plumb_bob", &[-1.0, 0.0, 0.0, 0.0]).from.iter().filter(|&&i| i == NOWHERE).count(),
            0
        );
        // And this one at 0.333.
        let folded = rectifier("plumb_bob", &[-3.0, 0.0, 0.0, 0.0]);
        assert_eq!(folded.from[0], NOWHERE);
        assert_ne!(folded.from[61 * SIZE.0 + 80], NOWHERE);
    }

    #[test]
    fn names_and_counts_are_checked() {
        let new = |model, coefficients: &[f64]| Distortion::new(model, coefficients).map(|found| found.model);
        assert_eq!(new("", &[]), Ok(PLUMB_BOB));
        assert_eq!(new("equidistant", &[0.0; 4]), Ok(PLUMB_BOB));
        assert_eq!(new("rational_polynomial", &[0.1; 8]), Ok(RATIONAL_POLYNOMIAL));
        let mut tilted = vec![0.1; 8];
        tilted.extend([0.0; 6]);
        assert_eq!(new("rational_polynomial", &tilted), Ok(RATIONAL_POLYNOMIAL));
        tilted[9] = 0.1;
        assert!(matches!(new("rational_polynomial", &tilted), Err(DistortionError::Count { found: 14, .. })));
        assert!(matches!(new("plumb_bob", &[0.1; 3]), Err(DistortionError::Count { found: 3, .. })));
        assert!(matches!(new("plumb_bob", &[0.1; 8]), Err(DistortionError::Count { found: 8, .. })));
        for model in ["equidistant", "fisheye", ""] {
            assert_eq!(new(model, &[0.1; 4]), Err(DistortionError::Model(model.to_owned())));
        }
        assert_eq!(new("plumb_bob", &[f64::NAN; 5]), Err(DistortionError::NotFinite));
    }
}

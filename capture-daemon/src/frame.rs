//! A depth frame and the camera that took it.

use glam::{Mat3, Vec2, Vec3};

/// Most pixels of a frame: 1280×1024.
pub const MAX_PIXELS: usize = 1280 * 1024;

/// A pinhole camera without distortion: focal lengths and principal point in pixels, pixel centres
/// at integers. Camera frame: x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraModel {
    /// Focal length along x, pixels, > 0.
    pub fx: f64,
    /// Focal length along y, pixels, > 0.
    pub fy: f64,
    /// Principal point, pixels from the first column's centre.
    pub cx: f64,
    /// Principal point, pixels from the first row's centre.
    pub cy: f64,
}

impl CameraModel {
    /// The point in the camera frame, metres, that pixel (`u`, `v`) sees at depth `z` metres.
    pub fn deproject(&self, u: f64, v: f64, z: f64) -> Vec3 {
        Vec3::new(((u - self.cx) / self.fx * z) as f32, ((v - self.cy) / self.fy * z) as f32, z as f32)
    }

    /// The pixel that sees a point of the camera frame (z > 0).
    pub fn project(&self, point: Vec3) -> (f64, f64) {
        let [x, y, z] = point.as_dvec3().to_array();
        (self.fx * x / z + self.cx, self.fy * y / z + self.cy)
    }

    /// Whether the numbers can be a camera: finite, focal lengths above 0.
    pub fn is_valid(&self) -> bool {
        let finite = [self.fx, self.fy, self.cx, self.cy].iter().all(|number| number.is_finite());
        finite && self.fx > 0.0 && self.fy > 0.0
    }
}

/// How the camera stands against gravity.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct CameraPose {
    /// How far it looks down, radians.
    pub tilt_rad: f32,
    /// How far it is turned clockwise about its own axis, radians.
    pub roll_rad: f32,
}

impl CameraPose {
    /// Rotation from the camera frame to the blade frame: +y up, +z horizontally towards the camera.
    pub fn blade_from_camera(&self) -> Mat3 {
        let level_from_camera = Mat3::from_rotation_x(-self.tilt_rad) * Mat3::from_rotation_z(self.roll_rad);
        Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0)) * level_from_camera
    }

    /// Where gravity points in the image; unit vector (straight down for a camera that looks along
    /// gravity).
    pub fn down_in_image(&self) -> Vec2 {
        (self.blade_from_camera().transpose() * Vec3::NEG_Y).truncate().normalize_or(Vec2::Y)
    }
}

/// One depth image: row-major, 0 means no reading.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthFrame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` readings in `depth_unit_m`; 0: no reading.
    pub depth: Vec<u16>,
    /// Metres of one count.
    pub depth_unit_m: f64,
    /// When it was taken, nanoseconds since 1970.
    pub timestamp_ns: u64,
    /// The camera that took it.
    pub camera: CameraModel,
}

impl DepthFrame {
    /// Depth at a pixel, metres; `None` without a reading or outside of the image.
    pub fn depth_m(&self, x: usize, y: usize) -> Option<f64> {
        let inside = x < self.width && y < self.height;
        let counts = if inside { self.depth[y * self.width + x] } else { 0 };
        (counts != 0).then(|| f64::from(counts) * self.depth_unit_m)
    }
}

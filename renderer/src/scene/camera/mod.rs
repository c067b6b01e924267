//! From where the meadow is seen.

use glam::camera::rh::proj::directx;
use glam::{Mat4, Vec2, Vec3, Vec4};

use super::terrain;

pub mod drive;
pub mod path;
pub mod views;

/// Distance of the near plane, metres.
const NEAR_M: f32 = 0.04;

/// Seconds after which [`Camera::drifted`] comes back to its start.
pub const WALK_S: f32 = 4096.0;

/// A camera that stands on the ground. World: x right, y up, z towards the viewer at heading 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Where it stands, (x, z) in metres.
    pub foot: Vec2,
    /// Height of the eye above the ground, metres.
    pub eye_height_m: f32,
    /// Direction of view, radians clockwise from −z seen from above.
    pub heading_rad: f32,
    /// Radians above the horizon.
    pub pitch_rad: f32,
    /// Vertical field of view, radians.
    pub fov_y_rad: f32,
}

impl Camera {
    /// The eye, metres.
    pub fn eye_in_world(&self) -> Vec3 {
        Vec3::new(self.foot.x, terrain::height_m(self.foot) + self.eye_height_m, self.foot.y)
    }

    /// The direction of view, unit.
    pub fn forward(&self) -> Vec3 {
        let (sin_heading, cos_heading) = self.heading_rad.sin_cos();
        let (sin_pitch, cos_pitch) = self.pitch_rad.sin_cos();
        Vec3::new(sin_heading * cos_pitch, sin_pitch, -cos_heading * cos_pitch)
    }

    /// World to clip space for a picture of `aspect` (width over height): reversed depth, 1 at the
    /// near plane, 0 infinitely far.
    pub fn clip_from_world(&self, aspect: f32) -> Mat4 {
        let eye = self.eye_in_world();
        // Straight up and down, the heading says where the picture's top is.
        let up = Vec3::new(self.heading_rad.sin(), 0.0, -self.heading_rad.cos()) * -self.pitch_rad.sin()
            + Vec3::Y * self.pitch_rad.cos();
        let view_from_world = glam::camera::rh::view::look_to_mat4(eye, self.forward(), up);
        directx::perspective_infinite_reverse(self.fov_y_rad, aspect, NEAR_M) * view_from_world
    }

    /// The camera `seconds` into an unhurried walk: a circle of 4 m across, swaying its view. Comes
    /// back to where it was after [`WALK_S`], so that it never strays to where numbers get coarse.
    pub fn drifted(&self, seconds: f32) -> Self {
        let turns = |count: f32| std::f32::consts::TAU * count * seconds / WALK_S;
        let (sin, cos) = turns(16.0).sin_cos();
        let step = Vec2::new(1.0 - cos, -sin) * 2.0;
        Self {
            foot: self.foot + Vec2::from_angle(self.heading_rad).rotate(step),
            heading_rad: self.heading_rad + 0.10 * turns(61.0).sin(),
            ..*self
        }
    }
}

/// The five planes of a view without a far end, pointing inwards: `plane · (p, 1) ≥ 0` inside, in
/// metres.
///
/// # Source
/// Gribb and Hartmann, "Fast Extraction of Viewing Frustum Planes", 2001; the near plane is the one
/// where reversed depth is 1.
pub fn frustum_planes(clip_from_world: Mat4) -> [Vec4; 5] {
    let (x, y, z, w) =
        (clip_from_world.row(0), clip_from_world.row(1), clip_from_world.row(2), clip_from_world.row(3));
    [w + x, w - x, w + y, w - y, w - z].map(|plane| plane / plane.truncate().length())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_projects_into_the_picture_is_inside_the_planes() {
        let camera = Camera {
            foot: Vec2::new(3.0, -2.0),
            eye_height_m: 0.5,
            heading_rad: 0.7,
            pitch_rad: -0.2,
            fov_y_rad: 0.9,
        };
        let clip_from_world = camera.clip_from_world(1.6);
        let planes = frustum_planes(clip_from_world);
        let eye = camera.eye_in_world();
        for i in 0..1000 {
            let angle = i as f32 * 2.399;
            let p =
                eye + Vec3::new(angle.sin(), (i as f32 * 0.37).sin(), angle.cos()) * (0.2 + i as f32 * 0.02);
            let clip = clip_from_world * p.extend(1.0);
            let inside_clip =
                clip.w > 0.0 && clip.x.abs() < clip.w && clip.y.abs() < clip.w && clip.z < clip.w;
            let inside_planes = planes.iter().all(|plane| plane.dot(p.extend(1.0)) > 0.0);
            assert_eq!(inside_clip, inside_planes, "point {p}");
        }
    }

    #[test]
    fn the_walk_is_a_round() {
        let camera =
            Camera { foot: Vec2::ONE, eye_height_m: 0.5, heading_rad: 1.0, pitch_rad: 0.0, fov_y_rad: 0.9 };
        let (start, end) = (camera.drifted(0.0), camera.drifted(WALK_S));
        assert_eq!(start, camera);
        assert!(end.foot.distance(camera.foot) < 1e-3 && (end.heading_rad - 1.0).abs() < 1e-3);
        let ahead = camera.drifted(1.0).foot - camera.foot;
        let forward = Vec2::new(camera.forward().x, camera.forward().z);
        assert!(ahead.normalize().dot(forward) > 0.9, "it sets out forward, not {ahead}");
    }

    #[test]
    fn straight_down_is_a_view_like_any_other() {
        let camera = Camera {
            foot: Vec2::ZERO,
            eye_height_m: 2.0,
            heading_rad: 0.3,
            pitch_rad: -std::f32::consts::FRAC_PI_2,
            fov_y_rad: 0.9,
        };
        assert!(camera.clip_from_world(1.0).is_finite());
    }
}

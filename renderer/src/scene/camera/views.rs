//! Views that have a name, so that pictures and measurements can be told of in a word.

use glam::Vec2;

use super::Camera;

/// A view that has a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum NamedView {
    /// From the field's edge over the whole of it: eye 1.7 m up, pitch −10°, 60° field of view
    Edge,
    /// A blade 30 cm away
    Blade,
    /// Straight down from 9 m, to see the wind go over the meadow
    Above,
    /// Low, towards the sun
    AgainstSun,
    /// Over the meadow to the horizon, eye 1.7 m up
    Horizon,
}

impl NamedView {
    /// The camera of this view of a square field around (0, 0) whose sides are `field_m` long.
    /// `sun_heading_rad`: where the sun stands.
    pub fn camera(self, field_m: f32, sun_heading_rad: f32) -> Camera {
        let camera = |foot, eye_height_m, heading_rad, pitch_deg: f32, fov_deg: f32| Camera {
            foot,
            eye_height_m,
            heading_rad,
            pitch_rad: pitch_deg.to_radians(),
            fov_y_rad: fov_deg.to_radians(),
        };
        match self {
            Self::Edge => camera(Vec2::new(0.0, 0.5 * field_m), 1.7, 0.0, -10.0, 60.0),
            // Looks at a point 0.30 m away, 0.13 m above the ground.
            Self::Blade => camera(Vec2::new(0.4, 1.3), 0.19, 0.5, -11.5, 46.0),
            Self::Above => camera(Vec2::ZERO, 9.0, 0.0, -90.0, 50.0),
            Self::AgainstSun => camera(Vec2::ZERO, 0.42, sun_heading_rad, -4.0, 55.0),
            Self::Horizon => camera(Vec2::new(0.0, 0.25 * field_m), 1.7, 0.6, -3.0, 50.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::camera::frustum_planes;
    use crate::scene::terrain;

    #[test]
    fn the_edge_sees_at_least_half_of_the_field() {
        let field_m = 22.0;
        let view = NamedView::Edge.camera(field_m, 0.0);
        let planes = frustum_planes(view.clip_from_world(16.0 / 9.0));
        let (mut seen, mut all) = (0, 0);
        for x in 0..100 {
            for z in 0..100 {
                let p = (Vec2::new(x as f32, z as f32) / 99.0 - 0.5) * field_m;
                let p = glam::Vec4::new(p.x, terrain::height_m(p), p.y, 1.0);
                all += 1;
                seen += usize::from(planes.iter().all(|plane| plane.dot(p) >= 0.0));
            }
        }
        assert!(2 * seen >= all, "{seen} of {all} points");
    }

    #[test]
    fn against_the_sun_looks_at_its_heading_and_above_straight_down() {
        let view = NamedView::AgainstSun.camera(20.0, 1.1);
        assert!(view.forward().dot(crate::scene::sky::direction(Vec2::new(1.1, 0.0))) > 0.99);
        assert!(NamedView::Above.camera(20.0, 0.0).forward().y < -0.999);
    }
}

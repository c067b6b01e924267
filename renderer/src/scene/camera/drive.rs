//! A camera that someone steers: it flies, walks, or goes round a point. Knows no keyboard and no clock.

use glam::{Vec2, Vec3};

use super::Camera;
use crate::scene::terrain;

/// How it moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Where it looks, through the air.
    Fly,
    /// On the ground, its eye at a grown-up's height.
    Walk,
    /// Round the point of the ground that it looks at.
    Orbit,
}

/// What the hands want, each from −1 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wish {
    /// Ahead, or back below zero; in orbit nearer.
    pub ahead: f32,
    /// To the right, or left below zero; in orbit round.
    pub right: f32,
    /// Up, or down below zero.
    pub up: f32,
    /// Whether to hurry.
    pub fast: bool,
}

const EYE_M: f32 = 1.7;
/// Seconds in which a speed comes to two thirds of what is wished.
const INERTIA_S: f32 = 0.18;
/// Nearest to the ground, metres.
const LOWEST_M: f32 = 0.06;
/// Farthest from the middle of the world: there, numbers are still finer than a blade is thick.
const FARTHEST_M: f32 = 4000.0;
const STEEPEST_RAD: f32 = 1.55;

/// A camera under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Driver {
    /// How it moves.
    pub mode: Mode,
    eye: Vec3,
    heading_rad: f32,
    pitch_rad: f32,
    fov_y_rad: f32,
    /// Metres a second in the camera's own directions: right, up, ahead.
    speed: Vec3,
    distance_m: f32,
}

impl Driver {
    /// Takes `camera` over where it is.
    pub fn take_over(camera: &Camera, mode: Mode) -> Self {
        let eye = camera.eye_in_world();
        let down = (-camera.forward().y).max(0.05);
        Self {
            mode,
            eye,
            heading_rad: camera.heading_rad,
            pitch_rad: camera.pitch_rad,
            fov_y_rad: camera.fov_y_rad,
            speed: Vec3::ZERO,
            distance_m: (camera.eye_height_m / down).clamp(0.3, 30.0),
        }
    }

    /// The camera as it is now.
    pub fn camera(&self) -> Camera {
        let foot = Vec2::new(self.eye.x, self.eye.z);
        Camera {
            foot,
            eye_height_m: self.eye.y - terrain::height_m(foot),
            heading_rad: self.heading_rad,
            pitch_rad: self.pitch_rad,
            fov_y_rad: self.fov_y_rad,
        }
    }

    /// Turns the view by so many radians to the right and up; in orbit round the point.
    pub fn look(&mut self, right_rad: f32, up_rad: f32) {
        let centre = self.centre();
        self.heading_rad = (self.heading_rad + right_rad).rem_euclid(std::f32::consts::TAU);
        self.pitch_rad = (self.pitch_rad + up_rad).clamp(-STEEPEST_RAD, STEEPEST_RAD);
        if self.mode == Mode::Orbit {
            self.pitch_rad = self.pitch_rad.min(-0.03);
            self.eye = centre - self.camera().forward() * self.distance_m;
            self.stay_above_ground();
        }
    }

    /// Goes nearer (`steps` above zero) or away in orbit; narrows or widens the view else.
    pub fn zoom(&mut self, steps: f32) {
        let factor = 0.9f32.powf(steps.clamp(-20.0, 20.0));
        if self.mode == Mode::Orbit {
            let centre = self.centre();
            self.distance_m = (self.distance_m * factor).clamp(0.15, 60.0);
            self.eye = centre - self.camera().forward() * self.distance_m;
            self.stay_above_ground();
        } else {
            self.fov_y_rad = (self.fov_y_rad * factor).clamp(0.2, 1.9);
        }
    }

    /// Moves on by `seconds`.
    pub fn step(&mut self, wish: Wish, seconds: f32) {
        let hurry = if wish.fast { 4.0 } else { 1.0 };
        let top_speed = match self.mode {
            Mode::Fly => 2.5,
            Mode::Walk => 1.4,
            Mode::Orbit => 0.8 * self.distance_m,
        };
        let wished = Vec3::new(wish.right, wish.up, wish.ahead) * (top_speed * hurry);
        let kept = (-seconds / INERTIA_S).exp();
        let before = self.speed;
        self.speed = wished + (before - wished) * kept;
        // The mean over the step, so that its length does not matter.
        let way = wished * seconds + (before - wished) * (INERTIA_S * (1.0 - kept));
        let forward = self.camera().forward();
        let flat = Vec3::new(self.heading_rad.sin(), 0.0, -self.heading_rad.cos());
        let right = Vec3::new(-flat.z, 0.0, flat.x);
        match self.mode {
            Mode::Fly => self.eye += forward * way.z + right * way.x + Vec3::Y * way.y,
            Mode::Walk => {
                self.eye += flat * way.z + right * way.x;
                let ground = terrain::height_m(Vec2::new(self.eye.x, self.eye.z));
                let height = self.eye.y - ground;
                self.eye.y = ground + EYE_M + (height - EYE_M) * (-seconds / 0.3).exp();
            }
            Mode::Orbit => {
                self.look(-way.x / self.distance_m, -way.y / self.distance_m);
                self.zoom(way.z / (0.105 * self.distance_m));
            }
        }
        self.stay_above_ground();
    }

    fn centre(&self) -> Vec3 {
        self.eye + self.camera().forward() * self.distance_m
    }

    fn stay_above_ground(&mut self) {
        self.eye.x = self.eye.x.clamp(-FARTHEST_M, FARTHEST_M);
        self.eye.z = self.eye.z.clamp(-FARTHEST_M, FARTHEST_M);
        let lowest = terrain::height_m(Vec2::new(self.eye.x, self.eye.z)) + LOWEST_M;
        self.eye.y = self.eye.y.clamp(lowest, lowest + 500.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AHEAD: Wish = Wish { ahead: 1.0, right: 0.0, up: 0.0, fast: false };

    fn start(mode: Mode) -> Driver {
        let camera = Camera {
            foot: Vec2::new(2.0, 3.0),
            eye_height_m: 1.2,
            heading_rad: 0.7,
            pitch_rad: -0.4,
            fov_y_rad: 0.9,
        };
        Driver::take_over(&camera, mode)
    }

    #[test]
    fn taking_over_changes_nothing() {
        for mode in [Mode::Fly, Mode::Walk, Mode::Orbit] {
            let driver = start(mode);
            assert!((driver.camera().eye_height_m - 1.2).abs() < 1e-5);
            assert_eq!(driver.camera().heading_rad, 0.7);
        }
    }

    #[test]
    fn a_walker_keeps_the_height_of_its_eye() {
        let mut driver = start(Mode::Walk);
        for _ in 0..600 {
            driver.step(AHEAD, 1.0 / 60.0);
        }
        assert!((driver.camera().eye_height_m - EYE_M).abs() < 0.05, "{}", driver.camera().eye_height_m);
        let gone = driver.camera().foot.distance(Vec2::new(2.0, 3.0));
        assert!((gone - 14.0).abs() < 1.0, "{gone} m in 10 s");
    }

    #[test]
    fn nobody_flies_into_the_ground() {
        let mut driver = start(Mode::Fly);
        for _ in 0..600 {
            driver.step(AHEAD, 1.0 / 60.0);
            assert!(driver.camera().eye_height_m > 0.9 * LOWEST_M);
        }
    }

    #[test]
    fn an_orbit_keeps_its_point_and_its_distance() {
        let mut driver = start(Mode::Orbit);
        let (centre, distance_m) = (driver.centre(), driver.distance_m);
        for _ in 0..200 {
            driver.step(Wish { right: 1.0, ..Wish::default() }, 1.0 / 60.0);
        }
        assert!(driver.centre().distance(centre) < 0.02 && (driver.distance_m - distance_m).abs() < 1e-3);
        assert!(driver.eye.distance(start(Mode::Orbit).eye) > 0.5, "it has gone round a part");
    }

    #[test]
    fn how_often_it_is_asked_does_not_matter() {
        let (mut often, mut seldom) = (start(Mode::Fly), start(Mode::Fly));
        let wish = Wish { up: 0.5, ..AHEAD };
        (0..240).for_each(|_| often.step(wish, 1.0 / 240.0));
        (0..10).for_each(|_| seldom.step(wish, 0.1));
        assert!(often.eye.distance(seldom.eye) < 1e-3, "{} and {}", often.eye, seldom.eye);
    }
}

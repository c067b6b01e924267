//! A way of the camera, scripted as key frames in TOML, between which it glides.
//!
//! ```toml
//! loop_s = 20.0            # optional: after so many seconds it is back at the first key frame
//!
//! [[key]]
//! time_s = 0.0             # seconds; grows from key to key
//! foot_m = [0.0, 3.0]      # where it stands, x and z
//! eye_height_m = 1.7       # above the ground there
//! heading_deg = 0.0        # clockwise from -z seen from above; the short way round to the next
//! pitch_deg = -5.0         # above the horizon
//! fov_deg = 50.0           # vertical field of view
//! ```

use glam::Vec2;
use serde::Deserialize;

use super::Camera;

/// The way of the kiosk's camera while nobody steers it: slow, low over the grass, and round.
pub const ATTRACT: &str = include_str!("attract.toml");

/// Why a text is no path.
#[derive(Debug, thiserror::Error)]
pub enum PathError {
    /// Not TOML, or not with these keys.
    #[error("{0}")]
    Form(#[from] toml::de::Error),
    /// A number that cannot be used.
    #[error("key frame {index}: {what}")]
    Value {
        /// Which, from 1.
        index: usize,
        /// What is wrong, and what was expected.
        what: &'static str,
    },
    /// There is no key frame.
    #[error("expected at least one [[key]]")]
    Empty,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Key {
    time_s: f32,
    foot_m: [f32; 2],
    eye_height_m: f32,
    heading_deg: f32,
    pitch_deg: f32,
    fov_deg: f32,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Script {
    loop_s: Option<f32>,
    key: Vec<Key>,
}

/// Foot x and z, eye height, heading, pitch, field of view: metres and radians.
type Pose = [f32; 6];

/// A way of the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    keys: Vec<(f32, Pose)>,
    loop_s: Option<f32>,
}

impl Path {
    /// Reads a path from TOML, as the module says.
    ///
    /// # Errors
    /// When the text is not such TOML, times do not grow, or a number is out of its range.
    pub fn parse(text: &str) -> Result<Self, PathError> {
        let script: Script = toml::from_str(text)?;
        let mut keys: Vec<(f32, Pose)> = Vec::with_capacity(script.key.len());
        for (key, index) in script.key.iter().zip(1..) {
            let wrong = |what| Err(PathError::Value { index, what });
            let numbers =
                [key.foot_m[0], key.foot_m[1], key.eye_height_m, key.heading_deg, key.pitch_deg, key.fov_deg];
            if !numbers.iter().all(|number| number.abs() <= 1e6) {
                return wrong("expected numbers within a million");
            }
            if !(0.0..=1e6).contains(&key.time_s) || keys.last().is_some_and(|last| last.0 >= key.time_s) {
                return wrong("time_s must grow from key to key, from 0 s to 1000000 s");
            }
            if !(10.0..=120.0).contains(&key.fov_deg) || key.eye_height_m < 0.0 || key.pitch_deg.abs() > 90.0
            {
                return wrong("fov_deg must be 10 to 120, eye_height_m at least 0, pitch_deg within 90");
            }
            let mut heading_rad = key.heading_deg.to_radians();
            if let Some((_, before)) = keys.last() {
                heading_rad = nearest_turn(heading_rad, before[3]);
            }
            let [x, z] = key.foot_m;
            let pose =
                [x, z, key.eye_height_m, heading_rad, key.pitch_deg.to_radians(), key.fov_deg.to_radians()];
            keys.push((key.time_s, pose));
        }
        let last_s = keys.last().ok_or(PathError::Empty)?.0;
        if script.loop_s.is_some_and(|loop_s| !(loop_s > last_s && loop_s <= 1e6)) {
            return Err(PathError::Value { index: keys.len(), what: "loop_s must be later than its time_s" });
        }
        Ok(Self { keys, loop_s: script.loop_s })
    }

    /// Seconds after which it begins anew; `None`: it stays at its end.
    pub fn loop_s(&self) -> Option<f32> {
        self.loop_s
    }

    /// The camera at `time_s`; before the first key frame it stands there.
    ///
    /// # Source
    /// Cubic Hermite curves with the finite differences of Catmull and Rom 1974, for uneven times.
    pub fn at(&self, time_s: f32) -> Camera {
        let first_s = self.keys[0].0;
        let time_s = match self.loop_s {
            Some(loop_s) => first_s + (time_s - first_s).rem_euclid(loop_s - first_s),
            None => time_s,
        };
        let next = self.keys.partition_point(|key| key.0 <= time_s) as isize;
        let [a, b, c, d] = [next - 2, next - 1, next, next + 1].map(|index| self.key(index));
        let span = c.0 - b.0;
        let s = if span > 0.0 { ((time_s - b.0) / span).clamp(0.0, 1.0) } else { 0.0 };
        let slope = |before: &(f32, Pose), after: &(f32, Pose), i: usize| {
            let time = after.0 - before.0;
            if time > 0.0 { (after.1[i] - before.1[i]) / time } else { 0.0 }
        };
        let pose: Pose = std::array::from_fn(|i| {
            let (from, to) = (slope(&a, &c, i) * span, slope(&b, &d, i) * span);
            let (s2, s3) = (s * s, s * s * s);
            b.1[i] * (2.0 * s3 - 3.0 * s2 + 1.0)
                + from * (s3 - 2.0 * s2 + s)
                + c.1[i] * (3.0 * s2 - 2.0 * s3)
                + to * (s3 - s2)
        });
        Camera {
            foot: Vec2::new(pose[0], pose[1]),
            eye_height_m: pose[2].max(0.02),
            heading_rad: pose[3],
            pitch_rad: pose[4].clamp(-std::f32::consts::FRAC_PI_2, std::f32::consts::FRAC_PI_2),
            fov_y_rad: pose[5].clamp(0.17, 2.1),
        }
    }

    /// The key frame of this index, of another round where it is out of the list; at an open end the last.
    fn key(&self, index: isize) -> (f32, Pose) {
        let count = self.keys.len() as isize;
        let Some(loop_s) = self.loop_s else {
            return self.keys[index.clamp(0, count - 1) as usize];
        };
        let (time_s, mut pose) = self.keys[index.rem_euclid(count) as usize];
        let rounds = index.div_euclid(count) as f32;
        // One round may turn the camera about once: the heading goes on, it does not unwind.
        let turn = nearest_turn(self.keys[0].1[3], self.keys[count as usize - 1].1[3]) - self.keys[0].1[3];
        pose[3] += turn * rounds;
        (time_s + rounds * (loop_s - self.keys[0].0), pose)
    }
}

/// `angle` plus as many full turns as bring it nearest to `to`.
fn nearest_turn(angle: f32, to: f32) -> f32 {
    angle + ((to - angle) / std::f32::consts::TAU).round() * std::f32::consts::TAU
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::camera::WALK_S;

    fn key(time_s: f32, x: f32, heading_deg: f32) -> String {
        format!(
            "[[key]]\ntime_s = {time_s}\nfoot_m = [{x}, 1.0]\neye_height_m = 1.7\nheading_deg = {heading_deg}\npitch_deg = -5.0\nfov_deg = 50.0\n"
        )
    }

    fn path(head: &str, keys: &[(f32, f32, f32)]) -> Result<Path, PathError> {
        let keys: String = keys.iter().map(|(time_s, x, heading)| key(*time_s, *x, *heading)).collect();
        Path::parse(&format!("{head}\n{keys}"))
    }

    fn speed(path: &Path, time_s: f32) -> Vec2 {
        (path.at(time_s + 0.01).foot - path.at(time_s - 0.01).foot) / 0.02
    }

    #[test]
    fn it_goes_through_its_key_frames_without_a_jerk() {
        let path = path("", &[(0.0, 0.0, 0.0), (2.0, 1.0, 90.0), (5.0, 7.0, 40.0)]).expect("a path");
        for (time_s, x) in [(-3.0, 0.0), (0.0, 0.0), (2.0, 1.0), (5.0, 7.0), (9.0, 7.0)] {
            assert!((path.at(time_s).foot.x - x).abs() < 1e-4, "at {time_s}");
        }
        assert!((path.at(2.0).heading_rad.to_degrees() - 90.0).abs() < 1e-2);
        let jerk = (speed(&path, 1.97) - speed(&path, 2.03)).length();
        assert!(jerk < 0.15 * speed(&path, 2.0).length(), "{jerk}");
    }

    #[test]
    fn a_loop_closes_and_turns_on() {
        let path =
            path("loop_s = 4.0", &[(0.0, 0.0, 0.0), (1.0, 1.0, 100.0), (3.0, 0.0, 250.0)]).expect("a path");
        assert!((path.at(3.999).foot - path.at(0.0).foot).length() < 0.01);
        assert!((path.at(4.5).foot - path.at(0.5).foot).length() < 1e-4);
        assert!(path.at(3.999).forward().dot(path.at(0.0).forward()) > 0.999);
        assert!((speed(&path, 3.98) - speed(&path, 4.02)).length() < 0.2);
        let mut last = path.at(0.0);
        for step in 1..400 {
            let now = path.at(step as f32 * 0.02);
            assert!(now.forward().dot(last.forward()) > 0.98, "a jump of the view at step {step}");
            last = now;
        }
    }

    #[test]
    fn one_key_frame_is_a_stand() {
        let path = path("", &[(1.0, 2.0, 30.0)]).expect("a path");
        assert_eq!(path.at(0.0), path.at(100.0));
    }

    #[test]
    fn wrong_scripts_are_refused_with_their_reason() {
        for (made, expected) in [
            (path("", &[(1.0, 0.0, 0.0), (1.0, 0.0, 0.0)]), "key frame 2"),
            (path("loop_s = 1.0", &[(1.0, 0.0, 0.0)]), "loop_s"),
            (path("", &[(0.0, 2e7, 0.0)]), "key frame 1"),
            (path("speed = 1.0", &[(0.0, 0.0, 0.0)]), "speed"),
            (Path::parse("key = []"), "at least one"),
        ] {
            let error = made.expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn the_example_of_the_document_is_one() {
        let document = include_str!("../../../docs/camera.md");
        let example = document.split("```").nth(1).and_then(|block| block.strip_prefix("toml\n"));
        let path = Path::parse(example.expect("a block of TOML")).expect("a path");
        assert_eq!(path.loop_s(), Some(20.0));
    }

    #[test]
    fn the_attract_path_is_slow_and_fits_the_meadows_round() {
        let path = Path::parse(ATTRACT).expect("a path");
        let loop_s = path.loop_s().expect("a loop");
        assert_eq!(WALK_S % loop_s, 0.0, "it jumps when the meadow's time begins anew");
        for step in 0..(loop_s * 10.0) as usize {
            let (now, next) = (path.at(step as f32 * 0.1), path.at(step as f32 * 0.1 + 0.1));
            let (now_eye, next_eye) = (now.eye_in_world(), next.eye_in_world());
            assert!(now_eye.distance(next_eye) < 0.1, "faster than 1 m/s at {} s", step as f32 * 0.1);
            assert!(now.forward().angle_between(next.forward()) < 0.02, "turns too fast at step {step}");
            assert!(now.eye_height_m > 0.2, "eye in the grass at step {step}");
        }
    }
}

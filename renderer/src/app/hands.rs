//! What keys and mouse ask of the camera.

use winit::dpi::PhysicalPosition;
use winit::event::{ElementState, MouseScrollDelta};
use winit::keyboard::{KeyCode, PhysicalKey};

use crate::scene::camera::Camera;
use crate::scene::camera::drive::{Driver, Mode, Wish};

/// Pixels of a wheel that count as one step.
const PIXELS_A_STEP: f64 = 40.0;
/// Longest step that a slow frame moves the camera on by, seconds.
const LONGEST_STEP_S: f32 = 0.25;

/// The hands at keyboard and mouse, and the camera that they have taken over, if they have.
#[derive(Debug, Default)]
pub(super) struct Hands {
    driver: Option<Driver>,
    held: Vec<KeyCode>,
    buttons: u32,
    pointer: Option<PhysicalPosition<f64>>,
}

impl Hands {
    /// A key went down or up. `camera`: the camera as it is, for the hands to take over.
    pub(super) fn key(&mut self, key: PhysicalKey, state: ElementState, camera: &Camera) {
        let PhysicalKey::Code(code) = key else { return };
        self.held.retain(|held| *held != code);
        if state == ElementState::Released {
            return;
        }
        let mode = match code {
            KeyCode::Digit1 => Some(Mode::Fly),
            KeyCode::Digit2 => Some(Mode::Walk),
            KeyCode::Digit3 => Some(Mode::Orbit),
            KeyCode::Digit0 => {
                self.driver = None;
                return;
            }
            _ => None,
        };
        if let Some(mode) = mode {
            self.driver = Some(Driver::take_over(camera, mode));
        } else if MOVES.iter().any(|(move_code, _)| *move_code == code) {
            self.held.push(code);
            self.take_over(camera);
        } else if matches!(code, KeyCode::ShiftLeft | KeyCode::ShiftRight) {
            self.held.push(code);
        }
    }

    /// A button of the mouse went down or up.
    pub(super) fn button(&mut self, state: ElementState) {
        self.buttons = match state {
            ElementState::Pressed => self.buttons + 1,
            ElementState::Released => self.buttons.saturating_sub(1),
        };
    }

    /// The pointer is at `position` of a window `height` pixels high.
    pub(super) fn pointer(&mut self, position: PhysicalPosition<f64>, height: u32, camera: &Camera) {
        let before = self.pointer.replace(position);
        if self.buttons == 0 {
            return;
        }
        let Some(before) = before else { return };
        // The point under the pointer stays there, as if it were held.
        let radians = |pixels: f64| pixels as f32 * camera.fov_y_rad / height.max(1) as f32;
        let (right, down) = (position.x - before.x, position.y - before.y);
        self.take_over(camera).look(-radians(right), radians(down));
    }

    /// The wheel turned.
    pub(super) fn wheel(&mut self, delta: MouseScrollDelta, camera: &Camera) {
        let steps = match delta {
            MouseScrollDelta::LineDelta(_, lines) => lines,
            MouseScrollDelta::PixelDelta(pixels) => (pixels.y / PIXELS_A_STEP) as f32,
        };
        self.take_over(camera).zoom(steps);
    }

    /// The window is no longer the one that keys go to: nothing is held.
    pub(super) fn let_go(&mut self) {
        self.held.clear();
        self.buttons = 0;
    }

    /// The camera `seconds` later, if the hands have it.
    pub(super) fn camera(&mut self, seconds: f32) -> Option<Camera> {
        let mut wish = Wish::default();
        for (code, [ahead, right, up]) in MOVES {
            if self.held.contains(&code) {
                wish.ahead += ahead;
                wish.right += right;
                wish.up += up;
            }
        }
        wish.fast = self.held.iter().any(|code| matches!(code, KeyCode::ShiftLeft | KeyCode::ShiftRight));
        let driver = self.driver.as_mut()?;
        driver.step(wish, seconds.min(LONGEST_STEP_S));
        Some(driver.camera())
    }

    fn take_over(&mut self, camera: &Camera) -> &mut Driver {
        self.driver.get_or_insert_with(|| Driver::take_over(camera, Mode::Fly))
    }
}

/// Keys, by their place and not their letter, and the ways ahead, right and up that they wish.
const MOVES: [(KeyCode, [f32; 3]); 10] = [
    (KeyCode::KeyW, [1.0, 0.0, 0.0]),
    (KeyCode::ArrowUp, [1.0, 0.0, 0.0]),
    (KeyCode::KeyS, [-1.0, 0.0, 0.0]),
    (KeyCode::ArrowDown, [-1.0, 0.0, 0.0]),
    (KeyCode::KeyD, [0.0, 1.0, 0.0]),
    (KeyCode::ArrowRight, [0.0, 1.0, 0.0]),
    (KeyCode::KeyA, [0.0, -1.0, 0.0]),
    (KeyCode::ArrowLeft, [0.0, -1.0, 0.0]),
    (KeyCode::Space, [0.0, 0.0, 1.0]),
    (KeyCode::KeyC, [0.0, 0.0, -1.0]),
];

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    fn camera() -> Camera {
        Camera { foot: Vec2::ZERO, eye_height_m: 1.0, heading_rad: 0.0, pitch_rad: -0.3, fov_y_rad: 0.8 }
    }

    fn press(hands: &mut Hands, code: KeyCode) {
        hands.key(PhysicalKey::Code(code), ElementState::Pressed, &camera());
    }

    #[test]
    fn the_camera_is_nobodys_until_someone_moves_it() {
        let mut hands = Hands::default();
        assert_eq!(hands.camera(0.1), None);
        press(&mut hands, KeyCode::KeyB);
        hands.pointer(PhysicalPosition::new(1.0, 1.0), 100, &camera());
        hands.pointer(PhysicalPosition::new(9.0, 9.0), 100, &camera());
        assert_eq!(hands.camera(0.1), None, "neither a key without a meaning nor a pointer without a button");
        press(&mut hands, KeyCode::KeyW);
        let ahead = (0..10).filter_map(|_| hands.camera(0.05)).last().expect("taken over");
        assert!(ahead.foot.y < -0.3, "−z is ahead: {ahead:?}");
        hands.let_go();
        let stopped = (0..40).filter_map(|_| hands.camera(0.1)).last().expect("kept");
        assert_eq!(Some(stopped.foot), hands.camera(0.1).map(|camera| camera.foot));
        press(&mut hands, KeyCode::Digit0);
        assert_eq!(hands.camera(0.1), None, "given back");
    }

    #[test]
    fn what_is_held_with_the_mouse_stays_under_it() {
        let mut hands = Hands::default();
        hands.button(ElementState::Pressed);
        hands.pointer(PhysicalPosition::new(10.0, 10.0), 100, &camera());
        hands.pointer(PhysicalPosition::new(20.0, 10.0), 100, &camera());
        let turned = hands.camera(0.0).expect("taken over");
        assert!((turned.heading_rad - (std::f32::consts::TAU - 0.08)).abs() < 1e-4, "{turned:?}");
    }
}

//! What stands still just outside of the depth window, while nothing is within: a visitor who holds it too
//! close or too far away is to be told so.

use std::ops::RangeInclusive;

use super::mask::MaskParams;
use super::presence::{self, Presence};
use crate::frame::DepthFrame;

/// Where something stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Nearer than the window.
    Near,
    /// So near that the sensor has no reading of it.
    Blind,
    /// Farther than the window.
    Far,
}

/// How far beyond the window something is still held up to the camera, metres.
const FAR_REACH_M: f64 = 0.3;
/// One frame in so many is looked at.
const EVERY: u32 = 8;
/// So many of these in a row are alike when something stands still.
const STILL: u32 = 3;
/// What has stood still for so many is a thing of the room.
const ROOM: u32 = 60;
/// Share of the region that a blade too near for the sensor takes at least: readings are missing here and
/// there anyhow.
const BLIND_SHARE: f64 = 0.005;

impl Side {
    const ALL: [Self; 3] = [Self::Near, Self::Blind, Self::Far];

    /// The readings that are there.
    fn readings(self, frame: &DepthFrame, params: &MaskParams) -> RangeInclusive<u16> {
        let window = params.window(frame);
        let reach = FAR_REACH_M / frame.depth_unit_m;
        match self {
            Self::Near => 1..=window.start().saturating_sub(1),
            Self::Blind => 0..=0,
            // `as` saturates.
            Self::Far => window.end().saturating_add(1)..=window.end().saturating_add(reach as u16),
        }
    }

    /// A frame and a depth window that show what is there as if it were within.
    pub fn shown(self, frame: &DepthFrame, params: &MaskParams) -> (DepthFrame, MaskParams) {
        let MaskParams { near_m, far_m, .. } = *params;
        let mut frame = frame.clone();
        let (near_m, far_m) = match self {
            Self::Near => (frame.depth_unit_m, near_m - frame.depth_unit_m),
            Self::Far => (far_m + frame.depth_unit_m, far_m + FAR_REACH_M),
            Self::Blind => {
                let within = *params.window(&frame).start();
                frame
                    .depth
                    .iter_mut()
                    .for_each(|counts| *counts = if *counts == 0 { within } else { u16::MAX });
                (near_m, far_m)
            }
        };
        (frame, MaskParams { near_m, far_m, ..params.clone() })
    }
}

/// What has been seen of one side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Seen {
    /// Least pixels there were: the room's own. `None` before the first look.
    room_px: Option<usize>,
    /// How it stood when it began to stand still.
    first: Presence,
    /// Looks since then.
    still: u32,
}

/// Watches what is outside of the window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Watch {
    frames: u32,
    sides: [Seen; 3],
}

impl Watch {
    /// Takes a frame that shows nothing within the window, and tells, once, where something has come to stand
    /// still since. O(pixels of the region) for one frame in eight.
    pub fn push(&mut self, frame: &DepthFrame, params: &MaskParams) -> Option<Side> {
        let due = self.frames.is_multiple_of(EVERY);
        self.frames = self.frames.wrapping_add(1);
        if !due {
            return None;
        }
        let [x0, y0, x1, y1] = params.region(frame.width, frame.height);
        let mut found = None;
        for (side, seen) in Side::ALL.into_iter().zip(&mut self.sides) {
            let blind_px = ((x1 - x0) * (y1 - y0)) as f64 * BLIND_SHARE;
            let least = if side == Side::Blind { blind_px as usize } else { 0 };
            let now = presence::within(frame, params, &side.readings(frame, params));
            if seen.look(now, least.max(params.min_area_px)) {
                found = found.or(Some(side));
            }
        }
        found
    }

    /// Forgets what stood still: something is within the window.
    pub fn interrupt(&mut self) {
        self.sides.iter_mut().for_each(|seen| seen.still = 0);
    }
}

impl Seen {
    /// Whether something of at least `needed_px` has just come to stand still.
    fn look(&mut self, now: Presence, needed_px: usize) -> bool {
        const NEAR_PX: f64 = 4.0;
        const ALIKE: f64 = 0.15;
        let room = self.room_px.map_or(now.area_px, |room| room.min(now.area_px));
        self.room_px = Some(room);
        let grown = now.area_px - room;
        let [dx, dy] = [0, 1].map(|axis| now.centroid_px[axis] - self.first.centroid_px[axis]);
        let alike = now.area_px.abs_diff(self.first.area_px) as f64 <= ALIKE * grown as f64;
        if grown < needed_px || !alike || dx.hypot(dy) > NEAR_PX {
            (self.first, self.still) = (now, 0);
            return false;
        }
        self.still += 1;
        if self.still >= ROOM {
            (self.room_px, self.still) = (Some(now.area_px), 0);
        }
        self.still == STILL - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CameraModel;

    /// The looks, by number, at which something is told of a wall at 1.3 m with `px` pixels at some depth from
    /// the fifth look on.
    fn told(depth_mm: u16, px: impl Fn(usize) -> usize) -> Vec<(usize, Side)> {
        let camera = CameraModel { fx: 570.0, fy: 570.0, cx: 50.0, cy: 50.0 };
        let mut watch = Watch::default();
        let look = |number: usize| {
            let mut depth = vec![1300; 10_000];
            depth[3000..3000 + if number < 5 { 0 } else { px(number) }].fill(depth_mm);
            let (width, height, depth_unit_m) = (100, 100, 0.001);
            let frame = DepthFrame { width, height, depth, depth_unit_m, timestamp_ns: 0, camera };
            let params = MaskParams::default();
            (0..EVERY).find_map(|_| watch.push(&frame, &params)).map(|side| (number, side))
        };
        (0..150).filter_map(look).collect()
    }

    #[test]
    fn what_comes_to_stand_outside_of_the_window_is_told_once() {
        for (depth_mm, side) in [(250, Side::Near), (0, Side::Blind), (1000, Side::Far)] {
            assert_eq!(told(depth_mm, |_| 400), [(7, side)]);
        }
    }

    #[test]
    fn the_wall_specks_and_what_moves_are_not_told() {
        assert_eq!(told(1250, |_| 400), []);
        assert_eq!(told(250, |_| 20), []);
        assert_eq!(told(250, |number| 250 * (number % 5)), []);
    }
}

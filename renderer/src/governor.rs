//! Holds a frame budget: less detail, then fewer pixels, when frames take too long; more again when there is room.
//!
//! It knows frame times and nothing else. So that the picture does not pump: it moves by notches, waits after each
//! until frames show what it has done, goes up only where what it has learnt of the next notch's cost leaves room, and
//! forgets a notch that was too dear only slowly.

use std::collections::VecDeque;

/// How much is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Factor on the distances at which less is drawn, 0 to 1.
    pub distance: f32,
    /// Factor on the picture's columns and rows, 0 to 1.
    pub resolution: f32,
}

/// Notches, from all to least.
pub const NOTCHES: usize = 25;
/// Frames after a change that are not counted: they may have been begun before it.
const SETTLING: usize = 2;
/// Frames that are looked at together.
const WINDOW: usize = 7;
/// Part of the budget that frames at a dearer notch must be expected to fit in.
const ROOM: f32 = 0.85;
/// Windows until a notch that was too dear is tried again; doubles each time that it was in vain.
const PATIENCE: u32 = 12;
/// Longest that it waits, windows.
const LONGEST_PATIENCE: u32 = 1 << 12;

/// The setting of a notch, 0 (all) to [`NOTCHES`] − 1 (least). Distances give way first, since far blades are
/// missed least; then pixels.
pub fn setting(notch: usize) -> Setting {
    const LEAST: Setting = Setting { distance: 0.2, resolution: 0.5 };
    /// Notches over which distances alone give way.
    const DISTANCES: f32 = 12.0;
    let notch = notch.min(NOTCHES - 1) as f32;
    let distance = (notch / DISTANCES).min(1.0);
    let resolution = ((notch - DISTANCES) / (NOTCHES as f32 - 1.0 - DISTANCES)).max(0.0);
    Setting { distance: LEAST.distance.powf(distance), resolution: LEAST.resolution.powf(resolution) }
}

/// The governor of one meadow.
#[derive(Clone, Debug)]
pub struct Governor {
    budget_s: f32,
    notch: usize,
    /// Frame times since the last change, seconds.
    recent: VecDeque<f32>,
    settling: usize,
    /// The dearest notch that may be tried, and for how many windows it is held back.
    ceiling: usize,
    held_back: u32,
    patience: u32,
    /// Over the last step: the finer notch's time over the coarser one's.
    step_cost: f32,
    /// What the last window at the notch before took, seconds.
    before: Option<(usize, f32)>,
}

impl Governor {
    /// For frames of at most `budget_s` seconds (> 0).
    pub fn new(budget_s: f32) -> Self {
        Self {
            budget_s,
            notch: 0,
            recent: VecDeque::with_capacity(WINDOW),
            settling: SETTLING,
            ceiling: 0,
            held_back: 0,
            patience: PATIENCE,
            step_cost: 1.25,
            before: None,
        }
    }

    /// How much to draw.
    pub fn setting(&self) -> Setting {
        setting(self.notch)
    }

    /// Takes a frame's time in seconds. Returns whether the setting changed.
    pub fn observe(&mut self, frame_s: f32) -> bool {
        if !frame_s.is_finite() || frame_s < 0.0 {
            return false;
        }
        if self.settling > 0 {
            self.settling -= 1;
            return false;
        }
        self.recent.push_back(frame_s);
        // A frame of many times the budget tells enough.
        let hopeless = self.recent.len() >= 2 && self.recent.iter().all(|time| *time > 3.0 * self.budget_s);
        if self.recent.len() < WINDOW && !hopeless {
            return false;
        }
        let time_s = self.median();
        self.recent.clear();
        self.learn(time_s);
        self.held_back = self.held_back.saturating_sub(1);
        if self.held_back == 0 {
            self.ceiling = 0;
        }
        if time_s > self.budget_s {
            return self.less(time_s);
        }
        let dearer = self.notch.checked_sub(1).filter(|notch| *notch >= self.ceiling);
        match dearer {
            Some(notch) if time_s * self.step_cost < ROOM * self.budget_s => self.turn_to(notch, time_s),
            _ => false,
        }
    }

    fn median(&self) -> f32 {
        let mut times: Vec<f32> = self.recent.iter().copied().collect();
        times.sort_by(f32::total_cmp);
        times[times.len() / 2]
    }

    /// What a notch costs, from the two notches that were seen last.
    fn learn(&mut self, time_s: f32) {
        if let Some((notch, before_s)) = self.before.take() {
            let steps = notch as f32 - self.notch as f32;
            if steps != 0.0 && before_s > 0.0 && time_s > 0.0 {
                self.step_cost = (time_s / before_s).powf(1.0 / steps).clamp(1.02, 1.6);
            }
        }
    }

    fn less(&mut self, time_s: f32) -> bool {
        if self.notch + 1 >= NOTCHES {
            return false;
        }
        // Some frames may be slow for other reasons: that a notch is too dear is held against it for a while.
        self.ceiling = self.notch + 1;
        self.held_back = self.patience;
        self.patience = (self.patience * 2).min(LONGEST_PATIENCE);
        let excess = (time_s / (ROOM * self.budget_s)).ln() / self.step_cost.ln();
        let steps = (excess.ceil() as usize).clamp(1, 8);
        self.turn_to((self.notch + steps).min(NOTCHES - 1), time_s)
    }

    fn turn_to(&mut self, notch: usize, time_s: f32) -> bool {
        self.before = Some((self.notch, time_s));
        self.notch = notch;
        self.settling = SETTLING;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frame time of a scene that costs `fixed` + `grass` at full detail, seconds; `noise` is a part of it.
    struct Scene {
        fixed: f32,
        grass: f32,
        noise: f32,
        frame: u32,
    }

    impl Scene {
        fn time_s(&mut self, setting: Setting) -> f32 {
            self.frame += 1;
            let jitter = ((self.frame.wrapping_mul(2_654_435_761) >> 16 & 0xFF) as f32 / 255.0 - 0.5) * 2.0;
            let pixels = setting.resolution * setting.resolution;
            let cost = self.fixed * pixels + self.grass * setting.distance * (0.4 + 0.6 * pixels);
            cost * (1.0 + self.noise * jitter)
        }
    }

    /// Runs `frames` frames; how often the setting changed, and the last frame's time.
    fn run(governor: &mut Governor, scene: &mut Scene, frames: u32) -> (u32, f32) {
        let (mut changes, mut last_s) = (0, 0.0);
        for _ in 0..frames {
            last_s = scene.time_s(governor.setting());
            changes += u32::from(governor.observe(last_s));
        }
        (changes, last_s)
    }

    #[test]
    fn a_scene_that_is_too_dear_soon_fits_and_stays() {
        for (fixed, grass, noise) in
            [(0.02, 0.2, 0.0), (0.02, 0.2, 0.1), (0.03, 1.5, 0.1), (0.005, 0.05, 0.15)]
        {
            let mut governor = Governor::new(1.0 / 30.0);
            let mut scene = Scene { fixed, grass, noise, frame: 0 };
            run(&mut governor, &mut scene, 120);
            let (changes, _) = run(&mut governor, &mut scene, 2000);
            let time_s = Scene { noise: 0.0, ..scene }.time_s(governor.setting());
            let least_s = Scene { noise: 0.0, fixed, grass, frame: 0 }.time_s(setting(NOTCHES - 1));
            assert!(changes <= 8, "{changes} changes in 2000 frames of {grass} s");
            assert!(
                time_s <= 1.05 / 30.0 || time_s <= 1.01 * least_s,
                "{time_s} s at {:?}",
                governor.setting()
            );
        }
    }

    #[test]
    fn room_is_used() {
        let mut governor = Governor::new(1.0 / 30.0);
        let mut heavy = Scene { fixed: 0.01, grass: 0.3, noise: 0.05, frame: 0 };
        run(&mut governor, &mut heavy, 300);
        assert!(governor.setting().distance < 0.5);
        let mut light = Scene { fixed: 0.005, grass: 0.01, noise: 0.05, frame: 0 };
        run(&mut governor, &mut light, 3000);
        assert_eq!(governor.setting(), setting(0), "a scene that fits is drawn in full");
        let (changes, _) = run(&mut governor, &mut light, 1000);
        assert_eq!(changes, 0);
    }

    #[test]
    fn a_single_slow_frame_changes_nothing() {
        let mut governor = Governor::new(1.0 / 30.0);
        for frame in 0..500 {
            let time_s = if frame % 23 == 0 { 0.5 } else { 0.02 };
            assert!(!governor.observe(time_s), "frame {frame}");
        }
        assert!(!governor.observe(f32::NAN));
    }

    #[test]
    fn each_notch_draws_less() {
        for notch in 1..NOTCHES {
            let (more, less) = (setting(notch - 1), setting(notch));
            assert!(less.distance <= more.distance && less.resolution <= more.resolution && less != more);
        }
        assert_eq!(setting(0), Setting { distance: 1.0, resolution: 1.0 });
    }
}

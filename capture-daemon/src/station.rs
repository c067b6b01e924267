//! The visitor's state machine: nothing is there; something is there and has to stand still; it has
//! been captured. Pure: state, observation and time in, state and effect out.

use crate::stages::presence::Presence;

/// When a capture happens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StationParams {
    /// How long something must stand still, seconds; 0 captures from the first frame that shows it.
    pub hold_s: f64,
    /// How far its centroid may move meanwhile, pixels of a camera with a focal length of [`FOCAL_PX`].
    pub still_px: f64,
    /// Less than this many pixels are nothing.
    pub min_area_px: usize,
}

/// Focal length for which [`StationParams::still_px`] is given, pixels.
pub const FOCAL_PX: f64 = 570.0;

impl StationParams {
    /// The same for a camera with another focal length, pixels. A longer one shows the tremor of a hand in more pixels,
    /// and is allowed as many more; with a shorter one nothing changes, since what remains is not the hand's.
    pub fn of_camera(&self, focal_px: f64) -> Self {
        Self { still_px: self.still_px * (focal_px / FOCAL_PX).max(1.0), ..*self }
    }
}

impl Default for StationParams {
    fn default() -> Self {
        Self { hold_s: 0.5, still_px: 4.0, min_area_px: 60 }
    }
}

/// Where the station is with its visitor.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum State {
    /// Nothing is held before the camera.
    #[default]
    Waiting,
    /// Something is; it has to stand still.
    Settling {
        /// When it began to stand still.
        since_ns: u64,
        /// How it stood then.
        first: Presence,
    },
    /// It has been captured; it has to go before the next one.
    Captured,
}

impl State {
    /// The state's name in the protocol.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Settling { .. } => "settling",
            Self::Captured => "captured",
        }
    }

    /// How much of the hold is over at `timestamp_ns`, 0..=1.
    pub fn hold(&self, timestamp_ns: u64, params: &StationParams) -> f32 {
        match self {
            Self::Waiting => 0.0,
            Self::Settling { since_ns, .. } if params.hold_s > 0.0 => {
                let held_s = timestamp_ns.saturating_sub(*since_ns) as f64 * 1e-9;
                (held_s / params.hold_s).min(1.0) as f32
            }
            Self::Settling { .. } | Self::Captured => 1.0,
        }
    }
}

/// What is to be done with the frame that was seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Nothing.
    Idle,
    /// Forget the frames added up so far and begin anew with this one.
    Restart,
    /// Add this frame.
    Add,
    /// Add this frame and capture.
    AddAndCapture,
    /// Begin anew with this frame and capture at once.
    RestartAndCapture,
}

/// How much of its pixels may come or go while it stands still.
const STILL_AREA: f64 = 0.25;

/// The next state, and what to do with the frame. A clock that steps back restarts the hold.
pub fn step(state: State, seen: Presence, timestamp_ns: u64, params: &StationParams) -> (State, Effect) {
    let present = seen.area_px >= params.min_area_px.max(1);
    let settle = || {
        if params.hold_s <= 0.0 {
            (State::Captured, Effect::RestartAndCapture)
        } else {
            (State::Settling { since_ns: timestamp_ns, first: seen }, Effect::Restart)
        }
    };
    match state {
        _ if !present => (State::Waiting, Effect::Idle),
        State::Waiting => settle(),
        State::Captured => (State::Captured, Effect::Idle),
        State::Settling { since_ns, first } => {
            let [dx, dy] = [0, 1].map(|axis| seen.centroid_px[axis] - first.centroid_px[axis]);
            let grown = (seen.area_px as f64 / first.area_px.max(1) as f64 - 1.0).abs();
            if dx.hypot(dy) > params.still_px || grown > STILL_AREA || timestamp_ns < since_ns {
                settle()
            } else if (timestamp_ns - since_ns) as f64 >= params.hold_s * 1e9 {
                (State::Captured, Effect::AddAndCapture)
            } else {
                (state, Effect::Add)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs the station over frames at 30 Hz: area and x of the centroid of each. Gives the indices
    /// of the frames that captured.
    fn captures(hold_s: f64, frames: &[(usize, f64)]) -> Vec<usize> {
        let params = StationParams { hold_s, ..StationParams::default() };
        let mut state = State::default();
        let mut captured = Vec::new();
        for (index, (area_px, x)) in frames.iter().enumerate() {
            let seen = Presence { area_px: *area_px, centroid_px: [*x, 100.0] };
            let (next, effect) = step(state, seen, 1_000_000_000 + index as u64 * 33_333_333, &params);
            state = next;
            if matches!(effect, Effect::AddAndCapture | Effect::RestartAndCapture) {
                captured.push(index);
            }
        }
        captured
    }

    #[test]
    fn what_stands_still_is_captured_once_after_the_hold() {
        let mut frames = vec![(0, 0.0); 5];
        frames.extend([(500, 50.0); 40]);
        assert_eq!(captures(0.5, &frames), [5 + 16]);
    }

    #[test]
    fn the_next_one_is_captured_after_the_first_has_gone() {
        let mut frames = vec![(500, 50.0); 30];
        frames.extend([(0, 0.0); 3]);
        frames.extend([(600, 80.0); 30]);
        assert_eq!(captures(0.5, &frames), [16, 33 + 16]);
    }

    #[test]
    fn what_moves_is_not_captured_until_it_stands() {
        let mut frames: Vec<(usize, f64)> = (0..40).map(|i| (500, 5.0 * f64::from(i))).collect();
        assert!(captures(0.5, &frames).is_empty());
        frames.extend([(500, 195.0); 20]);
        assert_eq!(captures(0.5, &frames).len(), 1);
    }

    #[test]
    fn the_hold_grows_from_nothing_to_one() {
        let params = StationParams { hold_s: 0.5, ..StationParams::default() };
        let seen = Presence { area_px: 500, centroid_px: [0.0, 0.0] };
        let settling = State::Settling { since_ns: 1_000_000_000, first: seen };
        let holds =
            [900_000_000, 1_000_000_000, 1_250_000_000, 9_000_000_000].map(|at| settling.hold(at, &params));
        assert_eq!(holds, [0.0, 0.0, 0.5, 1.0]);
        assert_eq!([State::Waiting, State::Captured].map(|state| state.hold(0, &params)), [0.0, 1.0]);
    }

    #[test]
    fn no_hold_captures_the_first_frame_that_shows_something() {
        assert_eq!(captures(0.0, &[(10, 0.0), (500, 5.0), (500, 9.0)]), [1]);
    }

    #[test]
    fn a_clock_that_steps_back_restarts_the_hold() {
        let params = StationParams::default();
        let seen = Presence { area_px: 500, centroid_px: [0.0, 0.0] };
        let state = State::Settling { since_ns: 5_000_000_000, first: seen };
        let (state, effect) = step(state, seen, 1_000_000_000, &params);
        assert_eq!(state, State::Settling { since_ns: 1_000_000_000, first: seen });
        assert_eq!(effect, Effect::Restart);
    }

    #[test]
    fn a_longer_lens_may_see_as_much_more_of_a_tremor() {
        let of = |focal_px| StationParams::default().of_camera(focal_px).still_px;
        assert_eq!([285.0, 570.0, 1140.0].map(of), [4.0, 4.0, 8.0]);
    }
}

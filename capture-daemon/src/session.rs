//! A visitor's session: frames through the station into captures. The same for a replay and for the
//! daemon; it knows no clock but the frames' own.

use crate::frame::DepthFrame;
use crate::note::Note;
use crate::pipeline::{self, PipelineParams, Steps};
use crate::stages::accumulate::Accumulation;
use crate::stages::blade::Refusal;
use crate::stages::outside::{Side, Watch};
use crate::stages::presence;
use crate::station::{self, Effect, State, StationParams};

/// What a session is told.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct SessionParams {
    /// The station.
    pub station: StationParams,
    /// The stages.
    pub pipeline: PipelineParams,
}

/// One capture.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Index of the frame that completed it, from 0.
    pub frame: u64,
    /// That frame's time, nanoseconds since 1970.
    pub timestamp_ns: u64,
    /// What each stage made of it.
    pub steps: Steps,
}

/// Frames seen so far and what is being added up.
#[derive(Clone, Debug, Default)]
pub struct Session {
    params: SessionParams,
    state: State,
    held: Option<Accumulation>,
    outside: Watch,
    frames: u64,
    /// Someone has asked for a capture before the hold is over.
    is_due: bool,
    /// Time of the last frame.
    last_ns: Option<u64>,
}

/// No sensor is that slow, nanoseconds: its clock was set forth, or frames lack. A hold is not over by that.
const GAP_NS: u64 = 10_000_000_000;

impl Session {
    /// A session that has seen nothing.
    pub fn new(params: SessionParams) -> Self {
        Self { params, ..Self::default() }
    }

    /// Takes the next frame, and gives a capture when it completes one: without blades, but with the reason,
    /// when what stands still does so outside of the depth window.
    pub fn push(&mut self, frame: &DepthFrame) -> Option<Capture> {
        let index = self.frames;
        self.frames += 1;
        let elapsed_ns =
            self.last_ns.replace(frame.timestamp_ns).map(|last| frame.timestamp_ns.saturating_sub(last));
        if elapsed_ns.is_some_and(|elapsed| elapsed > GAP_NS) {
            self.interrupt();
        }
        let PipelineParams { mask, .. } = &self.params.pipeline;
        if self.held.as_ref().is_some_and(|held| !held.fits(frame)) {
            self.held = None;
            self.state = State::Waiting;
        }
        let seen = presence::presence(frame, mask);
        let station = self.params.station.of_camera(frame.camera.fx);
        let (state, effect) = match station::step(self.state, seen, frame.timestamp_ns, &station) {
            (State::Settling { .. }, Effect::Add) if self.is_due => (State::Captured, Effect::AddAndCapture),
            other => other,
        };
        self.is_due &= matches!(state, State::Settling { .. });
        self.state = state;
        if state == State::Waiting {
            let side = self.outside.push(frame, mask)?;
            return self.look_outside(side, frame, index);
        }
        self.outside.interrupt();
        if effect == Effect::Idle {
            return None;
        }
        let held = self.held.get_or_insert_with(|| Accumulation::like(frame));
        if matches!(effect, Effect::Restart | Effect::RestartAndCapture) {
            held.clear();
        }
        held.add(frame, mask);
        let captures = matches!(effect, Effect::AddAndCapture | Effect::RestartAndCapture);
        captures.then(|| Capture {
            frame: index,
            timestamp_ns: frame.timestamp_ns,
            steps: pipeline::capture(held, &frame.camera, frame.timestamp_ns, &self.params.pipeline),
        })
    }

    /// Has what is held captured: as soon as it stands still from one frame to the next, or, if it was
    /// captured before, after another hold. Where the next frame shows nothing, this does nothing.
    pub fn demand(&mut self) {
        match self.state {
            State::Waiting | State::Settling { .. } => self.is_due = true,
            State::Captured => self.state = State::Waiting,
        }
    }

    /// Frames stopped coming for a while: what is held then may be something else, so a hold begins anew. What was
    /// captured is not captured again as long as something is there.
    pub fn interrupt(&mut self) {
        self.held = None;
        self.is_due = false;
        self.outside.interrupt();
        if matches!(self.state, State::Settling { .. }) {
            self.state = State::Waiting;
        }
    }

    /// What a session can begin with that captures from the next frame on what this one does; `None` while a hold runs,
    /// which the frames before the next one are part of.
    pub fn checkpoint(&self) -> Option<Note> {
        let is_holding = self.is_due || matches!(self.state, State::Settling { .. });
        (!is_holding).then(|| Note::Begins { captured: self.state == State::Captured })
    }

    /// Does what a recording says that the session was told. Of another configuration its owner has to see to it.
    pub fn take_note(&mut self, note: &Note) {
        match note {
            Note::Begins { captured } => {
                let state = if *captured { State::Captured } else { State::Waiting };
                *self = Self { state, frames: self.frames, ..Self::new(self.params.clone()) };
            }
            Note::Interrupted => self.interrupt(),
            Note::Asked => self.demand(),
            Note::Config { .. } | Note::Dropped { .. } => {}
        }
    }

    /// Goes by other parameters from the next frame on. No frame is lost; where the mask is another, what
    /// was added up by the old one is not mixed with what comes, and the hold begins anew.
    pub fn set_params(&mut self, params: SessionParams) {
        if params.pipeline.mask != self.params.pipeline.mask {
            self.held = None;
            self.outside.interrupt();
            if matches!(self.state, State::Settling { .. }) {
                self.state = State::Waiting;
            }
        }
        self.params = params;
    }

    /// What is to be said of something that stands still outside of the window: nothing, if it does not look
    /// like a blade.
    fn look_outside(&self, side: Side, frame: &DepthFrame, index: u64) -> Option<Capture> {
        let (shown, mask) = side.shown(frame, &self.params.pipeline.mask);
        let mut seen = Accumulation::like(&shown);
        seen.add(&shown, &mask);
        let pipeline = PipelineParams { mask, ..self.params.pipeline.clone() };
        let mut steps = pipeline::capture(&seen, &shown.camera, shown.timestamp_ns, &pipeline);
        let is_like_a_blade = !steps.blades.is_empty() || steps.refused.iter().any(Refusal::is_of_a_blade);
        let refusal = if side == Side::Far { Refusal::TooFar } else { Refusal::TooNear };
        (steps.blades, steps.refused) = (Vec::new(), vec![refusal]);
        let timestamp_ns = frame.timestamp_ns;
        is_like_a_blade.then_some(Capture { frame: index, timestamp_ns, steps })
    }

    /// Where the station is with its visitor.
    pub fn state(&self) -> State {
        self.state
    }

    /// What it goes by.
    pub fn params(&self) -> &SessionParams {
        &self.params
    }

    /// Frames taken so far.
    pub fn frames(&self) -> u64 {
        self.frames
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bar;

    /// Indices of the frames that captured; `change` is called before each frame.
    fn captures(held: impl Fn(u64) -> bool, mut change: impl FnMut(u64, &mut Session)) -> Vec<u64> {
        let mut session = Session::default();
        let mut captured = Vec::new();
        for index in 0..60 {
            change(index, &mut session);
            captured.extend(
                session
                    .push(&bar::frame(index, held(index).then_some(500), 1300))
                    .map(|capture| capture.frame),
            );
        }
        assert_eq!(session.frames(), 60, "no frame is lost");
        captured
    }

    #[test]
    fn a_demand_captures_during_the_hold_and_again_after_it() {
        assert_eq!(captures(|_| true, |_, _| {}), [16]);
        let at = |frames: &'static [u64]| {
            move |index: u64, session: &mut Session| {
                if frames.contains(&index) {
                    session.demand();
                }
            }
        };
        assert_eq!(captures(|_| true, at(&[5])), [5]);
        assert_eq!(captures(|_| true, at(&[30])), [16, 46]);
        assert_eq!(captures(|_| false, at(&[5])), [0; 0]);
        assert_eq!(captures(|index| index > 10, at(&[5])), [27], "a demand for nothing is forgotten");
    }

    #[test]
    fn an_interruption_begins_a_hold_anew_and_captures_nothing_twice() {
        let interrupted = |at: u64| {
            captures(
                |_| true,
                move |index, session| {
                    if index == at {
                        session.interrupt();
                    }
                },
            )
        };
        assert_eq!(interrupted(10), [26]);
        assert_eq!(interrupted(20), [16]);
    }

    #[test]
    fn a_clock_that_steps_does_not_end_a_hold() {
        for (step_ns, expected) in [(0, 16), (3_600_000_000_000, 26), (-500_000_000, 26)] {
            let mut session = Session::default();
            let captured = (0..60).find(|index| {
                let mut frame = bar::frame(*index, Some(500), 1300);
                frame.timestamp_ns += 1_000_000_000;
                if *index >= 10 {
                    frame.timestamp_ns = frame.timestamp_ns.saturating_add_signed(step_ns);
                }
                session.push(&frame).is_some()
            });
            assert_eq!(captured, Some(expected), "a step of {step_ns} ns");
        }
    }

    #[test]
    fn a_session_goes_on_from_a_checkpoint_as_the_one_before() {
        // Held from frame 10 on, gone from 40 to 45, and held again.
        let held = |index: u64| ((10..40).contains(&index) || index >= 45).then_some(500);
        let run = |from: u64, begins: Option<&Note>| {
            let mut session = Session::default();
            begins.iter().for_each(|note| session.take_note(note));
            let mut captured = Vec::new();
            let mut checkpoints = Vec::new();
            for index in from..80 {
                checkpoints.push(session.checkpoint());
                let capture = session.push(&bar::frame(index, held(index), 1300));
                captured.extend(capture.map(|capture| (capture.timestamp_ns, capture.steps.blades)));
            }
            (captured, checkpoints)
        };
        let (all, checkpoints) = run(0, None);
        assert_eq!(all.len(), 2);
        for (from, begins) in (0..).zip(&checkpoints) {
            let is_held = (11..=26).contains(&from) || (46..=61).contains(&from);
            assert_eq!(begins.is_none(), is_held, "frame {from}");
            if let Some(begins) = begins {
                let later = bar::frame(from, None, 1300).timestamp_ns;
                let expected: Vec<_> = all.iter().filter(|capture| capture.0 > later).cloned().collect();
                assert_eq!(run(from, Some(begins)).0, expected, "from frame {from}");
            }
        }
    }

    #[test]
    fn parameters_change_without_losing_a_frame() {
        let with = |change: fn(&mut SessionParams)| {
            captures(
                |_| true,
                move |index, session| {
                    if index == 10 {
                        let mut params = SessionParams::default();
                        change(&mut params);
                        session.set_params(params);
                    }
                },
            )
        };
        assert_eq!(with(|params| params.pipeline.refine.knots = 5), [16]);
        assert_eq!(with(|params| params.station.hold_s = 1.0), [31]);
        assert_eq!(with(|params| params.pipeline.mask.near_m = 0.31), [26], "the hold begins anew");
    }
}

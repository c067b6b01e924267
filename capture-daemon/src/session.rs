//! A visitor's session: frames through the station into captures. The same for a replay and for the
//! daemon; it knows no clock but the frames' own.

use crate::frame::DepthFrame;
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
}

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
        let PipelineParams { mask, .. } = &self.params.pipeline;
        if self.held.as_ref().is_some_and(|held| !held.fits(frame)) {
            self.held = None;
            self.state = State::Waiting;
        }
        let seen = presence::presence(frame, mask);
        let (state, effect) = station::step(self.state, seen, frame.timestamp_ns, &self.params.station);
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

    /// Frames taken so far.
    pub fn frames(&self) -> u64 {
        self.frames
    }
}

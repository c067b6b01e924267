//! What the visitor is told: a code for programs and plain words, from what the session makes of each frame.
//! Pure, like the station.

use crate::session::Capture;
use crate::stages::blade::Refusal;
use crate::station::State;

/// Something to tell the visitor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message {
    /// Nothing is before the camera.
    Waiting,
    /// Something is, and has to stand still.
    HoldStill,
    /// It has been captured.
    Captured {
        /// As so many blades, at least one.
        blades: usize,
    },
    /// It was captured before, as a recording that begins again shows it.
    Known {
        /// As so many blades, at least one.
        blades: usize,
    },
    /// It was looked at, and holds no blade.
    NothingFound,
    /// It was looked at, and is none.
    Refused(Refusal),
    /// The frames are interrupted.
    Reconnecting,
    /// No frames will come unless somebody sees to it.
    CallStaff,
}

impl Message {
    /// A word for programs, which stays when the sentence is put better: 1 to 24 of `a` to `z` and `_`.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::HoldStill => "hold_still",
            Self::Captured { .. } => "captured",
            Self::Known { .. } => "known",
            Self::NothingFound => "nothing_found",
            Self::Refused(refusal) => refusal.code(),
            Self::Reconnecting => "reconnecting",
            Self::CallStaff => "call_staff",
        }
    }
}

impl std::fmt::Display for Message {
    /// The sentences that the visitor reads.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Waiting => f.write_str("Please hold a blade of grass or a leaf up to the camera."),
            Self::HoldStill => f.write_str("Please hold it still."),
            Self::Captured { blades: 1 } => {
                f.write_str("Thank you, the blade is captured. Please take it away before the next.")
            }
            Self::Captured { blades } => {
                write!(f, "Thank you, {blades} blades are captured. Please take them away before the next.")
            }
            Self::Known { blades: 1 } => {
                f.write_str("Thank you, this blade was captured before. Please take it away before the next.")
            }
            Self::Known { blades } => write!(
                f,
                "Thank you, these {blades} blades were captured before. Please take them away before the next."
            ),
            Self::NothingFound => f.write_str("Please hold up a blade of grass or a leaf: none can be seen."),
            Self::Refused(refusal) => refusal.fmt(f),
            Self::Reconnecting => f.write_str("One moment please: the camera is being connected again."),
            Self::CallStaff => f.write_str("Please call the staff: no pictures come from the camera."),
        }
    }
}

/// How long it is told why something outside of the depth window is refused, nanoseconds: it stands there for
/// no state of the station.
const OUTSIDE_NS: u64 = 4_000_000_000;

/// What the visitor is told, from one frame to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visitor {
    message: Message,
    /// When it was first told, the frame's time.
    since_ns: u64,
    /// It is of something outside of the depth window.
    is_outside: bool,
}

impl Default for Visitor {
    fn default() -> Self {
        Self { message: Message::Waiting, since_ns: 0, is_outside: false }
    }
}

impl Visitor {
    /// What to tell after a frame: `state` is the session's, `capture` what the frame completed; `is_known`: all of
    /// its blades were captured before.
    pub fn tell(
        &mut self,
        state: State,
        capture: Option<&Capture>,
        is_known: bool,
        timestamp_ns: u64,
    ) -> Message {
        let message = match (capture, state) {
            (Some(capture), _) => Some(verdict(capture, is_known)),
            (None, State::Settling { .. }) => Some(Message::HoldStill),
            // What was said of the capture.
            (None, State::Captured) => None,
            (None, State::Waiting) => {
                let elapsed_ns = timestamp_ns.checked_sub(self.since_ns);
                let is_told = self.is_outside && elapsed_ns.is_some_and(|elapsed| elapsed < OUTSIDE_NS);
                (!is_told).then_some(Message::Waiting)
            }
        };
        if let Some(message) = message.filter(|message| *message != self.message || capture.is_some()) {
            let is_outside = capture.is_some() && state == State::Waiting;
            *self = Self { message, since_ns: timestamp_ns, is_outside };
        }
        self.message
    }
}

/// What a capture amounts to.
fn verdict(capture: &Capture, is_known: bool) -> Message {
    match (capture.steps.blades.len(), capture.steps.refused.first()) {
        (0, Some(refusal)) => Message::Refused(*refusal),
        (0, None) => Message::NothingFound,
        (blades, _) if is_known => Message::Known { blades },
        (blades, _) => Message::Captured { blades },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bar;
    use crate::session::{Session, SessionParams};

    /// The codes that are told over frames of a bar at a depth, where there is one; each with the index of the
    /// frame that it is first told at.
    fn told(bar_mm: impl Fn(u64) -> Option<u16>) -> Vec<(u64, &'static str)> {
        told_of(bar_mm, false)
    }

    /// The same where what is captured was captured before.
    fn told_of(bar_mm: impl Fn(u64) -> Option<u16>, is_known: bool) -> Vec<(u64, &'static str)> {
        let mut session = Session::new(SessionParams::default());
        let mut visitor = Visitor::default();
        let mut told: Vec<(u64, &'static str)> = Vec::new();
        for index in 0..250 {
            let frame = bar::frame(index, bar_mm(index), 2500);
            let capture = session.push(&frame);
            let code = visitor.tell(session.state(), capture.as_ref(), is_known, frame.timestamp_ns).code();
            if told.last().is_none_or(|(_, last)| *last != code) {
                told.push((index, code));
            }
        }
        told
    }

    #[test]
    fn a_blade_is_asked_for_held_still_and_taken_away() {
        let codes = told(|index| (10..60).contains(&index).then_some(500));
        assert_eq!(codes, [(0, "waiting"), (10, "hold_still"), (26, "captured"), (60, "waiting")]);
        let again = told_of(|index| (10..60).contains(&index).then_some(500), true);
        assert_eq!(again[2..], [(26, "known"), (60, "waiting")]);
    }

    #[test]
    fn why_it_is_refused_is_told_until_it_goes() {
        // So far off in a picture that small that it is some pixels across.
        let codes = told(|index| (10..60).contains(&index).then_some(890));
        assert_eq!(codes.len(), 4, "{codes:?}");
        assert_eq!((codes[2].0, codes[3]), (26, (60, "waiting")), "{codes:?}");
        assert_ne!(codes[2].1, "captured", "{codes:?}");
    }

    #[test]
    fn what_stands_outside_of_the_window_is_told_for_a_while() {
        let codes = told(|index| (40..250).contains(&index).then_some(1000));
        assert_eq!(codes.len(), 3, "{codes:?}");
        assert_eq!(codes[1].1, "too_far");
        assert_eq!(codes[2], (codes[1].0 + 121, "waiting"), "four seconds later");
    }

    #[test]
    fn codes_and_words_fit_a_preview_and_are_documented() {
        let document = include_str!("../docs/visitor.md");
        let interface = common::protocol::DEFINITION;
        let refusals = [Refusal::TooFar, Refusal::TooSteep, Refusal::Unsure { score: 0.1, needed: 0.2 }];
        let messages = [
            Message::Waiting,
            Message::HoldStill,
            Message::Captured { blades: 4096 },
            Message::Known { blades: 4096 },
            Message::NothingFound,
            Message::Reconnecting,
            Message::CallStaff,
        ];
        for message in refusals.map(Message::Refused).iter().chain(&messages) {
            let code = message.code();
            assert!(
                (1..=24).contains(&code.len()) && code.bytes().all(|b| b.is_ascii_lowercase() || b == b'_')
            );
            assert!((10..=512).contains(&message.to_string().len()), "{message}");
        }
        for message in &messages {
            let (code, words) = (message.code(), message.to_string().replace("4096", "5"));
            assert!(
                document.contains(&format!("| `{code}` | {words} |")),
                "{code} is not documented: {words}"
            );
            assert!(interface.contains(code), "the interface does not name {code}");
        }
    }
}

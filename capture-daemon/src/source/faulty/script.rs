//! What happens to a faulty sensor, and when. Pure: time in, state out.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

/// A recording, and what befalls whoever plays it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Script {
    /// The recording that is played over and over.
    pub recording: PathBuf,
    /// Frames each second; by default the recording's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fps: Option<f64>,
    /// The faults.
    #[serde(default, rename = "fault", skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<Fault>,
}

/// A fault and its time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    /// When it happens, seconds after the script was written.
    pub at_s: f64,
    /// What happens.
    #[serde(flatten)]
    pub kind: FaultKind,
}

/// A kind of fault. Times in seconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum FaultKind {
    /// It is not there for so long.
    Unplug {
        /// How long.
        for_s: f64,
    },
    /// It gives no frames for so long, to whoever has it.
    Stall {
        /// How long.
        for_s: f64,
    },
    /// The driver of the process that has it hangs until it is killed; the next one is well.
    Hang,
    /// The driver of the process that has it crashes.
    Crash,
    /// It begins anew: whoever has it loses it, and it is back at once.
    Reset,
    /// So many frames end as an earlier one.
    Torn {
        /// How many.
        frames: u64,
    },
    /// So many frames have fewer bytes than their process says.
    Short {
        /// How many.
        frames: u64,
    },
    /// So many frames have not a single reading.
    Zero {
        /// How many.
        frames: u64,
    },
    /// So many frames are lost on the way, and their numbers lack.
    Lost {
        /// How many.
        frames: u64,
    },
    /// Its clock steps, forth or back, and goes on from there.
    Clock {
        /// How far.
        step_s: f64,
    },
    /// So many frames come late, all at once.
    Burst {
        /// How many.
        frames: u64,
    },
    /// Its readings become noisy, evenly up to a standard deviation in millimetres; then they are well again.
    Noise {
        /// That at its end, millimetres.
        to_mm: f64,
        /// How long it rises.
        for_s: f64,
    },
}

/// How the sensor is to whoever has it open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    /// It gives frames.
    Streaming,
    /// It is not there.
    Absent,
    /// It began anew.
    Reset,
    /// Its driver crashed.
    Crashed,
    /// Its driver hangs.
    Hung,
}

/// What comes of the moment at which a frame is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Slot {
    /// A whole frame.
    Whole,
    /// One that ends as an earlier one.
    Torn,
    /// One with too few bytes.
    Short,
    /// One without a reading.
    Zero,
    /// One that is lost.
    Lost,
    /// None.
    Nothing,
}

/// Whether something that begins at a time and lasts for so long is on, seconds; times of frames are rounded.
fn lasts(from_s: f64, for_s: f64, t_s: f64) -> bool {
    const ROUNDED_S: f64 = 1e-6;
    (from_s..from_s + for_s).contains(&(t_s + ROUNDED_S))
}

impl Script {
    /// Reads a script, and when it was written: its time begins then.
    ///
    /// # Errors
    /// When it cannot be read, or is none.
    pub fn read(path: &Path) -> Result<(Self, SystemTime), String> {
        let told = |error: &dyn std::fmt::Display| {
            let error = error.to_string().trim_end().replace('\n', " ");
            format!("{}: the script of the faulty sensor cannot be read: {error}", path.display())
        };
        let text = std::fs::read_to_string(path).map_err(|error| told(&error))?;
        let written = std::fs::metadata(path).and_then(|metadata| metadata.modified());
        let script: Self = toml::from_str(&text).map_err(|error| told(&error))?;
        if script.fps.is_some_and(|fps| !(1.0..=1000.0).contains(&fps)) {
            return Err(told(&"fps is out of range, expected 1 to 1000"));
        }
        Ok((script, written.map_err(|error| told(&error))?))
    }

    /// As a file.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("numbers, names and a path in UTF-8 can be written as TOML")
    }

    /// Whether it is there at a time.
    pub(super) fn state(&self, now_s: f64) -> State {
        let is_gone = |fault: &Fault| match fault.kind {
            FaultKind::Unplug { for_s } => (fault.at_s..fault.at_s + for_s).contains(&now_s),
            _ => false,
        };
        if self.faults.iter().any(is_gone) { State::Absent } else { State::Streaming }
    }

    /// What has become of a process that opened it, of all that happened since the first.
    pub(super) fn happened(&self, opened_s: f64, now_s: f64) -> State {
        let fates = self.faults.iter().filter(|fault| (opened_s..=now_s).contains(&fault.at_s));
        let fate = |fault: &Fault| {
            Some(match fault.kind {
                FaultKind::Unplug { .. } => State::Absent,
                FaultKind::Hang => State::Hung,
                FaultKind::Crash => State::Crashed,
                FaultKind::Reset => State::Reset,
                _ => return None,
            })
        };
        let fates = fates.filter_map(|fault| Some((fault.at_s, fate(fault)?)));
        fates.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(State::Streaming, |(_, fate)| fate)
    }

    /// When frame `index` is sent, seconds: one of a burst with the last of it.
    pub(super) fn due_s(&self, index: u64, fps: f64) -> f64 {
        let t_s = index as f64 / fps;
        let end = |fault: &Fault| match fault.kind {
            FaultKind::Burst { frames } if lasts(fault.at_s, frames as f64 / fps, t_s) => {
                Some(fault.at_s + frames as f64 / fps)
            }
            _ => None,
        };
        self.faults.iter().filter_map(end).fold(t_s, f64::max)
    }

    /// What comes of frame `index`.
    pub(super) fn slot(&self, index: u64, fps: f64) -> Slot {
        let t_s = index as f64 / fps;
        let slot = |fault: &Fault| {
            let frames_s = |frames: u64| frames as f64 / fps;
            let (slot, for_s) = match fault.kind {
                FaultKind::Stall { for_s } => (Slot::Nothing, for_s),
                FaultKind::Torn { frames } => (Slot::Torn, frames_s(frames)),
                FaultKind::Short { frames } => (Slot::Short, frames_s(frames)),
                FaultKind::Zero { frames } => (Slot::Zero, frames_s(frames)),
                FaultKind::Lost { frames } => (Slot::Lost, frames_s(frames)),
                _ => return None,
            };
            lasts(fault.at_s, for_s, t_s).then_some(slot)
        };
        let slots: Vec<Slot> = self.faults.iter().filter_map(slot).collect();
        let is_nothing = slots.contains(&Slot::Nothing);
        if is_nothing { Slot::Nothing } else { slots.first().copied().unwrap_or(Slot::Whole) }
    }

    /// How far its clock is off at a time, seconds.
    pub(super) fn clock_s(&self, now_s: f64) -> f64 {
        let step = |fault: &Fault| match fault.kind {
            FaultKind::Clock { step_s } if fault.at_s <= now_s => step_s,
            _ => 0.0,
        };
        self.faults.iter().map(step).sum()
    }

    /// How noisy it is at a time: standard deviation, millimetres.
    pub(super) fn noise_mm(&self, now_s: f64) -> f64 {
        let noise = |fault: &Fault| match fault.kind {
            FaultKind::Noise { to_mm, for_s } if (fault.at_s..fault.at_s + for_s).contains(&now_s) => {
                to_mm * (now_s - fault.at_s) / for_s
            }
            _ => 0.0,
        };
        self.faults.iter().map(noise).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn script(faults: &str) -> Script {
        toml::from_str(&format!("recording = \"a.mcap\"\n{faults}")).expect("a script")
    }

    #[test]
    fn what_happened_first_to_a_process_is_its_fate_and_the_next_one_is_well() {
        let script = script(
            "[[fault]]\nat_s = 5.0\nkind = \"hang\"\n[[fault]]\nat_s = 2.0\nkind = \"unplug\"\nfor_s = 1.0\n\
             [[fault]]\nat_s = 8.0\nkind = \"crash\"\n[[fault]]\nat_s = 9.0\nkind = \"reset\"\n",
        );
        let happened = [
            (0.0, 1.9),
            (0.0, 2.1),
            (0.0, 99.0),
            (3.1, 4.9),
            (3.1, 5.0),
            (5.5, 8.5),
            (8.1, 9.0),
            (9.1, 99.0),
        ];
        use State::{Absent, Crashed, Hung, Reset, Streaming};
        let expected = [Streaming, Absent, Absent, Streaming, Hung, Crashed, Reset, Streaming];
        assert_eq!(happened.map(|(opened, now)| script.happened(opened, now)), expected);
        assert_eq!([1.9, 2.0, 2.9, 3.0].map(|now| script.state(now)), [Streaming, Absent, Absent, Streaming]);
    }

    #[test]
    fn a_slot_says_what_comes_of_it_and_when() {
        let script = script(
            "[[fault]]\nat_s = 1.0\nkind = \"zero\"\nframes = 2\n[[fault]]\nat_s = 2.0\nkind = \"burst\"\nframes = 3\n\
             [[fault]]\nat_s = 3.0\nkind = \"stall\"\nfor_s = 0.2\n[[fault]]\nat_s = 3.1\nkind = \"lost\"\nframes = 2\n",
        );
        let slots: Vec<Slot> = (9..13).map(|index| script.slot(index, 10.0)).collect();
        assert_eq!(slots, [Slot::Whole, Slot::Zero, Slot::Zero, Slot::Whole]);
        let slots: Vec<Slot> = (30..34).map(|index| script.slot(index, 10.0)).collect();
        assert_eq!(slots, [Slot::Nothing, Slot::Nothing, Slot::Lost, Slot::Whole]);
        let due: Vec<f64> = (19..24).map(|index| script.due_s(index, 10.0)).collect();
        assert_eq!(due, [1.9, 2.3, 2.3, 2.3, 2.3]);
    }

    #[test]
    fn a_script_is_written_as_it_is_read_and_what_is_odd_is_refused() {
        let kinds = [
            FaultKind::Unplug { for_s: 1.0 },
            FaultKind::Stall { for_s: 1.0 },
            FaultKind::Hang,
            FaultKind::Crash,
            FaultKind::Reset,
            FaultKind::Torn { frames: 1 },
            FaultKind::Short { frames: 1 },
            FaultKind::Zero { frames: 1 },
            FaultKind::Lost { frames: 1 },
            FaultKind::Clock { step_s: -3.5 },
            FaultKind::Burst { frames: 20 },
            FaultKind::Noise { to_mm: 20.0, for_s: 2.0 },
        ];
        let faults = (0..).zip(kinds).map(|(at, kind)| Fault { at_s: f64::from(at), kind }).collect();
        let all = Script { recording: "a.mcap".into(), fps: Some(90.0), faults };
        assert_eq!(toml::from_str::<Script>(&all.to_toml()), Ok(all));
        for odd in [
            "",
            "recording = \"a\"\nspeed = 2\n",
            "recording = \"a\"\n[[fault]]\nat_s = 1.0\nkind = \"mow\"\n",
        ] {
            assert!(toml::from_str::<Script>(odd).is_err(), "{odd}");
        }
    }
}

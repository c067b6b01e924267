//! What a session was told between two frames. A recording of a live run holds it beside the frames, so that a replay
//! does the same at the same place.

use serde::{Deserialize, Serialize};

/// Something that changes what a session makes of the frames behind it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "note", rename_all = "snake_case")]
pub enum Note {
    /// The session begins here, or begins anew.
    Begins {
        /// What is before the camera was captured already, and is not captured again until it has gone.
        captured: bool,
    },
    /// Frames stopped coming for a while.
    Interrupted,
    /// Somebody asked for a capture.
    Asked,
    /// The station goes by another configuration.
    Config {
        /// Its sections that a capture goes by.
        toml: String,
    },
    /// Frames that the session saw are not in the recording.
    Dropped {
        /// So many.
        frames: u64,
    },
}

impl Note {
    /// One line of JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("texts and numbers can be written as JSON")
    }

    /// What [`Self::to_json`] gave; `None` for what is none, as a later version may write it.
    pub fn of_json(text: &str) -> Option<Self> {
        serde_json::from_str(text).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_come_back_as_they_were() {
        let notes = [
            Note::Begins { captured: true },
            Note::Interrupted,
            Note::Asked,
            Note::Config { toml: "[mask]\nnear_m = 0.31\n".to_owned() },
            Note::Dropped { frames: u64::MAX },
        ];
        for note in notes {
            assert_eq!(Note::of_json(&note.to_json()), Some(note));
        }
        assert_eq!(Note::of_json("{\"note\":\"mown\"}"), None);
        assert_eq!(Note::of_json(""), None);
    }
}

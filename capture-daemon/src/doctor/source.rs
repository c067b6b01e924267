//! The recording that is to be the sensor.

use std::time::Duration;

use super::{Finding, within};
use crate::config::Config;
use crate::recording;
use crate::source::SourceError;

/// Whether its first frame can be read. `played`: what a station that runs plays. Frames before it that cannot be used are no trouble: they are skipped.
pub(super) fn first_frame(config: &Config, played: Option<&str>, deadline: Duration) -> Finding {
    const CHECK: &str = "source";
    const EXPECTED: &str = "a recording whose first frame can be read";
    if let Some(driver) = config.sensor.driver {
        let found =
            format!("frames come from a sensor of {}; sward-capture devices lists them", driver.name());
        return Finding::skipped(CHECK, "sensor.driver", found);
    }
    let Some(path) = config.source.recording.clone() else {
        if let Some(played) = played {
            let found = format!("this configuration sets none; the station that runs plays {played}");
            return Finding::skipped(CHECK, "source.recording", found);
        }
        let found = "neither a recording nor a sensor is set: a station started so never captures anything";
        let remedy =
            "set source.recording or sensor.driver, or name the station's own configuration with --config";
        return Finding::trouble(CHECK, "source.recording", found, EXPECTED, remedy);
    };
    let (options, place) = (config.open_options(), path.display().to_string());
    let read = within(deadline, move || {
        let mut source = recording::open(&path, &options).map_err(|error| error.to_string())?;
        let mut skipped = 0;
        loop {
            match source.next_frame() {
                Ok(frame) => return Ok((frame.width, frame.height, skipped)),
                Err(SourceError::BadFrame(_) | SourceError::Interrupted(_)) => skipped += 1,
                Err(SourceError::Told(_)) => {}
                Err(error) => return Err(format!("not one frame can be read: {error}")),
            }
        }
    });
    match read {
        Some(Ok((width, height, 0))) => Finding::ok(CHECK, place, format!("frames of {width}x{height} px")),
        Some(Ok((width, height, skipped))) => Finding::ok(
            CHECK,
            place,
            format!("frames of {width}x{height} px, after {skipped} that are skipped"),
        ),
        Some(Err(reason)) => {
            let remedy = "set source.recording to another path, or see sward-capture info and recover";
            Finding::told(CHECK, &place, &reason, EXPECTED, remedy)
        }
        None => {
            let found = format!("it gives no frame within {} s", deadline.as_secs_f64());
            Finding::trouble(CHECK, place, found, EXPECTED, "see whether the disk or the mount hangs")
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::tests::assert_trouble;
    use super::super::{DEADLINE, Verdict};
    use super::*;

    fn of(path: &Path) -> Finding {
        let mut config = Config::default();
        config.source.recording = Some(path.to_path_buf());
        first_frame(&config, None, DEADLINE)
    }

    #[test]
    fn a_recording_that_cannot_be_read_is_trouble() {
        let other = first_frame(&Config::default(), Some("moss.mcap"), DEADLINE);
        assert!(other.verdict == Verdict::Skipped && other.found.contains("moss.mcap"), "{other:?}");
        assert_trouble(
            &first_frame(&Config::default(), None, DEADLINE),
            &["source.recording", "never captures", "--config"],
        );
        let shipped = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../recordings/single-1.mcap"));
        let found = of(shipped);
        assert_eq!((found.verdict, &*found.found), (Verdict::Ok, "frames of 640x480 px"));
        let folder = tempfile::tempdir().expect("a folder");
        let lost = folder.path().join("lost.mcap");
        assert_trouble(&of(&lost), &["lost.mcap", "no such file", "source.recording"]);
        std::fs::write(&lost, "Remember to water the grass.\n").expect("room");
        assert_trouble(&of(&lost), &["lost.mcap", "source.recording"]);
    }
}

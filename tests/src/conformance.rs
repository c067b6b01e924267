//! What every sensor does, whatever driver reads it: frames come as it took them, and it may go and come back as another.

use std::time::Instant;

use capture_daemon::config;
use capture_daemon::frame::DepthFrame;
use capture_daemon::source::host::SensorSource;
use capture_daemon::source::{FrameSource, SourceError};

use crate::programs::{DEADLINE, Program};
use crate::sensors::picture;

/// A place where a sensor can be plugged in that sends [`picture`] after picture.
pub trait Bench {
    /// Keys of the configuration for its sensors, with their values as TOML; a millimetre a count, and a `deadline_s` of a
    /// second.
    fn settings(&self) -> Vec<(&'static str, String)>;
    /// Plugs one in that sends pictures of so many columns and rows.
    fn plug(&mut self, size: [usize; 2]);
    /// Unplugs it.
    fn unplug(&mut self);
}

/// A source with these settings, and `more` of the form `key=value`; its sensor in a process of its own.
///
/// # Panics
/// If they are not valid.
pub fn source(settings: &[(&'static str, String)], more: &[&str]) -> SensorSource {
    let mut sets: Vec<String> = settings.iter().map(|(key, value)| format!("{key}={value}")).collect();
    sets.extend(more.iter().map(|set| (*set).to_owned()));
    SensorSource::new(&config::load(None, &sets).expect("valid"), Some(&Program::Capture.path()))
}

/// So many frames in a row.
///
/// # Panics
/// If anything else comes.
pub fn frames(source: &mut SensorSource, count: usize) -> Vec<DepthFrame> {
    let frame = |source: &mut SensorSource| source.next_frame().unwrap_or_else(|error| panic!("{error}"));
    (0..count).map(|_| frame(source)).collect()
}

/// Frames until there are none, and why.
///
/// # Panics
/// If they go on for ever, or the source ends.
pub fn until_interrupted(source: &mut SensorSource) -> (usize, String) {
    let start = Instant::now();
    let mut count = 0;
    while start.elapsed() < DEADLINE {
        match source.next_frame() {
            Ok(_) => count += 1,
            Err(SourceError::Interrupted(reason)) => return (count, reason),
            Err(error) => panic!("{error}"),
        }
    }
    panic!("it goes on: {count} frames");
}

/// The first frame that comes, whatever is said before.
///
/// # Panics
/// If none comes, or the source ends.
pub fn first_frame(source: &mut SensorSource) -> DepthFrame {
    let start = Instant::now();
    let mut said = None;
    while start.elapsed() < DEADLINE {
        match source.next_frame() {
            Ok(frame) => return frame,
            Err(SourceError::Interrupted(reason)) => said = Some(reason),
            Err(error) => panic!("{error}"),
        }
    }
    panic!("no frame comes: {said:?}");
}

/// Which frame of the sensor this is.
///
/// # Panics
/// If it is none.
pub fn number(frame: &DepthFrame) -> u32 {
    let is_it = |k: &u32| picture(*k, frame.width, frame.height) == frame.depth;
    (0..300).find(is_it).expect("a frame of the sensor, pixel for pixel")
}

/// Asserts what every sensor does.
///
/// # Panics
/// If it does not.
pub fn holds(bench: &mut impl Bench) {
    let mut source = source(&bench.settings(), &[]);
    let (count, reason) = until_interrupted(&mut source);
    assert!(count == 0 && reason.contains("is plugged in"), "{reason}");

    bench.plug([320, 240]);
    let first = first_frame(&mut source);
    let more = frames(&mut source, 9);
    let all: Vec<&DepthFrame> = [&first].into_iter().chain(&more).collect();
    for pair in all.windows(2) {
        assert!(number(pair[0]) < number(pair[1]), "frames come in order, each once");
        let seconds = (pair[1].timestamp_ns - pair[0].timestamp_ns) as f64 * 1e-9;
        assert!((1e-3..10.0).contains(&seconds), "{seconds} s from one to the next");
    }
    let camera = first.camera;
    assert_eq!((first.width, first.height, first.depth_unit_m), (320, 240, 0.001));
    assert!(
        camera.is_valid() && (camera.cx - 159.5).abs() < 20.0 && (camera.cy - 119.5).abs() < 20.0,
        "{camera:?}"
    );
    let fares = source.health().expect("it is live").now();
    assert!(
        fares.name.is_some_and(|name| name.contains("320x240")) && fares.trouble.is_none(),
        "{:?}",
        fares.trouble
    );

    bench.unplug();
    let (_, reason) = until_interrupted(&mut source);
    assert!(reason.contains("unplugged"), "{reason}");
    let (count, reason) = until_interrupted(&mut source);
    assert!(count == 0 && reason.contains("is plugged in"), "{count} frames, then {reason}");

    bench.plug([160, 120]);
    let frame = first_frame(&mut source);
    number(&frame);
    assert!(frame.width == 160 && frame.timestamp_ns > more[8].timestamp_ns);
    let fares = source.health().expect("it is live").now();
    assert!(fares.starts >= 2 && fares.failures == 1 && fares.trouble.is_none(), "{fares:?}");
    assert_eq!((fares.silences, fares.deaths), (0, 0), "{fares:?}");
}

//! A recording, read to its end.

use std::path::Path;

use capture_daemon::frame::DepthFrame;
use capture_daemon::recording::{self, OpenOptions};
use capture_daemon::source::SourceError;

/// The frames of a recording, and why others were skipped; or why it cannot be opened.
pub(crate) fn to_its_end(
    path: &Path,
    options: &OpenOptions,
) -> Result<(Vec<DepthFrame>, Vec<String>), String> {
    let mut source = recording::open(path, options).map_err(|error| error.to_string())?;
    let (mut frames, mut skipped) = (Vec::new(), Vec::new());
    loop {
        match source.next_frame() {
            Ok(frame) => frames.push(frame),
            Err(SourceError::BadFrame(why)) => skipped.push(why),
            Err(SourceError::End) => return Ok((frames, skipped)),
            Err(error) => panic!("{error}"),
        }
    }
}

//! A recording that is being written: what is on disk of it is whole up to the last half second, whatever happens.

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::shot::{Shape, Shot};
use crate::note::Note;
use crate::recording::{McapWriter, RecordingParams, WriteError};

/// How long frames may wait for their chunk to be written and synced. With what the disk takes for it, less than a second
/// is lost in a power failure.
const CHUNK: Duration = Duration::from_millis(500);

/// A recording that is open. It is ended when dropped, too; nobody learns then whether that went well.
pub(super) struct RecordingFile {
    path: PathBuf,
    /// The same file as the writer's, to sync and to cut it.
    file: File,
    writer: McapWriter<BufWriter<File>>,
    shape: Shape,
    begun: Instant,
    /// Since when frames wait for their chunk to end.
    chunk_since: Option<Instant>,
    /// Bytes that are on disk, and whole.
    synced_bytes: u64,
    /// Frames in these.
    synced_frames: u64,
    frames: u64,
}

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Written {
    /// Frames.
    pub(super) frames: u64,
    /// Bytes.
    pub(super) bytes: u64,
}

impl RecordingFile {
    /// Begins a recording at `path`, where nothing may be yet, with frames that are like the one of `shot`.
    ///
    /// # Errors
    /// When the file cannot be made.
    pub(super) fn create(
        path: &Path,
        params: RecordingParams,
        shot: &Shot,
        now: Instant,
    ) -> Result<Self, WriteError> {
        let io = |source| WriteError::Io { path: path.to_owned(), source };
        let file = OpenOptions::new().write(true).create_new(true).open(path).map_err(io)?;
        let begun = Self::begin(path, file, params, shot, now);
        if begun.is_err() {
            // Nothing of it is worth a file; where it cannot be removed, it is empty.
            let _ = std::fs::remove_file(path);
        }
        begun
    }

    fn begin(
        path: &Path,
        file: File,
        params: RecordingParams,
        shot: &Shot,
        now: Instant,
    ) -> Result<Self, WriteError> {
        let io = |source| WriteError::Io { path: path.to_owned(), source };
        let shared = file.try_clone().map_err(io)?;
        let writer = McapWriter::new(BufWriter::new(file), RecordingParams { is_live: true, ..params })?;
        // The file's name is on disk before its frames.
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        File::open(folder).and_then(|folder| folder.sync_all()).map_err(io)?;
        Ok(Self {
            path: path.to_owned(),
            file: shared,
            writer,
            shape: Shape::of(&shot.frame),
            begun: now,
            chunk_since: None,
            synced_bytes: 0,
            synced_frames: 0,
            frames: 0,
        })
    }

    /// Where it is.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// It goes by another name now.
    pub(super) fn moved(&mut self, path: PathBuf) {
        self.path = path;
    }

    /// For how long it has been written.
    pub(super) fn age(&self, now: Instant) -> Duration {
        now.saturating_duration_since(self.begun)
    }

    /// Frames that are on disk, and those that are not yet.
    pub(super) fn frames(&self) -> (u64, u64) {
        (self.synced_frames, self.frames - self.synced_frames)
    }

    /// Whether a frame can be part of it.
    pub(super) fn fits(&self, shot: &Shot) -> bool {
        Shape::of(&shot.frame) == self.shape
    }

    /// Adds a frame, and what the session was told before it. The first one begins the session anew.
    ///
    /// # Errors
    /// When it cannot be written; [`Self::salvage`] then keeps what is whole.
    pub(super) fn write(&mut self, shot: &Shot, now: Instant) -> Result<(), WriteError> {
        self.write_notes(&shot.notes, shot)?;
        self.chunk_since.get_or_insert(now);
        self.end_chunk_if_due(now)
    }

    fn write_notes(&mut self, notes: &[Note], shot: &Shot) -> Result<(), WriteError> {
        self.frames += 1;
        match (&shot.begins, self.frames) {
            // What it was told before is part of where it begins.
            (begins, 1) => {
                let begins = begins.clone().unwrap_or(Note::Begins { captured: false });
                self.writer.write_noted(&[begins], &shot.frame)?;
            }
            _ => self.writer.write_noted(notes, &shot.frame)?,
        }
        Ok(())
    }

    /// Ends the chunk and syncs it, if its first frame has waited for long enough.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub(super) fn end_chunk_if_due(&mut self, now: Instant) -> Result<(), WriteError> {
        let is_due = |since: Instant| now.saturating_duration_since(since) >= CHUNK;
        if !self.chunk_since.is_some_and(is_due) {
            return Ok(());
        }
        self.writer.end_chunk()?;
        self.sync()?;
        self.chunk_since = None;
        Ok(())
    }

    fn sync(&mut self) -> Result<(), WriteError> {
        let io = |source| WriteError::Io { path: self.path.clone(), source };
        self.file.sync_data().map_err(io)?;
        self.synced_bytes = self.file.metadata().map_err(io)?.len();
        self.synced_frames = self.frames;
        Ok(())
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// When it cannot be written; what is whole of it is kept then.
    pub(super) fn finish(self) -> Result<Written, WriteError> {
        let Self { path, file, writer, synced_bytes, frames, .. } = self;
        let io = |source| WriteError::Io { path: path.clone(), source };
        let ended = writer.finish().map(drop).and_then(|()| file.sync_all().map_err(io));
        if let Err(error) = ended {
            keep_whole(&file, synced_bytes);
            return Err(error);
        }
        let bytes = file.metadata().map_err(io)?.len();
        Ok(Written { frames, bytes })
    }

    /// After an error: cuts off what is not whole; a replay reads what is left to its end. A file of which nothing is
    /// whole is removed.
    pub(super) fn salvage(self) {
        let Self { path, file, writer, synced_bytes, .. } = self;
        // Without its buffer, which would be written when it is dropped.
        let _ = writer.abandon().into_parts();
        if synced_bytes == 0 {
            if let Err(error) = std::fs::remove_file(&path) {
                tracing::debug!(%error, "an empty recording cannot be removed");
            }
        } else {
            keep_whole(&file, synced_bytes);
        }
    }
}

/// Where the disk does not even take that, a reader passes over what is torn.
fn keep_whole(file: &File, bytes: u64) {
    let cut = file.set_len(bytes).and_then(|()| file.sync_data());
    if let Err(error) = cut {
        tracing::debug!(%error, "a recording cannot be cut to what is whole");
    }
}

/// Removes a file that may be gone already.
pub(super) fn remove(path: &Path) -> io::Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::bar;
    use crate::recording::{self, OpenOptions as ReadOptions};
    use crate::source::SourceError;

    fn shot(index: u64) -> Shot {
        let frame = Arc::new(bar::frame(index, (index % 40 > 10).then_some(500), 1300));
        let begins = (index == 0).then_some(Note::Begins { captured: false });
        Shot { notes: Vec::new(), begins, frame }
    }

    /// Times of the frames that a replay reads; none where it opens nothing.
    fn read(bytes: &[u8], folder: &Path) -> Vec<u64> {
        let path = folder.join("cut.mcap");
        std::fs::write(&path, bytes).expect("room");
        let Ok(mut source) = recording::open(&path, &ReadOptions::default()) else { return Vec::new() };
        let mut times = Vec::new();
        loop {
            match source.next_frame() {
                Ok(frame) => times.push(frame.timestamp_ns),
                Err(SourceError::Told(_)) => {}
                Err(SourceError::End) => return times,
                Err(error) => panic!("{error}"),
            }
        }
    }

    /// Of a power failure nothing is left but what was synced, and behind it zeros, noise, or the beginning of more.
    #[test]
    fn what_was_synced_is_read_up_to_the_last_second_whatever_stands_behind_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.mcap");
        let start = Instant::now();
        let mut file = None;
        let mut checked = 0;
        for index in 0..100 {
            let shot = shot(index);
            let now = start + Duration::from_nanos(shot.frame.timestamp_ns - 1_000_000_000);
            let file = file.get_or_insert_with(|| {
                RecordingFile::create(&path, RecordingParams::default(), &shot, now).expect("room")
            });
            file.write(&shot, now).expect("room");
            let now_ns = shot.frame.timestamp_ns;
            if index % 7 != 3 || now_ns < 2_000_000_000 {
                continue;
            }
            let bytes = std::fs::read(&path).expect("readable");
            let whole = &bytes[..file.synced_bytes as usize];
            for tail in [&[][..], &[0; 3000], &[0x5a; 777], &whole[whole.len() - 500..]] {
                let times = read(&[whole, tail].concat(), folder.path());
                let expected: Vec<u64> =
                    (0..=index).map(|index| tests::shot(index).frame.timestamp_ns).collect();
                let last = *times.last().expect("frames");
                assert!(last + 1_000_000_000 > now_ns, "{last} of {now_ns}");
                assert_eq!(times, expected[..times.len()], "each frame once, in order");
                checked += 1;
            }
        }
        assert!(checked > 30);
    }

    #[test]
    fn frames_are_written_though_none_follow() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.mcap");
        let now = Instant::now();
        let mut file = RecordingFile::create(&path, RecordingParams::default(), &shot(0), now).expect("room");
        file.write(&shot(0), now).expect("room");
        file.end_chunk_if_due(now + CHUNK / 2).expect("room");
        assert!(read(&std::fs::read(&path).expect("readable"), folder.path()).is_empty());
        file.end_chunk_if_due(now + CHUNK).expect("room");
        assert_eq!(read(&std::fs::read(&path).expect("readable"), folder.path()).len(), 1);
    }

    #[test]
    fn what_fails_is_cut_to_what_is_whole() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.mcap");
        let start = Instant::now();
        let mut file =
            RecordingFile::create(&path, RecordingParams::default(), &shot(0), start).expect("room");
        for index in 0..40 {
            file.write(&shot(index), start + Duration::from_millis(index * 33)).expect("room");
        }
        let whole = file.synced_bytes;
        file.salvage();
        assert_eq!(std::fs::metadata(&path).expect("it is there").len(), whole);
        assert!(read(&std::fs::read(&path).expect("readable"), folder.path()).len() >= 15);
        let empty = folder.path().join("b.mcap");
        RecordingFile::create(&empty, RecordingParams::default(), &shot(0), start).expect("room").salvage();
        assert!(!empty.exists());
        let there = RecordingFile::create(&path, RecordingParams::default(), &shot(0), start);
        assert!(there.is_err(), "nothing is overwritten");
    }
}

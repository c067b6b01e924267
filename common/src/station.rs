//! The station as its clients call it: the methods of `io.sward.Station`, and what comes with a reply in shared
//! memory, checked before it is used.

use std::os::fd::OwnedFd;

use crate::library::{Snapshot, SnapshotError};
use crate::preview::{self, PreviewError};
use crate::protocol::{
    GetStatusReply, Library, ListBladesReply, ListHistoryReply, ListRecordingsReply, ListRemovedReply,
    MAX_SNAPSHOT_BYTES, Preview, RecordingEnd, RecordingName, ReloadReply, StationError,
};
use crate::sealed::{SealedBytes, SealedError};

/// The methods, for a connection of zlink on whatever runtime.
#[zlink_core::proxy(interface = "io.sward.Station", crate = "zlink_core")]
pub trait StationProxy {
    /// The newest library, as soon as its generation is beyond `after`.
    #[zlink(return_fds)]
    async fn get_library(
        &mut self,
        after: i64,
    ) -> zlink_core::Result<(Result<Library, StationError>, Vec<OwnedFd>)>;
    /// The newest preview, as soon as its sequence number is another than `after`.
    #[zlink(return_fds)]
    async fn get_preview(
        &mut self,
        after: i64,
    ) -> zlink_core::Result<(Result<Preview, StationError>, Vec<OwnedFd>)>;
    /// What the station is doing.
    async fn get_status(&mut self) -> zlink_core::Result<Result<GetStatusReply, StationError>>;
    /// What the library holds.
    async fn list_blades(&mut self) -> zlink_core::Result<Result<ListBladesReply, StationError>>;
    /// What a name can go back to.
    async fn list_history(
        &mut self,
        name: &str,
    ) -> zlink_core::Result<Result<ListHistoryReply, StationError>>;
    /// What names that no blade has now would go back to.
    async fn list_removed(&mut self) -> zlink_core::Result<Result<ListRemovedReply, StationError>>;
    /// Records from now on.
    async fn start_recording(&mut self) -> zlink_core::Result<Result<RecordingName, StationError>>;
    /// Ends the recording.
    async fn stop_recording(&mut self) -> zlink_core::Result<Result<RecordingEnd, StationError>>;
    /// Saves the last seconds.
    async fn save_recording(&mut self) -> zlink_core::Result<Result<RecordingName, StationError>>;
    /// What recordings there are.
    async fn list_recordings(&mut self) -> zlink_core::Result<Result<ListRecordingsReply, StationError>>;
    /// Has a recording stay, or no longer.
    async fn pin_recording(
        &mut self,
        name: &str,
        pinned: bool,
    ) -> zlink_core::Result<Result<(), StationError>>;
    /// Removes a recording.
    async fn remove_recording(&mut self, name: &str) -> zlink_core::Result<Result<(), StationError>>;
    /// Has the configuration read again.
    async fn reload(&mut self) -> zlink_core::Result<Result<ReloadReply, StationError>>;
    /// Sets how often a blade stands in the meadow.
    async fn set_mix(&mut self, name: &str, mix: f64) -> zlink_core::Result<Result<(), StationError>>;
    /// Gives a blade another name.
    async fn rename_blade(
        &mut self,
        name: &str,
        new_name: &str,
    ) -> zlink_core::Result<Result<(), StationError>>;
    /// Puts the blade of a file's text into the library.
    async fn put_blade(&mut self, name: &str, text: &str) -> zlink_core::Result<Result<(), StationError>>;
    /// Takes a blade away.
    async fn remove_blade(&mut self, name: &str) -> zlink_core::Result<Result<(), StationError>>;
    /// Goes back to an earlier one, so many; `None`: the newest.
    async fn restore_blade(
        &mut self,
        name: &str,
        back: Option<i64>,
    ) -> zlink_core::Result<Result<(), StationError>>;
}

/// Why what comes with a reply is not what the reply says.
#[derive(Debug, thiserror::Error)]
pub enum ReceiveError {
    /// The reply names a descriptor that did not come.
    #[error("it names descriptor {index} of {count}")]
    NoDescriptor {
        /// The descriptor's index.
        index: i64,
        /// Descriptors that came.
        count: usize,
    },
    /// It is not sealed, or cannot be mapped.
    #[error(transparent)]
    Sealed(#[from] SealedError),
    /// It is no snapshot of a library.
    #[error(transparent)]
    Snapshot(#[from] SnapshotError),
    /// It is no preview.
    #[error(transparent)]
    Preview(#[from] PreviewError),
    /// The reply says something else than the bytes.
    #[error("the reply says {field} {said}, the {bytes} has {found}")]
    Disagrees {
        /// Of what.
        field: &'static str,
        /// What the reply says.
        said: i64,
        /// What the bytes are.
        bytes: &'static str,
        /// What they say.
        found: u64,
    },
}

/// The library that came with a reply of `GetLibrary`.
///
/// # Errors
/// When it is not sealed, not valid, or not the one that the reply speaks of.
pub fn library(reply: &Library, descriptors: &[OwnedFd]) -> Result<Snapshot<SealedBytes>, ReceiveError> {
    let library = Snapshot::validate(map(reply.fd, descriptors, MAX_SNAPSHOT_BYTES)?)?;
    agree(
        "snapshot",
        &[
            ("generation", reply.generation, library.generation()),
            ("blades", reply.blades, library.len() as u64),
            ("size", reply.size, library.bytes().len() as u64),
        ],
    )?;
    Ok(library)
}

/// The preview that came with a reply of `GetPreview`.
///
/// # Errors
/// When it is not sealed, not valid, or not the one that the reply speaks of.
pub fn preview(
    reply: &Preview,
    descriptors: &[OwnedFd],
) -> Result<preview::Preview<SealedBytes>, ReceiveError> {
    let preview = preview::Preview::validate(map(reply.fd, descriptors, preview::MAX_BYTES)?)?;
    agree(
        "preview",
        &[
            ("sequence", reply.sequence, preview.header().sequence),
            ("size", reply.size, preview.bytes().len() as u64),
        ],
    )?;
    Ok(preview)
}

fn map(index: i64, descriptors: &[OwnedFd], limit: u64) -> Result<SealedBytes, ReceiveError> {
    let descriptor = usize::try_from(index).ok().and_then(|index| descriptors.get(index));
    let descriptor = descriptor.ok_or(ReceiveError::NoDescriptor { index, count: descriptors.len() })?;
    Ok(SealedBytes::map(descriptor, limit)?)
}

fn agree(bytes: &'static str, fields: &[(&'static str, i64, u64)]) -> Result<(), ReceiveError> {
    for (field, said, found) in fields.iter().copied() {
        if u64::try_from(said) != Ok(found) {
            return Err(ReceiveError::Disagrees { field, said, bytes, found });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preview::{Content, Header, State};

    fn library_reply(generation: i64, bytes: &[u8]) -> (Library, OwnedFd) {
        let size = bytes.len() as i64;
        (Library { generation, blades: 0, size, fd: 0 }, crate::sealed::seal("t", bytes).expect("memfd"))
    }

    #[test]
    fn a_reply_that_disagrees_with_its_snapshot_is_refused() {
        let bytes = crate::library::encode(7, &[]).expect("empty library");
        let (right, descriptor) = library_reply(7, &bytes);
        let descriptors = [descriptor];
        assert_eq!(library(&right, &descriptors).expect("valid").generation(), 7);
        let refused = |change: fn(&mut Library)| {
            let mut wrong = right;
            change(&mut wrong);
            library(&wrong, &descriptors).expect_err("refused").to_string()
        };
        assert_eq!(refused(|r| r.generation = 8), "the reply says generation 8, the snapshot has 7");
        assert_eq!(refused(|r| r.blades = -1), "the reply says blades -1, the snapshot has 0");
        assert_eq!(refused(|r| r.size = 1), "the reply says size 1, the snapshot has 64");
        assert_eq!(refused(|r| r.fd = 1), "it names descriptor 1 of 1");
        assert_eq!(refused(|r| r.fd = -1), "it names descriptor -1 of 1");
    }

    #[test]
    fn bytes_that_are_no_snapshot_are_refused() {
        let (reply, descriptor) = library_reply(1, b"no meadow here");
        assert!(matches!(library(&reply, &[descriptor]), Err(ReceiveError::Snapshot(_))));
    }

    #[test]
    fn a_reply_that_disagrees_with_its_preview_is_refused() {
        let header = Header {
            sequence: 3,
            frame: 0,
            timestamp_ns: 0,
            width: 0,
            height: 0,
            camera_px: [0.0; 4],
            window_mm: [300, 900],
            state: State::NoSource,
            hold: 0.0,
            capture: None,
        };
        let [code, words] = ["call_staff", "Please call the staff."];
        let content = Content { header, depth_mm: &[], mask: &[], labels: &[], polylines: &[], code, words };
        let bytes = preview::encode(&content).expect("nothing is too large");
        let descriptors = [crate::sealed::seal("t", &bytes).expect("memfd")];
        let right = Preview {
            sequence: 3,
            state: "no_source".to_owned(),
            code: code.to_owned(),
            words: words.to_owned(),
            size: bytes.len() as i64,
            fd: 0,
        };
        let preview = preview(&right, &descriptors).expect("valid");
        assert_eq!((preview.header(), preview.code(), preview.words()), (&header, code, words));
        let refused = |change: fn(&mut Preview)| {
            let mut wrong = right.clone();
            change(&mut wrong);
            super::preview(&wrong, &descriptors).expect_err("refused").to_string()
        };
        assert_eq!(refused(|r| r.sequence = 4), "the reply says sequence 4, the preview has 3");
        assert_eq!(
            refused(|r| r.size = 1),
            format!("the reply says size 1, the preview has {}", bytes.len())
        );
        assert_eq!(refused(|r| r.fd = 9), "it names descriptor 9 of 1");
        let library = crate::library::encode(3, &[]).expect("empty library");
        let library = [crate::sealed::seal("t", &library).expect("memfd")];
        assert!(matches!(super::preview(&right, &library), Err(ReceiveError::Preview(_))));
    }
}

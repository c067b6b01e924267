//! The files that a recording consists of: one, or those of a folder.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::PathBuf;

use super::records::{MAGIC, RecordReader};
use crate::recording::open_file;

/// One file of a recording.
#[derive(Clone, Debug)]
pub(in crate::recording) struct Part {
    /// Where it is.
    pub(in crate::recording) path: PathBuf,
}

/// Why a file cannot be read as MCAP. Each message goes on after \"is \" or \"is not a recording but \".
#[derive(Debug, thiserror::Error)]
pub(in crate::recording) enum PartError {
    /// The system refuses.
    #[error("a file that cannot be read ({0})")]
    Io(#[from] std::io::Error),
    /// Nothing in it.
    #[error("an empty file")]
    Empty,
    /// Fewer bytes than any MCAP file begins with.
    #[error("an MCAP file cut off in its first bytes")]
    CutInMagic,
    /// Other bytes than an MCAP file begins with.
    #[error("a file of another kind than MCAP")]
    NotMcap,
}

impl Part {
    /// Reads its records from the first one.
    pub(in crate::recording) fn reader(&self) -> Result<RecordReader<BufReader<File>>, PartError> {
        let mut file = open_file(&self.path)?;
        let metadata = file.metadata()?;
        let mut start = Vec::new();
        file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut start)?;
        match start.as_slice() {
            start if start == MAGIC => Ok(RecordReader::new(BufReader::new(file), metadata.len())?),
            [] => Err(PartError::Empty),
            start if MAGIC.starts_with(start) => Err(PartError::CutInMagic),
            _ => Err(PartError::NotMcap),
        }
    }
}

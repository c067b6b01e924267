//! What the store holds and refuses, as the service tells it.

use common::blade::Kind;
use common::protocol::{self, StationError};

use crate::store::StoreError;
use crate::store::record::Record;

/// A blade as the service shows it.
pub(super) fn shown(record: &Record) -> protocol::Blade {
    let blade = &record.blade;
    // What was measured as 0.1 is shown as 0.1, not as the f64 next to that f32.
    let shortest = |value: f32| format!("{value:?}").parse().unwrap_or(f64::from(value));
    protocol::Blade {
        name: blade.name().to_owned(),
        id: blade.id().to_string(),
        kind: match blade.kind() {
            Kind::Blade => "blade".to_owned(),
            Kind::Leaf => "leaf".to_owned(),
        },
        length_m: shortest(blade.length_m()),
        max_width_m: shortest(blade.max_width_m()),
        knots: blade.knots().len() as i64,
        mix: shortest(blade.mix()),
        quality: shortest(blade.quality()),
        pinned: record.pinned,
        captured_unix_ns: i64::try_from(blade.captured_unix_ns()).unwrap_or(i64::MAX),
        source: record.provenance.source.clone(),
        frames: record.provenance.frames.map(|frames| i64::try_from(frames).unwrap_or(i64::MAX)),
    }
}

/// A store's error as the service tells it.
pub(super) fn told(error: StoreError) -> StationError {
    let reason = error.to_string();
    match error {
        StoreError::NotFound(name) => StationError::NoSuchBlade { name },
        StoreError::Taken(name) => StationError::NameTaken { name },
        StoreError::Name(reason) => StationError::InvalidName { reason },
        StoreError::Mix(mix) => StationError::InvalidMix { mix },
        StoreError::NoHistory(name) => StationError::NothingToRestore { name },
        StoreError::Refused { reason } => StationError::FileRefused { reason },
        StoreError::AllPinned | StoreError::Disk { .. } => StationError::StoreTrouble { reason },
    }
}

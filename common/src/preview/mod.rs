//! What the station sees at one moment, as bytes: one contiguous block, sealed, mapped read-only and validated
//! by whoever receives it. `io.sward.Station.varlink` describes the bytes for readers in other languages.

pub mod layout;
mod view;

pub use layout::{
    CaptureNote, Content, EncodeError, HAND, Header, MAX_BYTES, Point, Polyline, PolylineKind, SEEN, State,
    encode,
};
pub use view::{PolylineView, Preview, PreviewError};

//! Synthetic recordings: blades of known shape, some in a hand, before the synthetic sensor.
//!
//! A [`Scene`] is a family and a seed; a [`Clip`] films it. Both are the same bits on every machine:
//! geometry and noise use only arithmetic that IEEE 754 defines exactly, and no clock. The picture
//! is that of real geometry, the ribbons of the blades and the hand drawn into a depth buffer four times as fine
//! as the pixels each way; the sensor's errors come on top.
//!
//! # Non-goals
//! Colour, and cameras with lens distortion.

pub mod accuracy;
mod arrange;
mod blade;
mod clip;
mod command;
mod hand;
mod held;
mod motion;
mod random;
pub mod refinement;
mod scene;
mod sensor;
mod surface;
mod sweep;
mod truth;

pub use blade::{SECTIONS, SHAPES, Section, Shape, SyntheticBlade};
pub use clip::{Clip, ClipParams, ClipParamsError};
pub use command::{Families, Format, SynthArgs, parse_size, run, write};
pub use held::Visit;
pub use motion::{Pose, VisitFrames};
pub use scene::{FAMILIES, Family, Scene};
pub use sensor::{BACKGROUND_M, DEPTH_UNIT_M};
pub use sweep::sweep;
pub use truth::{TRUTH_KNOTS, Truth, TruthBlade, TruthCamera, TruthKnot, TruthPose, TruthVisit};

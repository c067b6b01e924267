//! The meadow: grows the blades of a captured library, as many as the eye can see, into a landscape.
//!
//! The way of a frame: a snapshot of the library comes from [`library_watch`] (or a file), is planted
//! between two frames ([`frame::Meadow::plant`]), and each frame goes through [`frame::Meadow::draw`],
//! whether to a window ([`app`]) or to files ([`headless`]).
//!
//! In a window, [`nursery`] makes libraries ready beside the frames, and [`governor`] holds a frame budget;
//! [`mod@bench`] measures.
//!
//! Invariant: `scene` never names the GPU.

pub mod app;
pub mod bench;
pub mod cli;
pub mod frame;
pub mod garden;
pub mod governor;
pub mod gpu;
pub mod headless;
pub mod library_watch;
pub mod nursery;
pub mod passes;
pub mod scene;

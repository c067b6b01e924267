//! The capture stages: free functions from one result to the next, typed in and out.
//!
//! Invariant: a stage knows no clock, device, file, thread or log. The same input gives the same
//! bits.

pub mod accumulate;
mod behind;
mod bend;
pub mod blade;
pub mod blob;
mod buckets;
mod chamfer;
mod components;
pub mod confidence;
pub mod contour;
mod course;
pub mod cover;
pub mod crease;
mod crossing;
#[cfg(test)]
mod drawn;
pub mod hand;
mod hook;
mod join;
pub mod lift;
pub mod margin;
pub mod mask;
mod motion;
pub mod outside;
mod overhang;
pub mod partition;
pub mod presence;
mod rank;
mod ray;
mod register;
pub mod ribbon;
mod rootward;
pub mod section;
mod seed;
mod settle;
pub mod skeleton;
mod splice;
mod stem;
mod strip;
mod trail;
mod trend;
mod tuft;

//! The world on the CPU: what grows where, from where it is seen, how the wind goes. Nothing here
//! knows of a GPU; the passes carry the same laws out in WGSL and are held to these by tests.

pub mod camera;
pub mod grassland;
pub mod light;
pub mod perlin;
pub mod sky;
pub mod terrain;
pub mod wind;

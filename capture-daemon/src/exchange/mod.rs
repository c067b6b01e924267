//! Blades to and from the files of other programs: outlines as SVG, which an artist can redraw, and meshes as
//! GLB. No clock, no file: text and bytes in and out.

pub mod glb;
mod labels;
mod outline;
mod pressed;
pub mod svg_export;
pub mod svg_import;

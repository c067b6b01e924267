//! Blades to and from the files of other programs: outlines as SVG, which an artist can redraw, and meshes as
//! GLB. No clock, no file: text and bytes in and out.

mod fit;
pub mod glb;
mod labels;
mod likeness;
mod midrib;
mod outline;
mod pressed;
mod section;
pub mod svg_export;
pub mod svg_import;

//! The GPU: the device, buffers, shaders, targets and the way back to the CPU. No picture is made
//! here.

pub mod buffers;
pub mod device;
pub mod readback;
pub mod shader;
pub mod targets;
pub mod timing;

pub use device::Gpu;

//! Buffers and their bindings, in few words.

use wgpu::{BufferBindingType, BufferUsages, ShaderStages};

use super::Gpu;

/// A new buffer that holds `bytes` (at least 16, so that an empty list can be bound too).
pub fn upload(gpu: &Gpu, label: &str, usage: BufferUsages, bytes: &[u8]) -> wgpu::Buffer {
    let buffer = reserve(gpu, label, usage | BufferUsages::COPY_DST, bytes.len() as u64);
    gpu.queue.write_buffer(&buffer, 0, bytes);
    buffer
}

/// A new buffer of `size` bytes (at least 16), all zero.
pub fn reserve(gpu: &Gpu, label: &str, usage: BufferUsages, size: u64) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: size.next_multiple_of(4).max(16),
        usage,
        mapped_at_creation: false,
    })
}

/// What a shader does with a bound buffer.
#[derive(Clone, Copy, Debug)]
pub enum Use {
    /// `var<uniform>`.
    Uniform,
    /// `var<storage, read>`.
    Read,
    /// `var<storage, read_write>`.
    ReadWrite,
}

/// A bind group layout of buffers alone, bound in order.
pub fn layout(gpu: &Gpu, label: &str, visible: ShaderStages, uses: &[Use]) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = uses
        .iter()
        .zip(0..)
        .map(|(used, binding)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: visible,
            ty: wgpu::BindingType::Buffer {
                ty: match used {
                    Use::Uniform => BufferBindingType::Uniform,
                    Use::Read => BufferBindingType::Storage { read_only: true },
                    Use::ReadWrite => BufferBindingType::Storage { read_only: false },
                },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    gpu.device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

/// Binds whole buffers in order.
pub fn bind(
    gpu: &Gpu,
    label: &str,
    layout: &wgpu::BindGroupLayout,
    buffers: &[&wgpu::Buffer],
) -> wgpu::BindGroup {
    let entries: Vec<_> = buffers
        .iter()
        .zip(0..)
        .map(|(buffer, binding)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
        .collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some(label), layout, entries: &entries })
}

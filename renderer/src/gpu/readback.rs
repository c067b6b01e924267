//! From the GPU back to the CPU, waiting for it: for pictures on disk and for tests.

use super::Gpu;

/// Why bytes did not come back.
#[derive(Debug, thiserror::Error)]
#[error("the GPU did not give its result back: {0}; it may have been lost, start again")]
pub struct ReadbackError(String);

fn failed(error: impl std::fmt::Display) -> ReadbackError {
    ReadbackError(error.to_string())
}

/// The bytes of `buffer`, which was made with `COPY_SRC`.
///
/// # Errors
/// When the device is lost.
pub fn buffer(gpu: &Gpu, buffer: &wgpu::Buffer) -> Result<Vec<u8>, ReadbackError> {
    let staging = staging(gpu, buffer.size());
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
    gpu.queue.submit([encoder.finish()]);
    map(gpu, &staging)
}

/// The texels of an uncompressed texture, row by row from the top, without padding.
///
/// # Errors
/// When the device is lost.
pub fn texels(gpu: &Gpu, texture: &wgpu::Texture) -> Result<Vec<u8>, ReadbackError> {
    let (width, height) = (texture.width(), texture.height());
    let row = width * texture.format().block_copy_size(None).expect("a colour format has one size");
    let padded_row = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let staging = staging(gpu, u64::from(padded_row) * u64::from(height));
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &staging,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(padded_row),
                rows_per_image: None,
            },
        },
        texture.size(),
    );
    gpu.queue.submit([encoder.finish()]);
    let padded = map(gpu, &staging)?;
    Ok(padded.chunks(padded_row as usize).flat_map(|line| &line[..row as usize]).copied().collect())
}

fn staging(gpu: &Gpu, size: u64) -> wgpu::Buffer {
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
    super::buffers::reserve(gpu, "readback.staging", usage, size)
}

fn map(gpu: &Gpu, staging: &wgpu::Buffer) -> Result<Vec<u8>, ReadbackError> {
    let (sender, receiver) = std::sync::mpsc::channel();
    staging.slice(..).map_async(wgpu::MapMode::Read, move |result| {
        // The receiver waits below; it is gone only if polling failed, which is reported there.
        let _ = sender.send(result);
    });
    gpu.device.poll(wgpu::PollType::wait_indefinitely()).map_err(failed)?;
    receiver.recv().map_err(failed)?.map_err(failed)?;
    let bytes = staging.slice(..).get_mapped_range().map_err(failed)?;
    Ok(bytes.to_vec())
}

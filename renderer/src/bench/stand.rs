//! A meadow whose frames are measured.

use std::time::Instant;

use anyhow::Context;

use super::report::{PassTime, Scene};
use crate::frame::{Meadow, View};
use crate::gpu::targets::{self, Targets};
use crate::gpu::timing::Timing;
use crate::gpu::{Gpu, device, readback};
use crate::passes::cull::gpu_data::Draw;
use crate::passes::cull::level_indices;

/// A meadow, its device, and a clock.
#[derive(Debug)]
pub(super) struct Stand {
    pub(super) gpu: Gpu,
    pub(super) meadow: Meadow,
    targets: Targets,
    picture: wgpu::Texture,
    display: wgpu::TextureView,
    timing: Timing,
}

impl Stand {
    /// A bare meadow for pictures of `size` pixels, on a device of its own.
    pub(super) fn open(size: (u32, u32)) -> anyhow::Result<Self> {
        let format = targets::PICTURE;
        let gpu = Gpu::open(&device::instance(), None)?;
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let picture = targets::texture(&gpu, "picture", size, format, 1, usage);
        let mut meadow = Meadow::new(&gpu, format);
        // The paper's scheme has none; with them, both would draw the same again.
        meadow.set_shadows(false);
        Ok(Self {
            meadow,
            targets: Targets::new(&gpu, size),
            timing: Timing::new(&gpu).context("the device has no timestamps; measure on another one")?,
            display: picture.create_view(&Default::default()),
            picture,
            gpu,
        })
    }

    /// What draws: adapter and driver.
    pub(super) fn adapter(&self) -> String {
        let info = self.gpu.adapter.get_info();
        format!("{}, {}", info.name, info.driver_info)
    }

    /// Draws a frame and waits for it: seconds.
    pub(super) fn frame(&self, view: &View) -> anyhow::Result<f64> {
        let started = Instant::now();
        self.meadow.draw(&self.gpu, &self.targets, view, &self.display);
        self.gpu.device.poll(wgpu::PollType::wait_indefinitely()).context("the GPU was lost")?;
        Ok(started.elapsed().as_secs_f64())
    }

    /// Draws a frame and adds what it took to `scene`. Returns the picture, 4 bytes a pixel.
    pub(super) fn measure(&self, view: &View, scene: Option<&mut Scene>) -> anyhow::Result<Vec<u8>> {
        let started = Instant::now();
        self.meadow.draw_timed(&self.gpu, &self.targets, view, &self.display, Some(&self.timing));
        self.gpu.device.poll(wgpu::PollType::wait_indefinitely()).context("the GPU was lost")?;
        let seconds = started.elapsed().as_secs_f64();
        let passes = self.timing.take(&self.gpu)?;
        if let Some(scene) = scene {
            let draws = readback::buffer(&self.gpu, &self.meadow.cull().draws)?;
            let draws = draws.chunks_exact(size_of::<Draw>()).map(bytemuck::pod_read_unaligned::<Draw>);
            scene.level_blades = draws.map(|draw| draw.instance_count).collect();
            let triangles = scene.level_blades.iter().zip(level_indices());
            scene.triangles =
                triangles.map(|(blades, indices)| u64::from(*blades) * u64::from(indices / 3)).sum();
            scene.frames_s.push(seconds);
            for timed in passes {
                match scene.passes.iter_mut().find(|pass| pass.pass == timed.pass) {
                    Some(pass) => pass.least_s = pass.least_s.min(timed.seconds),
                    None => {
                        scene.passes.push(PassTime { pass: timed.pass.to_string(), least_s: timed.seconds })
                    }
                }
            }
            let memory = self.gpu.device.generate_allocator_report();
            scene.gpu_bytes = memory.map_or(0, |report| report.total_allocated_bytes);
        }
        Ok(readback::texels(&self.gpu, &self.picture)?)
    }
}

//! The instance, the adapter and the device.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::shader::Sources;

/// Why there is no device to draw with.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// No Vulkan adapter, or none that can show pictures on the window.
    #[error(
        "no Vulkan device was found{on}: install the graphics driver, or mesa-vulkan-drivers to draw in software"
    )]
    NoAdapter {
        /// " that can draw to this window", or nothing.
        on: &'static str,
    },
    /// The adapter gave no device.
    #[error("the Vulkan device {adapter} cannot be opened: {source}; update its driver")]
    Device {
        /// Name of the adapter.
        adapter: String,
        /// What the driver said.
        source: wgpu::RequestDeviceError,
    },
}

/// An open device and its queue.
#[derive(Debug)]
pub struct Gpu {
    /// Where it comes from; says what a surface can do.
    pub adapter: wgpu::Adapter,
    /// The device.
    pub device: wgpu::Device,
    /// Its only queue.
    pub queue: wgpu::Queue,
    /// What the passes are made from when they are made the next time.
    pub shaders: Sources,
    lost: Arc<AtomicBool>,
}

/// A Vulkan instance, without validation layers.
pub fn instance() -> wgpu::Instance {
    wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    })
}

impl Gpu {
    /// Opens the best adapter: a discrete GPU before an integrated one before software. With
    /// `surface`, only adapters that can present to it.
    ///
    /// # Errors
    /// When there is no Vulkan adapter, or it gives no device.
    pub fn open(instance: &wgpu::Instance, surface: Option<&wgpu::Surface<'_>>) -> Result<Self, OpenError> {
        let mut adapters = ready(instance.enumerate_adapters(wgpu::Backends::VULKAN));
        adapters.retain(|adapter| surface.is_none_or(|surface| adapter.is_surface_supported(surface)));
        let adapter = adapters.into_iter().min_by_key(|adapter| rank(adapter.get_info().device_type));
        let on = if surface.is_some() { " that can draw to this window" } else { "" };
        let adapter = adapter.ok_or(OpenError::NoAdapter { on })?;
        let info = adapter.get_info();
        let (device, queue) = ready(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("sward"),
            // One indirect draw serves all levels of detail, each with its own first instance. Timestamps are
            // for the bench alone.
            required_features: wgpu::Features::INDIRECT_FIRST_INSTANCE
                | adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
            // wgpu's defaults are what every driver has: 8 storage buffers a stage, workgroups of 256, bindings
            // of 128 MiB. No more is asked for.
            required_limits: wgpu::Limits::default().using_resolution(adapter.limits()),
            ..Default::default()
        }))
        .map_err(|source| OpenError::Device { adapter: info.name.clone(), source })?;
        tracing::info!(adapter = %info.name, driver = %info.driver_info, kind = ?info.device_type, "device open");
        let reported = AtomicBool::new(false);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            // A broken frame breaks again sixty times a second: said once.
            if !reported.swap(true, Ordering::Relaxed) {
                tracing::error!(%error, "the GPU refused a command; the picture may be incomplete");
            }
        }));
        let lost = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&lost);
        device.set_device_lost_callback(move |reason, text| {
            // Also called when the device is let go of, which is no loss.
            if !text.is_empty() {
                tracing::debug!(?reason, text, "device lost");
            }
            seen.store(true, Ordering::Relaxed);
        });
        Ok(Self { adapter, device, queue, shaders: Sources::default(), lost })
    }
}

impl Gpu {
    /// The same device; the passes made from now on are made from these.
    #[must_use]
    pub fn with_shaders(self, shaders: Sources) -> Self {
        Self { shaders, ..self }
    }

    /// Whether the driver has given the device up: all that was made on it is void.
    pub fn is_lost(&self) -> bool {
        self.lost.load(Ordering::Relaxed)
    }
}

fn rank(kind: wgpu::DeviceType) -> u32 {
    match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

/// The result of a future of wgpu, which is ready at once everywhere but in a browser.
pub(crate) fn ready<T>(future: impl Future<Output = T>) -> T {
    let mut context = std::task::Context::from_waker(std::task::Waker::noop());
    let mut future = std::pin::pin!(future);
    loop {
        if let std::task::Poll::Ready(value) = future.as_mut().poll(&mut context) {
            return value;
        }
        std::thread::yield_now();
    }
}

//! Transformations as WGSL compute shaders through wgpu.

mod mlp;

use std::{
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

pub use mlp::MlpGpu;

use crate::Error;

/// No submission may take longer; a driver that hangs becomes an error.
const TIMEOUT: Duration = Duration::from_secs(120);

/// Which adapters to consider.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdapterKind {
    /// Discrete, integrated and virtual GPUs.
    Hardware,
    /// Hardware if there is some, else a software rasteriser such as lavapipe.
    Any,
}

/// An open device.
#[derive(Clone, Debug)]
pub struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    name: String,
    /// The first error that the device reported outside a call, such as its loss.
    failure: Arc<Mutex<Option<String>>>,
}

impl Gpu {
    /// Opens the first adapter of the given kind, discrete GPUs first.
    ///
    /// # Errors
    /// [`Error::NoAdapter`] if there is none, [`Error::Gpu`] if it cannot be opened.
    pub fn open(kind: AdapterKind) -> Result<Self, Error> {
        pollster::block_on(Self::open_async(kind))
    }

    async fn open_async(kind: AdapterKind) -> Result<Self, Error> {
        let backends = wgpu::Backends::PRIMARY;
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let mut adapters = instance.enumerate_adapters(backends).await;
        let rank = |adapter: &wgpu::Adapter| match adapter.get_info().device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        };
        adapters.retain(|adapter| kind == AdapterKind::Any || rank(adapter) < 3);
        adapters.sort_by_key(rank);
        let adapter = adapters.into_iter().next().ok_or_else(|| {
            Error::NoAdapter("no Vulkan, Metal or Direct3D 12 driver offers one".into())
        })?;

        let info = adapter.get_info();
        let (device, queue) = adapter
            .request_device(&wgpu::DeviceDescriptor {
                label: Some("nst"),
                required_limits: adapter.limits(),
                ..Default::default()
            })
            .await
            .map_err(|error| Error::Gpu(format!("{}: {error}", info.name)))?;

        let failure = Arc::new(Mutex::new(None));
        let note = |failure: &Mutex<Option<String>>, message: String| {
            failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(message);
        };
        let on_error = Arc::clone(&failure);
        device.on_uncaptured_error(Arc::new(move |error| note(&on_error, error.to_string())));
        let on_lost = Arc::clone(&failure);
        device.set_device_lost_callback(move |_, message| {
            note(&on_lost, format!("the device was lost: {message}"));
        });
        Ok(Self { device, queue, name: info.name, failure })
    }

    /// The adapter's name, as its driver gives it.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Fails if the device has reported an error.
    fn check(&self) -> Result<(), Error> {
        match &*self.failure.lock().unwrap_or_else(PoisonError::into_inner) {
            Some(message) => Err(Error::Gpu(format!("{}: {message}", self.name))),
            None => Ok(()),
        }
    }

    /// Waits for all submitted work, but not for ever.
    fn wait(&self) -> Result<(), Error> {
        let wait = wgpu::PollType::Wait { submission_index: None, timeout: Some(TIMEOUT) };
        match self.device.poll(wait) {
            Ok(_) => self.check(),
            Err(error) => Err(Error::Gpu(format!("{}: {error}", self.name))),
        }
    }
}

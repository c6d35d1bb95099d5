//! Transformations as WGSL compute shaders through wgpu.

mod mlp;
mod shader;

use std::{
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

pub use mlp::{GpuOptions, MlpGpu};
pub use shader::{Kernel, Precision};

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

/// Bounds on an adapter's limits; `None` leaves a limit as it is.
#[derive(Clone, Copy, Debug, Default)]
pub struct LowerLimits {
    /// Bytes of workgroup memory.
    pub workgroup_bytes: Option<u32>,
    /// Invocations per workgroup.
    pub invocations: Option<u32>,
    /// Workgroups per dispatch.
    pub workgroups: Option<u32>,
    /// Bytes of a storage buffer.
    pub binding_bytes: Option<u64>,
}

/// An open device.
#[derive(Clone, Debug)]
pub struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    name: String,
    software: bool,
    /// The first error that the device reported outside a call, such as its loss.
    failure: Arc<Mutex<Option<String>>>,
}

impl Gpu {
    /// Opens the first adapter of the given kind, discrete GPUs first.
    ///
    /// # Errors
    /// [`Error::NoAdapter`] if there is none, [`Error::Gpu`] if it cannot be opened.
    pub fn open(kind: AdapterKind) -> Result<Self, Error> {
        Self::open_with(kind, &LowerLimits::default())
    }

    /// The same, with lower limits than the adapter's own: a test of what runs where.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn open_with(kind: AdapterKind, lower: &LowerLimits) -> Result<Self, Error> {
        pollster::block_on(Self::open_async(kind, lower))
    }

    async fn open_async(kind: AdapterKind, lower: &LowerLimits) -> Result<Self, Error> {
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
        let mut limits = adapter.limits();
        let lower_to = |limit: &mut u32, bound: Option<u32>| {
            *limit = (*limit).min(bound.unwrap_or(u32::MAX));
        };
        lower_to(&mut limits.max_compute_workgroup_storage_size, lower.workgroup_bytes);
        lower_to(&mut limits.max_compute_invocations_per_workgroup, lower.invocations);
        lower_to(&mut limits.max_compute_workgroups_per_dimension, lower.workgroups);
        let bound = lower.binding_bytes.unwrap_or(u64::MAX);
        limits.max_storage_buffer_binding_size = limits.max_storage_buffer_binding_size.min(bound);
        let (device, queue) = adapter
            .request_device(&wgpu::DeviceDescriptor {
                label: Some("nst"),
                required_features: adapter.features() & wgpu::Features::SHADER_F16,
                required_limits: limits,
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
        let software = info.device_type == wgpu::DeviceType::Cpu;
        Ok(Self { device, queue, name: info.name, software, failure })
    }

    /// The adapter's name, as its driver gives it.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether it is a program that runs on the CPU, such as lavapipe.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.software
    }

    /// Whether it takes [`Precision::F16`].
    #[must_use]
    pub fn has_f16(&self) -> bool {
        self.device.features().contains(wgpu::Features::SHADER_F16)
    }

    /// Loses the device, as a driver does that crashes; for tests.
    #[doc(hidden)]
    pub fn lose(&self) {
        self.device.destroy();
    }

    /// Fails if the device has reported an error.
    fn check(&self) -> Result<(), Error> {
        match &*self.failure.lock().unwrap_or_else(PoisonError::into_inner) {
            Some(message) => Err(Error::Gpu(format!("{}: {message}", self.name))),
            None => Ok(()),
        }
    }

    /// Waits for a submission, or for all, but not for ever.
    fn wait(&self, submission_index: Option<wgpu::SubmissionIndex>) -> Result<(), Error> {
        let wait = wgpu::PollType::Wait { submission_index, timeout: Some(TIMEOUT) };
        match self.device.poll(wait) {
            Ok(_) => self.check(),
            Err(error) => Err(Error::Gpu(format!("{}: {error}", self.name))),
        }
    }
}

//! Adapters, and the devices that are opened on them.

use std::time::Duration;

use super::{
    failure::{Failure, message},
    fault::{self, Fault},
};
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

/// Bounds on what an adapter has; `None` leaves a limit as it is.
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
    /// Whether f16 is left out.
    pub without_f16: bool,
}

impl LowerLimits {
    fn applied_to(&self, mut limits: wgpu::Limits) -> wgpu::Limits {
        fn lower<T: Ord + Copy>(limit: &mut T, bound: Option<T>) {
            *limit = bound.map_or(*limit, |bound| bound.min(*limit));
        }
        lower(&mut limits.max_compute_workgroup_storage_size, self.workgroup_bytes);
        lower(&mut limits.max_compute_invocations_per_workgroup, self.invocations);
        lower(&mut limits.max_compute_workgroups_per_dimension, self.workgroups);
        lower(&mut limits.max_storage_buffer_binding_size, self.binding_bytes);
        limits
    }
}

/// An open device.
#[derive(Clone, Debug)]
pub struct Gpu {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) name: String,
    software: bool,
    /// If it was opened with them.
    pub(super) cooperative: Option<Cooperative>,
    pub(super) failure: Failure,
}

impl Gpu {
    /// Opens the first adapter of the given kind, discrete GPUs first.
    ///
    /// # Errors
    /// [`Error::NoAdapter`] if there is none, [`Error::Gpu`] if it cannot be opened.
    pub fn open(kind: AdapterKind) -> Result<Self, Error> {
        let workgroup_bytes = (fault::wanted() == Some(Fault::Limits)).then_some(64);
        Self::open_with(kind, &LowerLimits { workgroup_bytes, ..LowerLimits::default() })
    }

    /// The same, with lower limits than the adapter's own: a test of what runs where.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn open_with(kind: AdapterKind, lower: &LowerLimits) -> Result<Self, Error> {
        pollster::block_on(Self::open_async(kind, lower, false))
    }

    /// The same, with what is experimental in wgpu: cooperative matrices, where the
    /// adapter has them in f16 with sums in f32.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn open_experimental(kind: AdapterKind) -> Result<Self, Error> {
        pollster::block_on(Self::open_async(kind, &LowerLimits::default(), true))
    }

    async fn open_async(
        kind: AdapterKind,
        lower: &LowerLimits,
        experimental: bool,
    ) -> Result<Self, Error> {
        let adapter = best_adapter(kind).await?;
        let info = adapter.get_info();
        if fault::wanted() == Some(Fault::Open) {
            return Err(Error::Gpu(format!("{}: it does not open", info.name)));
        }
        let cooperative = Cooperative::of(&adapter).filter(|_| experimental);
        let mut required_features = adapter.features() & wgpu::Features::SHADER_F16;
        if lower.without_f16 {
            required_features = wgpu::Features::empty();
        }
        let mut experimental_features = wgpu::ExperimentalFeatures::disabled();
        if cooperative.is_some() {
            required_features |= wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX;
            #[allow(unsafe_code)]
            // SAFETY: the caller has asked for what wgpu does not vouch for.
            let enabled = unsafe { wgpu::ExperimentalFeatures::enabled() };
            experimental_features = enabled;
        }
        let (device, queue) = adapter
            .request_device(&wgpu::DeviceDescriptor {
                label: Some("nst"),
                required_features,
                required_limits: lower.applied_to(adapter.limits()),
                experimental_features,
                ..Default::default()
            })
            .await
            .map_err(|error| Error::Gpu(format!("{}: {error}", info.name)))?;
        let failure = Failure::watch(&device);
        let software = info.device_type == wgpu::DeviceType::Cpu;
        Ok(Self { device, queue, name: info.name, software, cooperative, failure })
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

    /// Whether it takes [`Precision::F16`](super::Precision::F16).
    #[must_use]
    pub fn has_f16(&self) -> bool {
        self.device.features().contains(wgpu::Features::SHADER_F16)
    }

    /// Whether it takes [`Kernel::Cooperative`](super::Kernel::Cooperative).
    #[must_use]
    pub fn has_cooperative_matrices(&self) -> bool {
        self.cooperative.is_some()
    }

    /// Loses the device, as a driver does that crashes; for tests.
    #[doc(hidden)]
    pub fn lose(&self) {
        self.device.destroy();
    }

    /// An error that names the adapter.
    pub(super) fn error(&self, message: impl std::fmt::Display) -> Error {
        Error::Gpu(format!("{}: {message}", self.name))
    }

    /// Makes a call of several steps. It fails if one of them does, or if the device reports
    /// an error meanwhile; the next call knows nothing of that, unless the device is lost.
    pub(super) fn call<T>(&self, steps: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
        use wgpu::ErrorFilter::{Internal, OutOfMemory, Validation};
        self.check()?;
        // What was refused for want of memory is later not valid either: the cause counts.
        let scopes = [Validation, Internal, OutOfMemory];
        let scopes = scopes.map(|filter| self.device.push_error_scope(filter));
        let result = steps();
        let mut reported = None;
        // Scopes end in the reverse order, each on this thread.
        for scope in scopes.into_iter().rev() {
            let error = pollster::block_on(scope.pop());
            reported = reported.or(error);
        }
        self.check()?;
        match reported {
            Some(error) => Err(self.error(message(&error))),
            None => result,
        }
    }

    /// Fails if the device is of no more use.
    fn check(&self) -> Result<(), Error> {
        self.failure.message().map_or(Ok(()), |message| Err(self.error(message)))
    }

    /// Waits for a submission, or for all, but not for ever.
    pub(super) fn wait(
        &self,
        submission_index: Option<wgpu::SubmissionIndex>,
    ) -> Result<(), Error> {
        let wait = wgpu::PollType::Wait { submission_index, timeout: Some(TIMEOUT) };
        self.device.poll(wait).map_or_else(|error| Err(self.error(error)), |_| Ok(()))
    }
}

/// The first adapter of the given kind, discrete GPUs first.
/// The adapters that this machine's drivers offer, in the order in which they are preferred:
/// for each its name, what kind of device it is, its interface and its driver, in one line.
#[must_use]
pub fn adapters() -> Vec<String> {
    let described = |adapter: &wgpu::Adapter| {
        let wgpu::AdapterInfo { name, device_type, backend, driver, driver_info, .. } =
            adapter.get_info();
        format!("{name} ({device_type:?}, {backend:?}, {driver} {driver_info})")
    };
    pollster::block_on(all_adapters()).iter().map(described).collect()
}

/// All adapters, the best first.
async fn all_adapters() -> Vec<wgpu::Adapter> {
    let backends = wgpu::Backends::PRIMARY;
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let mut adapters = instance.enumerate_adapters(backends).await;
    adapters.sort_by_key(rank);
    adapters
}

/// The lower, the better.
fn rank(adapter: &wgpu::Adapter) -> u32 {
    match adapter.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

async fn best_adapter(kind: AdapterKind) -> Result<wgpu::Adapter, Error> {
    let any = kind == AdapterKind::Any || fault::wanted().is_some();
    let adapters = all_adapters().await;
    let none = || Error::NoAdapter("no Vulkan, Metal or Direct3D 12 driver offers one".into());
    adapters.into_iter().find(|adapter| any || rank(adapter) < 3).ok_or_else(none)
}

/// Matrices that a subgroup multiplies together: f16 with sums in f32.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cooperative {
    /// Rows and columns: 8 or 16.
    pub(super) size: u32,
    /// Invocations per subgroup.
    pub(super) subgroup: u32,
}

impl Cooperative {
    /// The largest that an adapter has, if its subgroups are all of one size.
    fn of(adapter: &wgpu::Adapter) -> Option<Self> {
        use wgpu::{CooperativeScalarType as Type, Features};
        let info = adapter.get_info();
        let needed = Features::EXPERIMENTAL_COOPERATIVE_MATRIX | Features::SHADER_F16;
        let fixed = info.subgroup_min_size == info.subgroup_max_size;
        if !(fixed && adapter.features().contains(needed)) {
            return None;
        }
        let matrices = adapter.cooperative_matrix_properties();
        let has = |size: &u32| {
            matrices.iter().any(|matrix| {
                [matrix.m_size, matrix.n_size, matrix.k_size] == [*size; 3]
                    && (matrix.ab_type, matrix.cr_type) == (Type::F16, Type::F32)
            })
        };
        let size = [16, 8].into_iter().find(has)?;
        Some(Self { size, subgroup: info.subgroup_min_size })
    }
}

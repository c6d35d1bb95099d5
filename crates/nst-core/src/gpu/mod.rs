//! Transformations as WGSL compute shaders through wgpu.

mod buffers;
mod check;
mod device;
mod failure;
mod fault;
mod kernel;
mod mlp;
mod pack;

pub use device::{AdapterKind, Gpu, LowerLimits};
pub use kernel::{Kernel, Precision};
pub use mlp::{GpuOptions, MlpGpu};

//! Transformations as WGSL compute shaders through wgpu.

mod buffers;
mod check;
mod device;
mod failure;
mod fault;
mod filter;
mod kernel;
mod mlp;
mod options;
mod pack;

pub use device::{AdapterKind, Gpu, LowerLimits, adapters};
pub use filter::FilterGpu;
pub use mlp::MlpGpu;
pub use options::{GpuOptions, Kernel, Precision};

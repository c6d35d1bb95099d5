//! How a network is to be evaluated on a GPU.

use std::fmt;

/// How [`MlpGpu`](super::MlpGpu) is to evaluate a network.
#[derive(Clone, Copy, Debug, Default)]
pub struct GpuOptions {
    /// The shader.
    pub kernel: Kernel,
    /// Of the weights.
    pub precision: Precision,
}

/// A way to evaluate a network in WGSL; all give the same results but for rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kernel {
    /// Tiles of 4 neurons × 16 lanes per invocation; activations in workgroup memory.
    #[default]
    Tiled,
    /// One lane per invocation, in private arrays: what the others are measured by.
    Naive,
    /// Matrices in f16 that a subgroup multiplies together, with sums in f32, where the
    /// adapter has them: experimental, with [`Precision::F16`], on a GPU from
    /// [`Gpu::open_experimental`](super::Gpu::open_experimental).
    Cooperative,
}

/// `tiled`, `naive` or `cooperative`.
impl fmt::Display for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Tiled => "tiled",
            Self::Naive => "naive",
            Self::Cooperative => "cooperative",
        })
    }
}

/// How the GPU stores weights; sums are always f32, and so are activations but for those of
/// [`Kernel::Cooperative`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// As they are.
    #[default]
    F32,
    /// Rounded to f16: half the memory traffic, relative errors of some 10⁻³. Needs
    /// [`Gpu::has_f16`](super::Gpu::has_f16), and weights below 65,520.
    F16,
}

/// `f32` or `f16`.
impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::F32 => "f32",
            Self::F16 => "f16",
        })
    }
}

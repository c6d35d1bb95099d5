//! What a rendering is asked, and what it gives.

use std::time::Duration;

use nst_core::{Keep, LaneSums, SequenceBatch, Side};

use crate::SamplerKind;

/// Channels of a picture: R, G and B.
pub(crate) const CHANNELS: usize = 3;

/// How to render a scene.
#[derive(Clone, Copy, Debug)]
pub struct RenderSettings {
    /// Samples per pixel, at least 1.
    pub spp: u32,
    /// The sampler: random numbers, or a Halton sequence.
    pub sampler: SamplerKind,
    /// Seed of the sampler; different seeds give independent renderings.
    pub seed: u64,
    /// The terms to keep.
    pub keep: Keep,
}

/// What [`render()`](crate::render()) returns.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// The kept terms, the fold means (where spp ≥ [`FOLDS`](nst_core::FOLDS)), the
    /// variance of S_N (where spp ≥ 2), and the number of samples that were not finite
    /// (where any was); three planar channels of lanes, in a grid.
    pub batch: SequenceBatch,
    /// What the rendering can be continued from, `[lane]`.
    pub sums: Vec<LaneSums>,
    /// How long it took, without loading the scene.
    pub time: Duration,
    /// The part of that time in which the acceleration structure, and tables for lights and
    /// materials, were built.
    pub build_time: Duration,
}

impl Rendering {
    /// The number of samples that were not finite, and count as black.
    #[must_use]
    pub fn skipped(&self) -> u64 {
        let counts = self.batch.side(&Side::Skipped).unwrap_or_default();
        counts.iter().map(|&count| count as u64).sum()
    }
}

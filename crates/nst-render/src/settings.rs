//! What a rendering is asked for, and what it starts from.

use nst_core::{FurtherPowers, Keep, SampleSums, SequenceBatch};

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
    /// Powers of the samples whose sums are kept, too.
    pub powers: FurtherPowers,
    /// Whether to keep [what the camera sees](nst_core::Side::FEATURES) beside radiance. The
    /// bits of all else are the same without.
    pub features: bool,
}

/// What a rendering is continued from.
#[derive(Clone, Debug)]
pub struct Start {
    /// The kept terms, and the number of samples that were not finite (where any was).
    pub batch: SequenceBatch,
    /// The sums of all samples, with those of the features if the settings ask for them, and of
    /// the settings' further powers.
    pub sums: SampleSums,
}

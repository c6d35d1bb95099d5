//! Sequence transformations for Monte Carlo estimates.
//!
//! A Monte Carlo integrator produces, for each integral, a sequence of progressive
//! estimates S_1, S_2, … whose mean squared error falls as 1/n. A sequence transformation
//! reads a few of these terms and returns a better estimate T_n. This crate contains the
//! sequences ([`SequenceBatch`]), the transformations ([`Transform`]: networks and the
//! [`methods`] that need no training) and the metrics that judge them ([`metrics`]). It
//! does not know of renderers or images.
//!
//! ```
//! use nst_core::{Estimates, MlpCpu, Network, SequenceBatch, Transform};
//!
//! // Two lanes of nine terms S_1 … S_9, stored [term][lane].
//! let samples = [[0.9_f32, 0.1], [1.1, 0.3], [1.0, 0.2], [0.8, 0.2], [1.2, 0.4],
//!                [1.0, 0.1], [0.9, 0.2], [1.1, 0.3], [1.0, 0.2]];
//! let batch = SequenceBatch::from_samples(2, samples.as_flattened())?;
//!
//! let network = Network::builtin("families").expect("the weights are part of the crate")?;
//! let mut estimates = Estimates::default();
//! MlpCpu::new(network).transform(&batch, &mut estimates)?;
//! assert_eq!(estimates.values().len(), 2);
//! # Ok::<(), nst_core::Error>(())
//! ```
//!
//! The method is *Neural Sequence Transformation* (Mukherjee et al., Pacific
//! Graphics 2021). With `default-features = false` everything runs on the CPU;
//! the feature `gpu` adds [`gpu::MlpGpu`], the same network as a WGSL compute
//! shader.

mod cholesky;
mod compact;
mod error;
mod evaluator;
mod filter;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod guard;
pub mod halves;
pub mod methods;
pub mod metrics;
mod mlp;
mod network;
pub mod random;
mod sample_mlp;
mod sequence;
mod transform;
mod vector;

pub use error::Error;
pub use filter::WelchFilter;
pub use mlp::MlpCpu;
pub use network::{
    Builtin, GuardNetwork, Layer, Metadata, Network, SampleForm, SampleNetwork, Weights,
};
pub use sample_mlp::SampleMlp;
pub use sequence::{
    Extent, FOLDS, FeatureSum, FeatureSums, FurtherPowers, Grid, Keep, LANES_PER_BLOCK, LaneSums,
    Merging, Power, PowerSums, SampleSums, SequenceBatch, Side, Strips, Whole, fold_count, root,
    write_fold_means,
};
pub(crate) use sequence::{mean_of_folds, sum_in_order};
pub use transform::{Estimates, Fit, Fitted, Identity, Requirements, Status, Support, Transform};
pub use vector::Instructions;

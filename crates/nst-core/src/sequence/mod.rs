//! Sequences of progressive estimates, side by side: what every method reads.

mod batch;
mod features;
mod further_powers;
mod grid;
mod keep;
mod power;
mod power_sums;
mod sample_sums;
mod side;
mod strips;
mod sums;

pub use batch::{LANES_PER_BLOCK, SequenceBatch};
pub use features::{FeatureSum, FeatureSums};
pub use further_powers::FurtherPowers;
pub use grid::Grid;
pub use keep::Keep;
pub use power::{Power, root};
pub use power_sums::PowerSums;
pub use sample_sums::SampleSums;
pub use side::{Extent, FOLDS, Merging, Side, fold_count};
pub(crate) use strips::sum_in_order;
pub use strips::{Strips, Whole};
pub(crate) use sums::mean_of_folds;
pub use sums::{LaneSums, write_fold_means};

#[cfg(test)]
pub(crate) use strips::tests;

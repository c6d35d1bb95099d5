//! Sequences of progressive estimates, side by side: what every method reads.

mod batch;
mod grid;
mod keep;
mod power;
mod side;
mod strips;
mod sums;

pub use batch::SequenceBatch;
pub use grid::Grid;
pub use keep::Keep;
pub use power::{Power, PowerSums};
pub use side::{Extent, Merging, Side};
pub(crate) use strips::sum_in_order;
pub use strips::{LANES_PER_BLOCK, Strips, Whole};
pub use sums::{FOLDS, LaneSums, fold_count, root};

#[cfg(test)]
pub(crate) use strips::tests;

//! The errors of this crate.

use thiserror::Error;

/// What can go wrong in this crate.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// The terms or side channels of a [`SequenceBatch`](crate::SequenceBatch) do not fit together.
    #[error("sequences do not fit together: {0}")]
    Batch(String),
    /// A weights file is not what its metadata says, or cannot be evaluated.
    #[error("malformed weights: {0}")]
    Weights(String),
    /// A weights file could not be read.
    #[error("cannot read weights: {0}")]
    Io(#[from] std::io::Error),
    /// The source of [`Strips`](crate::Strips) failed, as when a file is damaged.
    #[error(transparent)]
    Input(Box<dyn std::error::Error + Send + Sync>),
    /// Two inputs of a metric differ in length.
    #[error("{0} values cannot be compared with {1}")]
    Lengths(usize, usize),
    /// No adapter of the kind that was asked for.
    #[error("no GPU adapter: {0}")]
    NoAdapter(String),
    /// The adapter cannot run this network, or failed while it ran.
    #[error("GPU: {0}")]
    Gpu(String),
}

//! Networks: what they are, their files, and those inside the crate.

mod builtin;
mod file;
mod model;
mod samples;

pub use builtin::Builtin;
pub use file::Weights;
pub use model::{Layer, Metadata, Network};
pub use samples::{SampleForm, SampleNetwork};

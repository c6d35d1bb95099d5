//! Networks: what they are, their files, and those inside the crate.

mod builtin;
mod file;
mod guard;
mod model;
mod samples;

pub use builtin::Builtin;
pub use file::Weights;
pub use guard::GuardNetwork;
pub use model::{Layer, Metadata, Network};
pub use samples::{SampleForm, SampleNetwork};

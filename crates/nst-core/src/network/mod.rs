//! Networks: what they are, their files, and those inside the crate.

mod builtin;
mod file;
mod model;

pub use builtin::Builtin;
pub use model::{Layer, Metadata, Network};

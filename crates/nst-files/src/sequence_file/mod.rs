//! Sequences as EXR files; `docs/sequence-exr.md` defines the format for others.
//!
//! R, G, B contain S_N; the layer `S0008` the term of 8 samples, and so on; `fold0` …,
//! `Variance` and `Skipped` are the side channels; `state.…` is what a rendering is
//! continued from.

mod channels;
mod feature_state;
mod info;
mod kept_strips;
mod planes;
mod power_state;
mod reader;
mod state;
mod whole;
mod writer;

pub use info::{ResumeInfo, SequenceInfo};
pub use kept_strips::KeptStrips;
pub use reader::SequenceReader;
pub use whole::SequenceFile;
pub use writer::SequenceWriter;

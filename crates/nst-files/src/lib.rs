//! The files of nst: sequences of progressive estimates, datasets for training, and
//! pictures of any program.
//!
//! [`sequence_file`] reads and writes sequences as EXR files, some rows at a time; [`pack`]
//! makes them from pictures of other renderers, [`merge`] from other sequences, and
//! [`dataset`] stores many runs for training, and [`guard_table`] what the guard sees of a picture. [`picture`] and [`header`] read EXR files of
//! any program; [`picture_writer`], [`png`] and [`false_color`] write pictures. [`output`]
//! makes sure that files appear whole, and never replace an input or a file of another
//! kind.
//!
//! The lanes of a picture are planar: lane = channel · width · height + y · width + x, with
//! y counted from the top.

mod blender;
pub mod dataset;
mod error;
pub mod false_color;
pub mod guard_table;
pub mod header;
mod layers;
mod limits;
mod magic;
pub mod merge;
mod output_file;
mod outputs;
pub mod pack;
pub mod picture;
pub mod picture_writer;
pub mod png;
mod primaries;
mod rows;
pub mod sequence_file;
mod temporary;
mod window;

pub use error::Error;
pub use layers::ColorModel;

/// Files that appear whole or not at all, and never replace an input or a file of another
/// kind.
pub mod output {
    pub use crate::{
        output_file::{OutputFile, commit},
        outputs::{Kind, Name, Outputs},
        temporary::abandon_all,
    };
}

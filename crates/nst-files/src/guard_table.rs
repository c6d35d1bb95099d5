//! What a network that weighs the guard's experts is trained with, as a safetensors file of
//! f32 tensors that are named as the fields of [`TrainingTable`]. The metadata are `format`,
//! `experts` (names, separated by commas), `cell` and `samples`.

use std::{borrow::Cow, collections::HashMap, io::Write};

use nst_core::guard::TrainingTable;
use safetensors::{Dtype, View, serialize};

use crate::{Error, output_file::OutputFile};

/// The value of the metadata key `format`.
pub const FORMAT: &str = "nst-guard-table-1";

/// A tensor that is written.
struct Tensor {
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Tensor {
    fn new<'a>(shape: &[usize], numbers: impl Iterator<Item = &'a f32>) -> Self {
        Self { shape: shape.to_vec(), bytes: numbers.flat_map(|x| x.to_le_bytes()).collect() }
    }
}

impl View for Tensor {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.bytes)
    }

    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}

/// Writes a table.
///
/// # Errors
/// [`Error::Io`] if it cannot be written.
pub fn write(table: &TrainingTable, mut output: OutputFile) -> Result<(), Error> {
    let TrainingTable { experts, cell, samples, inputs, closed, places, changes, rest } = table;
    let metadata: HashMap<String, String> = [
        ("format", FORMAT.to_owned()),
        ("experts", experts.join(",")),
        ("cell", cell.to_string()),
        ("samples", samples.to_string()),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into();
    let tensors = [
        ("inputs", Tensor::new(inputs.shape(), inputs.iter())),
        ("closed", Tensor::new(closed.shape(), closed.iter())),
        ("places", Tensor::new(places.shape(), places.iter())),
        ("changes", Tensor::new(changes.shape(), changes.iter())),
        ("rest", Tensor::new(rest.shape(), rest.iter())),
    ];
    let bytes = serialize(tensors, Some(metadata));
    let bytes = bytes.map_err(|error| Error::Mismatch(error.to_string()))?;
    let written = output.file().write_all(&bytes);
    written.map_err(|error| Error::io("write", output.path(), error))?;
    output.commit()
}

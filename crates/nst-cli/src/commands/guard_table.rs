//! `nst guard-table`: what the guard sees of a sequence → a table for training.

use std::fmt;

use nst_core::Strips;
use nst_files::{
    guard_table,
    output::{Kind, Name, Outputs},
    sequence_file::SequenceReader,
};
use serde::Serialize;

use crate::{
    args::{ExpertArg, GuardTableArgs},
    error::Error,
    guard::guard_of_pictures,
    words::list,
};

/// What was written.
#[derive(Serialize)]
pub(super) struct Report {
    experts: Vec<String>,
    cell: usize,
    output: String,
}

pub(super) fn run(args: &GuardTableArgs) -> Result<Report, Error> {
    let files = args.experts.iter().filter_map(ExpertArg::file);
    let mut outputs = Outputs::of_inputs([&args.sequence].into_iter().chain(files));
    let output = outputs.open(&args.output, Kind::GuardTable, Name::Given)?;
    let reader = SequenceReader::open(&args.sequence)?;
    let height = reader.info().size[1];
    let guard = guard_of_pictures(&args.experts, &reader.info().sampler, &args.common)?;
    let mut reader = reader.with_strip_rows(height);
    let strip = reader.next_strip()?.expect("a sequence has rows");
    let table = guard.training_table(&strip)?;
    guard_table::write(&table, output)?;
    Ok(Report {
        experts: table.experts,
        cell: table.cell,
        output: args.output.display().to_string(),
    })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "experts    {}", list(&self.experts, ""))?;
        writeln!(f, "cells      of {0}x{0} pixels", self.cell)?;
        write!(f, "wrote      {}", self.output)
    }
}

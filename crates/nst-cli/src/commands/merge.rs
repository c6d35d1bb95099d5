//! `nst merge`: sequences of one scene with different seeds → one sequence.

use std::fmt;

use nst_files::{
    merge::Merge,
    output::{Kind, Name, Outputs},
};
use serde::Serialize;

use super::check_distinct;
use crate::{
    args::MergeArgs,
    error::Error,
    progress::Progress,
    words::{counted, list, numbers},
};

/// What was merged.
#[derive(Serialize)]
pub(super) struct Report {
    files: Vec<String>,
    width: u32,
    height: u32,
    channels: &'static [&'static str],
    sample_counts: Vec<u32>,
    seeds: Vec<u64>,
    output: String,
}

pub(super) fn run(args: &MergeArgs) -> Result<Report, Error> {
    if args.files.len() < 2 {
        return Err(Error::Usage("one sequence alone cannot be merged; name two or more".into()));
    }
    check_distinct(&args.files)?;
    let mut outputs = Outputs::of_inputs(&args.files);
    let mut output = outputs.open(&args.output, Kind::Sequence, Name::Given)?;
    let merge = Merge::open(&args.files)?;
    let info = merge.info().clone();
    let what = format!("merging {}", counted(args.files.len(), "sequence"));
    let progress = Progress::step(what, &args.common);
    merge.write(&mut output)?;
    drop(progress);
    output.commit()?;
    Ok(Report {
        files: args.files.iter().map(|path| path.display().to_string()).collect(),
        width: info.size[0],
        height: info.size[1],
        channels: info.model.channels(),
        sample_counts: info.sample_counts,
        seeds: info.seeds,
        output: args.output.display().to_string(),
    })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, .. } = self;
        let seeds: Vec<_> = self.seeds.iter().map(u64::to_string).collect();
        writeln!(f, "sequences  {} of {width}x{height} pixels", self.files.len())?;
        writeln!(f, "seeds      {}", list(&seeds, ""))?;
        writeln!(f, "terms      of {} samples per pixel", numbers(&self.sample_counts))?;
        writeln!(f, "wrote      {}", self.output)
    }
}

//! `nst pack --as runs`: sequences of independent renderings → a dataset for training.

use std::{fmt, path::Path};

use nst_files::{
    dataset::{DatasetInfo, DatasetWriter},
    output::{Kind, Name, Outputs},
    sequence_file::{SequenceFile, SequenceInfo, SequenceReader},
};
use serde::Serialize;

use crate::{
    args::PackArgs,
    commands::check_distinct,
    error::Error,
    progress::Progress,
    words::{counted, numbers},
};

/// The sequences, and the dataset that was made from them.
#[derive(Serialize)]
pub(super) struct Report {
    files: Vec<String>,
    runs: usize,
    width: u32,
    height: u32,
    sample_counts: Vec<u32>,
    output: String,
}

/// Copies the sequences one at a time.
pub(super) fn run(args: &PackArgs) -> Result<Report, Error> {
    check_distinct(&args.files)?;
    let mut outputs = Outputs::of_inputs(&args.files);
    let output = outputs.open(&args.output, Kind::Dataset, Name::Given)?;
    let infos = args
        .files
        .iter()
        .map(|path| Ok((path.as_path(), SequenceReader::open(path)?.info().clone())))
        .collect::<Result<Vec<_>, Error>>()?;
    let (first_path, first) = &infos[0];
    for (path, info) in &infos {
        check_run((path, info), (first_path, first))?;
    }
    let seeds: Vec<u64> = infos.iter().flat_map(|(_, info)| info.seeds.iter().copied()).collect();
    if let Some((i, j)) = equal_pair(&seeds).filter(|_| seeds.len() == infos.len()) {
        return Err(Error::Unlike(format!(
            "'{}' and '{}' both have the seed {}; runs must be independent",
            infos[i].0.display(),
            infos[j].0.display(),
            seeds[i]
        )));
    }
    let consecutive = seeds.len() == infos.len()
        && seeds.windows(2).all(|pair| pair[0].checked_add(1) == Some(pair[1]));
    let info = DatasetInfo {
        size: first.size,
        channels: first.model.channels().len() as u32,
        runs: infos.len() as u32,
        sample_counts: first.sample_counts.clone(),
        scene: first.scene.clone(),
        sampler: first.sampler.clone(),
        first_seed: seeds.first().copied().filter(|_| consecutive),
    };
    let mut writer = DatasetWriter::new(output, info)?;
    let before = format!("reading {}", counted(args.files.len(), "sequence"));
    let progress = Progress::count(&before, "pack", args.files.len() as u64, &args.common);
    for path in &args.files {
        writer.push(&SequenceFile::read(path)?.batch)?;
        progress.advance(1);
    }
    drop(progress);
    writer.finish()?;
    Ok(Report {
        files: args.files.iter().map(|path| path.display().to_string()).collect(),
        runs: infos.len(),
        width: first.size[0],
        height: first.size[1],
        sample_counts: first.sample_counts.clone(),
        output: args.output.display().to_string(),
    })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "runs       {} of {}x{} pixels", self.runs, self.width, self.height)?;
        writeln!(f, "terms      of {} samples per pixel", numbers(&self.sample_counts))?;
        write!(f, "wrote      {}", self.output)
    }
}

fn check_run(
    (path, info): (&Path, &SequenceInfo),
    (first_path, first): (&Path, &SequenceInfo),
) -> Result<(), Error> {
    let different = if info.size != first.size {
        "sizes"
    } else if info.model != first.model {
        "channels"
    } else if info.sample_counts != first.sample_counts {
        "terms (nst.terms)"
    } else if info.scene != first.scene {
        "scenes (nst.scene)"
    } else if info.sampler != first.sampler {
        "samplers (nst.sampler)"
    } else {
        return Ok(());
    };
    Err(Error::Unlike(format!(
        "'{}' and '{}' have different {different}; the runs of a dataset must agree in them",
        first_path.display(),
        path.display()
    )))
}

fn equal_pair(seeds: &[u64]) -> Option<(usize, usize)> {
    let mut order: Vec<usize> = (0..seeds.len()).collect();
    order.sort_by_key(|&i| seeds[i]);
    let pair = order.windows(2).find(|pair| seeds[pair[0]] == seeds[pair[1]])?;
    Some((pair[0], pair[1]))
}

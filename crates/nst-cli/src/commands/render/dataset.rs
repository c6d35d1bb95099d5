//! `nst render --runs`: many independent renderings into one file.

use std::fmt;

use nst_files::{
    dataset::{DatasetInfo, DatasetWriter},
    output::{Kind, OutputFile},
};
use nst_render::{Control, RenderSettings, Scene, check_memory, render_from};
use serde::Serialize;

use super::{describe, load_scene, outputs, paths, progress, settings};
use crate::{
    args::{KeepArg, RenderArgs},
    error::Error,
    interrupt,
    report::Done,
    words::counted,
};

/// What was rendered.
#[derive(Serialize)]
struct Report {
    runs: u32,
    files: Vec<String>,
    notes: Vec<String>,
}

pub(super) fn run(args: &RenderArgs, runs: u32) -> Result<Done, Error> {
    let settings = settings(args, 1, KeepArg::All);
    if settings.seed.checked_add(u64::from(runs - 1)).is_none() {
        return Err(Error::Usage(format!(
            "--seed {} is too large for {}, whose seeds count up from it",
            settings.seed,
            counted(runs as usize, "run")
        )));
    }
    let scene = load_scene(args, None)?;
    let path = args.output(&scene.name)?;
    let output = outputs(args, &scene).open(&path, Kind::Dataset, args.output_name())?;
    // Before its terms are counted.
    check_memory(scene.size, &settings)?;
    interrupt::finish_on_signal();
    describe(&scene, args.spp, &args.common);
    let done = write(args, runs, &scene, &settings, output)?;
    let report =
        Report { runs: done, files: vec![path.display().to_string()], notes: scene.notes.clone() };
    let early = (done < runs).then(|| format!("{done} of {runs} runs are in '{}'", path.display()));
    Ok(Done { report: Box::new(report), early })
}

/// Renders and writes runs until Ctrl-C; returns how many there are.
fn write(
    args: &RenderArgs,
    runs: u32,
    scene: &Scene,
    settings: &RenderSettings,
    output: OutputFile,
) -> Result<u32, Error> {
    let sample_counts = settings.keep.sample_counts(args.spp);
    let info = DatasetInfo {
        size: scene.size,
        channels: 3,
        runs,
        sample_counts: sample_counts.clone(),
        scene: scene.fingerprint(),
        sampler: settings.sampler.to_string(),
        first_seed: Some(settings.seed),
    };
    let mut writer = DatasetWriter::new(output, info)?;
    let bar = progress(scene, paths(scene, args.spp).saturating_mul(runs.into()), &args.common);
    let advance = |paths| bar.advance(paths);
    let control = Control { progress: &advance, stop: &interrupt::asked };
    let mut done = 0;
    while done < runs {
        let seed = settings.seed + u64::from(done);
        let rendering = render_from(None, scene, &RenderSettings { seed, ..*settings }, control)?;
        // A run that Ctrl-C has stopped early is left out.
        if rendering.sample_counts() != sample_counts {
            break;
        }
        writer.push(&rendering.batch())?;
        done += 1;
        if interrupt::asked() {
            break;
        }
    }
    drop(bar);
    if done == 0 {
        return Err(Error::Interrupted("no run was complete, nothing is written".into()));
    }
    writer.finish()?;
    Ok(done)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "wrote      {} ({})", self.files.join(", "), counted(self.runs as usize, "run"))
    }
}

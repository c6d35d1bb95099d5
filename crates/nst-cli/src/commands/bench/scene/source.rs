//! Where the runs of a bench come from: renderings of a scene, or sequence files.

use std::{path::PathBuf, time::Duration};

use nst_core::{FurtherPowers, Keep, SequenceBatch};
use nst_files::sequence_file::{SequenceFile, SequenceReader};
use nst_render::{Control, RenderSettings, SamplerKind, Scene, render_from};

use crate::{
    args::BenchSceneArgs,
    error::Error,
    interrupt,
    results::{Row, SCHEMA},
    system,
};

/// What is rendered, or read.
pub(super) enum Source {
    Scene {
        scene: Box<Scene>,
        /// How long it took to load.
        loading: Duration,
        sampler: SamplerKind,
        /// The seed of the first run.
        seed: u64,
    },
    /// Each file is a run at its own sample count.
    Files(Vec<File>),
}

/// A sequence file, of which the header was read.
pub(super) struct File {
    path: PathBuf,
    pub(super) spp: u32,
    /// Among the files of its sample count.
    pub(super) run: u32,
    pub(super) seed: Option<u64>,
}

/// Sequences to be transformed.
pub(super) struct Run {
    pub(super) spp: u32,
    pub(super) number: u32,
    pub(super) seed: Option<u64>,
    pub(super) batch: SequenceBatch,
    pub(super) render_time: Option<Duration>,
}

/// What all runs have in common.
pub(super) struct Origin {
    pub(super) scene: String,
    pub(super) fingerprint: String,
    pub(super) sampler: String,
    pub(super) size: [u32; 2],
}

impl Origin {
    /// A row that has what all runs have in common, and nothing else.
    pub(super) fn row(&self) -> Row {
        let Self { scene, fingerprint, sampler, size: [width, height] } = self;
        Row {
            scene: scene.clone(),
            width: *width,
            height: *height,
            fingerprint: fingerprint.clone(),
            sampler: sampler.clone(),
            threads: Some(rayon::current_num_threads() as u32),
            machine: system::processor(),
            version: system::VERSION.to_owned(),
            schema: SCHEMA,
            ..Row::default()
        }
    }
}

/// What methods need of a rendering.
#[derive(Clone, Copy)]
pub(super) struct Needs {
    /// How many last terms.
    pub(super) window: usize,
    /// The further powers of the samples of which means are read.
    pub(super) powers: FurtherPowers,
    pub(super) features: bool,
}

impl Source {
    /// Reads the headers of sequence files, which must agree.
    pub(super) fn files(paths: &[PathBuf]) -> Result<(Self, Origin), Error> {
        let mut files: Vec<File> = Vec::new();
        let mut first: Option<(PathBuf, Origin)> = None;
        for path in paths {
            let info = SequenceReader::open(path)?.info().clone();
            let name = info.scene.split(':').next().unwrap_or_default().to_owned();
            let stem = || path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let origin = Origin {
                scene: if name.is_empty() { stem() } else { name },
                fingerprint: info.scene.clone(),
                sampler: info.sampler.clone(),
                size: info.size,
            };
            if info.model != nst_files::ColorModel::Rgb {
                let path = path.display();
                let message = format!("'{path}' is monochrome; a bench compares R, G and B");
                return Err(Error::Unlike(message));
            }
            match &first {
                None => first = Some((path.clone(), origin)),
                Some((_, it))
                    if (&it.fingerprint, it.size, &it.sampler)
                        == (&origin.fingerprint, origin.size, &origin.sampler) => {}
                Some((other, _)) => {
                    return Err(Error::Unlike(format!(
                        "'{}' and '{}' are of different scenes, samplers or sizes; the runs of a \
                         bench must agree in them",
                        other.display(),
                        path.display()
                    )));
                }
            }
            let spp = info.samples();
            let run = files.iter().filter(|file| file.spp == spp).count() as u32;
            let seed = info.seeds.first().copied();
            let twice = |file: &&File| file.spp == spp && seed.is_some() && file.seed == seed;
            if let Some(earlier) = files.iter().find(twice) {
                return Err(Error::Usage(format!(
                    "'{}' and '{}' have the same seed, and are one run; name it once",
                    earlier.path.display(),
                    path.display()
                )));
            }
            files.push(File { path: path.clone(), spp, run, seed });
        }
        let (_, origin) = first.expect("the command line asks for one");
        Ok((Self::Files(files), origin))
    }

    /// The runs to measure, in pairs of one sample count, the first of which has the numbers
    /// 0 and 1. All sample counts come before the next pair, so that a bench that is cut off
    /// has something of each.
    pub(super) fn pairs(&self, args: &BenchSceneArgs) -> Vec<(u32, Vec<u32>)> {
        let mut counts: Vec<(u32, u32)> = match self {
            Self::Scene { .. } => args.spp.iter().map(|&spp| (spp, args.runs)).collect(),
            Self::Files(files) => {
                let runs = |spp| files.iter().filter(|file| file.spp == spp).count() as u32;
                files.iter().map(|file| (file.spp, runs(file.spp))).collect()
            }
        };
        counts.sort_unstable();
        counts.dedup();
        let most = counts.iter().map(|it| it.1).max().unwrap_or_default();
        (0..most)
            .step_by(2)
            .flat_map(|first| {
                counts.iter().map(move |&(spp, runs)| (spp, (first..runs.min(first + 2)).collect()))
            })
            .filter(|(_, runs): &(u32, Vec<u32>)| !runs.is_empty())
            .collect()
    }

    /// Whether [`Self::run`] has a run.
    pub(super) fn has(&self, spp: u32, number: u32) -> bool {
        match self {
            Self::Scene { .. } => true,
            Self::Files(files) => files.iter().any(|file| (file.spp, file.run) == (spp, number)),
        }
    }

    /// The files, if these are what is measured.
    pub(super) fn sequences(&self) -> &[File] {
        match self {
            Self::Scene { .. } => &[],
            Self::Files(files) => files,
        }
    }

    /// Renders a run, or reads it. What is needed of it matters to a rendering alone.
    pub(super) fn run(&self, spp: u32, number: u32, needs: Needs) -> Result<Run, Error> {
        match self {
            Self::Scene { scene, sampler, seed, .. } => {
                let seed = seed + u64::from(number);
                let Needs { window, powers, features } = needs;
                let keep = Keep::Window(window as u32);
                let settings =
                    RenderSettings { spp, sampler: *sampler, seed, keep, powers, features };
                let control = Control { progress: &|_| {}, stop: &interrupt::asked };
                let rendering = render_from(None, scene, &settings, control)?;
                let render_time = Some(rendering.time);
                Ok(Run { spp, number, seed: Some(seed), batch: rendering.batch(), render_time })
            }
            Self::Files(files) => {
                let file = files.iter().find(|file| file.spp == spp && file.run == number);
                let File { path, seed, .. } = file.expect("pairs are of these files");
                let SequenceFile { info, batch, .. } = SequenceFile::read(path)?;
                let seconds = Some(info.render_seconds).filter(|&seconds| seconds > 0.0);
                let render_time = seconds.map(Duration::from_secs_f32);
                Ok(Run { spp, number, seed: *seed, batch, render_time })
            }
        }
    }

    /// How long it took to load the scene.
    pub(super) fn loading(&self) -> Option<Duration> {
        match self {
            Self::Scene { loading, .. } => Some(*loading),
            Self::Files(_) => None,
        }
    }
}

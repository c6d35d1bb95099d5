//! What `nst render --resume` takes from a sequence file, and what it refuses.

use std::path::{Path, PathBuf};

use nst_core::{Keep, Power, Side};
use nst_files::sequence_file::{ResumeInfo, SequenceFile, SequenceInfo, SequenceReader};
use nst_render::{RenderSettings, SamplerKind, Scene};

use crate::{
    args::{KeepArg, RenderArgs},
    error::Error,
    method::Method,
};

/// A stored rendering that can be continued; only its header was read.
pub(crate) struct Resumed {
    pub(crate) path: PathBuf,
    pub(crate) info: SequenceInfo,
    how: ResumeInfo,
    pub(crate) sampler: SamplerKind,
    seed: u64,
}

/// A stored rendering, ready to be continued.
pub(crate) struct Start {
    pub(crate) from: nst_render::Start,
    /// Its samples per pixel.
    pub(crate) samples: u32,
    /// How long it has taken so far.
    pub(crate) seconds: f32,
}

/// Reads the header of the sequence to be continued.
pub(crate) fn open(path: &Path) -> Result<Resumed, Error> {
    let info = SequenceReader::open(path)?.info().clone();
    match (info.resume.clone(), info.sampler.parse(), info.seeds.as_slice()) {
        (Some(how), Ok(sampler), &[seed]) => {
            Ok(Resumed { path: path.to_owned(), info, how, sampler, seed })
        }
        _ => Err(Error::Usage(format!(
            "--resume '{}': it does not contain the sums of its samples, as 'nst render --sequence' stores them; \
             packed and merged sequences, and those of early versions, cannot be continued",
            path.display()
        ))),
    }
}

impl Resumed {
    /// The settings to continue with; fails if the command line contradicts the file.
    pub(crate) fn settings(
        &self,
        args: &RenderArgs,
        scene: &Scene,
        fingerprint: &str,
        method: &Method,
    ) -> Result<RenderSettings, Error> {
        let done = self.info.samples();
        if args.spp <= done {
            let why = format!("it has {done} spp already; --spp {} is not above that", args.spp);
            return Err(self.refuse(&why));
        }
        self.check_options(args, scene)?;
        self.check_scene(args, scene, fingerprint)?;
        // Terms that were not stored are lost, but later samples fill the window again.
        let stored = match self.how.keep {
            Keep::All => args.spp,
            Keep::Window(length) | Keep::Pow2(length) => length,
        };
        method.check_terms(
            stored as usize,
            "render again from the start with this network, or use --transform none",
        )?;
        let (sampler, seed) = (self.sampler, self.seed);
        Ok(RenderSettings {
            spp: args.spp,
            sampler,
            seed,
            keep: self.how.keep,
            powers: self.how.powers,
            features: self.info.has_features(),
        })
    }

    fn refuse(&self, why: &str) -> Error {
        Error::Usage(format!("--resume '{}': {why}", self.path.display()))
    }

    /// Fails if an option contradicts the file.
    fn check_options(&self, args: &RenderArgs, scene: &Scene) -> Result<(), Error> {
        let keep = match self.how.keep {
            Keep::All => KeepArg::All,
            Keep::Window(_) => KeepArg::Window,
            Keep::Pow2(_) => KeepArg::Pow2,
        };
        let sampler = args.sampler.map(SamplerKind::from);
        // (option, what it says, what the file says)
        let given = [
            ("--seed", args.seed.map(|seed| seed.to_string()), self.seed.to_string()),
            ("--sampler", sampler.map(|kind| kind.to_string()), self.sampler.to_string()),
            ("--size", args.size.map(size_text), size_text(self.info.size)),
            ("--keep", args.keep.map(|keep| keep_text(keep).into()), keep_text(keep).into()),
            (
                "--pixel",
                args.pixel.map(|_| scene.pixel_filter.to_string()),
                self.how.pixel_filter.clone(),
            ),
            (
                if args.integrator.is_some() { "--integrator" } else { "--max-depth" },
                (args.max_depth.is_some() || args.integrator.is_some())
                    .then(|| depth_text(scene.max_depth)),
                depth_text(self.how.max_depth),
            ),
        ];
        if args.features && !self.info.has_features() {
            return Err(self.refuse(
                "it has no features, which a rendering has from its first sample on or not at \
                 all; leave --features out, or render again from the start",
            ));
        }
        for (option, said, stored) in given {
            if let Some(said) = said.filter(|said| *said != stored) {
                let why =
                    format!("{option} says {said}, the file says {stored}; leave {option} out");
                return Err(self.refuse(&why));
            }
        }
        Ok(())
    }

    /// Fails if the scene is not the one of the file.
    fn check_scene(
        &self,
        args: &RenderArgs,
        scene: &Scene,
        fingerprint: &str,
    ) -> Result<(), Error> {
        if fingerprint != self.info.scene {
            return Err(self.refuse(&format!(
                "its scene is '{}', but '{}' is '{fingerprint}'; give the scene, \
                 its camera and its light as they were",
                self.info.scene,
                args.scene.display()
            )));
        }
        if scene.russian_roulette != self.how.russian_roulette {
            let why = "russian_roulette in the scene's TOML file has changed; put it back";
            return Err(self.refuse(why));
        }
        Ok(())
    }

    /// What the longer sequence will lack of this one, if anything: power means that came
    /// without their sums.
    pub(crate) fn loss(&self) -> Option<String> {
        let goes_on = |power: Power| self.how.powers.iter().any(|kept| kept == power);
        let lost = self.info.sides.iter().filter_map(|side| match *side {
            Side::PowerMean(power, 0) if !goes_on(power) => Some(power.to_string()),
            _ => None,
        });
        let lost: Vec<String> = lost.collect();
        (!lost.is_empty()).then(|| {
            format!(
                "the longer sequence has no means of the samples to the power {}: '{}' has them \
                 without their sums, as files of early versions",
                lost.join(", "),
                self.path.display()
            )
        })
    }

    /// Reads the whole file.
    pub(crate) fn read(self) -> Result<Start, Error> {
        let file = SequenceFile::read_to_resume(&self.path)?;
        let (samples, seconds) = (file.info.samples(), file.info.render_seconds);
        let Some(sums) = file.sums.filter(|_| file.info == self.info) else {
            return Err(Error::Usage(format!(
                "--resume '{}': it has just changed",
                self.path.display()
            )));
        };
        Ok(Start { from: nst_render::Start { batch: file.batch, sums }, samples, seconds })
    }
}

fn size_text([width, height]: [u32; 2]) -> String {
    format!("{width}x{height}")
}

fn depth_text(depth: u32) -> String {
    format!("{depth} vertices")
}

fn keep_text(keep: KeepArg) -> &'static str {
    match keep {
        KeepArg::Window => "window",
        KeepArg::Pow2 => "pow2",
        KeepArg::All => "all",
    }
}

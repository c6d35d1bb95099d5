//! `nst render`.

use std::path::{Path, PathBuf};

use clap::{ArgGroup, ValueEnum};
use nst_files::output::Name;
use nst_render::{Lighting, LoadOptions, PixelFilter, SamplerKind, View};

use super::{
    common::CommonArgs,
    method::MethodArgs,
    values::{count, ending_in, has_extension, point, seed, size},
};
use crate::error::Error;

/// Render a scene, transform each pixel's sequence, write EXR and PNG.
#[derive(Debug, clap::Args)]
#[command(group(ArgGroup::new("stored").args(["sequence", "resume", "runs"]).multiple(true)))]
pub(crate) struct RenderArgs {
    /// OBJ file; its MTL files, and a TOML file of the same name, are read with it.
    #[arg(long, value_name = "OBJ")]
    pub(crate) scene: PathBuf,
    /// Samples per pixel.
    #[arg(long, default_value_t = 64, value_parser = count, allow_negative_numbers = true)]
    pub(crate) spp: u32,
    /// Picture to write: .exr, with a PNG beside it, or .png alone. With --runs, the
    /// dataset (.safetensors). [default: the scene's name, in this folder]
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// Instead of a picture, write a dataset for training: this many independent runs,
    /// whose seeds count up from --seed.
    #[arg(
        long,
        value_name = "R",
        value_parser = count,
        allow_negative_numbers = true,
        conflicts_with_all = ["sequence", "experts", "guard", "weights"]
    )]
    pub(crate) runs: Option<u32>,
    /// Also store the sequence, for `nst transform` and --resume.
    #[arg(long, value_name = "EXR", value_parser = ending_in(["exr"]))]
    pub(crate) sequence: Option<PathBuf>,
    /// Continue the rendering of this sequence file, up to --spp. Options that the file
    /// sets can be left out. Without --sequence, the file itself is replaced by the longer
    /// sequence.
    #[arg(long, value_name = "EXR", conflicts_with = "runs")]
    pub(crate) resume: Option<PathBuf>,
    /// Also store what the camera sees beside radiance, which denoisers read: albedo, normal,
    /// depth, and emission that is seen directly; in the EXR picture, and in the sequence.
    #[arg(long, conflicts_with = "runs")]
    pub(crate) features: bool,
    /// Which terms of the sequence to store. [default: window; with --runs, all]
    #[arg(long, value_enum, requires = "stored")]
    pub(crate) keep: Option<KeepArg>,
    /// Where the camera is, in the scene's coordinates, as in 0,1.5,4. [default: the
    /// scene's, or where it sees the whole scene from the front, +z]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub(crate) camera_position: Option<[f64; 3]>,
    /// What the camera looks at. [default: the scene's, or its middle]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub(crate) camera_target: Option<[f64; 3]>,
    /// The angle between the upper and the lower edge of the picture, in degrees.
    /// [default: the scene's, or 40]
    #[arg(long, value_name = "DEGREES")]
    pub(crate) camera_fov: Option<f32>,
    /// Light that replaces the scene's environment. [default: the scene's; a studio if
    /// nothing else emits light]
    #[arg(long, value_enum)]
    pub(crate) light: Option<LightArg>,
    /// Refuse a scene with faults, instead of forgiving them with a note.
    #[arg(long)]
    pub(crate) strict: bool,
    /// Film size in pixels, as in 512x512. [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) size: Option<[u32; 2]>,
    /// Which random numbers to use. [default: random]
    #[arg(long, value_enum)]
    pub(crate) sampler: Option<SamplerArg>,
    /// Seed of the random numbers; runs with different seeds are independent. [default: 0]
    #[arg(long, value_parser = seed, allow_negative_numbers = true)]
    pub(crate) seed: Option<u64>,
    /// `path`: paths up to the depth; `direct`: depth 2, direct light only. [default: path]
    #[arg(long, value_enum, conflicts_with = "max_depth")]
    pub(crate) integrator: Option<IntegratorArg>,
    /// Path vertices after the camera that may scatter or emit: 1 shows lights only.
    /// [default: the scene's]
    #[arg(long, value_name = "N", value_parser = count, allow_negative_numbers = true)]
    pub(crate) max_depth: Option<u32>,
    /// Where in a pixel samples are. [default: box]
    #[arg(long, value_enum)]
    pub(crate) pixel: Option<PixelArg>,
    #[command(flatten)]
    pub(crate) method: MethodArgs,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

impl RenderArgs {
    /// How to read the scene.
    pub(crate) fn load_options(&self) -> LoadOptions {
        LoadOptions {
            strict: self.strict,
            view: View {
                position: self.camera_position,
                target: self.camera_target,
                up: None,
                vertical_fov: self.camera_fov,
            },
            size: self.size,
            lighting: self.light.map(Into::into),
        }
    }

    /// Where the picture or the dataset goes.
    pub(crate) fn output(&self, scene: &str) -> Result<PathBuf, Error> {
        let extensions: &[&str] = match self.runs {
            None => &["exr", "png"],
            Some(_) => &["safetensors"],
        };
        match &self.output {
            None => Ok(PathBuf::from(format!("{scene}.{}", extensions[0]))),
            Some(path) if self.features_are_lost(path) => Err(Error::Usage(format!(
                "--features: '{}' has no layers for them; give an .exr as --output, or --sequence",
                path.display()
            ))),
            Some(path) if extensions.iter().any(|it| has_extension(path, it)) => Ok(path.clone()),
            Some(path) => Err(Error::Usage(format!(
                "--output '{}': the name must end in .{}",
                path.display(),
                extensions.join(" or .")
            ))),
        }
    }

    /// Whether nothing that is written can have features, though they are asked for.
    fn features_are_lost(&self, output: &Path) -> bool {
        let stored = self.sequence.is_some() || self.resume.is_some();
        self.features && !stored && has_extension(output, "png")
    }

    /// Whether the user or the program chose that name.
    pub(crate) fn output_name(&self) -> Name {
        if self.output.is_some() { Name::Given } else { Name::Default }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum KeepArg {
    /// The last eight terms, or as many as the network reads.
    Window,
    /// The window, and the terms of 1, 2, 4, 8, … samples.
    Pow2,
    /// All terms, from one sample on.
    All,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SamplerArg {
    /// Independent and uniform.
    Random,
    /// A scrambled Halton sequence for each pixel: the least noise, but `auto` gains nothing.
    Halton,
    /// Four independent ones for each pixel, so that `auto` can measure what it gains.
    HaltonFolds,
}

impl From<SamplerArg> for SamplerKind {
    fn from(arg: SamplerArg) -> Self {
        match arg {
            SamplerArg::Random => Self::Random,
            SamplerArg::Halton => Self::Halton,
            SamplerArg::HaltonFolds => Self::HaltonFolds,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum IntegratorArg {
    /// Paths up to the depth.
    Path,
    /// Lights, and light that reaches the first surface directly.
    Direct,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum LightArg {
    /// Two lamps beside the camera, a dim sky, and a grey background.
    Studio,
    /// A clear sky with a sun.
    Sky,
    /// Radiance 1 from everywhere.
    White,
    /// Nothing: only the scene's own lamps shine.
    None,
}

impl From<LightArg> for Lighting {
    fn from(arg: LightArg) -> Self {
        match arg {
            LightArg::Studio => Self::Studio,
            LightArg::Sky => Self::Sky,
            LightArg::White => Self::White,
            LightArg::None => Self::None,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PixelArg {
    /// Uniformly, which smooths edges.
    Box,
    /// At the centre, as in the paper.
    Center,
}

impl From<PixelArg> for PixelFilter {
    fn from(arg: PixelArg) -> Self {
        match arg {
            PixelArg::Box => Self::Box,
            PixelArg::Center => Self::Center,
        }
    }
}

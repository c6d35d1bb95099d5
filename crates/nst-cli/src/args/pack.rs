//! `nst pack`.

use std::path::PathBuf;

use clap::ValueEnum;

use super::{
    common::CommonArgs,
    values::{count, seed},
};

/// Make a sequence from pictures of another renderer.
///
/// EXR files of any layout are read: RGB or a single channel, f16, f32 or u32, with layers
/// and parts. All must have the same size.
#[derive(Debug, clap::Args)]
pub(crate) struct PackArgs {
    /// EXR files; with --as runs, sequence files.
    #[arg(value_name = "EXR", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// What the files are. [default: samples]
    #[arg(long = "as", value_enum, value_name = "KIND")]
    pub(crate) kind: Option<PackAs>,
    /// Sequence to write (.exr); with --as runs, the dataset (.safetensors).
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Layer to read, as in `diffuse`, or a channel by its whole name. [default: the main
    /// picture, Blender's `Combined`, or the only layer]
    #[arg(long, value_name = "LAYER", alias = "channels")]
    pub(crate) layer: Option<String>,
    /// Layer with the surfaces' reflectance (R, G, B), which denoisers read. [default: as
    /// Blender's denoising pass, pbrt's gbuffer film, or `albedo`]
    #[arg(long, value_name = "LAYER")]
    pub(crate) albedo: Option<String>,
    /// Layer with the surfaces' normals (X, Y, Z). [default: as Blender's denoising pass, pbrt's
    /// gbuffer film, or `sh_normal`, `normal`, `nn`]
    #[arg(long, value_name = "LAYER")]
    pub(crate) normal: Option<String>,
    /// Layer with the light that the camera sees directly (R, G, B). [default: Blender's passes
    /// of emission and environment]
    #[arg(long, value_name = "LAYER")]
    pub(crate) emission: Option<String>,
    /// With --as samples: samples per pixel of each file. [default: what the files say]
    #[arg(long, value_name = "K", value_parser = count, allow_negative_numbers = true)]
    pub(crate) spp: Option<u32>,
    /// With --as estimates: samples per pixel of each file, as in 1,2,4,8.
    /// [default: what the files or their names say]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = count, allow_negative_numbers = true)]
    pub(crate) spp_list: Option<Vec<u32>>,
    /// Name of the scene, to be stored in the sequence.
    #[arg(long, value_name = "NAME")]
    pub(crate) scene: Option<String>,
    /// Seed that the other renderer used, to be stored in the sequence; `nst merge` needs
    /// it.
    #[arg(long, value_parser = seed, allow_negative_numbers = true)]
    pub(crate) seed: Option<u64>,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

impl PackArgs {
    /// What the files are.
    pub(crate) fn kind(&self) -> PackAs {
        self.kind.unwrap_or(PackAs::Samples)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PackAs {
    /// Independent renderings with different seeds: the terms are the means of the first 1,
    /// 2, 3, … files.
    Samples,
    /// Snapshots of one progressive rendering: the terms themselves, sorted by their samples.
    Estimates,
    /// Sequence files of independent renderings: a dataset for training.
    Runs,
}

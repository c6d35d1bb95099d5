//! What the user types.

use std::path::{Path, PathBuf};

use clap::{
    ArgGroup, Parser, Subcommand, ValueEnum,
    builder::{PathBufValueParser, TypedValueParser},
};
use nst_core::{Network, methods::METHODS};
use nst_files::output::Name;
use nst_render::{PixelFilter, SamplerKind};

use crate::error::Error;

/// Monte Carlo renderings that converge faster: neural sequence transformation.
#[derive(Debug, Parser)]
#[command(version)]
pub(crate) struct Args {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Render(RenderArgs),
    Transform(TransformArgs),
    Pack(PackArgs),
    Merge(MergeArgs),
    Info(InfoArgs),
    Compare(CompareArgs),
    Bench(BenchArgs),
}

impl Command {
    /// The options that all commands have.
    pub(crate) fn common(&self) -> &CommonArgs {
        match self {
            Self::Render(args) => &args.common,
            Self::Transform(args) => &args.common,
            Self::Pack(args) => &args.common,
            Self::Merge(args) => &args.common,
            Self::Info(args) => &args.common,
            Self::Compare(args) => &args.common,
            Self::Bench(BenchArgs { bench: Bench::Scene(args) }) => &args.common,
            Self::Bench(BenchArgs { bench: Bench::Stability(args) }) => &args.common,
        }
    }
}

/// Render a scene, transform each pixel's sequence, write EXR and PNG.
#[derive(Debug, clap::Args)]
#[command(group(ArgGroup::new("stored").args(["sequence", "resume", "runs"]).multiple(true)))]
pub(crate) struct RenderArgs {
    /// OBJ file; its MTL files and a TOML sidecar of the same name are read with it.
    #[arg(long, value_name = "OBJ")]
    pub(crate) scene: PathBuf,
    /// Samples per pixel.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) spp: u32,
    /// Picture to write (.exr); a PNG is written beside it. With --runs, the dataset
    /// (.safetensors). [default: the scene's name, in this folder]
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// Render this many independent runs into a dataset for training instead of a
    /// picture; the seeds count up from --seed.
    #[arg(long, value_name = "R", value_parser = clap::value_parser!(u32).range(1..), conflicts_with = "sequence")]
    pub(crate) runs: Option<u32>,
    /// Also store the sequence, for `nst transform` and --resume.
    #[arg(long, value_name = "EXR", value_parser = ending_in("exr"))]
    pub(crate) sequence: Option<PathBuf>,
    /// Continue the rendering of this sequence file, up to --spp. What the file says
    /// need not be repeated; without --sequence it is brought up to date.
    #[arg(long, value_name = "EXR", conflicts_with = "runs")]
    pub(crate) resume: Option<PathBuf>,
    /// Which terms of the sequence to store. [default: window; with --runs, all]
    #[arg(long, value_enum, requires = "stored")]
    pub(crate) keep: Option<KeepArg>,
    /// Film size in pixels, as in 512x512. [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) size: Option<[u32; 2]>,
    /// Which random numbers to use. [default: random]
    #[arg(long, value_enum)]
    pub(crate) sampler: Option<SamplerArg>,
    /// Seed of the random numbers; runs with different seeds are independent. [default: 0]
    #[arg(long)]
    pub(crate) seed: Option<u64>,
    /// `path`: paths up to the depth; `direct`: depth 2. [default: the scene's]
    #[arg(long, value_enum)]
    pub(crate) integrator: Option<IntegratorArg>,
    /// Path vertices after the camera that may scatter or emit. [default: the scene's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) max_depth: Option<u32>,
    /// Where in a pixel samples are taken. [default: box]
    #[arg(long, value_enum)]
    pub(crate) pixel: Option<PixelArg>,
    #[command(flatten)]
    pub(crate) method: MethodArgs,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Transform a stored sequence.
#[derive(Debug, clap::Args)]
pub(crate) struct TransformArgs {
    /// Sequence file, as written by `nst render --sequence`.
    #[arg(value_name = "EXR")]
    pub(crate) sequence: PathBuf,
    /// Picture to write. [default: beside the sequence, ending in .nst.exr]
    #[arg(short, long, value_name = "EXR", value_parser = ending_in("exr"))]
    pub(crate) output: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) method: MethodArgs,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Make a sequence out of another renderer's pictures.
///
/// EXR files of any layout are read: RGB or a single channel, f16, f32 or u32, with
/// layers and parts. All must agree in size.
#[derive(Debug, clap::Args)]
pub(crate) struct PackArgs {
    /// EXR files; with --as runs, sequence files.
    #[arg(value_name = "EXR", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// What the files are.
    #[arg(long = "as", value_enum, value_name = "KIND")]
    pub(crate) kind: PackAs,
    /// Sequence to write (.exr); with --as runs, the dataset (.safetensors).
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Layer to read, such as `diffuse`, or a channel by its whole name. [default: the main
    /// picture, or the only layer]
    #[arg(long, value_name = "LAYER")]
    pub(crate) channels: Option<String>,
    /// With --as samples: samples per pixel of each file. [default: what the files say]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) spp: Option<u32>,
    /// With --as estimates: samples per pixel of each file, as in 1,2,4,8.
    /// [default: what the files or their names say]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) spp_list: Option<Vec<u32>>,
    /// Name of the scene to record; networks are trained for scenes by name.
    #[arg(long, value_name = "NAME")]
    pub(crate) scene: Option<String>,
    /// Seed that the other renderer used, to record; `nst merge` needs it.
    #[arg(long)]
    pub(crate) seed: Option<u64>,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PackAs {
    /// Independent renderings with different seeds; the sequence is that of their means.
    Samples,
    /// Snapshots of one progressive rendering: the terms themselves, sorted by their samples.
    Estimates,
    /// Sequence files of independent renderings: a dataset for training.
    Runs,
}

/// Join sequences of one scene that were rendered with different seeds.
#[derive(Debug, clap::Args)]
pub(crate) struct MergeArgs {
    /// Sequence files that agree in size, scene, sampler and terms.
    #[arg(value_name = "EXR", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Sequence to write.
    #[arg(short, long, value_name = "EXR", value_parser = ending_in("exr"))]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Say what is in a file: a sequence or picture (EXR), a scene (OBJ), a network's
/// weights or a dataset (safetensors).
#[derive(Debug, clap::Args)]
pub(crate) struct InfoArgs {
    /// The file.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Compare pictures with a reference: MSE, relMSE and SMAPE.
///
/// Several pictures are taken for independent runs of one method: the error is their
/// mean, and bias and variance are told apart.
#[derive(Debug, clap::Args)]
pub(crate) struct CompareArgs {
    /// EXR pictures of any program, of one size; the last is the reference.
    #[arg(value_name = "EXR", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Layer of the pictures to compare, such as S. The reference's main picture is
    /// always taken. [default: the main picture]
    #[arg(long, value_name = "NAME")]
    pub(crate) layer: Option<String>,
    /// Also draw each pixel's relative squared error: false colours, logarithmic.
    #[arg(long, value_name = "PNG", value_parser = ending_in("png"))]
    pub(crate) error_map: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Measure methods side by side.
#[derive(Debug, clap::Args)]
pub(crate) struct BenchArgs {
    #[command(subcommand)]
    pub(crate) bench: Bench,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Bench {
    Scene(BenchSceneArgs),
    Stability(BenchStabilityArgs),
}

/// Render a scene with several seeds; compare each method with a reference.
#[derive(Debug, clap::Args)]
pub(crate) struct BenchSceneArgs {
    /// OBJ file.
    #[arg(long, value_name = "OBJ")]
    pub(crate) scene: PathBuf,
    /// EXR picture whose R, G, B are taken for the truth; it sets the film size.
    #[arg(long, value_name = "EXR")]
    pub(crate) reference: PathBuf,
    /// Sample counts to render with.
    #[arg(long, value_delimiter = ',', default_values_t = [8, 16, 32, 64], value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) spp: Vec<u32>,
    /// Independent renderings per sample count.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) runs: u32,
    /// Seed of the first run; the others follow.
    #[arg(long, default_value_t = 1_000_000)]
    pub(crate) seed: u64,
    /// Methods to compare: `auto`, or names as for `nst transform`; `none` always is.
    #[arg(long, value_name = "METHOD", value_delimiter = ',', default_value = "auto", value_parser = transform)]
    pub(crate) transform: Vec<TransformArg>,
    /// What evaluates networks.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) backend: BackendArg,
    /// CSV file to write.
    #[arg(short, long, value_name = "CSV")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Apply all methods to sequences of known limits, made to break them.
#[derive(Debug, clap::Args)]
pub(crate) struct BenchStabilityArgs {
    /// CSV file to write.
    #[arg(short, long, value_name = "CSV")]
    pub(crate) output: PathBuf,
    /// Also write the tables for readers.
    #[arg(long, value_name = "FILE")]
    pub(crate) markdown: Option<PathBuf>,
    /// Few lanes and up to 64 samples: seconds instead of minutes.
    #[arg(long)]
    pub(crate) short: bool,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

#[derive(Debug, clap::Args)]
pub(crate) struct MethodArgs {
    /// `auto`, `none`, the name of a built-in network, or of a classical or robust
    /// method. `auto` takes the network that was trained on this very scene, else none.
    #[arg(long, value_name = "METHOD", default_value = "auto", value_parser = transform)]
    pub(crate) transform: TransformArg,
    /// Use the network of this safetensors file.
    #[arg(long, value_name = "FILE", conflicts_with = "transform")]
    pub(crate) weights: Option<PathBuf>,
    /// What evaluates the network. `auto`: a hardware GPU if there is one, else the CPU.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) backend: BackendArg,
}

#[derive(Debug, clap::Args)]
pub(crate) struct CommonArgs {
    /// Threads to use. [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    /// Print nothing but errors.
    #[arg(short, long)]
    pub(crate) quiet: bool,
    /// Print the summary as one JSON object.
    #[arg(long, conflicts_with = "quiet")]
    pub(crate) json: bool,
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
    /// A scrambled Halton sequence for each pixel.
    Halton,
}

impl RenderArgs {
    /// Where the picture or the dataset goes.
    pub(crate) fn output(&self, scene: &str) -> Result<PathBuf, Error> {
        let extension = if self.runs.is_some() { "safetensors" } else { "exr" };
        match &self.output {
            None => Ok(PathBuf::from(format!("{scene}.{extension}"))),
            Some(path) if has_extension(path, extension) => Ok(path.clone()),
            Some(path) => Err(Error::Usage(format!(
                "--output '{}': the name must end in .{extension}",
                path.display()
            ))),
        }
    }

    /// Who chose that name.
    pub(crate) fn output_name(&self) -> Name {
        if self.output.is_some() { Name::Given } else { Name::Default }
    }
}

impl From<SamplerArg> for SamplerKind {
    fn from(arg: SamplerArg) -> Self {
        match arg {
            SamplerArg::Random => Self::Random,
            SamplerArg::Halton => Self::Halton,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum IntegratorArg {
    /// Paths as deep as the scene says.
    Path,
    /// Light that reaches the first surface directly.
    Direct,
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

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum BackendArg {
    /// A hardware GPU if there is one, else the CPU.
    #[default]
    Auto,
    /// The first adapter, a software one if there is no other.
    Gpu,
    /// The CPU.
    Cpu,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TransformArg {
    Auto,
    None,
    /// The name of a network of [`Network::builtins`].
    Builtin(&'static str),
    /// A name in [`METHODS`].
    Method(&'static str),
}

fn transform(text: &str) -> Result<TransformArg, String> {
    let builtin = Network::builtins().map(|it| (it.name(), TransformArg::Builtin(it.name())));
    let methods = METHODS.iter().map(|&name| (name, TransformArg::Method(name)));
    let known = [("auto", TransformArg::Auto), ("none", TransformArg::None)];
    let mut known = known.into_iter().chain(builtin).chain(methods);
    known.clone().find(|&(name, _)| name == text).map(|(_, arg)| arg).ok_or_else(|| {
        let first = known.next().map(|(name, _)| name.to_owned()).unwrap_or_default();
        let names = known.fold(first, |names, (name, _)| names + ", " + name);
        format!("known methods are {names}")
    })
}

fn size(text: &str) -> Result<[u32; 2], String> {
    text.split_once('x')
        .and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]))
        .filter(|size| !size.contains(&0))
        .ok_or_else(|| "a size is two numbers above 0, as in 512x512".to_owned())
}

/// Takes a path with an extension; file names need not be UTF-8.
fn ending_in(extension: &'static str) -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(move |path| {
        let fits = has_extension(&path, extension);
        if fits { Ok(path) } else { Err(format!("the name must end in .{extension}")) }
    })
}

/// Whether a path ends in the extension, whatever its case.
pub(crate) fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Args::command().debug_assert();
    }

    #[test]
    fn sizes_and_methods() {
        assert_eq!(size("640x480"), Ok([640, 480]));
        for bad in ["640", "640x", "0x3", "-1x3", "1x2x3"] {
            assert!(size(bad).is_err(), "{bad}");
        }
        assert_eq!(transform("cornell"), Ok(TransformArg::Builtin("cornell")));
        assert_eq!(transform("levin-u"), Ok(TransformArg::Method("levin-u")));
        assert!(transform("Cornell").is_err_and(|error| error.contains("families")));
        let transform = |output| Args::try_parse_from(["nst", "transform", "s.exr", "-o", output]);
        assert!(transform("x.EXR").is_ok() && transform("x.png").is_err());
    }
}

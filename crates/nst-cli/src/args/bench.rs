//! `nst bench`.

use std::path::PathBuf;

use clap::Subcommand;

use super::{
    common::CommonArgs,
    method::{BackendArg, ExpertArg, GuardArg, TransformArg, expert, guard, transform},
    picture::{NamedPicture, named_picture},
    render::{PixelArg, SamplerArg},
    values::{count, ending_in, seed, size},
};

/// Measure methods and compare them.
#[derive(Debug, clap::Args)]
pub(crate) struct BenchArgs {
    #[command(subcommand)]
    pub(crate) bench: Bench,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Bench {
    Scene(Box<BenchSceneArgs>),
    Stability(BenchStabilityArgs),
}

/// Measure methods on a scene: errors against a reference, and times, as CSV.
///
/// The scene is rendered with several seeds and sample counts, and each method is compared
/// with a reference that is rendered once. A bench that was cut off goes on where it was. A
/// file of the same name that ends in .exr shows pictures of the best methods. `nst chart`
/// and `nst report` draw the table.
#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("source").args(["scene", "sequence"]).required(true)))]
pub(crate) struct BenchSceneArgs {
    /// OBJ file.
    #[arg(long, value_name = "OBJ")]
    pub(crate) scene: Option<PathBuf>,
    /// Instead of a scene, sequence files of independent runs, as `nst pack` makes them. A bench
    /// that goes on measures those anew that do not say their seeds.
    #[arg(long, value_name = "EXR", num_args = 1.., requires = "reference", conflicts_with_all = ["spp", "runs", "seed", "sampler", "size", "pixel", "max_depth", "reference_spp"])]
    pub(crate) sequence: Vec<PathBuf>,
    /// EXR picture whose R, G, B count as the true values, or two independent ones; it sets
    /// the film size. [default: two are rendered, and kept for the next bench]
    #[arg(long, value_name = "EXR", num_args = 1..=2)]
    pub(crate) reference: Vec<PathBuf>,
    /// Samples per pixel of each of the two references that are rendered. [default: those of
    /// the table, if it is there, else 16 for each of the largest --spp]
    #[arg(long, value_name = "N", value_parser = count, allow_negative_numbers = true, conflicts_with = "reference")]
    pub(crate) reference_spp: Option<u32>,
    /// Film size in pixels, as in 512x512. [default: the scene's shape, at most 256 wide and
    /// high]
    #[arg(long, value_name = "WxH", value_parser = size, conflicts_with = "reference")]
    pub(crate) size: Option<[u32; 2]>,
    /// Sample counts to render with.
    #[arg(long, value_delimiter = ',', num_args = 1.., default_values_t = [8, 16, 32, 64], value_parser = count, allow_negative_numbers = true)]
    pub(crate) spp: Vec<u32>,
    /// Independent renderings per sample count; the squared bias is measured of pairs of them,
    /// so that the last of an odd number has none.
    #[arg(long, default_value_t = 10, value_parser = count, allow_negative_numbers = true)]
    pub(crate) runs: u32,
    /// Seed of the first run; those of the others count up from it.
    #[arg(long, default_value_t = 1_000_000, value_parser = seed, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    /// Which random numbers to use. [default: random]
    #[arg(long, value_enum)]
    pub(crate) sampler: Option<SamplerArg>,
    /// Path vertices after the camera that may scatter or emit. [default: the scene's]
    #[arg(long, value_name = "N", value_parser = count, allow_negative_numbers = true)]
    pub(crate) max_depth: Option<u32>,
    /// Where in a pixel samples are. [default: box]
    #[arg(long, value_enum)]
    pub(crate) pixel: Option<PixelArg>,
    /// Methods to compare, beside the plain estimate. [default: all]
    #[arg(long, value_name = "METHOD", value_delimiter = ',', num_args = 1.., hide_possible_values = true, value_parser = transform())]
    pub(crate) transform: Vec<TransformArg>,
    /// Experts that `auto` may trust; with other names than `auto` alone, the table can compare
    /// several lists. [default: lane,filter, however long the filter takes]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = expert)]
    pub(crate) experts: Vec<ExpertArg>,
    /// What weighs experts of `auto` that look at neighbours: `closed`, `learned`, or the network of a
    /// safetensors file; the table calls it `auto (closed)` and so on. [default: learned]
    #[arg(long, value_name = "HOW", value_parser = guard)]
    pub(crate) guard: Option<GuardArg>,
    /// Also measure networks of these safetensors files, under the names of the files. A bench
    /// that goes on measures them anew, as they may have changed.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub(crate) weights: Vec<PathBuf>,
    /// Also judge a picture of another program, which says its samplesPerPixel, and perhaps its
    /// renderTimeSeconds, which count as the time of the whole job; can be given several times,
    /// with one name for several runs.
    #[arg(long, value_name = "NAME=FILE[:LAYER]", value_parser = named_picture)]
    pub(crate) picture: Vec<NamedPicture>,
    /// What networks run on.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) backend: BackendArg,
    /// CSV file to write, or to go on with.
    #[arg(short, long, value_name = "CSV", value_parser = ending_in(["csv"]))]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Apply all methods to sequences that are known to break some of them, write CSV.
#[derive(Debug, clap::Args)]
pub(crate) struct BenchStabilityArgs {
    /// CSV file to write.
    #[arg(short, long, value_name = "CSV")]
    pub(crate) output: PathBuf,
    /// Also write the results as a Markdown page.
    #[arg(long, value_name = "FILE")]
    pub(crate) markdown: Option<PathBuf>,
    /// Fewer sequences, and at most 64 samples: about a second.
    #[arg(long)]
    pub(crate) short: bool,
    /// Seed of the random numbers: each makes another draw of all random sequences.
    #[arg(long, default_value_t = 0, value_parser = seed, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

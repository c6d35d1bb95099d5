//! `nst bench`.

use std::path::PathBuf;

use clap::Subcommand;

use super::{
    common::CommonArgs,
    method::{BackendArg, TransformArg, transform},
    values::{count, seed},
};

/// Measure methods and compare them.
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

/// Render a scene with several seeds, compare each method with a reference, write CSV.
#[derive(Debug, clap::Args)]
pub(crate) struct BenchSceneArgs {
    /// OBJ file.
    #[arg(long, value_name = "OBJ")]
    pub(crate) scene: PathBuf,
    /// EXR picture whose R, G, B count as the true values; it sets the film size.
    #[arg(long, value_name = "EXR")]
    pub(crate) reference: PathBuf,
    /// Sample counts to render with.
    #[arg(long, value_delimiter = ',', num_args = 1.., default_values_t = [8, 16, 32, 64], value_parser = count, allow_negative_numbers = true)]
    pub(crate) spp: Vec<u32>,
    /// Independent renderings per sample count.
    #[arg(long, default_value_t = 10, value_parser = count, allow_negative_numbers = true)]
    pub(crate) runs: u32,
    /// Seed of the first run; those of the others count up from it.
    #[arg(long, default_value_t = 1_000_000, value_parser = seed, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    /// Methods to compare: `auto`, or names as for `nst transform`; `none` is always
    /// included.
    #[arg(long, value_name = "METHOD", value_delimiter = ',', num_args = 1.., default_value = "auto", value_parser = transform())]
    pub(crate) transform: Vec<TransformArg>,
    /// What networks run on.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) backend: BackendArg,
    /// CSV file to write.
    #[arg(short, long, value_name = "CSV")]
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
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

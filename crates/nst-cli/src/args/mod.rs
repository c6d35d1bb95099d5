//! The commands and their options. Commands with many options have a module each.

#[cfg(feature = "render")]
mod bench;
mod chart;
mod common;
mod method;
mod pack;
mod picture;
#[cfg(feature = "render")]
mod render;
mod report;
mod values;

use std::path::PathBuf;

use clap::{Parser, Subcommand};

#[cfg(feature = "render")]
pub(crate) use bench::{Bench, BenchArgs, BenchSceneArgs, BenchStabilityArgs};
pub(crate) use chart::ChartArgs;
pub(crate) use common::CommonArgs;
pub(crate) use method::{
    BackendArg, CLOSED, ExpertArg, FILTER, GuardArg, LEARNED, MethodArgs, TransformArg,
};
use method::{builtin_name, expert};
pub(crate) use pack::{PackArgs, PackAs};
pub(crate) use picture::NamedPicture;
#[cfg(feature = "render")]
pub(crate) use render::{IntegratorArg, KeepArg, RenderArgs};
pub(crate) use report::ReportArgs;
use values::ending_in;
pub(crate) use values::has_extension;

/// Monte Carlo renderings that converge faster: neural sequence transformation.
#[derive(Debug, Parser)]
#[command(name = "nst", version)]
pub(crate) struct Args {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    #[cfg(feature = "render")]
    Render(RenderArgs),
    Transform(TransformArgs),
    Pack(PackArgs),
    Merge(MergeArgs),
    GuardTable(GuardTableArgs),
    Info(InfoArgs),
    Compare(CompareArgs),
    #[cfg(feature = "render")]
    Bench(BenchArgs),
    Chart(ChartArgs),
    Report(ReportArgs),
    Completions(CompletionsArgs),
    Man(ManArgs),
}

impl Command {
    /// The options that all commands have.
    pub(crate) fn common(&self) -> &CommonArgs {
        match self {
            #[cfg(feature = "render")]
            Self::Render(args) => &args.common,
            Self::Transform(args) => &args.common,
            Self::Pack(args) => &args.common,
            Self::Merge(args) => &args.common,
            Self::GuardTable(args) => &args.common,
            Self::Info(args) => &args.common,
            Self::Compare(args) => &args.common,
            Self::Chart(args) => &args.common,
            Self::Report(args) => &args.common,
            Self::Completions(args) => &args.common,
            Self::Man(args) => &args.common,
            #[cfg(feature = "render")]
            Self::Bench(BenchArgs { bench: Bench::Scene(args) }) => &args.common,
            #[cfg(feature = "render")]
            Self::Bench(BenchArgs { bench: Bench::Stability(args) }) => &args.common,
        }
    }
}

/// Transform a stored sequence, write EXR and PNG.
#[derive(Debug, clap::Args)]
pub(crate) struct TransformArgs {
    /// Sequence file, as written by `nst render --sequence`.
    #[arg(value_name = "EXR")]
    pub(crate) sequence: PathBuf,
    /// Picture to write: .exr, with a PNG beside it, or .png alone. [default: beside the
    /// sequence, ending in .nst.exr]
    #[arg(short, long, value_name = "FILE", value_parser = ending_in(["exr", "png"]))]
    pub(crate) output: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) method: MethodArgs,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Join sequences of one scene that were rendered with different seeds.
#[derive(Debug, clap::Args)]
pub(crate) struct MergeArgs {
    /// Sequence files that agree in size, scene, sampler and terms.
    #[arg(value_name = "EXR", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Sequence to write.
    #[arg(short, long, value_name = "EXR", value_parser = ending_in(["exr"]))]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Write what a network that weighs the guard's experts is trained with: see train/README.md.
#[derive(Debug, clap::Args)]
pub(crate) struct GuardTableArgs {
    /// Sequence file, as written by `nst render --sequence`.
    #[arg(value_name = "EXR")]
    pub(crate) sequence: PathBuf,
    /// The experts, as of `nst transform`; some of them look at neighbours.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = expert, required = true)]
    pub(crate) experts: Vec<ExpertArg>,
    /// Table to write.
    #[arg(short, long, value_name = "FILE", value_parser = ending_in(["safetensors"]))]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Show what is in a file: a sequence or picture (EXR), a scene (OBJ), a network's weights
/// or a dataset (safetensors).
#[derive(Debug, clap::Args)]
pub(crate) struct InfoArgs {
    /// The file.
    #[arg(value_name = "FILE", required_unless_present_any = ["system", "network"])]
    pub(crate) file: Option<PathBuf>,
    /// Show the program's version and build, the processor, the adapters and the library of Open
    /// Image Denoise instead: for reports of errors.
    #[arg(long, conflicts_with = "file")]
    pub(crate) system: bool,
    /// Show a built-in network instead.
    #[arg(long, value_name = "NAME", hide_possible_values = true, value_parser = builtin_name(), conflicts_with_all = ["file", "system"])]
    pub(crate) network: Option<String>,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Compare pictures with a reference: MSE, relMSE and SMAPE.
///
/// Several pictures count as independent runs of one method: the error is the mean over
/// them, and is split into bias and variance.
#[derive(Debug, clap::Args)]
pub(crate) struct CompareArgs {
    /// EXR pictures of any program, all of the same frame; the last is the reference. Of
    /// pictures that are parts of the frame, what all have in common is compared.
    #[arg(value_name = "EXR", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Layer to compare, as in S; or a channel by its whole name. [default: the main
    /// picture, or the only layer]
    #[arg(long, value_name = "LAYER")]
    pub(crate) layer: Option<String>,
    /// Layer of the reference; an empty name is its main picture. [default: that of --layer
    /// if it has it, else its main picture]
    #[arg(long, value_name = "LAYER")]
    pub(crate) reference_layer: Option<String>,
    /// Also write a picture of each pixel's relative squared error, in false colours on a
    /// logarithmic scale.
    #[arg(long, value_name = "PNG", value_parser = ending_in(["png"]))]
    pub(crate) error_map: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Print what a shell needs to complete the options of this program.
///
/// For example, for bash: nst completions bash > ~/.local/share/bash-completion/completions/nst
#[derive(Debug, clap::Args)]
pub(crate) struct CompletionsArgs {
    /// The shell.
    #[arg(value_enum)]
    pub(crate) shell: clap_complete::Shell,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

/// Print the manual page of this program, or of one of its commands.
///
/// For example: nst man render | man -l -
#[derive(Debug, clap::Args)]
pub(crate) struct ManArgs {
    /// The command.
    pub(crate) command: Option<String>,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Args::command().debug_assert();
    }
}

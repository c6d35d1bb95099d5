//! The command line.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};

/// Time the evaluation of networks, after comparing it with f64, beside a matrix product.
#[derive(Debug, Parser)]
pub(crate) struct Args {
    /// Networks to time, as hidden layers × neurons.
    #[arg(long, value_name = "LxN", value_delimiter = ',', default_value = "2x32,2x64,4x64,4x128,4x256", value_parser = shape)]
    pub(crate) shapes: Vec<Shape>,
    /// Time the network of this safetensors file instead.
    #[arg(long, value_name = "FILE", conflicts_with = "shapes")]
    pub(crate) weights: Option<PathBuf>,
    /// Sequences per batch.
    #[arg(long, value_name = "N", value_delimiter = ',', default_values_t = [1024, 16384, 262_144], value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) lanes: Vec<u32>,
    /// What to time.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) backend: Backends,
    /// Also time what would not be chosen: other instructions, other kernels, f16 weights.
    #[arg(long)]
    pub(crate) variants: bool,
    /// Turns of each, of 20 ms or more; the median of all their calls counts.
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) runs: u32,
    /// Threads to use. [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    /// Print nothing but errors.
    #[arg(short, long)]
    pub(crate) quiet: bool,
    /// CSV file to write.
    #[arg(short, long, value_name = "CSV")]
    pub(crate) output: Option<PathBuf>,
}

/// A network of equally wide hidden layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shape {
    pub(crate) layers: usize,
    pub(crate) hidden: usize,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Backends {
    /// The CPU, and the first adapter if there is one.
    #[default]
    All,
    /// The CPU.
    Cpu,
    /// The first adapter, a software one if there is no other.
    Gpu,
}

fn shape(text: &str) -> Result<Shape, String> {
    let number = |text: &str| text.parse().ok().filter(|x| (1..=4096).contains(x));
    text.split_once('x')
        .and_then(|(layers, hidden)| {
            Some(Shape { layers: number(layers)?, hidden: number(hidden)? })
        })
        .ok_or_else(|| {
            "a shape is hidden layers × neurons, as in 4x256, each from 1 to 4096".to_owned()
        })
}

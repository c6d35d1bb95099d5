//! `nst chart`.

use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser};

use super::{common::CommonArgs, values::has_extension};
use crate::results::Metric;

/// Draw tables of `nst bench scene`: error against time and samples, as SVG and PNG.
///
/// The Pareto front is marked, and methods are compared at equal time. The SVG is light or
/// dark, as readers prefer; the PNG is light.
#[derive(Debug, clap::Args)]
pub(crate) struct ChartArgs {
    /// Tables; several are joined.
    #[arg(value_name = "CSV", required = true)]
    pub(crate) tables: Vec<PathBuf>,
    /// Chart to write, .svg or .png. [default: both, named after the first table]
    #[arg(short, long, value_name = "FILE", value_parser = chart_file())]
    pub(crate) output: Option<PathBuf>,
    /// The only measure of error. [default: MSE and relMSE]
    #[arg(long, value_enum)]
    pub(crate) metric: Option<Metric>,
    /// The scene, where the tables have several.
    #[arg(long, value_name = "NAME")]
    pub(crate) scene: Option<String>,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

fn chart_file() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| {
        let fits = has_extension(&path, "svg") || has_extension(&path, "png");
        if fits { Ok(path) } else { Err("the name must end in .svg or .png") }
    })
}

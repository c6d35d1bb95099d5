//! `nst report`.

use std::path::PathBuf;

use super::{
    common::CommonArgs,
    picture::{NamedPicture, named_picture},
    values::ending_in,
};

/// Make a page of the results of `nst bench scene`: charts, a table, and its pictures side by
/// side.
///
/// The page is one file that needs no network. Its pictures come from the EXR file that `nst
/// bench scene` writes beside the table.
#[derive(Debug, clap::Args)]
pub(crate) struct ReportArgs {
    /// Table of `nst bench scene`.
    #[arg(value_name = "CSV", value_parser = ending_in(["csv"]))]
    pub(crate) table: PathBuf,
    /// Page to write. [default: the table's name, ending in .html]
    #[arg(short, long, value_name = "HTML", value_parser = ending_in(["html"]))]
    pub(crate) output: Option<PathBuf>,
    /// The scene, if the table has several.
    #[arg(long, value_name = "NAME")]
    pub(crate) scene: Option<String>,
    /// Also show a picture, as of another program; LAYER is a layer of the file. May be given
    /// several times.
    #[arg(long, value_name = "NAME=FILE[:LAYER]", value_parser = named_picture)]
    pub(crate) picture: Vec<NamedPicture>,
    #[command(flatten)]
    pub(crate) common: CommonArgs,
}

//! The options that all commands have.

#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct CommonArgs {
    /// Threads to use. [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    /// Print only errors and warnings.
    #[arg(short, long)]
    pub(crate) quiet: bool,
    /// Print the report as one JSON object.
    #[arg(long, conflicts_with = "quiet")]
    pub(crate) json: bool,
}

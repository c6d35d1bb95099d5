//! One module for each command; each returns its report.

#[cfg(feature = "render")]
mod bench;
mod chart;
mod compare;
mod describe;
mod guard_table;
mod info;
mod merge;
mod pack;
mod picture_files;
#[cfg(feature = "render")]
mod render;
mod report;
mod transform;

use std::{collections::BTreeSet, path::PathBuf};

use crate::{args::Command, error::Error, report::Done};

/// Runs a command; the caller prints what it reports.
pub(crate) fn run(command: &Command) -> Result<Done, Error> {
    match command {
        #[cfg(feature = "render")]
        Command::Render(args) => render::run(args),
        Command::Transform(args) => transform::run(args).map(Done::whole),
        Command::Pack(args) => pack::run(args),
        Command::Merge(args) => merge::run(args).map(Done::whole),
        Command::GuardTable(args) => guard_table::run(args).map(Done::whole),
        Command::Info(args) => info::run(args),
        Command::Compare(args) => compare::run(args).map(Done::whole),
        #[cfg(feature = "render")]
        Command::Bench(args) => bench::run(args),
        Command::Chart(args) => chart::run(args).map(Done::whole),
        Command::Report(args) => report::run(args).map(Done::whole),
        Command::Completions(args) => describe::completions(args).map(Done::whole),
        Command::Man(args) => describe::manual(args).map(Done::whole),
    }
}

/// Fails if a file is named twice: it would count as two independent ones.
fn check_distinct(paths: &[PathBuf]) -> Result<(), Error> {
    let mut seen = BTreeSet::new();
    // Files that are not there are reported by those who read them.
    let places = paths.iter().filter_map(|path| Some((path, path.canonicalize().ok()?)));
    for (path, place) in places {
        if !seen.insert(place) {
            let message = format!("'{}' is named twice; name each file once", path.display());
            return Err(Error::Usage(message));
        }
    }
    Ok(())
}

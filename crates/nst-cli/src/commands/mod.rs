//! One module for each command; each returns its report.

mod bench;
mod chart;
mod compare;
mod describe;
mod info;
mod merge;
mod pack;
mod render;
mod report;
mod transform;

use std::{collections::BTreeSet, path::PathBuf};

use crate::{args::Command, error::Error, report::Done};

/// The most numbers or names that a line of text lists, so that it fits a screen.
const MOST_LISTED: usize = 12;

/// Runs a command; the caller prints what it reports.
pub(crate) fn run(command: &Command) -> Result<Done, Error> {
    match command {
        Command::Render(args) => render::run(args),
        Command::Transform(args) => transform::run(args).map(Done::whole),
        Command::Pack(args) => pack::run(args),
        Command::Merge(args) => merge::run(args).map(Done::whole),
        Command::Info(args) => info::run(args).map(Done::whole),
        Command::Compare(args) => compare::run(args).map(Done::whole),
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

/// Numbers as text, like the names of [`list`].
fn numbers(numbers: &[u32]) -> String {
    list(&numbers.iter().map(u32::to_string).collect::<Vec<_>>(), "none")
}

/// Names as text; the middle of a long list is left out, and `none` is the text of an empty
/// one.
fn list(names: &[impl AsRef<str>], none: &str) -> String {
    let names: Vec<_> = names.iter().map(AsRef::as_ref).collect();
    match names.len() {
        0 => none.to_owned(),
        1..=MOST_LISTED => names.join(", "),
        count => {
            let (start, end) = (&names[..MOST_LISTED / 2], &names[count - MOST_LISTED / 2..]);
            format!("{}, …, {} ({count})", start.join(", "), end.join(", "))
        }
    }
}

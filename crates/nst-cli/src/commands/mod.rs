//! One module for each command; each returns its report.

mod bench;
mod compare;
mod info;
mod merge;
mod pack;
mod render;
mod transform;

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
    }
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

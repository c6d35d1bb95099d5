//! What commands report, and the only place that prints.

use std::{
    fmt,
    io::{ErrorKind, Write},
};

use serde::Serialize;

use crate::{
    args::CommonArgs,
    error::Error,
    progress::above,
    words::{printable, wrapped},
};

/// What a command did or found, as JSON for programs and as text for people.
pub(crate) trait Report {
    /// One JSON object.
    fn json(&self) -> String;

    /// Lines of text.
    fn text(&self) -> String;
}

impl<T: Serialize + fmt::Display> Report for T {
    fn json(&self) -> String {
        serde_json::to_string(self).expect("reports consist of numbers and strings")
    }

    fn text(&self) -> String {
        self.to_string()
    }
}

/// The result of a command that did not fail.
pub(crate) struct Done {
    pub(crate) report: Box<dyn Report>,
    /// What is missing, if Ctrl-C ended the job early.
    pub(crate) early: Option<String>,
}

impl Done {
    /// The result of a command that has done everything.
    pub(crate) fn whole(report: impl Report + 'static) -> Self {
        Self { report: Box::new(report), early: None }
    }
}

/// Prints a report as the command line asks.
pub(crate) fn print(report: &dyn Report, common: &CommonArgs) -> Result<(), Error> {
    match common {
        CommonArgs { json: true, .. } => write(&report.json()),
        CommonArgs { quiet: true, .. } => Ok(()),
        _ => write(&printable(&report.text())),
    }
}

/// Tells people something while a job is running. If that fails, the job continues:
/// printing the report will fail in the same way, after the files are complete.
pub(crate) fn say(text: &str, common: &CommonArgs) {
    if !(common.json || common.quiet) {
        let _ = write(&printable(text));
    }
}

/// The same on standard error, for what must be seen if the job ends at once.
pub(crate) fn warn(text: &str, common: &CommonArgs) {
    if !(common.json || common.quiet) {
        complain(text);
    }
}

/// Writes lines to standard output. A reader that closes the pipe early, as `head` does,
/// does not end the job; a full disk is an error.
fn write(text: &str) -> Result<(), Error> {
    // In a pipe, a line stays a line.
    let columns = console::Term::stdout().size_checked().map(|(_, columns)| columns.into());
    let text = columns.map_or_else(|| text.to_owned(), |columns| wrapped(text, columns));
    let written = above(|| {
        let mut out = std::io::stdout().lock();
        writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush())
    });
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Error::Stdout(error)),
        _ => Ok(()),
    }
}

/// Writes a line to standard error, if that is possible.
pub(crate) fn complain(line: &str) {
    // If it is closed, there is no other place to report that.
    let _ = above(|| writeln!(std::io::stderr(), "{}", printable(line)));
}

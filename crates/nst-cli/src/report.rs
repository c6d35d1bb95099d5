//! What a command says when it is done, and the only place that prints it.

use std::{
    fmt,
    io::{ErrorKind, Write},
};

use serde::Serialize;

use crate::{args::CommonArgs, error::Error};

/// What a command did or found: for programs as JSON, for people as text.
pub(crate) trait Report {
    /// One object.
    fn json(&self) -> String;

    /// Lines.
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

/// A command that has done what it could.
pub(crate) struct Done {
    pub(crate) report: Box<dyn Report>,
    /// What is missing, if Ctrl-C ended the job early.
    pub(crate) early: Option<String>,
}

impl Done {
    /// A command that has done all it was asked.
    pub(crate) fn whole(report: impl Report + 'static) -> Self {
        Self { report: Box::new(report), early: None }
    }
}

/// Prints a report as the command line asks.
pub(crate) fn print(report: &dyn Report, common: &CommonArgs) -> Result<(), Error> {
    match common {
        CommonArgs { json: true, .. } => write(&report.json()),
        CommonArgs { quiet: true, .. } => Ok(()),
        _ => write(&report.text()),
    }
}

/// Tells people something while a job is under way. Where it cannot be written, the job
/// goes on: the report fails in the same way, when the files are there.
pub(crate) fn say(text: &str, common: &CommonArgs) {
    if !(common.json || common.quiet) {
        let _ = write(text);
    }
}

/// Writes lines to standard output. A reader who has heard enough, such as `head`, is no
/// reason to end a job; a full disk is an error.
fn write(text: &str) -> Result<(), Error> {
    let mut out = std::io::stdout().lock();
    let written = writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush());
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Error::Stdout(error)),
        _ => Ok(()),
    }
}

/// Writes a line to standard error, where it can be written to.
pub(crate) fn complain(line: &str) {
    // There is no other place to say that this one is closed.
    let _ = writeln!(std::io::stderr(), "{line}");
}

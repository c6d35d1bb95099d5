//! `nst`: renders scenes, and transforms sequences of Monte Carlo estimates.

#![cfg_attr(
    not(all(feature = "gpu", feature = "render")),
    allow(dead_code, reason = "some parts are only used by those that are left out")
)]

mod adapter;
mod args;
mod chart;
mod commands;
mod error;
#[cfg(feature = "gpu")]
mod fallback;
mod guard;
mod interrupt;
mod method;
mod networks;
mod oidn;
mod progress;
mod report;
mod results;
mod samples;
mod summary;
mod system;
mod words;

use std::process::ExitCode;

use clap::Parser;

use args::{Args, CommonArgs};
use error::Error;
use report::{complain, print};

fn main() -> ExitCode {
    let args = Args::parse();
    match run(&args) {
        Ok(None) => ExitCode::SUCCESS,
        Ok(Some(missing)) | Err(Error::Interrupted(missing)) => {
            complain(&format!("stopped: {missing}"));
            ExitCode::from(interrupt::exit_code())
        }
        Err(error) => {
            complain(&format!("error: {error}"));
            ExitCode::from(error.exit_code())
        }
    }
}

/// Runs the command and prints its report; returns what is missing if it ended early.
fn run(args: &Args) -> Result<Option<String>, Error> {
    let common = args.command.common();
    interrupt::watch()?;
    set_threads(common)?;
    let done = commands::run(&args.command)?;
    print(&*done.report, common)?;
    Ok(done.early)
}

/// Sets the number of threads of everything that follows.
fn set_threads(common: &CommonArgs) -> Result<(), Error> {
    let Some(threads) = common.threads else { return Ok(()) };
    rayon::ThreadPoolBuilder::new()
        .num_threads(usize::from(threads))
        .build_global()
        .map_err(|error| Error::Usage(format!("--threads {threads}: {error}")))
}

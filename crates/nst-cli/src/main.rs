//! `nst`: renders scenes, and transforms sequences of Monte Carlo estimates.

mod args;
mod commands;
mod error;
mod fallback;
mod interrupt;
mod method;
mod summary;

use std::process::ExitCode;

use clap::Parser;

use args::{Args, Command};
use error::Error;

fn main() -> ExitCode {
    let args = Args::parse();
    let result = match &args.command {
        Command::Render(args) => commands::render::run(args),
        Command::Transform(args) => commands::transform::run(args),
        Command::Pack(args) => commands::pack::run(args),
        Command::Merge(args) => commands::merge::run(args),
        Command::Info(args) => commands::info::run(args),
        Command::Compare(args) => commands::compare::run(args),
        Command::Bench(args) => commands::bench::run(args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(Error::Interrupted(message)) => {
            eprintln!("stopped: {message}");
            ExitCode::from(interrupt::EXIT_CODE)
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(if matches!(error, Error::Usage(_)) { 2 } else { 1 })
        }
    }
}

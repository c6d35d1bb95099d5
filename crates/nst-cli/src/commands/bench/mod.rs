//! `nst bench`: measurements, written to CSV files.

mod scene;
mod stability;

use crate::{
    args::{Bench, BenchArgs},
    error::Error,
    report::Done,
};

pub(super) fn run(args: &BenchArgs) -> Result<Done, Error> {
    match &args.bench {
        Bench::Scene(args) => scene::run(args),
        Bench::Stability(args) => stability::run(args).map(Done::whole),
    }
}

//! `nst bench`: measurements, in CSV files.

mod random;
mod scene;
mod stability;

use crate::{
    args::{Bench, BenchArgs},
    error::Error,
};

pub(crate) fn run(args: &BenchArgs) -> Result<(), Error> {
    match &args.bench {
        Bench::Scene(args) => scene::run(args),
        Bench::Stability(args) => stability::run(args),
    }
}

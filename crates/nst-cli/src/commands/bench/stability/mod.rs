//! `nst bench stability`: every method on every kind of sequences that may break it.

mod integrands;
mod markdown;
mod regimes;
mod simulate;

use std::{io::Write, time::Instant};

use nst_core::{
    BUILTIN, Estimates, SequenceBatch, Status,
    methods::{FOLDS, METHODS, extrapolation},
};
use nst_render::output::OutputFile;
use serde::Serialize;

use crate::{
    args::{BackendArg, BenchStabilityArgs, TransformArg},
    commands::set_threads,
    error::Error,
    method::Method,
};

use regimes::{REGIMES, Regime, window};
use simulate::{Case, Rng, simulate};

/// A method on the sequences of a regime with n samples. T and S are compared on
/// the lanes whose S is finite.
#[derive(Clone, Debug, Serialize)]
struct Row {
    method: String,
    regime: &'static str,
    n: u32,
    /// Σ (T − I)² / Σ (S − I)²; 1 where both sums are 0.
    mse_ratio: f64,
    /// The share of lanes that hold S_n because the method broke down.
    fallback_share: f64,
    /// max (T − I)² / max (S − I)²; 1 where both are 0.
    worst_ratio: f64,
    /// Lanes whose T is not finite although S is.
    nonfinite: usize,
    /// Mean (T − I)².
    mse: f64,
    /// (Mean T − I)² / mean (S − I)², which does not average out over lanes.
    bias2_ratio: f64,
    /// The share of lanes that are constant, and hold S_n for that.
    constant_share: f64,
    /// Of the method, on many lanes with all threads.
    nanoseconds_per_lane: f64,
    /// The same, in terms and fold means that are read per second.
    lane_terms_per_second: f64,
}

/// How much work to do.
struct Effort {
    sample_counts: Vec<u32>,
    /// Runs of each integrand.
    runs: usize,
    /// Where `Regime::far` asks for it: samples, and runs of each integrand.
    far: Option<(u32, usize)>,
    cost_lanes: usize,
}

impl Effort {
    fn new(short: bool) -> Self {
        if short {
            Self { sample_counts: vec![8, 64], runs: 20, far: None, cost_lanes: 1 << 12 }
        } else {
            Self {
                sample_counts: (3..=12).map(|k| 1 << k).collect(),
                runs: 400,
                far: Some((1_000_000, 20)),
                cost_lanes: 1 << 18,
            }
        }
    }
}

pub(super) fn run(args: &BenchStabilityArgs) -> Result<(), Error> {
    set_threads(&args.common)?;
    let start = Instant::now();
    let mut csv = OutputFile::create(&args.output)?;
    let mut markdown = args.markdown.as_deref().map(OutputFile::create).transpose()?;

    let rows = rows(&Effort::new(args.short))?;
    write_csv(&mut csv, &rows)
        .map_err(|source| Error::Csv { path: args.output.clone(), source })?;
    if let Some(file) = &mut markdown {
        let write = file.file().write_all(markdown::document(&rows).as_bytes());
        let path = file.path().to_owned();
        write.map_err(|error| Error::Csv { path, source: error.into() })?;
    }
    for output in [csv].into_iter().chain(markdown) {
        output.commit()?;
    }
    if !args.common.quiet {
        let nonfinite: usize = rows.iter().map(|row| row.nonfinite).sum();
        println!(
            "{} rows, {nonfinite} results not finite, {:.1} s",
            rows.len(),
            start.elapsed().as_secs_f64()
        );
    }
    Ok(())
}

fn write_csv(output: &mut OutputFile, rows: &[Row]) -> Result<(), csv::Error> {
    let mut writer = csv::Writer::from_writer(output.file());
    rows.iter().try_for_each(|row| writer.serialize(row))?;
    Ok(writer.flush()?)
}

fn rows(effort: &Effort) -> Result<Vec<Row>, Error> {
    let networks = BUILTIN.iter().map(|&(name, _)| TransformArg::Builtin(name));
    let methods = METHODS.iter().map(|&name| TransformArg::Method(name));
    let methods = [TransformArg::None]
        .into_iter()
        .chain(methods)
        .chain(networks)
        .map(|transform| Method::named(transform, BackendArg::Cpu, "", 0))
        .collect::<Result<Vec<_>, _>>()?;

    let sample = cost_sample(effort.cost_lanes);
    let costs = methods
        .iter()
        .map(|method| nanoseconds_per_lane(method, &sample.batch))
        .collect::<Result<Vec<_>, _>>()?;
    let mut rows = Vec::new();
    for regime in REGIMES {
        let far = effort.far.filter(|_| regime.far);
        let counts = effort.sample_counts.iter().map(|&n| (n, effort.runs)).chain(far);
        for (n, runs) in counts {
            let case = (regime.make)(n, runs);
            for (method, nanoseconds) in methods.iter().zip(&costs) {
                rows.push(measure(method, regime, n, &case, *nanoseconds)?);
            }
        }
    }
    Ok(rows)
}

fn measure(
    method: &Method,
    regime: &Regime,
    n: u32,
    case: &Case,
    nanoseconds: f64,
) -> Result<Row, Error> {
    let mut estimates = Estimates::default();
    method.transform.apply(&case.batch, &mut estimates)?;
    let (mut t, mut s) = (Errors::default(), Errors::default());
    let mut nonfinite = 0;
    let pairs = estimates.values().iter().zip(case.batch.last());
    for ((&value, &last), limit) in pairs.zip(&case.limits) {
        if !last.is_finite() {
            continue;
        }
        nonfinite += usize::from(!value.is_finite());
        t.add(f64::from(value) - limit);
        s.add(f64::from(last) - limit);
    }
    let lanes = case.limits.len() as f64;
    Ok(Row {
        method: method.name.clone(),
        regime: regime.name,
        n,
        mse_ratio: ratio(t.squares, s.squares),
        fallback_share: estimates.fallen_back() as f64 / lanes,
        worst_ratio: ratio(t.worst, s.worst),
        nonfinite,
        mse: t.squares / t.count,
        bias2_ratio: ratio(t.sum * t.sum / t.count, s.squares),
        constant_share: estimates.count(Status::Constant) as f64 / lanes,
        nanoseconds_per_lane: nanoseconds,
        lane_terms_per_second: terms_read(method) as f64 / (1e-9 * nanoseconds),
    })
}

/// Sums of errors over lanes.
#[derive(Default)]
struct Errors {
    count: f64,
    sum: f64,
    squares: f64,
    worst: f64,
}

impl Errors {
    fn add(&mut self, error: f64) {
        self.count += 1.0;
        self.sum += error;
        self.squares += error * error;
        self.worst = self.worst.max(error * error);
    }
}

/// a/b, where no error over no error is no change.
fn ratio(a: f64, b: f64) -> f64 {
    if a == b { 1.0 } else { a / b }
}

/// Numbers that a method reads per lane.
fn terms_read(method: &Method) -> usize {
    match extrapolation(&method.name) {
        Some(method) => method.terms(),
        None if ["none", "prior-mean"].contains(&method.name.as_str()) => 1,
        None if METHODS.contains(&method.name.as_str()) => 1 + FOLDS,
        None => method.transform.window(),
    }
}

/// Lanes like those of a rendering: noisy, all different.
fn cost_sample(lanes: usize) -> Case {
    simulate(&window(64), lanes, 0, |lane, _| {
        let height = 1.0 + lane as f64 / lanes as f64;
        (0.5 * height, move |_: u32, rng: &mut Rng| height * rng.uniform())
    })
}

/// The least of some times, on all threads, after one application that warms up.
fn nanoseconds_per_lane(method: &Method, batch: &SequenceBatch) -> Result<f64, Error> {
    const REPEATS: usize = 5;
    let mut estimates = Estimates::default();
    let mut least = f64::INFINITY;
    for repeat in 0..=REPEATS {
        let start = Instant::now();
        method.transform.apply(batch, &mut estimates)?;
        if repeat > 0 {
            least = least.min(start.elapsed().as_secs_f64());
        }
    }
    Ok(1e9 * least / batch.lanes() as f64)
}

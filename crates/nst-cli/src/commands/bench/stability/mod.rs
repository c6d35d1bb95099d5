//! `nst bench stability`: every method on every kind of sequence that may break it.

mod integrands;
mod markdown;
mod regimes;
mod simulate;

use std::{fmt, io::Write, time::Instant};

use nst_core::{
    Estimates, SampleMlp, SequenceBatch, Status,
    guard::{Expert, Guard},
    methods::of_single_lanes,
    random::SplitMix64,
};
use nst_files::output::{Kind, Name, OutputFile, Outputs, commit};
use serde::{Serialize, Serializer};

use crate::{
    args::{BackendArg, BenchStabilityArgs, CommonArgs, TransformArg},
    error::Error,
    method::Method,
    networks::builtin_of_samples,
};

use regimes::{REGIMES, Regime, window};
use simulate::{Case, Runs, simulate};

/// A method on the sequences of a regime with n samples. T and S are compared on
/// the lanes whose S is finite.
#[derive(Clone, Debug, Serialize)]
struct Row {
    method: String,
    regime: &'static str,
    n: u32,
    /// Σ (T − I)² / Σ (S − I)²; 1 where both sums are 0.
    #[serde(serialize_with = "rounded")]
    mse_ratio: f64,
    /// The share of lanes that have S_n because the method broke down.
    #[serde(serialize_with = "rounded")]
    fallback_share: f64,
    /// max (T − I)² / max (S − I)²; 1 where both are 0.
    #[serde(serialize_with = "rounded")]
    worst_ratio: f64,
    /// Lanes whose T is not finite although S is.
    nonfinite: usize,
    /// Mean (T − I)².
    #[serde(serialize_with = "rounded")]
    mse: f64,
    /// (Mean T − I)² / mean (S − I)², which does not average out over lanes.
    #[serde(serialize_with = "rounded")]
    bias2_ratio: f64,
    /// The share of lanes that have S_n because they are constant.
    #[serde(serialize_with = "rounded")]
    constant_share: f64,
    /// Of the method, on many lanes with all threads.
    #[serde(serialize_with = "rounded")]
    nanoseconds_per_lane: f64,
    /// The same, in terms and fold means that are read per second.
    #[serde(serialize_with = "rounded")]
    lane_terms_per_second: f64,
}

/// Four digits: further ones are noise, and people read the file, too.
fn rounded<S: Serializer>(x: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    let rounded = format!("{x:.3e}").parse();
    serializer.serialize_f64(rounded.unwrap_or(*x))
}

/// How much work to do.
struct Effort {
    sample_counts: Vec<u32>,
    /// Runs of each integrand.
    runs: usize,
    /// Where `Regime::far` asks for it: samples, and runs of each integrand.
    far: Option<(u32, usize)>,
    cost_lanes: usize,
    seed: u64,
}

impl Effort {
    fn new(short: bool, seed: u64) -> Self {
        if short {
            Self { sample_counts: vec![8, 64], runs: 20, far: None, cost_lanes: 1 << 12, seed }
        } else {
            Self {
                sample_counts: vec![8, 16, 32, 64, 256, 1024, 4096],
                runs: 1000,
                far: Some((1_000_000, 20)),
                cost_lanes: 1 << 18,
                seed,
            }
        }
    }
}

/// What was measured, in short.
#[derive(Serialize)]
pub(super) struct Report {
    rows: usize,
    nonfinite: usize,
    seconds: f64,
    files: Vec<String>,
}

pub(super) fn run(args: &BenchStabilityArgs) -> Result<Report, Error> {
    let start = Instant::now();
    let mut outputs = Outputs::default();
    let mut csv = outputs.open(&args.output, Kind::Csv, Name::Given)?;
    let markdown = args.markdown.as_deref();
    let markdown = markdown.map(|path| outputs.open(path, Kind::Markdown, Name::Given));
    let mut markdown = markdown.transpose()?;

    let rows = rows(&Effort::new(args.short, args.seed))?;
    write_csv(&mut csv, &rows)
        .map_err(|source| Error::Csv { path: args.output.clone(), source })?;
    if let Some(file) = &mut markdown {
        let write = file.file().write_all(markdown::document(&rows).as_bytes());
        let path = file.path().to_owned();
        write.map_err(|error| Error::Csv { path, source: error.into() })?;
    }
    let files = [&csv].into_iter().chain(&markdown).map(|f| f.path().display().to_string());
    let report = Report {
        rows: rows.len(),
        nonfinite: rows.iter().map(|row| row.nonfinite).sum(),
        seconds: start.elapsed().as_secs_f64(),
        files: files.collect(),
    };
    commit([csv].into_iter().chain(markdown))?;
    Ok(report)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rows, nonfinite, seconds, .. } = self;
        writeln!(f, "{rows} rows, {nonfinite} results not finite, {seconds:.1} s")?;
        write!(f, "wrote {}", self.files.join(", "))
    }
}

fn write_csv(output: &mut OutputFile, rows: &[Row]) -> Result<(), csv::Error> {
    let mut writer = csv::Writer::from_writer(output.file());
    rows.iter().try_for_each(|row| writer.serialize(row))?;
    Ok(writer.flush()?)
}

/// One built-in network trained on a scene, and one on integrals.
const NETWORKS: [&str; 2] = ["cornell", "families"];

/// The guard over the networks that see samples.
const GUARDED: &str = "guard-samples";

/// Those of the families of integrals.
const OF_SAMPLES: [&str; 4] =
    ["families-samples", "gaussian-samples", "step-samples", "gaussian-step-samples"];

/// The one of them whose last layer is fitted again to each batch.
const REFITTED: &str = "families-samples";

/// Regimes whose folds depend on each other, as those of this sampler do.
const NESTED: [&str; 2] = ["halton", "halton-random"];
const NESTED_SAMPLER: &str = "halton";

/// All methods of single lanes, for samples of this sampler.
fn methods(sampler: &str) -> Result<Vec<Method>, Error> {
    let networks = NETWORKS.iter().map(|&name| TransformArg::Builtin(name));
    let methods = of_single_lanes().filter_map(TransformArg::named);
    let methods = [TransformArg::None].into_iter().chain(methods).chain(networks);
    let method = |transform| match transform {
        TransformArg::Auto => {
            Method::auto(&[], None, sampler, BackendArg::Cpu, &CommonArgs::default())
        }
        other => Method::named(other, BackendArg::Cpu),
    };
    methods.map(method).chain([guarded(sampler)]).collect()
}

fn guarded(sampler: &str) -> Result<Method, Error> {
    let expert = |name: &'static str| -> Result<Box<dyn Expert>, Error> {
        let mlp = SampleMlp::new(name, builtin_of_samples(name)?);
        Ok(Box::new(if name == REFITTED { mlp.with_refit() } else { mlp }))
    };
    let auto = Method::auto(&[], None, sampler, BackendArg::Cpu, &CommonArgs::default())?;
    let name = GUARDED.to_owned();
    if sampler == NESTED_SAMPLER {
        return Ok(Method { name, ..auto });
    }
    let experts = OF_SAMPLES.into_iter().map(expert).collect::<Result<_, _>>()?;
    Ok(Method { name, transform: Box::new(Guard::new(experts)?), ..auto })
}

fn rows(effort: &Effort) -> Result<Vec<Row>, Error> {
    let [independent, nested] = [methods("")?, methods(NESTED_SAMPLER)?];
    let sample = cost_sample(effort.cost_lanes);
    let costs = independent
        .iter()
        .map(|method| nanoseconds_per_lane(method, &sample.batch))
        .collect::<Result<Vec<_>, _>>()?;
    let mut rows = Vec::new();
    for regime in REGIMES {
        let methods = if NESTED.contains(&regime.name) { &nested } else { &independent };
        let far = effort.far.filter(|_| regime.far);
        let counts = effort.sample_counts.iter().map(|&n| (n, effort.runs)).chain(far);
        for (n, each) in counts {
            let case = (regime.make)(n, Runs { each, seed: effort.seed });
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
    method.transform.transform(&case.batch, &mut estimates)?;
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
        lane_terms_per_second: method.transform.requires().numbers_per_lane() as f64
            / (1e-9 * nanoseconds),
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

/// a/b, and 1 for 0/0: no error before and after is no change.
fn ratio(a: f64, b: f64) -> f64 {
    if a == b { 1.0 } else { a / b }
}

/// Lanes like those of a rendering: noisy, all different.
fn cost_sample(lanes: usize) -> Case {
    simulate(&window(64), lanes, 0, |lane, _| {
        let height = 1.0 + lane as f64 / lanes as f64;
        (0.5 * height, move |_: u32, rng: &mut SplitMix64| height * rng.uniform())
    })
}

/// The shortest of five applications on all threads, after one that is not counted.
fn nanoseconds_per_lane(method: &Method, batch: &SequenceBatch) -> Result<f64, Error> {
    const REPEATS: usize = 5;
    let mut estimates = Estimates::default();
    let mut least = f64::INFINITY;
    for repeat in 0..=REPEATS {
        let start = Instant::now();
        method.transform.transform(batch, &mut estimates)?;
        if repeat > 0 {
            least = least.min(start.elapsed().as_secs_f64());
        }
    }
    Ok(1e9 * least / batch.lanes() as f64)
}

#[cfg(test)]
mod tests {
    use nst_core::{Fitted, Requirements, Strips, Transform as _};

    use super::*;

    fn short() -> Vec<Row> {
        rows(&Effort::new(true, 0)).expect("built-in methods")
    }

    #[test]
    fn no_result_is_not_finite_without_need() {
        let rows = short();
        let methods = 2 + of_single_lanes().count() + NETWORKS.len();
        assert_eq!(rows.len(), REGIMES.len() * 2 * methods);
        assert!(rows.iter().all(|row| row.nonfinite == 0));
        assert!(rows.iter().filter(|row| row.method == "none").all(|row| row.mse_ratio == 1.0));
        let names: std::collections::BTreeSet<_> = REGIMES.iter().map(|r| r.name).collect();
        assert_eq!(names.len(), REGIMES.len());
    }

    #[test]
    fn each_seed_is_another_draw_of_what_is_random() {
        let draw = |name: &str, seed: u64| {
            let regime = REGIMES.iter().find(|it| it.name == name).expect("a regime");
            (regime.make)(8, Runs { each: 2, seed }).batch.last().to_vec()
        };
        for name in ["gaussian", "gaussian-step", "pareto", "powers", "correlated", "halton-random"]
        {
            assert_eq!(draw(name, 1), draw(name, 1));
            let of_seeds = [0, 1, u64::MAX].map(|seed| draw(name, seed));
            assert!(of_seeds[0] != of_seeds[1] && of_seeds[1] != of_seeds[2], "{name}");
        }
        for name in ["linear", "halton"] {
            assert_eq!(draw(name, 0), draw(name, 1), "{name}");
        }
    }

    /// What textbooks promise (Weniger 1989) with these eight terms: bounds on
    /// √(MSE ratio) = |T − I|/|S − I|. A gain ends at f32's rounding of S, 6e-8, times
    /// what the method magnifies it by, over |S_8 − I|: 4.3, 0.06, 0.12, 2.8e-5.
    #[test]
    fn textbook_gains() {
        let rows = short();
        let error = |regime: &str, method: &str| {
            let wanted = |row: &&Row| row.n == 8 && row.regime == regime && row.method == method;
            rows.iter().find(wanted).expect("all pairs are measured").mse_ratio.sqrt()
        };
        let gains = [
            // One geometric remainder is removed whole.
            ("linear", "aitken", 1e-4),
            ("linear", "aitken-iterated", 1e-4),
            ("linear", "brezinski-theta", 1e-4),
            ("linear", "wynn-epsilon", 1e-4),
            // Δ² of a remainder (−1)^n/(2n) leaves a part of 1/(4 n²) of it.
            ("alternating", "aitken", 1.0 / 128.0),
            ("alternating", "wynn-epsilon", 1e-4),
            ("alternating", "levin-u", 1e-6),
            ("alternating", "brezinski-theta", 1e-4),
            // Seven halvings.
            ("alternating", "euler", 1.0 / 128.0),
            // a_n g_n removes 1/n and leaves 1/(2 n²), Richardson n^{-4}.
            ("logarithmic", "an-gn", 1.0 / 12.0),
            ("logarithmic", "richardson", 1e-3),
            ("logarithmic", "levin-u", 1e-2),
            ("logarithmic", "brezinski-theta", 1e-2),
            ("hyperlinear", "levin-u", 1e-2),
        ];
        for (regime, method, bound) in gains {
            let error = error(regime, method);
            assert!(error < bound, "{regime}, {method}: {error}");
        }
        // Δ² halves a remainder 1/n in the limit, no more; ε gains little either.
        assert!((0.4..0.7).contains(&error("logarithmic", "aitken")));
        assert!(error("logarithmic", "wynn-epsilon") > 0.2);
        // Euler goes back in time, and Richardson sees powers of 1/n everywhere.
        assert!(error("linear", "euler") > 1.0 && error("hyperlinear", "richardson") > 1.0);
    }

    #[test]
    fn a_ratio_of_nothing_is_one() {
        assert_eq!((ratio(0.0, 0.0), ratio(1.0, 0.0), ratio(1.0, 4.0)), (1.0, f64::INFINITY, 0.25));
    }

    /// Says that all is well, and returns 5, NaN, 2, 2, ….
    struct Bad;

    impl nst_core::Transform for Bad {
        fn requires(&self) -> Requirements {
            Requirements::of_lane(1)
        }

        fn fit(&self, _: &mut dyn Strips) -> Result<Box<dyn Fitted + '_>, nst_core::Error> {
            Ok(Box::new(self))
        }
    }

    impl Fitted for Bad {
        fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), nst_core::Error> {
            let value = |(_, lane)| [2.0, 5.0, f32::NAN][if lane < 2 { lane + 1 } else { 0 }];
            let terms = ndarray::Array2::from_shape_fn((1, batch.lanes()), value);
            nst_core::Identity.transform(&SequenceBatch::new(terms, vec![1])?, out)
        }
    }

    #[test]
    fn the_measures_see_errors_bias_and_outliers() -> Result<(), Error> {
        let method = Method { transform: Box::new(Bad), ..named("none")? };
        // I = 0, S = 1.
        let case = simulate(&[4], 100, 0, |_, _| (0.0, |_: u32, _: &mut SplitMix64| 1.0));
        let row = measure(&method, &REGIMES[0], 4, &case, 1.0)?;
        assert_eq!((row.nonfinite, row.worst_ratio), (1, 25.0));
        assert!(row.mse_ratio.is_nan(), "a NaN must not pass unseen");
        Ok(())
    }

    fn named(name: &'static str) -> Result<Method, Error> {
        let none = name == "none";
        let transform = if none { TransformArg::None } else { TransformArg::Method(name) };
        Method::named(transform, BackendArg::Cpu)
    }

    #[test]
    fn numbers_that_methods_read() -> Result<(), Error> {
        let read = [("none", 1), ("prior-mean", 1), ("levin-u", 8), ("aitken", 3), ("ridge", 5)];
        for (name, numbers) in read {
            let requirements = named(name)?.transform.requires();
            assert_eq!(requirements.numbers_per_lane(), numbers, "{name}");
        }
        Ok(())
    }
}

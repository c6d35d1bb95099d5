//! Networks that see samples: PyTorch, CPU and WGSL agree on the same weights and samples.

use std::{fs, path::PathBuf};

use nst_core::{
    Error, FOLDS, Power, SampleMlp, SampleNetwork, SequenceBatch, Side, fold_count,
    guard::{Expert, Seen},
};
use nst_tests::gpu;
use safetensors::{Dtype, SafeTensors};

/// Relative to |S| + u, of which inputs and outputs in f32 are within some 10⁻⁷.
const TOLERANCE: f64 = 1e-6;

/// The fold that the fixtures' second output does not see.
const LEFT_OUT: usize = 1;

/// A network, and what PyTorch makes of the samples of some lanes.
struct Fixture {
    name: String,
    network: SampleNetwork,
    lanes: usize,
    /// `[sample][lane]`
    samples: Vec<f32>,
    /// T of all samples, and without a fold, `[lane]`.
    outputs: [Vec<f64>; 2],
    units: [f64; 2],
}

impl Fixture {
    fn all() -> Vec<Self> {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("data/sample-fixtures");
        let files = fs::read_dir(folder).expect("fixtures are part of the repository");
        let paths = files.map(|entry| entry.expect("a readable folder").path());
        let networks = paths.filter(|path| !path.to_string_lossy().ends_with(".io.safetensors"));
        let fixtures: Vec<_> = networks.map(|path| Self::read(&path)).collect();
        assert!(fixtures.len() >= 4, "{} fixtures", fixtures.len());
        fixtures
    }

    fn read(path: &std::path::Path) -> Self {
        let network = SampleNetwork::read(path).expect("PyTorch's export is readable");
        let bytes = fs::read(path.with_extension("io.safetensors")).expect("samples and outputs");
        let io = SafeTensors::deserialize(&bytes).expect("a safetensors file");
        let numbers = |name| numbers(&io, name);
        Self {
            name: path.display().to_string(),
            network,
            lanes: io.tensor("samples").expect("samples").shape()[1],
            samples: numbers("samples").into_iter().map(|y| y as f32).collect(),
            outputs: [numbers("output_f64"), numbers("part_output_f64")],
            units: [numbers("unit")[0], numbers("part_unit")[0]],
        }
    }

    fn batch(&self, factor: f32) -> SequenceBatch {
        let samples: Vec<f32> = self.samples.iter().map(|y| factor * y).collect();
        let powers = &self.network.form().powers;
        SequenceBatch::from_samples_with(self.lanes, &samples, powers).expect("samples")
    }

    /// The network on every processor there is.
    fn experts(&self) -> Vec<SampleMlp> {
        let mut experts = vec![SampleMlp::new("CPU", self.network.clone())];
        experts.extend(gpu().map(|gpu| {
            SampleMlp::on_gpu("GPU", self.network.clone(), gpu).expect("it runs this network")
        }));
        experts
    }
}

fn numbers(io: &SafeTensors<'_>, name: &str) -> Vec<f64> {
    let tensor = io.tensor(name).expect("the fixture has this tensor");
    let data = tensor.data();
    match tensor.dtype() {
        Dtype::F32 => data.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b).into()).collect(),
        Dtype::F64 => data.as_chunks().0.iter().map(|&b| f64::from_le_bytes(b)).collect(),
        other => panic!("{name} is {other:?}"),
    }
}

/// Means over the folds of a batch but one, `[lane]`.
#[derive(Clone)]
struct Means {
    samples: f64,
    unit: f64,
    mean: Vec<f32>,
    root: Vec<f32>,
    square: Vec<f32>,
    further: Vec<(Power, Vec<f32>)>,
}

impl Means {
    fn of(batch: &SequenceBatch, left_out: Option<usize>, powers: &[Power]) -> Self {
        let n = *batch.sample_counts().last().expect("a term");
        let folds = (0..FOLDS).filter(|&fold| Some(fold) != left_out);
        let samples: f64 = folds.clone().map(|fold| fold_count(fold, n)).sum();
        let side = |sides: &[Side; FOLDS], power: Option<Power>| -> Vec<f32> {
            let mean = |lane: usize| {
                let of_fold = |fold: usize| {
                    let mean = f64::from(batch.side(&sides[fold]).expect("a mean")[lane]);
                    fold_count(fold, n) / samples * power.map_or(mean, |power| power.of(mean))
                };
                let mean = folds.clone().map(of_fold).sum();
                power.map_or(mean, |power| power.mean_of(mean)) as f32
            };
            (0..batch.lanes()).map(mean).collect()
        };
        let [mean, root, square] = Side::OF_FOLDS.map(|sides| side(sides, None));
        let further = powers.iter().filter(|power| !power.is_usual());
        let further =
            further.map(|&power| (power, side(&Side::power_means(power), Some(power)))).collect();
        let unit = mean.iter().map(|&x| f64::from(x.abs())).sum::<f64>() / mean.len() as f64;
        Self { samples, unit, mean, root, square, further }
    }

    fn seen(&self) -> Seen<'_> {
        let Self { samples, unit, mean, root, square, further } = self;
        Seen { samples: *samples, unit: *unit, mean, root, square, further }
    }

    /// Some lanes of the same batch.
    fn part(&self, lanes: std::ops::Range<usize>) -> Self {
        let part = |values: &[f32]| values[lanes.clone()].to_vec();
        let further = self.further.iter().map(|(power, means)| (*power, part(means))).collect();
        let [mean, root, square] = [&self.mean, &self.root, &self.square].map(|it| part(it));
        Self { mean, root, square, further, ..*self }
    }
}

fn estimate_of(expert: &SampleMlp, means: &Means) -> Vec<f32> {
    let mut out = vec![f32::NAN; means.mean.len()];
    expert.estimate(&means.seen(), &mut out).expect("it has all means");
    out
}

/// The largest error relative to |S| + u.
fn worst_error(values: &[f32], expected: &[f64], means: &Means) -> f64 {
    let of_lane = |lane: usize| {
        let plain = means.mean[lane];
        let error = (f64::from(values[lane]) - expected[lane]).abs();
        if error.is_nan() { f64::INFINITY } else { error / (f64::from(plain.abs()) + means.unit) }
    };
    (0..values.len()).map(of_lane).fold(0.0, f64::max)
}

#[test]
fn pytorch_fixtures() {
    for fixture in Fixture::all() {
        let batch = fixture.batch(1.0);
        for (i, left_out) in [None, Some(LEFT_OUT)].into_iter().enumerate() {
            let means = Means::of(&batch, left_out, &fixture.network.form().powers);
            assert!((means.unit / fixture.units[i] - 1.0).abs() < 1e-6, "{}", fixture.name);
            for expert in fixture.experts() {
                let values = estimate_of(&expert, &means);
                let error = worst_error(&values, &fixture.outputs[i], &means);
                let name = format!("{}, {}, {left_out:?}", expert.name(), fixture.name);
                assert!(error <= TOLERANCE, "{name}: {error:e}");
                // What must not be taken for right: one wrong lane, and the other output.
                let mut wrong = values.clone();
                wrong[7] *= 1.01;
                assert!(worst_error(&wrong, &fixture.outputs[i], &means) > TOLERANCE, "{name}");
                let other = worst_error(&values, &fixture.outputs[1 - i], &means);
                assert!(other > TOLERANCE, "{name}: {other:e} of what sees other samples");
            }
        }
    }
}

/// T(aS) = a T(S): the same bits if a is a power of two.
#[test]
fn estimates_have_the_unit_of_the_samples() {
    for fixture in Fixture::all() {
        let means =
            |factor| Means::of(&fixture.batch(factor), None, &fixture.network.form().powers);
        for expert in fixture.experts() {
            let (plain, values) = (means(1.0), estimate_of(&expert, &means(1.0)));
            for factor in [0.25, 4.0, 1048576.0] {
                let scaled: Vec<f32> = values.iter().map(|value| factor * value).collect();
                assert_eq!(estimate_of(&expert, &means(factor)), scaled, "{}", fixture.name);
            }
            let scaled = estimate_of(&expert, &means(1000.0));
            let scaled: Vec<f32> = scaled.iter().map(|value| value / 1000.0).collect();
            let values: Vec<f64> = values.into_iter().map(f64::from).collect();
            let error = worst_error(&scaled, &values, &plain);
            assert!(error <= TOLERANCE, "{}: {error:e}", fixture.name);
        }
    }
}

/// With its own coefficients, the features of a network are its change.
#[test]
fn features_are_those_of_the_last_layer() {
    for fixture in Fixture::all() {
        let means = Means::of(&fixture.batch(1.0), None, &fixture.network.form().powers);
        for expert in fixture.experts() {
            assert!(expert.adapts().is_none(), "unless it is asked to");
            let expert = expert.with_refit();
            let of = expert.adapts().expect("it was asked to");
            let coefficients = of.coefficients();
            let mut features = vec![f32::NAN; fixture.lanes * coefficients.len()];
            of.features(&means.seen(), &mut features).expect("it has all means");
            let estimate = |(row, plain): (&[f32], &f32)| {
                let products = row.iter().zip(coefficients).map(|(x, c)| f64::from(x * c));
                f64::from(*plain) + products.sum::<f64>()
            };
            let rows = features.chunks_exact(coefficients.len()).zip(&means.mean);
            let by_features: Vec<f64> = rows.map(estimate).collect();
            let error = worst_error(&estimate_of(&expert, &means), &by_features, &means);
            assert!(error <= TOLERANCE, "{}, {}: {error:e}", expert.name(), fixture.name);
        }
    }
}

/// No bit depends on the lanes beside a lane.
#[test]
fn lanes_are_independent() {
    for fixture in Fixture::all() {
        let means = Means::of(&fixture.batch(1.0), None, &fixture.network.form().powers);
        for expert in fixture.experts() {
            let all = estimate_of(&expert, &means);
            for lanes in [0..1, 3..50, 37..fixture.lanes] {
                let part = estimate_of(&expert, &means.part(lanes.clone()));
                assert_eq!(part, all[lanes], "{}, {}", expert.name(), fixture.name);
            }
        }
    }
}

/// What cannot be evaluated keeps the plain estimate.
#[test]
fn lanes_that_are_not_finite_keep_s() {
    for fixture in Fixture::all() {
        let means = Means::of(&fixture.batch(1.0), None, &fixture.network.form().powers);
        let mut damaged = means.clone();
        let (nan, infinity) = (f32::NAN, f32::INFINITY);
        if fixture.network.form().powers.contains(&Power::SQUARE) {
            damaged.square[3] = infinity;
            damaged.square[4] = nan;
        } else {
            damaged.root[3] = infinity;
            damaged.root[4] = nan;
        }
        damaged.mean[5] = nan;
        for expert in fixture.experts() {
            let [before, after] = [&means, &damaged].map(|means| estimate_of(&expert, means));
            for lane in 0..fixture.lanes {
                match lane {
                    3 | 4 => assert_eq!(after[lane], means.mean[lane], "{}", fixture.name),
                    5 => assert!(after[lane].is_nan()),
                    _ => assert_eq!(after[lane], before[lane], "{}", fixture.name),
                }
            }
        }
    }
}

#[test]
fn means_that_are_not_there_are_missed() {
    let fixtures = Fixture::all();
    let fixture = fixtures.iter().find(|it| it.name.contains("integrals")).expect("a fixture");
    let mut means = Means::of(&fixture.batch(1.0), None, &fixture.network.form().powers);
    means.further.remove(1);
    let expert = SampleMlp::new("x", fixture.network.clone());
    let error = expert.estimate(&means.seen(), &mut vec![0.0; fixture.lanes]);
    assert!(matches!(&error, Err(Error::Batch(why)) if why.contains("power 0.25")), "{error:?}");
}

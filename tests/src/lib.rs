//! What the cross-crate tests are judged by: a network evaluated slowly in f64,
//! statistical comparison of images, and access to a GPU that cannot be skipped
//! unseen.

pub mod image_test;

use std::process::ExitCode;

use ndarray::{Array1, Array2, ArrayView1, ArrayView2};
use nst_core::{
    Layer, Metadata, Network,
    gpu::{AdapterKind, Gpu},
};
use nst_render::{SampleStream, Sampler, SamplerKind};

/// The exit code of a program, whose error, if any, is printed.
#[must_use]
pub fn exit_code(result: Result<(), Box<dyn std::error::Error>>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// How far f32 may be from the oracle, as [`worst_error`] measures it: rounding of sums of up
/// to 256 terms in up to five layers stays well below it.
pub const TOLERANCE: f64 = 1e-5;

/// The same, where weights are rounded to f16, to 11 bits.
pub const TOLERANCE_F16: f64 = 5e-3;

/// The adapter to test on, by the environment variable `NST_GPU`:
/// `require` (fail without one), `off` (none), `auto` (the default: use one if
/// there is one). Says on standard error what it found.
///
/// # Panics
/// If an adapter is required and there is none, or if the variable is something else.
#[must_use]
pub fn gpu() -> Option<Gpu> {
    let mode = std::env::var("NST_GPU").unwrap_or_else(|_| "auto".into());
    let gpu = match mode.as_str() {
        "off" => None,
        "auto" => Gpu::open_experimental(AdapterKind::Any).ok(),
        "require" => Some(Gpu::open_experimental(AdapterKind::Any).expect("NST_GPU=require")),
        other => panic!("NST_GPU is '{other}', not require, auto or off"),
    };
    match &gpu {
        Some(gpu) => eprintln!("GPU tests run on {}", gpu.name()),
        None => eprintln!("GPU tests are skipped: NST_GPU={mode}"),
    }
    gpu
}

/// What a lane's estimate should be, in f64.
#[derive(Clone, Copy, Debug)]
pub struct Expected {
    /// The network's output.
    pub value: f64,
    /// The sum of the magnitudes that the output layer adds up. Rounding errors
    /// are relative to it: where the terms cancel, no f32 evaluation can be
    /// close to the small rest.
    pub magnitude: f64,
}

/// The oracle: the network by its definition, lane by lane, in f64.
#[must_use]
pub fn forward_f64(network: &Network, window: ArrayView2<'_, f32>) -> Vec<Expected> {
    let (output, hidden) = network.layers().split_last().expect("a network has layers");
    let slope = f64::from(network.metadata().negative_slope);
    let affine = |layer: &Layer, x: ArrayView1<'_, f64>| {
        layer.weight.mapv(f64::from).dot(&x) + layer.bias.mapv(f64::from)
    };
    window
        .columns()
        .into_iter()
        .map(|lane| {
            let mut x = lane.mapv(f64::from);
            for layer in hidden {
                x = affine(layer, x.view()).mapv_into(|y| if y > 0.0 { y } else { slope * y });
            }
            let terms = &output.weight.row(0).mapv(f64::from) * &x;
            Expected {
                value: affine(output, x.view())[0],
                magnitude: terms.mapv(f64::abs).sum() + f64::from(output.bias[0]).abs(),
            }
        })
        .collect()
}

/// The largest error of `actual`, relative to [`Expected::magnitude`]; infinite
/// where a value is not finite.
///
/// # Panics
/// If the two differ in length.
#[must_use]
pub fn worst_error(actual: &[f32], expected: &[Expected]) -> f64 {
    assert_eq!(actual.len(), expected.len());
    actual.iter().zip(expected).fold(0.0, |worst: f64, (&actual, expected)| {
        let error = (f64::from(actual) - expected.value).abs();
        // Not `max`, which would drop a NaN.
        if error <= worst * expected.magnitude {
            worst
        } else if error.is_finite() {
            error / expected.magnitude
        } else {
            f64::INFINITY
        }
    })
}

/// Random weights of a usual size (He et al. 2015) for the given widths, window
/// first and without the output.
#[must_use]
pub fn random_network(widths: &[usize], seed: u64) -> Network {
    let mut samples = Sampler::new(SamplerKind::Random, seed).stream(0, 0);
    let ends = widths.iter().skip(1).chain(&[1]);
    let layers = widths
        .iter()
        .zip(ends)
        .map(|(&inputs, &outputs)| {
            let bound = (6.0 / inputs as f32).sqrt();
            Layer {
                weight: Array2::from_shape_simple_fn((outputs, inputs), || {
                    symmetric(&mut samples) * bound
                }),
                bias: Array1::from_shape_simple_fn(outputs, || symmetric(&mut samples)),
            }
        })
        .collect();
    let metadata = Metadata {
        window: widths[0],
        negative_slope: 0.01,
        trained_on: vec!["nothing".into()],
        samples: (8, 64),
        sampler: None,
        loss: "L2".into(),
        epochs: 0,
        seed,
        config: String::new(),
    };
    Network::new(layers, metadata).expect("the shapes chain")
}

/// Random windows `[term][lane]` whose sizes span 1e-3 to 1e3.
#[must_use]
pub fn random_window(terms: usize, lanes: usize, seed: u64) -> Array2<f32> {
    let mut samples = Sampler::new(SamplerKind::Random, seed).stream(1, 0);
    let scales: Vec<f32> =
        (0..lanes).map(|_| 10.0_f32.powf(3.0 * symmetric(&mut samples))).collect();
    Array2::from_shape_fn((terms, lanes), |(_, lane)| symmetric(&mut samples) * scales[lane])
}

fn symmetric(samples: &mut SampleStream) -> f32 {
    2.0 * samples.next_1d() - 1.0
}

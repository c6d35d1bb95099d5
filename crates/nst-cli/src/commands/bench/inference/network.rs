//! Networks and windows of any size, and the network in f64 as its definition says.

use ndarray::{Array1, Array2, ArrayView1};
use nst_core::{Layer, Metadata, Network};

use nst_core::random::SplitMix64;

/// Terms that the networks read.
const WINDOW: usize = 8;

/// Random weights of a usual size (He et al. 2015): `layers` hidden layers of `hidden` neurons.
pub(super) fn random_network(layers: usize, hidden: usize) -> Network {
    let mut rng = SplitMix64::of_stream(hidden as u64, layers as u64);
    let mut symmetric = move || 2.0 * rng.uniform() as f32 - 1.0;
    let widths = [&[WINDOW][..], &vec![hidden; layers], &[1]].concat();
    let layers = widths
        .windows(2)
        .map(|pair| {
            let bound = (6.0 / pair[0] as f32).sqrt();
            Layer {
                weight: Array2::from_shape_simple_fn((pair[1], pair[0]), || bound * symmetric()),
                bias: Array1::from_shape_simple_fn(pair[1], &mut symmetric),
            }
        })
        .collect();
    let metadata = Metadata {
        window: WINDOW,
        negative_slope: 0.01,
        trained_on: vec!["nothing".to_owned()],
        samples: (8, 64),
        sampler: None,
        loss: "L2".to_owned(),
        epochs: 0,
        seed: 0,
        config: String::new(),
    };
    Network::new(layers, metadata).expect("the shapes chain")
}

/// Random windows `[term][lane]` on [0, 1).
pub(super) fn random_window(terms: usize, lanes: usize) -> Array2<f32> {
    let mut rng = SplitMix64::of_stream(1, lanes as u64);
    Array2::from_shape_simple_fn((terms, lanes), || rng.uniform() as f32)
}

/// How far `value` is from the network's output in f64, relative to the sum of the
/// magnitudes that the output layer adds up; infinite if it is not finite.
pub(super) fn worst_error(network: &Network, lane: ArrayView1<'_, f32>, value: f32) -> f64 {
    let (output, hidden) = network.layers().split_last().expect("a network has layers");
    let slope = f64::from(network.metadata().negative_slope);
    let mut x = lane.mapv(f64::from);
    for layer in hidden {
        let y = layer.weight.mapv(f64::from).dot(&x) + layer.bias.mapv(f64::from);
        x = y.mapv(|y| if y > 0.0 { y } else { slope * y });
    }
    let bias = f64::from(output.bias[0]);
    let terms = &output.weight.row(0).mapv(f64::from) * &x;
    let error = (f64::from(value) - terms.sum() - bias).abs();
    if error.is_finite() {
        error / (terms.mapv(f64::abs).sum() + bias.abs())
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use nst_core::{Estimates, MlpCpu, SequenceBatch, Transform};

    use super::*;

    /// The comparison must see a value that is a little off, and one that was not written.
    #[test]
    fn wrong_values_are_found() {
        let network = random_network(2, 16);
        let window = random_window(WINDOW, 3);
        let batch = SequenceBatch::new(window.clone(), (1..=8).collect()).expect("a batch");
        let mut estimates = Estimates::default();
        MlpCpu::new(network.clone()).transform(&batch, &mut estimates).expect("the CPU works");
        let value = estimates.values()[1];
        assert!(worst_error(&network, window.column(1), value) < 1e-6);
        assert!(worst_error(&network, window.column(2), value) > 1e-4);
        assert!(worst_error(&network, window.column(1), f32::NAN).is_infinite());
    }
}

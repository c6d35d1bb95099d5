//! The network on the CPU: tiles of lanes, one matrix product per layer.
//!
//! The WGSL twin is `gpu/mlp.wgsl`; both compute, for layers i = 0 … L−1,
//! `a ← leaky_relu(W_i a + b_i)`, without the activation after the last one.

use std::sync::Arc;

use gemm::Parallelism;
use ndarray::ArrayView2;
use rayon::prelude::*;

use crate::{Error, Estimates, Layer, Network, SequenceBatch, Status, Transform};

/// Lanes per tile: the activations of a 256-wide layer (256 KiB) stay in the L2 cache.
const TILE: usize = 256;

/// Evaluates a [`Network`] with rayon and the CPU's vector units.
#[derive(Clone, Debug)]
pub struct MlpCpu {
    network: Arc<Network>,
}

impl MlpCpu {
    /// A transformation by the given network.
    #[must_use]
    pub fn new(network: impl Into<Arc<Network>>) -> Self {
        Self { network: network.into() }
    }
}

impl Transform for MlpCpu {
    fn window(&self) -> usize {
        self.network.metadata().window
    }

    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let Some(window) = batch.window(self.window()) else {
            out.fall_back(batch, Status::TooShort);
            return Ok(());
        };
        let mut raw = vec![0.0; batch.lanes()];
        raw.par_chunks_mut(TILE).enumerate().for_each_init(
            || Workspace::new(&self.network),
            |workspace, (tile, out)| {
                let first = tile * TILE;
                forward(&self.network, window, first, workspace, out);
            },
        );
        out.accept(window, raw);
        Ok(())
    }
}

/// Two activation buffers `[neuron][lane of tile]`, used in turn.
struct Workspace {
    front: Vec<f32>,
    back: Vec<f32>,
}

impl Workspace {
    fn new(network: &Network) -> Self {
        let widest = network.layers().iter().map(Layer::outputs).max().unwrap_or(0);
        Self { front: vec![0.0; widest * TILE], back: vec![0.0; widest * TILE] }
    }
}

/// Evaluates the network on lanes `first .. first + out.len()` of the window `[term][lane]`.
fn forward(
    network: &Network,
    window: ArrayView2<'_, f32>,
    first: usize,
    workspace: &mut Workspace,
    out: &mut [f32],
) {
    let Workspace { front, back } = workspace;
    let (hidden, output) = network.layers().split_at(network.layers().len() - 1);
    let slope = network.metadata().negative_slope;
    let count = out.len();

    // The first layer reads the window in place: a row per term, lanes apart by one.
    let stride = window.ncols();
    let window = window.to_slice().expect("a window is a run of whole rows");
    let mut input = (&window[first..], stride);
    for layer in hidden {
        multiply(layer, input.0, input.1, front, count);
        activate(layer, slope, front, count);
        std::mem::swap(front, back);
        input = (back.as_slice(), TILE);
    }
    multiply(&output[0], input.0, input.1, front, count);
    let bias = output[0].bias[0];
    for (out, value) in out.iter_mut().zip(front.iter()) {
        *out = value + bias;
    }
}

/// `out[neuron][lane] = Σ_k weight[neuron][k] · input[k][lane]`; rows of `input`
/// are `stride` apart, rows of `out` are `TILE` apart.
fn multiply(layer: &Layer, input: &[f32], stride: usize, out: &mut [f32], count: usize) {
    let (outputs, inputs) = (layer.outputs(), layer.inputs());
    let weight = layer.weight.as_slice().expect("layers are stored in standard layout");
    assert!(count > 0 && count <= TILE && out.len() >= (outputs - 1) * TILE + count);
    assert!(input.len() >= (inputs - 1) * stride + count);
    #[allow(unsafe_code)]
    // SAFETY: the assertions above bound every index that the strides can reach
    // in `out` and `input`; `weight` is [outputs, inputs]; `out` is borrowed
    // exclusively, so it overlaps neither.
    unsafe {
        gemm::gemm(
            outputs,
            count,
            inputs,
            out.as_mut_ptr(),
            1,
            TILE as isize,
            false,
            weight.as_ptr(),
            1,
            inputs as isize,
            input.as_ptr(),
            1,
            stride as isize,
            0.0,
            1.0,
            false,
            false,
            false,
            Parallelism::None,
        );
    }
}

/// Adds the bias and applies the leaky ReLU, in place.
fn activate(layer: &Layer, slope: f32, values: &mut [f32], count: usize) {
    for (row, &bias) in values.chunks_mut(TILE).zip(&layer.bias) {
        for value in &mut row[..count] {
            let x = *value + bias;
            *value = if x > 0.0 { x } else { slope * x };
        }
    }
}

//! What the CPU can do at most: a matrix product of the widest layer's size.

use gemm::Parallelism;
use rayon::prelude::*;

/// Inputs and outputs of the layer.
pub(crate) const SIZE: usize = 256;

/// Lanes per product: its operands and its result stay in the cache.
const TILE: usize = 256;

/// `[SIZE, SIZE] · [SIZE, lanes]` by the crate `gemm`, tiles of lanes side by side.
pub(crate) struct Product {
    weights: Vec<f32>,
    /// Per tile, `[SIZE][TILE]`.
    inputs: Vec<f32>,
    outputs: Vec<f32>,
}

impl Product {
    /// For about this number of lanes, at least a tile per thread.
    pub(crate) fn new(lanes: usize) -> Self {
        let tiles = lanes.div_ceil(TILE).clamp(rayon::current_num_threads(), 64);
        Self {
            weights: vec![1.0 / SIZE as f32; SIZE * SIZE],
            inputs: vec![0.5; tiles * SIZE * TILE],
            outputs: vec![0.0; tiles * SIZE * TILE],
        }
    }

    pub(crate) fn lanes(&self) -> usize {
        self.outputs.len() / SIZE
    }

    /// Multiplications and additions of [`Self::multiply`].
    pub(crate) fn flops(&self) -> f64 {
        (2 * SIZE * SIZE * self.lanes()) as f64
    }

    /// Computes it once.
    pub(crate) fn multiply(&mut self) {
        let weights = &self.weights;
        self.outputs
            .par_chunks_mut(SIZE * TILE)
            .zip(self.inputs.par_chunks(SIZE * TILE))
            .for_each(|(output, input)| multiply(weights, input, output));
        assert!((self.outputs[0] - 0.5).abs() < 1e-5, "the product is {}", self.outputs[0]);
    }
}

fn multiply(weights: &[f32], input: &[f32], output: &mut [f32]) {
    assert!(weights.len() == SIZE * SIZE && input.len() == SIZE * TILE);
    assert_eq!(output.len(), input.len());
    #[allow(unsafe_code)]
    // SAFETY: the assertions bound what the strides reach; `output` is borrowed
    // exclusively, so it overlaps neither.
    unsafe {
        gemm::gemm(
            SIZE,
            TILE,
            SIZE,
            output.as_mut_ptr(),
            1,
            TILE as isize,
            false,
            weights.as_ptr(),
            1,
            SIZE as isize,
            input.as_ptr(),
            1,
            TILE as isize,
            0.0,
            1.0,
            false,
            false,
            false,
            Parallelism::None,
        );
    }
}

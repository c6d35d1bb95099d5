//! The whole network on a tile of lanes, for any [`Vector`].
//!
//! A tile is cut into panels of [`COLUMNS`] vectors of lanes; the activations of a
//! panel are `[neuron][lane of panel]`. The kernel keeps [`ROWS`] neurons × one panel
//! of sums in registers; they start as the biases and end in the leaky ReLU, so that
//! each activation is written once. A lane's sums are added in the order of the
//! inputs, whatever its place in the tile.

use std::slice;

use crate::Network;
use crate::vector::Vector;

/// Neurons of a layer that are computed together. It divides the usual widths.
const ROWS: usize = 4;

/// Vectors of lanes in a panel. Eight sums hide the latency of a multiplication and
/// addition (4 cycles, two begun in each); twelve would leave too few registers for
/// the rest, as x86-64 has sixteen.
const COLUMNS: usize = 2;

/// Lanes per panel.
pub(super) const fn panel<V: Vector>() -> usize {
    COLUMNS * V::LANES
}

/// A cache line of numbers: the widest vector, and how tiles are aligned.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Line([f32; 16]);

/// The weights in the order in which the kernel reads them: per layer and block of
/// [`ROWS`] neurons `[1 + input][neuron of block]`, the biases first.
#[derive(Clone, Debug)]
pub(super) struct Packed {
    layers: Vec<PackedLayer>,
    /// Those of the output layer, whose one neuron is a block of its own.
    output: Vec<f32>,
    /// Of the leaky ReLU.
    slope: f32,
}

#[derive(Clone, Debug)]
struct PackedLayer {
    inputs: usize,
    blocks: usize,
    weights: Vec<f32>,
}

impl Packed {
    pub(super) fn new(network: &Network) -> Self {
        let (output, hidden) = network.layers().split_last().expect("a network has layers");
        let layers = hidden.iter().map(|layer| {
            let blocks = layer.outputs().div_ceil(ROWS);
            let mut weights = Vec::with_capacity(blocks * ROWS * (1 + layer.inputs()));
            for block in 0..blocks {
                // Neurons that only fill up the last block stay 0.
                let neurons = ROWS * block..ROWS * (block + 1);
                weights.extend(neurons.clone().map(|n| layer.bias.get(n).unwrap_or(&0.0)));
                for k in 0..layer.inputs() {
                    weights
                        .extend(neurons.clone().map(|n| layer.weight.get((n, k)).unwrap_or(&0.0)));
                }
            }
            PackedLayer { inputs: layer.inputs(), blocks, weights }
        });
        Self {
            layers: layers.collect(),
            output: output.bias.iter().chain(&output.weight).copied().collect(),
            slope: network.metadata().negative_slope,
        }
    }

    /// The neurons of the last hidden layer, with those that fill up its last block.
    pub(super) fn last_width(&self, window: usize) -> usize {
        self.layers.last().map_or(window, |layer| layer.blocks * ROWS)
    }

    /// Values per lane that a buffer must hold.
    fn widest(&self, window: usize) -> usize {
        self.layers.iter().map(|layer| layer.blocks * ROWS).fold(window, usize::max)
    }
}

/// The activations of a tile, reused from tile to tile.
pub(super) struct Tile {
    front: Vec<Line>,
    back: Vec<Line>,
}

impl Tile {
    /// Room for `lanes` lanes, a multiple of the kernel's panel.
    pub(super) fn new(packed: &Packed, window: usize, lanes: usize) -> Self {
        let lines = (packed.widest(window) * lanes).div_ceil(16);
        Self { front: vec![Line([0.0; 16]); lines], back: vec![Line([0.0; 16]); lines] }
    }

    /// The inputs, `[panel][term][lane of panel]`.
    pub(super) fn input(&mut self) -> &mut [f32] {
        numbers_mut(&mut self.front)
    }

    /// The activations of the last hidden layer, as [`evaluate`] leaves them:
    /// `[panel][neuron][lane of panel]`, with [`Packed::last_width`] neurons.
    pub(super) fn hidden(&self) -> &[f32] {
        numbers(&self.front)
    }

    /// The outputs, `[lane]`, as [`evaluate`] leaves them.
    pub(super) fn output(&self) -> &[f32] {
        numbers(&self.back)
    }
}

fn numbers(lines: &[Line]) -> &[f32] {
    #[allow(unsafe_code)]
    // SAFETY: a `Line` is sixteen numbers and nothing else.
    unsafe {
        slice::from_raw_parts(lines.as_ptr().cast(), 16 * lines.len())
    }
}

fn numbers_mut(lines: &mut [Line]) -> &mut [f32] {
    #[allow(unsafe_code)]
    // SAFETY: the same.
    unsafe {
        slice::from_raw_parts_mut(lines.as_mut_ptr().cast(), 16 * lines.len())
    }
}

/// Evaluates the network on the first `panels` panels of `tile`.
///
/// # Safety
/// The processor has the instructions of `V`.
#[allow(unsafe_code)]
#[inline(always)]
pub(super) unsafe fn evaluate<V: Vector>(
    packed: &Packed,
    window: usize,
    tile: &mut Tile,
    panels: usize,
) {
    let lanes = panel::<V>();
    let Tile { front, back } = tile;
    assert!(packed.widest(window) * lanes * panels <= 16 * front.len().min(back.len()));
    let mut width = window;
    for layer in &packed.layers {
        let next = layer.blocks * ROWS;
        assert!(layer.inputs <= width);
        assert_eq!(layer.weights.len(), next * (1 + layer.inputs));
        for panel in 0..panels {
            let input = numbers(front)[panel * width * lanes..].as_ptr();
            let output = numbers_mut(back)[panel * next * lanes..].as_mut_ptr();
            for (b, weights) in layer.weights.chunks_exact(ROWS * (1 + layer.inputs)).enumerate() {
                // SAFETY: the caller's promise; and the assertions keep panel `panel` of
                // both buffers, `width` and `next` rows of `lanes` lanes, inside of them;
                // rows are whole vectors, and buffers are aligned to the widest.
                unsafe {
                    let output = output.add(b * ROWS * lanes);
                    block::<V>(weights, input, packed.slope, output);
                }
            }
        }
        std::mem::swap(front, back);
        width = next;
    }
    assert!(packed.output.len() <= 1 + width);
    for panel in 0..panels {
        // SAFETY: as above, with one row of output per panel.
        unsafe {
            let input = numbers(front)[panel * width * lanes..].as_ptr();
            let output = numbers_mut(back)[panel * lanes..].as_mut_ptr();
            last::<V>(&packed.output, input, output);
        }
    }
}

/// [`ROWS`] neurons of a hidden layer on one panel. `weights` are `[1 + input][ROWS]`.
///
/// # Safety
/// The processor has the instructions of `V`. `input` is valid for as many rows of `COLUMNS`
/// vectors as there are inputs, `output` for `ROWS` rows; both are aligned to vectors, and
/// they do not overlap.
#[allow(unsafe_code)]
#[inline(always)]
unsafe fn block<V: Vector>(weights: &[f32], input: *const f32, slope: f32, output: *mut f32) {
    let (weights, _) = weights.as_chunks::<ROWS>();
    // SAFETY: the caller's promise.
    let mut sums = unsafe { [[V::splat(0.0); COLUMNS]; ROWS] };
    for (sums, &bias) in sums.iter_mut().zip(&weights[0]) {
        // SAFETY: the caller's promise.
        *sums = unsafe { [V::splat(bias); COLUMNS] };
    }
    let mut add = |k: usize, weights: &[f32; ROWS]| {
        // SAFETY: the caller's promise.
        unsafe {
            let row = load::<V>(input, k);
            for (sums, &weight) in sums.iter_mut().zip(weights) {
                let weight = V::splat(weight);
                for (sum, value) in sums.iter_mut().zip(row) {
                    *sum = weight.mul_add(value, *sum);
                }
            }
        }
    };
    // Four at a time, as a loop of one would spend a fifth of its instructions on itself.
    let (fours, rest) = weights[1..].as_chunks::<4>();
    for (k, four) in fours.iter().enumerate() {
        for (i, weights) in four.iter().enumerate() {
            add(4 * k + i, weights);
        }
    }
    for (i, weights) in rest.iter().enumerate() {
        add(4 * fours.len() + i, weights);
    }
    // SAFETY: the caller's promise.
    unsafe {
        let slope_vector = V::splat(slope);
        for (r, sums) in sums.into_iter().enumerate() {
            for (c, sum) in sums.into_iter().enumerate() {
                // The leaky ReLU: which of x and slope · x is meant depends on their order alone.
                let scaled = sum.mul(slope_vector);
                let value = if slope > 1.0 { sum.min(scaled) } else { sum.max(scaled) };
                value.store(output.add((r * COLUMNS + c) * V::LANES));
            }
        }
    }
}

/// The output layer on one panel. `weights` are `[1 + input]`.
///
/// One neuron gives too few sums to keep the processor busy: those over every
/// fourth input are four sums, which meet at the end.
///
/// # Safety
/// As for [`block`], with one row of output.
#[allow(unsafe_code)]
#[inline(always)]
unsafe fn last<V: Vector>(weights: &[f32], input: *const f32, output: *mut f32) {
    let (fours, rest) = weights[1..].as_chunks::<4>();
    // SAFETY: the caller's promise.
    unsafe {
        let mut sums = [[V::splat(0.0); COLUMNS]; 4];
        sums[0] = [V::splat(weights[0]); COLUMNS];
        for (k, weights) in fours.iter().enumerate() {
            for (i, sums) in sums.iter_mut().enumerate() {
                let row = load::<V>(input, 4 * k + i);
                for (sum, value) in sums.iter_mut().zip(row) {
                    *sum = V::splat(weights[i]).mul_add(value, *sum);
                }
            }
        }
        for (i, &weight) in rest.iter().enumerate() {
            let row = load::<V>(input, 4 * fours.len() + i);
            for (sum, value) in sums[i].iter_mut().zip(row) {
                *sum = V::splat(weight).mul_add(value, *sum);
            }
        }
        for c in 0..COLUMNS {
            let sum = sums[0][c].add(sums[1][c]).add(sums[2][c].add(sums[3][c]));
            sum.store(output.add(c * V::LANES));
        }
    }
}

/// Row `k` of a panel.
///
/// # Safety
/// The processor has the instructions of `V`. The row is inside of what `input` is valid for,
/// and aligned to vectors.
#[allow(unsafe_code)]
#[inline(always)]
unsafe fn load<V: Vector>(input: *const f32, k: usize) -> [V; COLUMNS] {
    // SAFETY: the caller's promise.
    unsafe {
        let mut row = [V::splat(0.0); COLUMNS];
        for (c, vector) in row.iter_mut().enumerate() {
            *vector = V::load(input.add((k * COLUMNS + c) * V::LANES));
        }
        row
    }
}

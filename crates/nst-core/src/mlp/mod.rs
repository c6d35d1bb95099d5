//! The network on the CPU: tiles of lanes that stay in the cache from layer to layer.
//!
//! The WGSL twin is in `gpu`; both compute, for layers i = 0 … L−1,
//! `a ← leaky_relu(W_i a + b_i)`, without the activation after the last one.

mod kernel;

use std::{
    convert::Infallible,
    sync::{Arc, Mutex, PoisonError},
};

use ndarray::ArrayView2;
use rayon::prelude::*;

#[cfg(target_arch = "x86_64")]
use crate::vector::{Eight, Sixteen};
use crate::vector::{Four, Instructions, Vector};
use crate::{
    Error, Estimates, Fitted, Network, Requirements, SequenceBatch, Status, Strips, Transform,
    compact::{Compact, Selection, classify},
};
use kernel::{Packed, Tile, evaluate, panel};

/// Lanes per tile, whole panels of any vector: 64 KiB of activations for a 256-wide
/// layer, of which the half that is being read stays in the L1 cache panel by panel.
const TILE: usize = 64;

/// The least work that a thread fetches at a time, in floating-point operations: some
/// 15 µs, beside which the fetching is nothing.
const JOB: usize = 1_000_000;

/// Evaluates a [`Network`] with all threads and the CPU's vector units. A lane's bits
/// depend on neither the threads nor the lanes beside it.
#[derive(Clone, Debug)]
pub struct MlpCpu {
    network: Arc<Network>,
    packed: Arc<Packed>,
    instructions: Instructions,
}

impl MlpCpu {
    /// A transformation by the given network, with the best instructions there are.
    #[must_use]
    pub fn new(network: impl Into<Arc<Network>>) -> Self {
        Self::with_instructions(network, Instructions::detect())
    }

    /// A transformation by the given network, with given instructions.
    ///
    /// # Panics
    /// If the processor lacks them.
    #[must_use]
    pub fn with_instructions(network: impl Into<Arc<Network>>, instructions: Instructions) -> Self {
        assert!(
            Instructions::available().contains(&instructions),
            "this processor has no {instructions}"
        );
        let network = network.into();
        let packed = Arc::new(Packed::new(&network));
        Self { network, packed, instructions }
    }

    /// How many terms the network reads.
    fn window(&self) -> usize {
        self.network.metadata().window
    }

    /// Classifies the lanes of a job, evaluates those that the network must see, and
    /// leaves S_n in the others.
    fn run(&self, window: ArrayView2<'_, f32>, job: Job<'_>, worker: &mut Worker) {
        let Job { first, values, status } = job;
        let Worker { tile, compact } = worker;
        let ok = classify(window, first, values, status);
        let Ok(()) = compact.evaluate(window, first, ok, values, status, |selection, out| {
            self.evaluate(window, selection, tile, out);
            Ok::<_, Infallible>(())
        });
    }

    /// Evaluates the first lanes of a window `[term][lane]`, on this thread alone.
    #[cfg(feature = "gpu")]
    pub(crate) fn evaluate_here(&self, window: ArrayView2<'_, f32>, out: &mut [f32]) {
        let mut tile = Tile::new(&self.packed, self.window(), TILE);
        self.evaluate(window, Selection::From(0), &mut tile, out);
    }

    /// Evaluates all lanes of inputs `[input][lane]`, also where they are constant.
    pub(crate) fn evaluate_all(&self, inputs: ArrayView2<'_, f32>, out: &mut [f32]) {
        let job = self.job();
        out.par_chunks_mut(job).enumerate().for_each_init(
            || Tile::new(&self.packed, self.window(), TILE),
            |tile, (i, out)| self.evaluate(inputs, Selection::From(i * job), tile, out),
        );
    }

    /// The activations of the last hidden layer for all lanes of inputs `[input][lane]`, as
    /// `[lane][neuron]`.
    pub(crate) fn hidden(&self, inputs: ArrayView2<'_, f32>) -> Vec<f32> {
        let neurons = self.network.layers().last().expect("a network has layers").inputs();
        let (panel, width) = (self.panel(), self.packed.last_width(self.window()));
        let mut hidden = vec![0.0; inputs.ncols() * neurons];
        hidden.par_chunks_mut(TILE * neurons).enumerate().for_each_init(
            || Tile::new(&self.packed, self.window(), TILE),
            |tile, (i, hidden)| {
                let mut out = [0.0; TILE];
                let count = hidden.len() / neurons;
                self.evaluate_tile(inputs, Selection::From(0), i * TILE, tile, &mut out[..count]);
                for (lane, hidden) in hidden.chunks_exact_mut(neurons).enumerate() {
                    let of_panel = &tile.hidden()[lane / panel * width * panel..];
                    let activations = of_panel.iter().skip(lane % panel).step_by(panel);
                    hidden.iter_mut().zip(activations).for_each(|(h, &activation)| *h = activation);
                }
            },
        );
        hidden
    }

    /// Lanes per panel of a tile.
    fn panel(&self) -> usize {
        match self.instructions {
            Instructions::Portable => panel::<Four>(),
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => panel::<Eight>(),
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => panel::<Sixteen>(),
        }
    }

    /// Lanes that a thread fetches at a time: whole tiles.
    fn job(&self) -> usize {
        TILE * (JOB / self.network.flops_per_lane()).div_ceil(TILE).clamp(1, 64)
    }

    /// Evaluates as many lanes of `selection` as `out` has room for, tile by tile.
    fn evaluate(
        &self,
        window: ArrayView2<'_, f32>,
        selection: Selection<'_>,
        tile: &mut Tile,
        out: &mut [f32],
    ) {
        for (i, out) in out.chunks_mut(TILE).enumerate() {
            self.evaluate_tile(window, selection, i * TILE, tile, out);
        }
    }

    /// Evaluates `out.len()` lanes of `selection`, from its number `start` on.
    fn evaluate_tile(
        &self,
        window: ArrayView2<'_, f32>,
        selection: Selection<'_>,
        start: usize,
        tile: &mut Tile,
        out: &mut [f32],
    ) {
        let packed = &*self.packed;
        #[allow(unsafe_code)]
        // SAFETY: the constructor has asserted that the processor has the instructions.
        unsafe {
            match self.instructions {
                Instructions::Portable => {
                    run_tile::<Four>(packed, window, selection, start, tile, out);
                }
                #[cfg(target_arch = "x86_64")]
                Instructions::Avx2 => run_tile_avx2(packed, window, selection, start, tile, out),
                #[cfg(target_arch = "x86_64")]
                Instructions::Avx512 => {
                    run_tile_avx512(packed, window, selection, start, tile, out);
                }
            }
        }
    }
}

impl Transform for MlpCpu {
    fn requires(&self) -> Requirements {
        Requirements::of_lane(self.window())
    }

    fn fit<'a>(&'a self, _: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        Ok(Box::new(self))
    }
}

impl Fitted for MlpCpu {
    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let Some(window) = batch.window(self.window()) else {
            out.fall_back(batch, Status::TooShort);
            return Ok(());
        };
        let job = self.job();
        let (values, status) = out.reset(batch.lanes());
        let jobs = values.len().div_ceil(job);
        let queue = values.chunks_mut(job).zip(status.chunks_mut(job)).enumerate();
        let queue =
            Mutex::new(queue.map(|(i, (values, status))| Job { first: i * job, values, status }));
        let work = || {
            let mut worker = Worker {
                tile: Tile::new(&self.packed, self.window(), TILE),
                compact: Compact::default(),
            };
            loop {
                let job = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
                let Some(job) = job else { break };
                self.run(window, job, &mut worker);
            }
        };
        // This thread begins at once; to wake others up takes as long as a small batch.
        rayon::in_place_scope(|scope| {
            for _ in 1..rayon::current_num_threads().min(jobs) {
                scope.spawn(|_| work());
            }
            work();
        });
        Ok(())
    }
}

/// Lanes that one thread fetches at a time.
struct Job<'a> {
    /// The lane that `values` and `status` begin with.
    first: usize,
    values: &'a mut [f32],
    status: &'a mut [Status],
}

/// What a thread keeps from job to job.
struct Worker {
    tile: Tile,
    compact: Compact,
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_tile_avx2(
    packed: &Packed,
    window: ArrayView2<'_, f32>,
    selection: Selection<'_>,
    start: usize,
    tile: &mut Tile,
    out: &mut [f32],
) {
    #[allow(unsafe_code)]
    // SAFETY: this runs where the processor has what it is compiled for.
    unsafe {
        run_tile::<Eight>(packed, window, selection, start, tile, out);
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
fn run_tile_avx512(
    packed: &Packed,
    window: ArrayView2<'_, f32>,
    selection: Selection<'_>,
    start: usize,
    tile: &mut Tile,
    out: &mut [f32],
) {
    #[allow(unsafe_code)]
    // SAFETY: this runs where the processor has what it is compiled for.
    unsafe {
        run_tile::<Sixteen>(packed, window, selection, start, tile, out);
    }
}

/// Gathers a tile's inputs, evaluates the network, and writes one value per lane.
///
/// # Safety
/// The processor has the instructions of `V`.
#[allow(unsafe_code)]
#[inline(always)]
unsafe fn run_tile<V: Vector>(
    packed: &Packed,
    window: ArrayView2<'_, f32>,
    selection: Selection<'_>,
    start: usize,
    tile: &mut Tile,
    out: &mut [f32],
) {
    let width = panel::<V>();
    let panels = out.len().div_ceil(width);
    let terms = window.nrows();
    for (p, panel) in tile.input().chunks_exact_mut(terms * width).take(panels).enumerate() {
        let count = width.min(out.len() - p * width);
        for (term, row) in window.rows().into_iter().zip(panel.chunks_exact_mut(width)) {
            let term = term.to_slice().expect("a term of all lanes is contiguous");
            if count == width {
                // Of a length that is known when this is compiled.
                selection.gather(term, start + p * width, &mut row[..width]);
            } else {
                selection.gather(term, start + p * width, &mut row[..count]);
                row[count..].fill(0.0);
            }
        }
    }
    // SAFETY: the caller's promise.
    unsafe { evaluate::<V>(packed, terms, tile, panels) };
    out.copy_from_slice(&tile.output()[..out.len()]);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tiles are whole panels, or a lane would be left out.
    #[test]
    fn panels_divide_a_tile() {
        assert_eq!(TILE % panel::<Four>(), 0);
        #[cfg(target_arch = "x86_64")]
        assert_eq!((TILE % panel::<Eight>(), TILE % panel::<Sixteen>()), (0, 0));
    }
}

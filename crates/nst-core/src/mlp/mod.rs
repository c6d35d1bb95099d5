//! The network on the CPU: tiles of lanes that stay in the cache from layer to layer.
//!
//! The WGSL twin is in `gpu`; both compute, for layers i = 0 … L−1,
//! `a ← leaky_relu(W_i a + b_i)`, without the activation after the last one.

mod kernel;
mod vector;

use std::sync::{Arc, Mutex, PoisonError};

use ndarray::ArrayView2;

use crate::{Error, Estimates, Network, SequenceBatch, Status, Transform, transform::Active};
use kernel::{Packed, Tile, evaluate, panel};
pub use vector::Instructions;
#[cfg(target_arch = "x86_64")]
use vector::{Eight, Sixteen};
use vector::{Four, Vector};

/// Lanes per tile, whole panels of any vector: 64 KiB of activations for a 256-wide
/// layer, of which the half that is being read stays in the L1 cache panel by panel.
const TILE: usize = 64;

/// The least work that a thread fetches at a time, in floating-point operations: some
/// 50 µs, beside which the fetching is nothing.
const JOB: usize = 4_000_000;

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
            "this processor has no {}",
            instructions.name()
        );
        let network = network.into();
        let packed = Arc::new(Packed::new(&network));
        Self { network, packed, instructions }
    }

    /// Evaluates the lanes of `active` into `out`, one value each.
    fn evaluate(&self, window: ArrayView2<'_, f32>, active: &Active, out: &mut [f32]) {
        let tiles = (JOB / self.network.flops_per_lane()).div_ceil(TILE).clamp(1, 64);
        let jobs = out.len().div_ceil(tiles * TILE);
        let queue = Mutex::new(out.chunks_mut(tiles * TILE).enumerate());
        let work = || {
            let mut tile = Tile::new(&self.packed, self.window(), TILE);
            loop {
                let job = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
                let Some((job, out)) = job else { break };
                for (i, out) in out.chunks_mut(TILE).enumerate() {
                    self.evaluate_tile(window, active, (job * tiles + i) * TILE, &mut tile, out);
                }
            }
        };
        let threads = rayon::current_num_threads().min(jobs);
        if threads <= 1 {
            work();
        } else {
            rayon::scope(|scope| (0..threads).for_each(|_| scope.spawn(|_| work())));
        }
    }

    /// Evaluates the active lanes `first .. first + out.len()`.
    fn evaluate_tile(
        &self,
        window: ArrayView2<'_, f32>,
        active: &Active,
        first: usize,
        tile: &mut Tile,
        out: &mut [f32],
    ) {
        let packed = &*self.packed;
        match self.instructions {
            Instructions::Portable => {
                run_tile::<Four>(packed, window, active, first, tile, out);
            }
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: the constructor has asserted that the processor has them.
            Instructions::Avx2 => unsafe {
                run_tile_avx2(packed, window, active, first, tile, out);
            },
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: the same.
            Instructions::Avx512 => unsafe {
                run_tile_avx512(packed, window, active, first, tile, out);
            },
        }
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
        out.transform_active(window, |active, out| {
            self.evaluate(window, active, out);
            Ok(())
        })
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_tile_avx2(
    packed: &Packed,
    window: ArrayView2<'_, f32>,
    active: &Active,
    first: usize,
    tile: &mut Tile,
    out: &mut [f32],
) {
    run_tile::<Eight>(packed, window, active, first, tile, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
fn run_tile_avx512(
    packed: &Packed,
    window: ArrayView2<'_, f32>,
    active: &Active,
    first: usize,
    tile: &mut Tile,
    out: &mut [f32],
) {
    run_tile::<Sixteen>(packed, window, active, first, tile, out);
}

/// Gathers a tile's inputs, evaluates the network, and writes one value per lane.
#[inline(always)]
fn run_tile<V: Vector>(
    packed: &Packed,
    window: ArrayView2<'_, f32>,
    active: &Active,
    first: usize,
    tile: &mut Tile,
    out: &mut [f32],
) {
    let lanes = panel::<V>();
    let panels = out.len().div_ceil(lanes);
    let terms = window.nrows();
    for (p, panel) in tile.input().chunks_exact_mut(terms * lanes).take(panels).enumerate() {
        let start = p * lanes;
        let count = lanes.min(out.len() - start);
        for (term, row) in window.rows().into_iter().zip(panel.chunks_exact_mut(lanes)) {
            let term = term.to_slice().expect("a term of all lanes is contiguous");
            if count == lanes {
                // Of a length that is known when this is compiled.
                active.gather(term, first + start, &mut row[..lanes]);
            } else {
                active.gather(term, first + start, &mut row[..count]);
                row[count..].fill(0.0);
            }
        }
    }
    evaluate::<V>(packed, terms, tile, panels);
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

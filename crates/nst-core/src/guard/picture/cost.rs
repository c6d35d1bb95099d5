//! How long a guard may take, and a tile by which that is measured.

use std::{
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use super::layers::FEATURES;
use crate::{Error, Extent, Grid, SequenceBatch, Side, random::SplitMix64};

/// The side of a tile, in pixels.
const SIDE: u32 = 192;

/// Its pixels.
pub(super) const TILE: usize = (SIDE * SIDE) as usize;

/// How long experts that look at neighbours may take, which may become known after the guard was
/// made. Without a limit they may take any time.
#[derive(Clone, Debug, Default)]
pub struct TimeLimit(Arc<Mutex<Option<Duration>>>);

impl TimeLimit {
    /// From now on, this is the limit.
    pub fn set(&self, limit: Duration) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(limit);
    }

    /// The limit, if there is one.
    #[must_use]
    pub fn get(&self) -> Option<Duration> {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A tile of noise in three channels, with features: what is even, or has less, may take less time.
pub(super) fn tile() -> Result<SequenceBatch, Error> {
    let grid = Grid::new(SIDE, SIDE, 3, 0)?;
    let mut random = SplitMix64(0);
    let mut noise = |side: &Side| -> Vec<f32> {
        let count = if side.extent() == Extent::Vector { 3 * TILE } else { grid.lanes() };
        // Emission is rare.
        let shines = !Side::FEATURE_FOLDS[2].contains(side);
        (0..count).map(|_| if shines { 0.5 + random.uniform() as f32 } else { 0.0 }).collect()
    };
    let mut batch = SequenceBatch::from_last(&noise(&Side::Fold(0)), 16)?;
    batch.set_grid(grid)?;
    for side in Side::of_sums(16).chain(FEATURES) {
        batch.set_side(side.clone(), noise(side))?;
    }
    Ok(batch)
}

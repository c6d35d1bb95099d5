//! [`Strips`]: a batch that is read part by part, as it may not fit into memory.

use std::{borrow::Cow, ops::Range};

use rayon::prelude::*;

use super::{LANES_PER_BLOCK, SequenceBatch};
use crate::Error;

/// A batch that is read strip after strip, as often as needed.
///
/// Strips of a picture are whole rows, and say so by their [`Grid`](super::Grid). Others
/// end at multiples of [`LANES_PER_BLOCK`] lanes, so that sums over all lanes can be
/// taken in one order however the batch is cut.
pub trait Strips {
    /// Goes back to the first strip. From now on strips have a halo of this many rows on
    /// either side, or fewer at the picture's edges; 0 for most methods.
    ///
    /// # Errors
    /// What the source of the strips reports; [`Error::Batch`] if it cannot give a halo.
    fn rewind(&mut self, halo: u32) -> Result<(), Error>;

    /// The next strip, `None` after the last.
    ///
    /// # Errors
    /// What the source of the strips reports.
    fn next_strip(&mut self) -> Result<Option<Cow<'_, SequenceBatch>>, Error>;
}

/// A batch in memory, as one strip.
#[derive(Clone, Debug)]
pub struct Whole<'a> {
    batch: &'a SequenceBatch,
    done: bool,
}

impl<'a> Whole<'a> {
    /// Gives the batch as its only strip.
    #[must_use]
    pub fn new(batch: &'a SequenceBatch) -> Self {
        Self { batch, done: false }
    }
}

impl Strips for Whole<'_> {
    /// No halo is needed: beyond the batch there is nothing.
    fn rewind(&mut self, _: u32) -> Result<(), Error> {
        self.done = false;
        Ok(())
    }

    fn next_strip(&mut self) -> Result<Option<Cow<'_, SequenceBatch>>, Error> {
        let first = !std::mem::replace(&mut self.done, true);
        Ok(first.then_some(Cow::Borrowed(self.batch)))
    }
}

/// Sums over all lanes in a way whose rounding depends neither on the strips nor on the
/// number of threads. `sum` gets the ranges of the lanes of one block; `merge` gets the
/// results, block after block. A block is a row of the picture, with all channels, or a run
/// of [`LANES_PER_BLOCK`] lanes.
pub(crate) fn sum_in_order<T: Send>(
    strips: &mut dyn Strips,
    sum: impl Fn(&SequenceBatch, &[Range<usize>]) -> T + Sync,
    mut merge: impl FnMut(T),
) -> Result<(), Error> {
    strips.rewind(0)?;
    let mut whole_blocks = true;
    while let Some(strip) = strips.next_strip()? {
        let strip = &*strip;
        if !whole_blocks {
            return Err(Error::Batch(format!(
                "a strip without a grid ends within a block of {LANES_PER_BLOCK} lanes"
            )));
        }
        let partial: Vec<T> = match strip.grid() {
            Some(grid) => (0..grid.rows())
                .into_par_iter()
                .map(|y| {
                    let row: Vec<_> =
                        (0..grid.channels()).map(|c| grid.lanes_of(c, y..y + 1)).collect();
                    sum(strip, &row)
                })
                .collect(),
            None => {
                whole_blocks = strip.lanes().is_multiple_of(LANES_PER_BLOCK);
                let blocks = strip.lanes().div_ceil(LANES_PER_BLOCK);
                (0..blocks)
                    .into_par_iter()
                    .map(|block| {
                        let first = block * LANES_PER_BLOCK;
                        let end = strip.lanes().min(first + LANES_PER_BLOCK);
                        sum(strip, std::slice::from_ref(&(first..end)))
                    })
                    .collect()
            }
        };
        partial.into_iter().for_each(&mut merge);
    }
    Ok(())
}

#[cfg(test)]
pub(crate) mod tests {
    use ndarray::Array2;

    use super::*;
    use crate::Grid;

    /// A batch in memory, cut every few rows or blocks.
    pub(crate) struct Cut<'a> {
        pub(crate) batch: &'a SequenceBatch,
        pub(crate) step: usize,
        pub(crate) next: usize,
    }

    impl Cut<'_> {
        /// Rows of the grid, or lanes.
        fn length(&self) -> usize {
            self.batch.grid().map_or(self.batch.lanes(), |grid| grid.rows())
        }

        fn part(&self, from: usize, to: usize) -> SequenceBatch {
            let lanes: Vec<usize> = match self.batch.grid() {
                None => (from..to).collect(),
                Some(grid) => {
                    (0..grid.channels()).flat_map(|c| grid.lanes_of(c, from..to)).collect()
                }
            };
            let terms = self.batch.terms();
            let terms =
                Array2::from_shape_fn((terms.nrows(), lanes.len()), |(k, i)| terms[(k, lanes[i])]);
            let counts = self.batch.sample_counts().to_vec();
            let mut part = SequenceBatch::new(terms, counts).expect("a part of a batch");
            if let Some(grid) = self.batch.grid() {
                let [width, channels] = [grid.width(), grid.channels()].map(|x| x as u32);
                let grid = Grid::new(width, (to - from) as u32, channels, from as u32);
                part.set_grid(grid.expect("rows of a grid")).expect("its lanes");
            }
            for (side, values) in self.batch.sides() {
                let values = lanes.iter().map(|&lane| values[lane]).collect();
                part.set_side(side.clone(), values).expect("one value per lane");
            }
            part
        }
    }

    impl Strips for Cut<'_> {
        fn rewind(&mut self, halo: u32) -> Result<(), Error> {
            assert_eq!(halo, 0, "no method of this crate looks at neighbours");
            self.next = 0;
            Ok(())
        }

        fn next_strip(&mut self) -> Result<Option<Cow<'_, SequenceBatch>>, Error> {
            let from = self.next;
            self.next = self.length().min(from + self.step);
            Ok((from < self.next).then(|| Cow::Owned(self.part(from, self.next))))
        }
    }

    /// Numbers whose sum depends on its order: magnitudes from 1 to 2^40.
    fn batch(lanes: usize, grid: Option<Grid>) -> SequenceBatch {
        let value = |(_, lane): (usize, usize)| ((lane * 7919 % 41) as f32).exp2() + lane as f32;
        let terms = Array2::from_shape_fn((1, lanes), value);
        let mut batch = SequenceBatch::new(terms, vec![1]).expect("one term");
        if let Some(grid) = grid {
            batch.set_grid(grid).expect("as many lanes");
        }
        batch
    }

    fn total(strips: &mut dyn Strips) -> Result<f64, Error> {
        let sum = |strip: &SequenceBatch, lanes: &[Range<usize>]| {
            let lanes = lanes.iter().cloned().flatten();
            lanes.fold(0.0, |sum, lane| sum + f64::from(strip.last()[lane]).sqrt())
        };
        let mut total = 0.0;
        sum_in_order(strips, sum, |part| total += part)?;
        Ok(total)
    }

    #[test]
    fn sums_do_not_depend_on_the_strips() -> Result<(), Error> {
        let picture = batch(3 * 7 * 50, Some(Grid::new(7, 50, 3, 0)?));
        let plain = batch(5 * LANES_PER_BLOCK + 17, None);
        for (batch, steps) in [(&picture, [1, 16, 23]), (&plain, [1, 2, 4])] {
            let whole = total(&mut Whole::new(batch))?;
            let unit = if batch.grid().is_some() { 1 } else { LANES_PER_BLOCK };
            for step in steps {
                let mut cut = Cut { batch, step: step * unit, next: 0 };
                assert_eq!(total(&mut cut)?.to_bits(), whole.to_bits(), "{step}");
            }
            // In another order the sum differs: the test would see it.
            let lanes = batch.last().iter().rev().map(|&x| f64::from(x).sqrt());
            assert_ne!(lanes.sum::<f64>().to_bits(), whole.to_bits());
        }
        let mut ragged = Cut { batch: &plain, step: LANES_PER_BLOCK + 1, next: 0 };
        assert!(total(&mut ragged).is_err());
        Ok(())
    }
}

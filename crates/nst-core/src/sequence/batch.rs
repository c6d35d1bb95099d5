//! [`SequenceBatch`]: many sequences of progressive estimates, side by side.

use std::{collections::BTreeMap, ops::Range};

use ndarray::{Array2, ArrayView2, s};
use rayon::prelude::*;

use super::{Extent, FOLDS, Grid, LaneSums, Power, PowerSums, Side};
use crate::Error;

/// Without a grid, all strips but the last end at multiples of this many lanes: the lanes
/// whose sum is one task of the thread pool.
pub const LANES_PER_BLOCK: usize = 4096;

/// Progressive estimates of many independent integrals.
///
/// Terms are stored `[term][lane]`, so that one term of all lanes is contiguous.
/// Term k is the estimate S_n with n = [`sample_counts`](Self::sample_counts)`[k]`
/// samples; the counts increase but need not be consecutive. [Side channels](Side)
/// carry further numbers per lane or pixel, such as the mean of a fold. Lanes that are
/// those of a picture, or of some of its rows, have a [`Grid`].
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceBatch {
    terms: Array2<f32>,
    sample_counts: Vec<u32>,
    grid: Option<Grid>,
    sides: BTreeMap<Side, Vec<f32>>,
}

impl SequenceBatch {
    /// Takes terms `[term][lane]` and the number of samples behind each term.
    ///
    /// # Errors
    /// [`Error::Batch`] if there is no term or no lane, if the number of terms
    /// differs from the number of counts, or if the counts do not increase from
    /// at least 1.
    pub fn new(terms: Array2<f32>, sample_counts: Vec<u32>) -> Result<Self, Error> {
        let (rows, lanes) = terms.dim();
        if rows == 0 || lanes == 0 {
            return Err(Error::Batch(format!("{rows} terms of {lanes} lanes")));
        }
        if rows != sample_counts.len() {
            return Err(Error::Batch(format!(
                "{rows} terms but {} sample counts",
                sample_counts.len()
            )));
        }
        if sample_counts[0] == 0 || sample_counts.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(Error::Batch("sample counts must start at 1 or above and increase".into()));
        }
        let terms = if terms.is_standard_layout() {
            terms
        } else {
            terms.as_standard_layout().into_owned()
        };
        Ok(Self { terms, sample_counts, grid: None, sides: BTreeMap::new() })
    }

    /// A batch of one term: the means of this many samples, `[lane]`.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn from_last(means: &[f32], samples: u32) -> Result<Self, Error> {
        let terms = Array2::from_shape_vec((1, means.len()), means.to_vec())
            .map_err(|error| Error::Batch(error.to_string()))?;
        Self::new(terms, vec![samples])
    }

    /// Accumulates samples `[sample][lane]` into the running means S_1 … S_N (in f64), with the
    /// side channels that a rendering has: means of folds from four samples on, the variance
    /// from two on.
    ///
    /// # Errors
    /// [`Error::Batch`] if `samples` is empty or no multiple of `lanes`.
    pub fn from_samples(lanes: usize, samples: &[f32]) -> Result<Self, Error> {
        Self::from_samples_with(lanes, samples, &[])
    }

    /// The same with the means of further powers of the samples, which networks that see
    /// samples may [need](crate::guard::Expert::powers).
    ///
    /// # Errors
    /// As [`Self::from_samples`].
    pub fn from_samples_with(
        lanes: usize,
        samples: &[f32],
        powers: &[Power],
    ) -> Result<Self, Error> {
        if lanes == 0 || samples.is_empty() || !samples.len().is_multiple_of(lanes) {
            return Err(Error::Batch(format!("{} samples for {lanes} lanes", samples.len())));
        }
        let rows = samples.len() / lanes;
        let last = u32::try_from(rows)
            .map_err(|_| Error::Batch(format!("{rows} samples of each lane are too many")))?;
        let mut sums = vec![LaneSums::default(); lanes];
        let mut further = PowerSums::new(powers, lanes);
        let mut terms = Vec::with_capacity(samples.len());
        for (index, row) in (0..last).zip(samples.chunks_exact(lanes)) {
            for (lane, (sums, sample)) in sums.iter_mut().zip(row).enumerate() {
                sums.add(index, f64::from(*sample));
                further.add(lane, index, f64::from(*sample));
                terms.push((sums.total() / f64::from(index + 1)) as f32);
            }
        }
        let terms = Array2::from_shape_vec((rows, lanes), terms)
            .map_err(|error| Error::Batch(error.to_string()))?;
        let mut batch = Self::new(terms, (1..=last).collect())?;
        batch.set_sums(&sums, last)?;
        batch.set_power_sums(&further, last)?;
        Ok(batch)
    }

    /// Sets the side channels that [follow from the sums](Side::of_sums) of n samples of each
    /// lane.
    ///
    /// # Errors
    /// [`Error::Batch`] if there is another number of lanes.
    pub fn set_sums(&mut self, sums: &[LaneSums], n: u32) -> Result<(), Error> {
        for side in Side::of_sums(n) {
            let mut values = vec![0.0; sums.len()];
            values
                .par_chunks_mut(LANES_PER_BLOCK)
                .zip(sums.par_chunks(LANES_PER_BLOCK))
                .for_each(|(values, sums)| LaneSums::write_side(sums, side, n, values));
            self.set_side(side.clone(), values)?;
        }
        Ok(())
    }

    /// Sets the power means of the folds of n samples of each lane if n ≥ 4.
    ///
    /// # Errors
    /// [`Error::Batch`] if there is another number of lanes.
    pub fn set_power_sums(&mut self, sums: &PowerSums, n: u32) -> Result<(), Error> {
        for (index, power) in sums.powers().iter().enumerate().filter(|_| n as usize >= FOLDS) {
            for (fold, side) in Side::power_means(power).into_iter().enumerate() {
                self.set_side(side, sums.means(index, fold, n))?;
            }
        }
        Ok(())
    }

    /// The number of sequences.
    #[must_use]
    pub fn lanes(&self) -> usize {
        self.terms.ncols()
    }

    /// The number of samples behind each stored term.
    #[must_use]
    pub fn sample_counts(&self) -> &[u32] {
        &self.sample_counts
    }

    /// The stored terms, `[term][lane]`.
    #[must_use]
    pub fn terms(&self) -> ArrayView2<'_, f32> {
        self.terms.view()
    }

    /// Term k of all lanes.
    ///
    /// # Panics
    /// If fewer terms are stored.
    #[must_use]
    pub fn term(&self, k: usize) -> &[f32] {
        let values = self.terms.as_slice().expect("the constructor makes the layout standard");
        &values[k * self.lanes()..(k + 1) * self.lanes()]
    }

    /// The stored terms, `[term][lane]`, to keep.
    #[must_use]
    pub fn into_terms(self) -> Vec<f32> {
        let count = self.terms.len();
        let (mut terms, offset) = self.terms.into_raw_vec_and_offset();
        // Of an array that was cut out of another, there is more.
        terms.drain(..offset.unwrap_or_default());
        terms.truncate(count);
        terms
    }

    /// The memory of its numbers, for those of another batch.
    #[must_use]
    pub fn into_buffers(self) -> Vec<Vec<f32>> {
        let (terms, _) = self.terms.into_raw_vec_and_offset();
        std::iter::once(terms).chain(self.sides.into_values()).collect()
    }

    /// The best plain estimate of each lane: S_N, the last term.
    #[must_use]
    pub fn last(&self) -> &[f32] {
        self.term(self.sample_counts.len() - 1)
    }

    /// The last `length` terms, `[term][lane]`, oldest first; `None` if fewer are stored.
    #[must_use]
    pub fn window(&self, length: usize) -> Option<ArrayView2<'_, f32>> {
        let first = self.sample_counts.len().checked_sub(length)?;
        Some(self.terms.slice(s![first.., ..]))
    }

    /// Says where in a picture the lanes lie.
    ///
    /// # Errors
    /// [`Error::Batch`] if the grid has another number of lanes.
    pub fn set_grid(&mut self, grid: Grid) -> Result<(), Error> {
        if grid.lanes() != self.lanes() {
            let message = format!("a grid of {} lanes for {} lanes", grid.lanes(), self.lanes());
            return Err(Error::Batch(message));
        }
        self.grid = Some(grid);
        Ok(())
    }

    /// Where in a picture the lanes lie, if they are those of a picture.
    #[must_use]
    pub fn grid(&self) -> Option<&Grid> {
        self.grid.as_ref()
    }

    /// Which half a lane is in, 0 or 1, where a method learns from one half what it applies to
    /// the other: the squares of a chessboard, so that a pixel's channels, which share samples,
    /// are in the same half. Without a grid, every other lane is.
    pub(crate) fn half(&self, lane: usize) -> usize {
        self.grid.map_or(lane % 2, |grid| {
            let pixel = lane % grid.pixels();
            let (x, y) = (pixel % grid.width(), pixel / grid.width());
            (x + y + grid.first_row() as usize) % 2
        })
    }

    /// The same for lanes that follow each other.
    pub(crate) fn halves(&self, lanes: Range<usize>) -> Vec<u8> {
        let (width, rows, first_row) = self.grid.map_or((self.lanes(), 1, 0), |grid| {
            (grid.width(), grid.rows(), grid.first_row() as usize)
        });
        let mut halves = Vec::with_capacity(lanes.len());
        let mut lane = lanes.start;
        while lane < lanes.end {
            let (row, x) = (lane / width, lane % width);
            let first = x + row % rows + first_row;
            let count = (width - x).min(lanes.end - lane);
            halves.extend((first..first + count).map(|place| (place % 2) as u8));
            lane += count;
        }
        halves
    }

    /// Adds or replaces a side channel: one value per lane, or one or three per pixel of the
    /// grid, as its [extent](Side::extent) says.
    ///
    /// # Errors
    /// [`Error::Batch`] if the number of values differs, or if there is no grid of pixels.
    pub fn set_side(&mut self, side: Side, values: Vec<f32>) -> Result<(), Error> {
        let wanted = match side.extent() {
            Extent::Lane => Some(self.lanes()),
            Extent::Pixel => self.grid.map(|grid| grid.pixels()),
            Extent::Vector => self.grid.map(|grid| 3 * grid.pixels()),
        };
        if wanted != Some(values.len()) {
            return Err(Error::Batch(format!(
                "side channel '{side}' has {} values for {} lanes{}",
                values.len(),
                self.lanes(),
                wanted.map_or(" without a grid".into(), |count| format!(", not {count}"))
            )));
        }
        self.sides.insert(side, values);
        Ok(())
    }

    /// A side channel, `[lane]`, `[pixel]` or `[coordinate][pixel]` as its [extent](Side::extent) says.
    #[must_use]
    pub fn side(&self, side: &Side) -> Option<&[f32]> {
        self.sides.get(side).map(Vec::as_slice)
    }

    /// The side channels of four folds, if all are there.
    pub(crate) fn of_folds(&self, sides: &[Side; FOLDS]) -> Option<[&[f32]; FOLDS]> {
        let [Some(a), Some(b), Some(c), Some(d)] = sides.each_ref().map(|side| self.side(side))
        else {
            return None;
        };
        Some([a, b, c, d])
    }

    /// All side channels, in the order of [`Side`].
    pub fn sides(&self) -> impl Iterator<Item = (&Side, &[f32])> {
        self.sides.iter().map(|(side, values)| (side, values.as_slice()))
    }
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;

    #[test]
    fn running_means_of_samples() -> Result<(), Error> {
        let batch = SequenceBatch::from_samples(2, &[1.0, 4.0, 3.0, 0.0, 2.0, 2.0])?;
        assert_eq!(batch.terms(), array![[1.0, 4.0], [2.0, 2.0], [2.0, 2.0]]);
        assert_eq!(batch.sample_counts(), [1, 2, 3]);
        assert_eq!(batch.last(), [2.0, 2.0]);
        assert_eq!(batch.window(2).map(|w| w.nrows()), Some(2));
        assert!(batch.window(4).is_none());
        Ok(())
    }

    #[test]
    fn terms_of_a_part_of_an_array() -> Result<(), Error> {
        let whole = array![[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0]];
        let batch = SequenceBatch::new(whole.slice_move(s![1..3, ..]), vec![1, 2])?;
        assert_eq!(batch.last(), [5.0, 6.0]);
        assert_eq!(batch.into_terms(), [3.0, 4.0, 5.0, 6.0]);
        Ok(())
    }

    #[test]
    fn a_transposed_array_keeps_its_meaning() -> Result<(), Error> {
        let lanes_by_terms = array![[1.0, 2.0, 3.0], [10.0, 20.0, 30.0]];
        let batch = SequenceBatch::new(lanes_by_terms.reversed_axes(), vec![1, 2, 4])?;
        assert_eq!(batch.last(), [3.0, 30.0]);
        Ok(())
    }

    #[test]
    fn inconsistent_sequences_are_refused() {
        let terms = || array![[1.0], [2.0]];
        for counts in [vec![1], vec![0, 1], vec![2, 2], vec![3, 1]] {
            assert!(SequenceBatch::new(terms(), counts.clone()).is_err(), "{counts:?}");
        }
        assert!(SequenceBatch::new(Array2::zeros((0, 3)), vec![]).is_err());
        assert!(SequenceBatch::new(Array2::zeros((1, 0)), vec![1]).is_err());
        assert!(SequenceBatch::from_samples(2, &[1.0, 2.0, 3.0]).is_err());
        let mut batch = SequenceBatch::new(terms(), vec![1, 2]).expect("two terms, one lane");
        assert!(batch.set_side(Side::Fold(0), vec![1.0, 2.0]).is_err());
    }

    #[test]
    fn halves_are_a_chessboard() -> Result<(), Error> {
        let mut batch = SequenceBatch::new(Array2::zeros((1, 30)), vec![1])?;
        let halves: Vec<u8> = (0..30).map(|lane| lane % 2).collect();
        assert_eq!(batch.halves(0..30), halves);
        for (width, rows, first_row, expected) in [(5, 2, 1, "1010101010"), (2, 5, 0, "0110011001")]
        {
            batch.set_grid(Grid::new(width, rows, 3, first_row)?)?;
            let expected = expected.repeat(3);
            for lanes in [0..30, 3..17, 9..10, 20..30, 7..7] {
                let halves: String =
                    batch.halves(lanes.clone()).iter().map(u8::to_string).collect();
                assert_eq!(halves, expected[lanes.clone()], "{lanes:?}");
                let each: String = lanes.map(|lane| batch.half(lane).to_string()).collect();
                assert_eq!(each, halves);
            }
        }
        Ok(())
    }

    #[test]
    fn pixels_have_one_value_whatever_their_lanes() -> Result<(), Error> {
        let mut batch = SequenceBatch::new(Array2::zeros((1, 12)), vec![1])?;
        assert!(batch.set_side(Side::Skipped, vec![0.0; 4]).is_err(), "no grid, no pixels");
        assert!(batch.set_grid(Grid::new(2, 3, 3, 0)?).is_err());
        batch.set_grid(Grid::new(2, 2, 3, 0)?)?;
        assert!(batch.set_side(Side::Skipped, vec![0.0; 12]).is_err());
        batch.set_side(Side::Skipped, vec![0.0, 1.0, 2.0, 3.0])?;
        assert!(batch.set_side(Side::Normal, vec![0.0; 4]).is_err());
        batch.set_side(Side::Normal, vec![0.0; 12])?;
        assert_eq!(batch.side(&Side::Skipped).map(<[f32]>::len), Some(4));
        Ok(())
    }
}

//! [`SequenceBatch`]: many sequences of progressive estimates, side by side.

use std::collections::BTreeMap;

use ndarray::{Array2, ArrayView2, s};

use crate::Error;

/// Progressive estimates of many independent integrals.
///
/// Terms are stored `[term][lane]`, so that one term of all lanes is contiguous.
/// Term k is the estimate S_n with n = [`sample_counts`](Self::sample_counts)`[k]`
/// samples; the counts increase but need not be consecutive. Named side channels
/// carry one further number per lane, such as the mean of a fold.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceBatch {
    terms: Array2<f32>,
    sample_counts: Vec<u32>,
    side: BTreeMap<String, Vec<f32>>,
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
        Ok(Self { terms, sample_counts, side: BTreeMap::new() })
    }

    /// Accumulates samples `[sample][lane]` into the running means S_1 … S_N (in f64).
    ///
    /// # Errors
    /// [`Error::Batch`] if `samples` is empty or no multiple of `lanes`.
    pub fn from_samples(lanes: usize, samples: &[f32]) -> Result<Self, Error> {
        if lanes == 0 || samples.is_empty() || !samples.len().is_multiple_of(lanes) {
            return Err(Error::Batch(format!("{} samples for {lanes} lanes", samples.len())));
        }
        let rows = samples.len() / lanes;
        let mut sums = vec![0.0_f64; lanes];
        let mut terms = Vec::with_capacity(samples.len());
        for (k, row) in samples.chunks_exact(lanes).enumerate() {
            for (sum, sample) in sums.iter_mut().zip(row) {
                *sum += f64::from(*sample);
                terms.push((*sum / (k + 1) as f64) as f32);
            }
        }
        let terms = Array2::from_shape_vec((rows, lanes), terms)
            .map_err(|error| Error::Batch(error.to_string()))?;
        Self::new(terms, (1..=rows as u32).collect())
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

    /// Adds or replaces a side channel: one value per lane under a name.
    ///
    /// # Errors
    /// [`Error::Batch`] if the number of values differs from the number of lanes.
    pub fn set_side(&mut self, name: &str, values: Vec<f32>) -> Result<(), Error> {
        if values.len() != self.lanes() {
            return Err(Error::Batch(format!(
                "side channel '{name}' has {} values for {} lanes",
                values.len(),
                self.lanes()
            )));
        }
        self.side.insert(name.to_owned(), values);
        Ok(())
    }

    /// A side channel by name.
    #[must_use]
    pub fn side(&self, name: &str) -> Option<&[f32]> {
        self.side.get(name).map(Vec::as_slice)
    }

    /// All side channels, by name.
    pub fn sides(&self) -> impl Iterator<Item = (&str, &[f32])> {
        self.side.iter().map(|(name, values)| (name.as_str(), values.as_slice()))
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
        assert!(batch.set_side("fold0", vec![1.0, 2.0]).is_err());
    }
}

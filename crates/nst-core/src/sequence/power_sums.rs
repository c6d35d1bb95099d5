//! [`PowerSums`]: what is kept of further powers of samples.

use super::{FOLDS, Power, fold_count};

/// Sums of further powers of the samples of many lanes, beside [`LaneSums`](super::LaneSums):
/// constant memory, however many samples there are.
#[derive(Clone, Debug, PartialEq)]
pub struct PowerSums {
    /// Without those that [`LaneSums`](super::LaneSums) contains.
    powers: Vec<Power>,
    /// Σφ_p(y) of each fold, `[lane][power]`.
    sums: Vec<[f64; FOLDS]>,
}

impl PowerSums {
    /// Sums of no samples. Powers whose sums [`LaneSums`](super::LaneSums) contains are left
    /// out here.
    #[must_use]
    pub fn new(powers: &[Power], lanes: usize) -> Self {
        let mut powers: Vec<_> = powers.iter().copied().filter(|p| !p.is_usual()).collect();
        powers.sort_unstable();
        powers.dedup();
        let sums = vec![[0.0; FOLDS]; powers.len() * lanes];
        Self { powers, sums }
    }

    /// Adds the sample of a lane with an index. It must be finite, as a NaN would spoil the
    /// sums of all others.
    ///
    /// # Panics
    /// If there is no such lane.
    pub fn add(&mut self, lane: usize, index: u32, sample: f64) {
        let count = self.powers.len();
        let sums = &mut self.sums[lane * count..(lane + 1) * count];
        for (power, sums) in self.powers.iter().zip(sums) {
            sums[index as usize % FOLDS] += power.of(sample);
        }
    }

    /// Appends the lanes of others.
    ///
    /// # Panics
    /// If these have other powers.
    pub fn append(&mut self, others: &Self) {
        assert_eq!(self.powers, others.powers, "sums of other powers");
        self.sums.extend_from_slice(&others.sums);
    }

    /// The powers, ascending.
    #[must_use]
    pub fn powers(&self) -> &[Power] {
        &self.powers
    }

    /// M_p of a fold of n samples in all, `[lane]`, for the power of an index.
    pub(super) fn means(&self, power: usize, fold: usize, n: u32) -> Vec<f32> {
        let (p, count) = (self.powers[power], fold_count(fold, n));
        let lanes = self.sums.chunks_exact(self.powers.len());
        lanes.map(|sums| p.mean_of(sums[power][fold] / count) as f32).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folds_have_means_of_their_own() {
        let fourth = Power::of_value(4.0).expect("a power of two");
        let mut sums = PowerSums::new(&[fourth, Power::ONE, fourth], 2);
        for (index, y) in (0..).zip([1.0, 2.0, -3.0, 0.0, 2.0]) {
            sums.add(1, index, y);
        }
        assert_eq!(sums.powers(), [fourth]);
        let mut both = PowerSums::new(&[fourth], 1);
        both.append(&sums);
        assert_eq!(both.means(0, 2, 5), [0.0, 0.0, 3.0]);
        assert_eq!(sums.means(0, 0, 5), [0.0, 8.5_f64.powf(0.25) as f32]);
        assert_eq!(sums.means(0, 2, 5), [0.0, 3.0]);
    }
}

//! [`PowerSums`]: what is kept of further powers of samples.

use super::{FOLDS, FurtherPowers, Power, fold_count};
use crate::Error;

/// Sums of further powers of the samples of many lanes, beside [`LaneSums`](super::LaneSums):
/// constant memory, however many samples there are. The default is that of no powers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PowerSums {
    /// Ascending; without those that [`LaneSums`](super::LaneSums) contains.
    powers: Vec<Power>,
    /// Σφ_p(y) of each fold, `[power][lane]`.
    sums: Vec<[f64; FOLDS]>,
}

impl PowerSums {
    /// Sums of no samples. Powers whose sums [`LaneSums`](super::LaneSums) contains are left
    /// out here.
    #[must_use]
    pub fn new(powers: &[Power], lanes: usize) -> Self {
        let powers: Vec<_> = FurtherPowers::of(powers).iter().collect();
        let sums = vec![[0.0; FOLDS]; powers.len() * lanes];
        Self { powers, sums }
    }

    /// Takes sums of each fold, `[power][lane]`, the powers ascending.
    ///
    /// # Errors
    /// [`Error::Batch`] if there are not equally many for each power.
    pub fn from_sums(powers: FurtherPowers, sums: Vec<[f64; FOLDS]>) -> Result<Self, Error> {
        let powers: Vec<_> = powers.iter().collect();
        if !sums.len().is_multiple_of(powers.len()) {
            let message = format!("{} sums of {} powers", sums.len(), powers.len());
            return Err(Error::Batch(message));
        }
        Ok(Self { powers, sums })
    }

    /// The lanes of several, one after the other; without any, sums of no powers.
    ///
    /// # Panics
    /// If they have different powers.
    #[must_use]
    pub fn concat(parts: &[&Self]) -> Self {
        let powers = parts.first().map_or_else(Vec::new, |part| part.powers.clone());
        assert!(parts.iter().all(|part| part.powers == powers), "sums of other powers");
        let of_power = |power: usize| parts.iter().flat_map(move |part| part.of_power(power));
        let sums = (0..powers.len()).flat_map(of_power).copied().collect();
        Self { powers, sums }
    }

    /// Adds the sample of a lane with an index. It must be finite, as a NaN would spoil the
    /// sums of all others.
    ///
    /// # Panics
    /// If there is no such lane.
    pub fn add(&mut self, lane: usize, index: u32, sample: f64) {
        let lanes = self.lanes();
        for (i, power) in self.powers.iter().enumerate() {
            let sums = &mut self.sums[i * lanes..(i + 1) * lanes];
            sums[lane][index as usize % FOLDS] += power.of(sample);
        }
    }

    /// The powers.
    #[must_use]
    pub fn powers(&self) -> FurtherPowers {
        FurtherPowers::of(&self.powers)
    }

    /// The sums of each fold, `[power][lane]`.
    #[must_use]
    pub fn sums(&self) -> &[[f64; FOLDS]] {
        &self.sums
    }

    /// The same, to keep.
    #[must_use]
    pub fn into_sums(self) -> Vec<[f64; FOLDS]> {
        self.sums
    }

    /// Whether these are sums of these powers of this many lanes.
    #[must_use]
    pub fn are_of(&self, powers: FurtherPowers, lanes: usize) -> bool {
        self.powers.iter().copied().eq(powers.iter())
            && self.sums.len() == self.powers.len() * lanes
    }

    /// The number of lanes; 0 without powers.
    fn lanes(&self) -> usize {
        self.sums.len() / self.powers.len().max(1)
    }

    /// The sums of the power of an index, `[lane]`.
    fn of_power(&self, power: usize) -> &[[f64; FOLDS]] {
        &self.sums[power * self.lanes()..(power + 1) * self.lanes()]
    }

    /// M_p of a fold of n samples in all, `[lane]`, for the power of an index.
    pub(super) fn means(&self, power: usize, fold: usize, n: u32) -> Vec<f32> {
        let (p, count) = (self.powers[power], fold_count(fold, n));
        self.of_power(power).iter().map(|sums| p.mean_of(sums[fold] / count) as f32).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn power(p: f64) -> Power {
        Power::of_value(p).expect("a power of two")
    }

    #[test]
    fn folds_have_means_of_their_own() {
        let mut sums = PowerSums::new(&[power(4.0), Power::ONE, power(4.0)], 2);
        for (index, y) in (0..).zip([1.0, 2.0, -3.0, 0.0, 2.0]) {
            sums.add(1, index, y);
        }
        assert!(sums.powers().iter().eq([power(4.0)]));
        assert_eq!(sums.means(0, 0, 5), [0.0, 8.5_f64.powf(0.25) as f32]);
        assert_eq!(sums.means(0, 2, 5), [0.0, 3.0]);
    }

    #[test]
    fn lanes_stand_side_by_side_for_each_power() -> Result<(), Error> {
        let powers = [power(4.0), power(0.25)];
        let [mut one, mut two] = [1, 2].map(|lanes| PowerSums::new(&powers, lanes));
        one.add(0, 1, 16.0);
        two.add(1, 2, -1.0);
        let all = PowerSums::concat(&[&one, &two]);
        let (quarters, fourths) = ([0.0, 2.0, 0.0, 0.0], [0.0, 65536.0, 0.0, 0.0]);
        let (zero, last) = ([0.0; FOLDS], [0.0, 0.0, 1.0, 0.0]);
        assert_eq!(all.sums(), [quarters, zero, last, fourths, zero, last]);
        assert_eq!(PowerSums::from_sums(all.powers(), all.sums().to_vec())?, all);
        assert_eq!(PowerSums::concat(&[]), PowerSums::new(&[Power::ONE], 3));
        Ok(())
    }

    #[test]
    fn sums_of_other_sizes_are_seen() {
        let set = FurtherPowers::of(&[power(4.0), power(0.25)]);
        let sums = |count: usize| PowerSums::from_sums(set, vec![[0.0; FOLDS]; count]);
        assert!(
            sums(5).is_err() && PowerSums::from_sums(FurtherPowers::NONE, vec![[0.0; 4]]).is_err()
        );
        let sums = sums(6).expect("three lanes");
        assert!(sums.are_of(set, 3) && !sums.are_of(set, 2));
        assert!(!sums.are_of(FurtherPowers::of(&[power(4.0)]), 6));
        assert!(!sums.are_of(FurtherPowers::NONE, 3));
        assert!(PowerSums::default().are_of(FurtherPowers::NONE, 3));
    }
}

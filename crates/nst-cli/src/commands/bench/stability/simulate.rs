//! Running means of simulated samples.

use ndarray::Array2;
use nst_core::{LaneSums, Power, PowerSums, SequenceBatch, random::SplitMix64};
use rayon::prelude::*;

use super::integrands::COUNT;

/// How many runs there are of each integrand, and by which random numbers.
#[derive(Clone, Copy)]
pub(super) struct Runs {
    pub(super) each: usize,
    /// Each makes another draw of all regimes.
    pub(super) seed: u64,
}

impl Runs {
    /// Those of all integrands.
    pub(super) fn lanes(self) -> usize {
        COUNT * self.each
    }

    /// The seed of a regime that has this number.
    pub(super) fn seed(self, regime: u64) -> u64 {
        /// More than there are regimes.
        const STEP: u64 = 500;
        regime.wrapping_add(self.seed.wrapping_mul(STEP))
    }
}

/// Sequences whose limits are known.
pub(super) struct Case {
    pub(super) batch: SequenceBatch,
    /// I of each lane.
    pub(super) limits: Vec<f64>,
}

/// Running means with the given sample counts, and the means of the folds and of all powers,
/// where sample i belongs to fold i mod 4.
///
/// `lane` returns the limit of a lane and its samples, as a function of their index
/// and of the lane's own random numbers. Sums are in f64, as in a rendering.
pub(super) fn simulate<F: FnMut(u32, &mut SplitMix64) -> f64>(
    counts: &[u32],
    lanes: usize,
    seed: u64,
    lane: impl Fn(usize, &mut SplitMix64) -> (f64, F) + Sync,
) -> Case {
    let last = counts[counts.len() - 1];
    let all_powers: Vec<_> = Power::all().collect();
    let recorded: Vec<_> = (0..lanes)
        .into_par_iter()
        .map(|index| {
            let mut rng = SplitMix64::of_stream(seed, index as u64);
            let (limit, mut sample) = lane(index, &mut rng);
            let (mut sum, mut sums) = (0.0, LaneSums::default());
            let mut powers = PowerSums::new(&all_powers, 1);
            let mut terms = Vec::with_capacity(counts.len());
            for i in 0..last {
                let value = sample(i, &mut rng);
                sum += value;
                sums.add(i, value);
                powers.add(0, i, value);
                if counts[terms.len()] == i + 1 {
                    terms.push((sum / f64::from(i + 1)) as f32);
                }
            }
            (limit, terms, sums, powers)
        })
        .collect();
    let terms = Array2::from_shape_fn((counts.len(), lanes), |(k, lane)| recorded[lane].1[k]);
    let mut batch = batch(terms, counts);
    let sums: Vec<_> = recorded.iter().map(|(_, _, sums, _)| *sums).collect();
    batch.set_sums(&sums, last).expect("sums of each lane");
    let powers: Vec<&PowerSums> = recorded.iter().map(|(.., of_lane)| of_lane).collect();
    batch.set_power_sums(&PowerSums::concat(&powers), last).expect("sums of each lane");
    Case { batch, limits: recorded.iter().map(|&(limit, ..)| limit).collect() }
}

/// One lane: the partial sums of a series, in f64 and rounded, and its limit.
pub(super) fn series(counts: &[u32], limit: f64, term: impl Fn(u32) -> f64) -> (Case, Vec<f64>) {
    let mut sum = 0.0;
    let sums: Vec<_> = (1..=counts[counts.len() - 1])
        .map(|n| {
            sum += term(n);
            sum
        })
        .collect();
    let sums: Vec<_> = counts.iter().map(|&n| sums[n as usize - 1]).collect();
    let terms = Array2::from_shape_fn((counts.len(), 1), |(k, _)| sums[k] as f32);
    (Case { batch: batch(terms, counts), limits: vec![limit] }, sums)
}

fn batch(terms: Array2<f32>, counts: &[u32]) -> SequenceBatch {
    SequenceBatch::new(terms, counts.to_vec()).expect("counts increase from 1")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn running_means_and_folds() {
        let case = simulate(&[2, 6], 2, 0, |lane, _| (3.0, move |i, _| f64::from(i) + lane as f64));
        assert_eq!(case.batch.terms(), ndarray::array![[0.5, 1.5], [2.5, 3.5]]);
        // Samples 0 and 4; 1 and 5; 2; 3.
        for (fold, mean) in [2.0, 3.0, 2.0, 3.0].into_iter().enumerate() {
            let side = case.batch.side(&nst_core::Side::Fold(fold as u8));
            assert_eq!(side, Some(&[mean, mean + 1.0][..]));
        }
        let (case, sums) = series(&[1, 3], 2.0, f64::from);
        assert_eq!((case.batch.last(), sums), (&[6.0][..], vec![1.0, 6.0]));
    }
}

//! Chooses between the environment and many emitters with given probabilities.
//!
//! A random f32 has too few digits to choose among a million lights: it is a multiple of
//! 2⁻²⁴, and the probability of a light may be less. So integers of [`FINE_BITS`] bits
//! choose. Each light has an interval of them, and its probability is the length of the
//! interval divided by the number of all integers. The same numbers thus choose a light
//! and tell its probability, without rounding.

use crate::sampler::FINE_BITS;

/// How many integers there are.
const ALL: u64 = 1 << FINE_BITS;

/// The environment and the emitters, with their probabilities.
pub(super) struct Choice {
    /// The integers below this choose the environment.
    environment: u64,
    /// By emitter: where its interval ends. It begins where that of the emitter before it
    /// ends.
    ends: Vec<u64>,
}

impl Choice {
    /// `environment` is the probability of the environment: at most 0.9 if there are
    /// emitters, else 0 or 1. The emitters, at most 2³², share the rest in proportion to
    /// their `powers`, which are above 0. Each gets one integer more than its share,
    /// before rounding, so that every light can be found.
    pub(super) fn new(
        environment: f32,
        powers: impl ExactSizeIterator<Item = f64> + Clone,
    ) -> Self {
        let environment = (f64::from(environment) * ALL as f64) as u64;
        let count = powers.len() as u64;
        let total: f64 = powers.clone().sum();
        let shared = (ALL - environment - count) as f64;
        let mut sum = 0.0;
        let ends = (1..).zip(powers).map(|(extra, power): (u64, f64)| {
            sum += power;
            environment + extra + (sum / total * shared).round() as u64
        });
        Self { environment, ends: ends.collect() }
    }

    /// Whether an integer of [`FINE_BITS`] bits chooses the environment.
    #[inline(always)]
    pub(super) fn is_environment(&self, pick: u64) -> bool {
        pick < self.environment
    }

    /// The emitter that an integer of [`FINE_BITS`] bits chooses; any emitter if it chooses
    /// the environment. There must be emitters.
    #[inline(always)]
    pub(super) fn emitter(&self, pick: u64) -> usize {
        self.ends.partition_point(|&end| end <= pick)
    }

    /// The probabilities of the emitters, which are exact.
    pub(super) fn probabilities(&self) -> impl Iterator<Item = f64> {
        let starts = std::iter::once(&self.environment).chain(&self.ends);
        starts.zip(&self.ends).map(|(start, end)| (end - start) as f64 / ALL as f64)
    }

    /// The probability of the environment.
    pub(super) fn environment(&self) -> f64 {
        self.environment as f64 / ALL as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A million powers within 24 orders of magnitude.
    fn powers() -> impl ExactSizeIterator<Item = f64> + Clone {
        (0..1_000_000_u32).map(|i| 10.0_f64.powf(f64::from(i * 709 % 1000) * 0.024 - 12.0))
    }

    /// How many integers choose an emitter: both ends of its interval, by bisection.
    fn measure(choice: &Choice, emitter: usize) -> u64 {
        let first = |least: usize| {
            let (mut low, mut high) = (0, ALL);
            while low < high {
                let middle = u64::midpoint(low, high);
                let is_before = choice.is_environment(middle) || choice.emitter(middle) < least;
                if is_before { low = middle + 1 } else { high = middle }
            }
            low
        };
        first(emitter + 1) - first(emitter)
    }

    #[test]
    fn a_million_emitters_are_chosen_as_often_as_their_probability_says() {
        for share in [0.0, 0.1, 0.37, 0.9_f32] {
            let choice = Choice::new(share, powers());
            let probabilities: Vec<_> = choice.probabilities().collect();
            let total: f64 = powers().sum();
            let mut sum = (choice.environment() * ALL as f64) as u64;
            for (i, (&probability, power)) in probabilities.iter().zip(powers()).enumerate() {
                let numbers = (probability * ALL as f64) as u64;
                assert_eq!(numbers as f64 / ALL as f64, probability);
                assert!(numbers > 0);
                sum += numbers;
                // Off by the one that each gets, by rounding at both ends, and by what all
                // extra ones take from the shares, some 10⁶ / 2⁴⁸.
                let expected = power / total * f64::from(1.0 - share) * ALL as f64;
                let error = (numbers as f64 - expected).abs();
                assert!(error < 2.1 + 1e-7 * expected, "{i}: {numbers}, not {expected}");
                if i % 1009 == 0 {
                    assert_eq!(measure(&choice, i), numbers);
                }
            }
            assert_eq!(sum, ALL);
            assert_eq!(
                measure(&choice, powers().len() - 1),
                (probabilities[powers().len() - 1] * ALL as f64) as u64
            );
            assert!((choice.environment() - f64::from(share)).abs() < 1e-14);
        }
    }

    #[test]
    fn few_or_no_emitters() {
        let equal = Choice::new(0.0, [3.0; 4].into_iter());
        assert!(equal.probabilities().eq([0.25; 4]));
        assert_eq!([0, ALL / 4 - 1, ALL / 4, ALL - 1].map(|n| equal.emitter(n)), [0, 0, 1, 3]);
        assert!(!equal.is_environment(0));
        let none = Choice::new(1.0, std::iter::empty());
        assert!(none.is_environment(ALL - 1) && none.environment() == 1.0);
        assert_eq!(none.probabilities().count(), 0);
    }
}

//! [`Power`]: the powers of samples whose means a batch may have for each fold.

use std::{fmt, str::FromStr};

use super::{FOLDS, fold_count, root};

/// The exponent p of a *power mean* M_p = |m_p|^(1/p), where m_p is the mean of φ_p(y) over
/// samples y:
///
/// ```text
/// φ_p(y) = |y|^p,   but φ_1(y) = y,   and φ_½(y) = ±√|y| with the sign of y.
/// ```
///
/// It is a power of two from 1/16 to 16: roots and squares alone give φ_p and M_p, so that
/// their bits are the same on every machine. M_p has the unit of the samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Power {
    /// p = 2^exponent.
    exponent: i8,
}

impl Power {
    /// ½.
    pub const ROOT: Self = Self { exponent: -1 };
    /// 1, whose mean is the plain estimate.
    pub const ONE: Self = Self { exponent: 0 };
    /// 2.
    pub const SQUARE: Self = Self { exponent: 1 };

    /// The largest exponent, and the least with a minus. Sums of φ_16 in f64 have room for
    /// samples from 10^−19 to 10^19.
    const MOST: i8 = 4;

    /// All, from 1/16 to 16.
    pub fn all() -> impl Iterator<Item = Self> {
        (-Self::MOST..=Self::MOST).map(|exponent| Self { exponent })
    }

    /// The power p, if it is one of [`Self::all`].
    #[must_use]
    pub fn of_value(p: f64) -> Option<Self> {
        Self::all().find(|power| power.value() == p)
    }

    /// p.
    #[must_use]
    pub fn value(self) -> f64 {
        2.0_f64.powi(self.exponent.into())
    }

    /// Whether every file of sequences has its means: those of roots, of samples, of squares.
    #[must_use]
    pub fn is_usual(self) -> bool {
        self.exponent.abs() <= 1
    }

    /// φ_p(y).
    #[must_use]
    pub fn of(self, y: f64) -> f64 {
        match self {
            Self::ONE => y,
            Self::ROOT => root(y),
            Self { exponent } => scaled_exponent(y.abs(), exponent),
        }
    }

    /// M_p of m_p, the mean of φ_p.
    #[must_use]
    pub fn mean_of(self, m: f64) -> f64 {
        scaled_exponent(m.abs(), -self.exponent)
    }
}

/// x^(2^exponent) of an x of 0 or more.
fn scaled_exponent(x: f64, exponent: i8) -> f64 {
    (0..exponent.abs()).fold(x, |x, _| if exponent > 0 { x * x } else { x.sqrt() })
}

impl fmt::Display for Power {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.value())
    }
}

impl FromStr for Power {
    type Err = String;

    /// Reads p, as in `0.125`.
    fn from_str(text: &str) -> Result<Self, String> {
        let power = text.trim().parse().ok().and_then(Self::of_value);
        power.ok_or_else(|| format!("'{text}' is not a power of two from 0.0625 to 16"))
    }
}

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
    fn powers_and_their_inverses() {
        let values: Vec<f64> = Power::all().map(Power::value).collect();
        assert_eq!(values, [0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0]);
        for power in Power::all() {
            assert_eq!(power.to_string().parse(), Ok(power));
            for y in [1e-19, 0.3, 7.0, 1e19] {
                let phi = power.of(y);
                assert!((phi / y.powf(power.value()) - 1.0).abs() < 1e-12, "{power} of {y}");
                assert!((power.mean_of(phi) / y - 1.0).abs() < 1e-12, "{power} of {y}");
            }
            let sign = if [0.5, 1.0].contains(&power.value()) { -1.0 } else { 1.0 };
            assert_eq!(power.of(-3.0), sign * power.of(3.0));
            assert_eq!((power.of(0.0), power.mean_of(0.0)), (0.0, 0.0));
        }
        for bad in ["", "x", "0", "-1", "3", "32", "NaN"] {
            assert!(bad.parse::<Power>().is_err(), "{bad}");
        }
    }

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

//! [`Power`]: the powers of samples whose means a batch may have for each fold.

use std::{fmt, str::FromStr};

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

/// √y, and −√−y for a negative y. As the second moment of √y is Σ|y|, two sums give both the
/// mean and the variance of samples that are closer to normal than y.
#[inline]
#[must_use]
pub fn root(y: f64) -> f64 {
    y.abs().sqrt().copysign(y)
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
}

//! What several runs say of one number.

/// Mean, median and tail of the values of several runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spread {
    pub(crate) mean: f64,
    /// The 95 % interval of the mean: Student's t over the runs, as if their values were
    /// normal. It does not cover the reference's own error, which all runs share. `None` for
    /// one run.
    pub(crate) interval: Option<[f64; 2]>,
    pub(crate) median: f64,
    /// The 95th percentile of the runs.
    pub(crate) p95: f64,
}

impl Spread {
    /// `None` if there are no values.
    pub(super) fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.into_iter().collect();
        let mean = mean(&values)?;
        values.sort_by(f64::total_cmp);
        let count = values.len();
        let interval = (count > 1).then(|| {
            // Relative to the largest, whose square may be beyond the range of f64.
            let largest = values.iter().fold(f64::MIN_POSITIVE, |most, x| most.max(x.abs()));
            let squares: f64 =
                values.iter().map(|x| ((x / largest) - mean / largest).powi(2)).sum();
            let variance_of_mean = squares / (count - 1) as f64 / count as f64;
            let half = student_t(count - 1) * variance_of_mean.sqrt() * largest;
            [mean - half, mean + half].map(|end| end.clamp(f64::MIN, f64::MAX))
        });
        let (median, p95) = (quantile(&values, 0.5), quantile(&values, 0.95));
        Some(Self { mean, interval, median, p95 })
    }
}

/// `None` if there are no values.
pub(super) fn mean(values: &[f64]) -> Option<f64> {
    let count = values.len() as f64;
    let sum: f64 = values.iter().sum();
    // A sum beyond the range of f64 has a mean within it.
    let mean =
        if sum.is_finite() { sum / count } else { values.iter().map(|value| value / count).sum() };
    (!values.is_empty()).then_some(mean)
}

/// `None` if there are no values.
pub(super) fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    (!values.is_empty()).then(|| quantile(&values, 0.5))
}

/// A quantile of sorted values: linear between the order statistics (definition 7 of Hyndman
/// and Fan, 1996, the usual one of R and NumPy).
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
    below + place.fract() * (above - below)
}

/// The 97.5 % quantile of Student's t for ν ≥ 1 degrees of freedom.
///
/// A table up to ν = 10; from there, the expansion of Abramowitz and Stegun, 26.7.5, whose
/// error is below 1e-4.
fn student_t(degrees: usize) -> f64 {
    const TABLE: [f64; 10] =
        [12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060, 2.2622, 2.2281];
    /// The 97.5 % quantile of the normal distribution.
    const Z: f64 = 1.959_964;
    if let Some(&t) = TABLE.get(degrees - 1) {
        return t;
    }
    let degrees = degrees as f64;
    let terms = [
        Z,
        (Z.powi(3) + Z) / 4.0,
        (5.0 * Z.powi(5) + 16.0 * Z.powi(3) + 3.0 * Z) / 96.0,
        (3.0 * Z.powi(7) + 19.0 * Z.powi(5) + 17.0 * Z.powi(3) - 15.0 * Z) / 384.0,
    ];
    terms.iter().rev().fold(0.0, |sum, term| sum / degrees + term)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: f64, b: f64, tolerance: f64) -> bool {
        (a - b).abs() <= tolerance
    }

    #[test]
    fn quantiles_of_students_t() {
        // From printed tables, to three decimals.
        for (degrees, expected) in [
            (1, 12.706),
            (2, 4.303),
            (9, 2.262),
            (11, 2.201),
            (20, 2.086),
            (30, 2.042),
            (99, 1.984),
        ] {
            let t = student_t(degrees);
            assert!(near(t, expected, 6e-4), "{degrees}: {t}");
            assert!(!near(student_t(degrees + 1), expected, 6e-4) || degrees > 40, "{degrees}");
        }
        assert!(near(student_t(1_000_000), 1.959_964, 1e-5));
    }

    /// 1, 2, 3, 6: mean 3, variance (4 + 1 + 0 + 9) / 3 = 14/3, that of the mean 7/6.
    #[test]
    fn a_spread_by_hand() {
        let spread = Spread::of([6.0, 1.0, 3.0, 2.0]).expect("values");
        assert_eq!((spread.mean, spread.median), (3.0, 2.5));
        // 0.95 · 3 = 2.85: between 3 and 6.
        assert!(near(spread.p95, 3.0 + 0.85 * 3.0, 1e-12), "{spread:?}");
        let [low, high] = spread.interval.expect("four runs");
        let half = 3.1824 * (7.0_f64 / 6.0).sqrt();
        assert!(near(low, 3.0 - half, 1e-12) && near(high, 3.0 + half, 1e-12), "{spread:?}");
        // The check sees another number of runs, and another value.
        assert!(!near(low, 3.0 - 2.7764 * (7.0_f64 / 6.0).sqrt(), 1e-3));
        assert_ne!(Spread::of([6.0, 1.0, 3.0, 2.1]), Some(spread));
    }

    /// Sums and squares of them are beyond the range of f64.
    #[test]
    fn huge_values() {
        let spread = Spread::of([1e308, 1.2e308]).expect("values");
        assert!(near(spread.mean / 1.1e308, 1.0, 1e-12), "{spread:?}");
        let [low, high] = spread.interval.expect("two runs");
        // Half of their distance, times Student's t.
        assert!(near(low / (1.1e308 - 12.7062 * 0.1e308), 1.0, 1e-9), "{low}");
        assert_eq!(high, f64::MAX);
    }

    #[test]
    fn few_values() {
        let one = Spread { mean: 2.0, interval: None, median: 2.0, p95: 2.0 };
        assert_eq!(Spread::of([2.0]), Some(one));
        assert_eq!((Spread::of([]), median([])), (None, None));
        assert_eq!(Spread::of([2.0, 2.0]).and_then(|spread| spread.interval), Some([2.0, 2.0]));
        assert_eq!(median([3.0, 1.0]), Some(2.0));
    }
}

//! Error metrics of estimates x against reference values I.
//!
//! [`error()`] takes lanes one by one. [`RunErrors`] compares several independent
//! runs with one reference, and tells bias from variance; its unit is the pixel,
//! the lanes of which are its channels. [`crate::halves`] has a reference that knows its
//! own error.

use std::fmt;

use crate::Error;

/// Added to the denominator of relMSE and SMAPE, so that nearly black lanes do not decide
/// the mean: below a radiance of 0.1, it is the larger part of I² + 0.01.
pub const EPSILON: f64 = 0.01;

/// The share of pixels, those with the largest errors, that a trimmed mean leaves out: one
/// in a thousand, as a few fireflies can decide a mean.
pub const TRIMMED: f64 = 0.001;

/// A measure of how far estimates are from the reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Metric {
    /// The mean squared error.
    Mse,
    /// The mean relative squared error.
    RelMse,
    /// The symmetric mean absolute percentage error, as a fraction.
    Smape,
}

impl Metric {
    /// All metrics.
    pub const ALL: [Self; 3] = [Self::Mse, Self::RelMse, Self::Smape];

    /// The definition, with [`EPSILON`] as a number.
    #[must_use]
    pub fn formula(self) -> &'static str {
        match self {
            Self::Mse => "mean (x − I)²",
            Self::RelMse => "mean (x − I)² / (I² + 0.01)",
            Self::Smape => "mean |x − I| / (|x| + |I| + 0.01)",
        }
    }

    /// The error of one lane.
    #[must_use]
    pub fn of(self, x: f64, i: f64) -> f64 {
        let difference = x - i;
        match self.weight(i) {
            Some(weight) => weight * difference * difference,
            None => difference.abs() / (x.abs() + i.abs() + EPSILON),
        }
    }

    /// What a squared difference is multiplied by; `None` for what is not quadratic.
    fn weight(self, i: f64) -> Option<f64> {
        match self {
            Self::Mse => Some(1.0),
            Self::RelMse => Some(1.0 / (i * i + EPSILON)),
            Self::Smape => None,
        }
    }
}

/// The usual name.
impl fmt::Display for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Mse => "MSE",
            Self::RelMse => "relMSE",
            Self::Smape => "SMAPE",
        })
    }
}

/// The error of a set of estimates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorSummary {
    /// MSE = mean (x − I)².
    pub mse: f64,
    /// relMSE = mean (x − I)² / (I² + 0.01).
    pub relmse: f64,
    /// SMAPE = mean |x − I| / (|x| + |I| + 0.01).
    pub smape: f64,
    /// Lanes left out because x or I is not finite.
    pub nonfinite: usize,
}

/// Compares `estimates` with `reference`, lane by lane. All are means over the
/// lanes whose estimate and reference are finite.
///
/// # Errors
/// [`Error::Lengths`] if the two differ in length.
pub fn error(estimates: &[f32], reference: &[f32]) -> Result<ErrorSummary, Error> {
    if estimates.len() != reference.len() {
        return Err(Error::Lengths(estimates.len(), reference.len()));
    }
    let mut sums = [0.0; 3];
    let mut lanes = 0_usize;
    for (&x, &i) in estimates.iter().zip(reference) {
        if x.is_finite() && i.is_finite() {
            for (sum, metric) in sums.iter_mut().zip(Metric::ALL) {
                *sum += metric.of(f64::from(x), f64::from(i));
            }
            lanes += 1;
        }
    }
    // Without any lane, 0 / 0 is the NaN that it should be.
    let [mse, relmse, smape] = sums.map(|sum| sum / lanes as f64);
    Ok(ErrorSummary { mse, relmse, smape, nonfinite: estimates.len() - lanes })
}

/// A metric over all pixels of a run, and over all but the worst.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Means {
    /// The mean over all pixels that are finite in x and I.
    pub all: f64,
    /// The same without the share [`TRIMMED`] of the pixels, those with the largest errors.
    pub trimmed: f64,
}

/// The expected squared error, taken apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decomposition {
    /// An unbiased estimate of bias², which may be below zero: mean ((x̄ − I)² − s²/R).
    pub bias_squared: f64,
    /// An unbiased estimate of the variance of a run: s² = Σ (x − x̄)² / (R − 1).
    pub variance: f64,
}

/// Compares independent runs with one reference, one run after the other. Its memory does
/// not grow with their number.
#[derive(Clone, Debug)]
pub struct RunErrors<'a> {
    reference: &'a [f32],
    channels: usize,
    runs: u32,
    /// Per lane: the mean over runs, and the sum of squared deviations from it (Welford 1962).
    mean: Vec<f64>,
    deviations: Vec<f64>,
}

impl<'a> RunErrors<'a> {
    /// Takes the reference, planar: `[channel][pixel]`.
    ///
    /// # Errors
    /// [`Error::Lengths`] if the channels are not of equal length.
    pub fn new(reference: &'a [f32], channels: usize) -> Result<Self, Error> {
        if channels == 0 || !reference.len().is_multiple_of(channels) {
            return Err(Error::Lengths(reference.len(), channels));
        }
        let zeros = vec![0.0; reference.len()];
        Ok(Self { reference, channels, runs: 0, mean: zeros.clone(), deviations: zeros })
    }

    /// The number of pixels.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.reference.len() / self.channels
    }

    /// How many pixels a trimmed mean leaves out.
    #[must_use]
    pub fn trimmed_pixels(&self) -> usize {
        (self.pixels() as f64 * TRIMMED) as usize
    }

    /// Adds a run. Returns the means by metric, in the order of [`Metric::ALL`], and
    /// the number of pixels left out because x or I is not finite in any channel.
    ///
    /// # Errors
    /// [`Error::Lengths`] if the run is not as long as the reference.
    pub fn push(&mut self, run: &[f32]) -> Result<([Means; 3], usize), Error> {
        if run.len() != self.reference.len() {
            return Err(Error::Lengths(run.len(), self.reference.len()));
        }
        self.runs += 1;
        let weight = 1.0 / f64::from(self.runs);
        for ((mean, deviation), &x) in self.mean.iter_mut().zip(&mut self.deviations).zip(run) {
            let difference = f64::from(x) - *mean;
            *mean += difference * weight;
            *deviation += difference * (f64::from(x) - *mean);
        }
        let errors = |metric: Metric| {
            let reference = self.reference;
            self.pixel_means(move |lane| {
                metric.of(f64::from(run[lane]), f64::from(reference[lane]))
            })
        };
        let mut nonfinite = 0;
        let means = Metric::ALL.map(|metric| {
            let mut finite: Vec<_> = errors(metric).filter(|error| !error.is_nan()).collect();
            nonfinite = self.pixels() - finite.len();
            means(&mut finite, self.trimmed_pixels())
        });
        Ok((means, nonfinite))
    }

    /// Bias² and variance over the runs so far, which add up to the mean of
    /// [`Means::all`] over runs; `None` for fewer than two runs, and for SMAPE, which
    /// is not a square. Pixels that are not finite in some run are left out.
    #[must_use]
    pub fn decomposition(&self, metric: Metric) -> Option<Decomposition> {
        if self.runs < 2 || metric == Metric::Smape {
            return None;
        }
        let runs = f64::from(self.runs);
        let mean = |of: &dyn Fn(f64, f64) -> f64| {
            let values = self.pixel_means(|lane| {
                let i = f64::from(self.reference[lane]);
                let variance = self.deviations[lane] / (runs - 1.0);
                metric.weight(i).unwrap_or(f64::NAN) * of(self.mean[lane] - i, variance)
            });
            let finite: Vec<_> = values.filter(|value| !value.is_nan()).collect();
            finite.iter().sum::<f64>() / finite.len() as f64
        };
        Some(Decomposition {
            bias_squared: mean(&|bias, variance| bias * bias - variance / runs),
            variance: mean(&|_, variance| variance),
        })
    }

    /// The relative squared error (x − I)² / (I² + 0.01) of each pixel, the mean over
    /// its channels and the runs so far; NaN where a run or the reference is not finite.
    pub fn relative_error_map(&self) -> impl Iterator<Item = f64> {
        let runs = f64::from(self.runs);
        self.pixel_means(move |lane| {
            let i = f64::from(self.reference[lane]);
            let bias = self.mean[lane] - i;
            (bias * bias + self.deviations[lane] / runs) / (i * i + EPSILON)
        })
    }

    /// The means over the channels of each pixel; NaN where any is not finite.
    fn pixel_means(&self, lane: impl Fn(usize) -> f64) -> impl Iterator<Item = f64> {
        let pixels = self.pixels();
        (0..pixels).map(move |pixel| {
            let lanes = (0..self.channels).map(|channel| lane(channel * pixels + pixel));
            let mean = lanes.sum::<f64>() / self.channels as f64;
            if mean.is_finite() { mean } else { f64::NAN }
        })
    }
}

/// The mean of all errors, and of all but the `trimmed` largest.
fn means(errors: &mut [f64], trimmed: usize) -> Means {
    let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
    let all = mean(errors);
    let kept = errors.len().saturating_sub(trimmed);
    if kept < errors.len() && kept > 0 {
        errors.select_nth_unstable_by(kept, f64::total_cmp);
    }
    Means { all, trimmed: mean(&errors[..kept]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-12, "{a} is not {b}");
    }

    #[test]
    fn hand_computed_values() -> Result<(), Error> {
        let e = error(&[1.0, 0.0, f32::NAN], &[3.0, 1.0, 1.0])?;
        close(e.mse, 2.5);
        close(e.relmse, (4.0 / 9.01 + 1.0 / 1.01) / 2.0);
        close(e.smape, (2.0 / 4.01 + 1.0 / 1.01) / 2.0);
        assert_eq!(e.nonfinite, 1);
        assert!(error(&[1.0], &[]).is_err());
        Ok(())
    }

    /// One run by pixels is what it is by lanes.
    #[test]
    fn one_run_agrees_with_the_lanes() -> Result<(), Error> {
        let (run, reference) = ([1.0, 0.0, 4.0, 2.5], [3.0, 1.0, 4.5, 0.0]);
        let mut errors = RunErrors::new(&reference, 2)?;
        let (means, nonfinite) = errors.push(&run)?;
        let lanes = error(&run, &reference)?;
        close(means[0].all, lanes.mse);
        close(means[1].all, lanes.relmse);
        close(means[2].all, lanes.smape);
        assert_eq!((nonfinite, errors.trimmed_pixels()), (0, 0));
        assert_eq!(means[0].all, means[0].trimmed);
        assert_eq!(errors.decomposition(Metric::Mse), None);
        let map: Vec<_> = errors.relative_error_map().collect();
        close(map[0], (4.0 / 9.01 + 0.25 / 20.26) / 2.0);
        close(map[1], (1.0 / 1.01 + 6.25 / 0.01) / 2.0);
        assert!(errors.push(&run[..2]).is_err());
        assert!(RunErrors::new(&reference, 3).is_err());
        Ok(())
    }

    #[test]
    fn the_worst_pixels_are_trimmed_and_nonfinite_ones_left_out() -> Result<(), Error> {
        let reference = vec![0.0; 4000];
        let mut run = vec![1.0_f32; 4000];
        // Two of the four worst pixels of 2000; the others are 1 in both channels.
        (run[7], run[2000 + 900]) = (101.0, 51.0);
        (run[3], run[2000 + 4], run[5], run[2005]) =
            (f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::INFINITY);
        let mut errors = RunErrors::new(&reference, 2)?;
        let (means, nonfinite) = errors.push(&run)?;
        assert_eq!((nonfinite, errors.trimmed_pixels()), (3, 2));
        close(means[0].trimmed, 1.0);
        close(means[0].all, (1995.0 + (10201.0 + 1.0) / 2.0 + (2601.0 + 1.0) / 2.0) / 1997.0);
        assert_eq!(errors.relative_error_map().filter(|error| error.is_nan()).count(), 3);
        Ok(())
    }

    /// E = bias² + variance, exactly; the two by hand.
    #[test]
    fn bias_and_variance() -> Result<(), Error> {
        let reference = [1.0, 2.0];
        let runs = [[2.0, 2.0], [4.0, 2.5], [3.0, 1.5]];
        let mut errors = RunErrors::new(&reference, 1)?;
        let mut sums = [0.0; 3];
        for run in &runs {
            for (sum, means) in sums.iter_mut().zip(errors.push(run)?.0) {
                *sum += means.all / 3.0;
            }
        }
        let mse = errors.decomposition(Metric::Mse).expect("three runs");
        close(mse.variance, (1.0 + 0.25) / 2.0);
        close(mse.bias_squared, ((4.0 - 1.0 / 3.0) + (0.0 - 0.25 / 3.0)) / 2.0);
        for (metric, sum) in Metric::ALL.into_iter().zip(sums).take(2) {
            let Decomposition { bias_squared, variance } = errors.decomposition(metric).expect("3");
            close(bias_squared + variance, sum);
        }
        assert_eq!(errors.decomposition(Metric::Smape), None);
        Ok(())
    }

    /// Unbiased: over many repetitions the estimate of bias² is the true one.
    #[test]
    fn the_estimate_of_bias_is_unbiased() -> Result<(), Error> {
        // A pixel per repetition. Errors are ±1 with equal chance, on a bias of 0.5,
        // from the bits of a linear congruential generator (Knuth's MMIX).
        const PIXELS: usize = 100_000;
        let reference = vec![0.0; PIXELS];
        let mut errors = RunErrors::new(&reference, 1)?;
        let mut state = 1_u64;
        for _ in 0..3 {
            let run: Vec<f32> = (0..PIXELS)
                .map(|_| {
                    state = state
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(1_442_695_040_888_963_407);
                    if state >> 63 == 0 { 1.5 } else { -0.5 }
                })
                .collect();
            errors.push(&run)?;
        }
        let Decomposition { bias_squared, variance } =
            errors.decomposition(Metric::Mse).expect("three runs");
        // A pixel's estimates have standard deviations near 1: 1e-2 is three of the mean's.
        assert!((bias_squared - 0.25).abs() < 1e-2, "{bias_squared}");
        assert!((variance - 1.0).abs() < 1e-2, "{variance}");
        Ok(())
    }
}

//! Errors against a reference that is two independent estimates of the true values.

use crate::{
    Error,
    metrics::{EPSILON, Metric, TRIMMED},
};

/// Two independent, unbiased estimates R₁ and R₂ of the true values, planar lanes
/// `[channel][pixel]`.
///
/// With (x − R₁)(x − R₂) in the place of (x − I)², the errors of the reference itself do not
/// add to those of x, whose samples are others: the reference need not be much better than
/// what it judges.
#[derive(Clone, Copy, Debug)]
pub struct Halves<'a> {
    first: &'a [f32],
    second: &'a [f32],
    channels: usize,
}

/// The errors of one picture, as means over the pixels that are finite in all channels.
/// The first three may be below 0 by chance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalvesError {
    /// MSE: the mean of (x − R₁)(x − R₂).
    pub mse: f64,
    /// relMSE: the same, divided by R² + 0.01, where R is the mean of R₁ and R₂.
    pub relmse: f64,
    /// MSE without the share [`TRIMMED`] of the pixels, those with the largest (x − R)².
    pub mse_trimmed: f64,
    /// SMAPE against R, which is no square: the reference's own error adds to it.
    pub smape: f64,
    /// Pixels that were left out.
    pub nonfinite: usize,
}

impl<'a> Halves<'a> {
    /// Takes both halves.
    ///
    /// # Errors
    /// [`Error::Lengths`] if they differ in length, or are not of so many equal channels.
    pub fn new(first: &'a [f32], second: &'a [f32], channels: usize) -> Result<Self, Error> {
        if first.len() != second.len() {
            return Err(Error::Lengths(first.len(), second.len()));
        }
        if channels == 0 || !first.len().is_multiple_of(channels) {
            return Err(Error::Lengths(first.len(), channels));
        }
        Ok(Self { first, second, channels })
    }

    /// The MSE of R, the mean of both halves: the mean of (R₁ − R₂)² / 4.
    #[must_use]
    pub fn own_mse(&self) -> f64 {
        self.mean_of_lanes(|lane| (self.half(0, lane) - self.half(1, lane)).powi(2) / 4.0)
    }

    /// The errors of a picture.
    ///
    /// # Errors
    /// [`Error::Lengths`] if it is not as long as the reference.
    pub fn error(&self, picture: &[f32]) -> Result<HalvesError, Error> {
        self.check(picture)?;
        let x = |lane: usize| f64::from(picture[lane]);
        let product = |lane: usize| (x(lane) - self.half(0, lane)) * (x(lane) - self.half(1, lane));
        let relative = |lane: usize| product(lane) / (self.mean(lane).powi(2) + EPSILON);
        let smape = |lane: usize| Metric::Smape.of(x(lane), self.mean(lane));
        let size = |lane: usize| (x(lane) - self.mean(lane)).powi(2);

        let products: Vec<(f64, f64)> =
            self.pixels(size).zip(self.pixels(product)).filter(|it| it.1.is_finite()).collect();
        let all = self.first.len() / self.channels;
        Ok(HalvesError {
            mse: mean(products.iter().map(|it| it.1)),
            relmse: mean(self.pixels(relative)),
            mse_trimmed: trimmed(products, (all as f64 * TRIMMED) as usize),
            smape: mean(self.pixels(smape)),
            nonfinite: self.pixels(product).filter(|it| !it.is_finite()).count(),
        })
    }

    /// The mean squared bias of a method, of which two independent pictures are given: the
    /// mean of ((a − R₁)(b − R₂) + (a − R₂)(b − R₁)) / 2, which may be below 0 by chance.
    ///
    /// # Errors
    /// As for [`Self::error`].
    pub fn bias_squared(&self, a: &[f32], b: &[f32]) -> Result<f64, Error> {
        self.check(a)?;
        self.check(b)?;
        let deviation = |x: f32, half: usize, lane: usize| f64::from(x) - self.half(half, lane);
        Ok(self.mean_of_lanes(|lane| {
            let (a, b) = (a[lane], b[lane]);
            let crossed = deviation(a, 0, lane) * deviation(b, 1, lane);
            (crossed + deviation(a, 1, lane) * deviation(b, 0, lane)) / 2.0
        }))
    }

    fn check(&self, picture: &[f32]) -> Result<(), Error> {
        let fits = picture.len() == self.first.len();
        if fits { Ok(()) } else { Err(Error::Lengths(picture.len(), self.first.len())) }
    }

    fn half(&self, half: usize, lane: usize) -> f64 {
        f64::from([self.first, self.second][half][lane])
    }

    fn mean(&self, lane: usize) -> f64 {
        f64::midpoint(self.half(0, lane), self.half(1, lane))
    }

    /// The mean over the finite pixels of the means over their channels.
    fn mean_of_lanes(&self, of: impl Fn(usize) -> f64) -> f64 {
        mean(self.pixels(of))
    }

    /// The means over the channels of each pixel; not finite where a channel is not.
    fn pixels(&self, of: impl Fn(usize) -> f64) -> impl Iterator<Item = f64> {
        let pixels = self.first.len() / self.channels;
        (0..pixels).map(move |pixel| {
            let lanes = (0..self.channels).map(|channel| of(channel * pixels + pixel));
            lanes.sum::<f64>() / self.channels as f64
        })
    }
}

/// The mean of what is finite.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0_usize);
    for value in values.filter(|value| value.is_finite()) {
        sum += value;
        count += 1;
    }
    sum / count as f64
}

/// The mean of the second numbers without those of the largest first numbers.
fn trimmed(mut values: Vec<(f64, f64)>, count: usize) -> f64 {
    let kept = values.len().saturating_sub(count);
    if kept < values.len() && kept > 0 {
        values.select_nth_unstable_by(kept, |a, b| a.0.total_cmp(&b.0));
    }
    mean(values[..kept].iter().map(|it| it.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-9, "{a} is not {b}");
    }

    #[test]
    fn hand_computed_values() -> Result<(), Error> {
        // Two pixels of two channels: lanes R R G G.
        let halves = Halves::new(&[1.0, 2.0, 3.0, 0.0], &[3.0, 2.0, 1.0, 2.0], 2)?;
        close(halves.own_mse(), (4.0 + 0.0 + 4.0 + 4.0) / 4.0 / 4.0);
        let error = halves.error(&[4.0, 2.0, 2.0, 1.0])?;
        close(error.mse, (3.0 + 0.0 - 1.0 - 1.0) / 4.0);
        close(error.relmse, (3.0 / 4.01 - 1.0 / 4.01 - 1.0 / 1.01) / 4.0);
        close(error.smape, 2.0 / 6.01 / 4.0);
        assert_eq!((error.nonfinite, error.mse), (0, error.mse_trimmed));
        let bias = halves.bias_squared(&[4.0, 2.0, 2.0, 1.0], &[2.0, 2.0, 2.0, 1.0])?;
        close(bias, ((1.0 - 3.0) / 2.0 - 1.0 - 1.0) / 4.0);
        // A pixel that is not finite in one channel is left out in all.
        let error = halves.error(&[f32::NAN, 2.0, 2.0, 1.0])?;
        close(error.mse, -0.5);
        assert_eq!(error.nonfinite, 1);
        assert!(halves.error(&[1.0]).is_err() && halves.bias_squared(&[1.0], &[1.0]).is_err());
        assert!(Halves::new(&[1.0], &[], 1).is_err() && Halves::new(&[1.0], &[1.0], 2).is_err());
        Ok(())
    }

    #[test]
    fn the_worst_pixels_are_trimmed() -> Result<(), Error> {
        let reference = vec![0.0; 2000];
        let mut picture = vec![1.0_f32; 2000];
        (picture[7], picture[900]) = (101.0, 51.0);
        let error = Halves::new(&reference, &reference, 1)?.error(&picture)?;
        close(error.mse_trimmed, 1.0);
        close(error.mse, (1998.0 + 101.0 * 101.0 + 51.0 * 51.0) / 2000.0);
        Ok(())
    }

    /// Errors are those against the truth, however bad the reference is: within four
    /// standard errors, which are measured. With one half alone they are not.
    #[test]
    fn the_noise_of_the_reference_does_not_count() -> Result<(), Error> {
        const LANES: usize = 200_000;
        let mut random = SplitMix64::of_stream(7, 1);
        let mut noise = |mean: f32, deviation: f64| -> Vec<f32> {
            // Uniform, with this standard deviation.
            let width = deviation * 12_f64.sqrt();
            (0..LANES).map(|_| mean + ((random.uniform() - 0.5) * width) as f32).collect()
        };
        let (first, second) = (noise(1.0, 0.5), noise(1.0, 0.5));
        let (a, b) = (noise(1.2, 0.3), noise(1.2, 0.3));
        let halves = Halves::new(&first, &second, 1)?;
        let n = LANES as f64;
        // The largest of the deviations of the three products below is about 0.4.
        let tolerance = 4.0 * 0.4 / n.sqrt();
        assert!((halves.own_mse() - 0.125).abs() < tolerance);
        assert!((halves.error(&a)?.mse - (0.04 + 0.09)).abs() < tolerance);
        assert!((halves.bias_squared(&a, &b)? - 0.04).abs() < tolerance);
        let alone = Halves::new(&first, &first, 1)?;
        assert!((alone.error(&a)?.mse - 0.13).abs() > tolerance);
        assert!((halves.bias_squared(&a, &a)? - 0.04).abs() > tolerance);
        Ok(())
    }
}

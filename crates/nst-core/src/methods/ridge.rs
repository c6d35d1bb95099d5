//! Ridge regression on statistics of the folds, fitted on the batch itself.

use std::ops::Range;

use rayon::prelude::*;

use super::{
    folds::{CHUNK, OF_FOLDS, judge, sort_by},
    prior_mean::finite_mean,
};
use crate::{
    Error, Estimates, FOLDS, Fitted, Requirements, SequenceBatch, Side, Status, Strips, Transform,
    cholesky::solve, sum_in_order,
};

/// Learns from the batch how to predict one fold mean from the other three, and corrects
/// S_n by what it has learned.
///
/// The mean y of a held-out fold is an unbiased estimate of I that is independent
/// of the other three folds, so that least squares on it estimates
/// E[I | three folds], with no reference at all (the idea of Lehtinen et al.:
/// *Noise2Noise*, 2018). With features φ of the three and their mean x,
///
/// β = argmin Σ (y − x − β·φ)² + λ |β|², T = S_n + mean over the held-out fold of β·φ.
///
/// The sum is over lanes and over the four choices of y. Features are centred and scaled to
/// unit variance; λ draws T towards S_n. *Cross-fitted*: β for one half of the lanes comes
/// from the other, so that the noise of a lane has no part in its own correction. The
/// channels of a pixel share their samples, and are in the same half: pixels are split like
/// the squares of a chessboard. Without a grid, every other lane is.
///
/// Needs independent folds: those of a low-discrepancy sequence are not. As each prediction
/// knows three quarters of the samples, T is drawn a little more towards the batch's mean
/// than n samples would need.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ridge;

/// λ = `RELATIVE` · samples of the fit + `ABSOLUTE`. This part bounds the condition number
/// of the normal equations by [`FEATURES`] / `RELATIVE` = 8000.
const RELATIVE: f64 = 1e-3;

/// The other part of λ: a fit of fewer than about a hundred samples stays close to S_n.
const ABSOLUTE: f64 = 100.0;

/// The number of [`features`].
const FEATURES: usize = 8;

type Features = [f64; FEATURES];

impl Transform for Ridge {
    fn requires(&self) -> Requirements {
        Requirements { fits: true, ..OF_FOLDS }
    }

    fn fit<'a>(&'a self, strips: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        let magnitude = finite_mean(strips, |s| f64::from(s.abs()))?;
        let unit = magnitude.max(f64::from(f32::MIN_POSITIVE));
        let mut halves = [Moments::default(), Moments::default()];
        sum_in_order(
            strips,
            |strip, lanes| moments(strip, lanes, unit),
            |part| halves.iter_mut().zip(&part).for_each(|(sum, part)| sum.merge(part)),
        )?;
        let [first, second] = halves.map(|half| half.fit());
        // Each half is corrected by what was learned from the other.
        Ok(Box::new(Corrections { unit, of_half: [second, first] }))
    }
}

/// The moments of the two halves of a block of lanes; none if there are no folds.
fn moments(strip: &SequenceBatch, lanes: &[Range<usize>], unit: f64) -> [Moments; 2] {
    let mut halves = [Moments::default(), Moments::default()];
    if let Some(folds) = strip.of_folds(Side::ALL_FOLDS) {
        for lane in lanes.iter().cloned().flatten() {
            let means = folds.map(|fold| f64::from(fold[lane]) / unit);
            halves[strip.half(lane)].add_lane(means);
        }
    }
    halves
}

/// What was learned, ready to be applied.
struct Corrections {
    unit: f64,
    of_half: [Fit; 2],
}

impl Fitted for Corrections {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let Some(folds) = strip.of_folds(Side::ALL_FOLDS) else {
            out.fall_back(strip, Status::NoFolds);
            return Ok(());
        };
        let last = strip.last();
        let (values, status) = out.reset(strip.lanes());
        let chunks = values.par_chunks_mut(CHUNK).zip(status.par_chunks_mut(CHUNK));
        chunks.enumerate().for_each(|(chunk, (values, status))| {
            for (i, (value, status)) in values.iter_mut().zip(status).enumerate() {
                let lane = chunk * CHUNK + i;
                let means = folds.map(|fold| f64::from(fold[lane]) / self.unit);
                let correction = self.unit * self.of_half[strip.half(lane)].correction(means);
                let estimate = (f64::from(last[lane]) + correction) as f32;
                (*value, *status) = judge(last[lane], means, estimate);
            }
        });
        Ok(())
    }
}

/// The features of three fold means, and their mean.
///
/// The means from dark to bright; the same compressed to (−1, 1), so that bright lanes do
/// not decide the fit for dark ones; how far the means disagree, alone and times the
/// brightness.
#[inline(always)]
fn features([a, b, c]: [f64; 3]) -> (Features, f64) {
    let [low, middle, high, _] = sort_by([a, b, c, f64::INFINITY], |x| x);
    let mean = (low + middle + high) / 3.0;
    let compress = |x: f64| x / (1.0 + x.abs());
    let magnitude = low.abs() + middle.abs() + high.abs();
    let disagreement = (high - low) / magnitude.max(f64::MIN_POSITIVE);
    let compressed = compress(mean);
    let features = [
        low,
        middle,
        high,
        compress(low),
        compress(middle),
        compress(high),
        disagreement,
        disagreement * compressed,
    ];
    (features, mean)
}

/// The folds without one, and that one.
#[inline(always)]
fn hold_out(folds: [f64; FOLDS], out: usize) -> ([f64; 3], f64) {
    ([1, 2, 3].map(|step| folds[(out + step) % FOLDS]), folds[out])
}

/// Sums over samples of the fit. The targets y − x sum to 0 in each lane.
#[derive(Clone, Default)]
struct Moments {
    count: f64,
    sum: Features,
    products: [Features; FEATURES],
    targets: Features,
}

impl Moments {
    fn add_lane(&mut self, folds: [f64; FOLDS]) {
        if !folds.iter().all(|x| x.is_finite()) {
            return;
        }
        for out in 0..FOLDS {
            let (rest, held_out) = hold_out(folds, out);
            let (features, mean) = features(rest);
            let target = held_out - mean;
            self.count += 1.0;
            for i in 0..FEATURES {
                self.sum[i] += features[i];
                self.targets[i] += features[i] * target;
                for j in 0..FEATURES {
                    self.products[i][j] += features[i] * features[j];
                }
            }
        }
    }

    fn merge(&mut self, other: &Self) {
        self.count += other.count;
        for i in 0..FEATURES {
            self.sum[i] += other.sum[i];
            self.targets[i] += other.targets[i];
            for j in 0..FEATURES {
                self.products[i][j] += other.products[i][j];
            }
        }
    }

    /// Solves the normal equations of the standardised features.
    fn fit(&self) -> Fit {
        let count = self.count.max(1.0);
        let mean = self.sum.map(|sum| sum / count);
        let covariance = |i: usize, j: usize| self.products[i][j] / count - mean[i] * mean[j];
        // A feature whose variance is below the rounding of the sums (1e-12 of the squares,
        // as f64 has 16 digits and the sums have many terms) is left out.
        let scale: Features = std::array::from_fn(|i| {
            let variance = covariance(i, i);
            let rounding = 1e-12 * self.products[i][i] / count;
            if variance > rounding { variance.sqrt().recip() } else { 0.0 }
        });
        let penalty = RELATIVE + ABSOLUTE / count;
        let mut matrix = [[0.0; FEATURES]; FEATURES];
        for i in 0..FEATURES {
            for j in 0..FEATURES {
                matrix[i][j] = covariance(i, j) * scale[i] * scale[j];
            }
            matrix[i][i] += penalty;
        }
        let targets = std::array::from_fn(|i| self.targets[i] / count * scale[i]);
        let solution = solve(matrix, targets, FEATURES);
        Fit { mean, slope: std::array::from_fn(|i| solution[i] * scale[i]) }
    }
}

struct Fit {
    mean: Features,
    slope: Features,
}

impl Fit {
    /// The mean of β·φ over the four choices of the held-out fold.
    #[inline(always)]
    fn correction(&self, folds: [f64; FOLDS]) -> f64 {
        let mut sum = 0.0;
        for out in 0..FOLDS {
            let (features, _) = features(hold_out(folds, out).0);
            for i in 0..FEATURES {
                sum += self.slope[i] * (features[i] - self.mean[i]);
            }
        }
        sum / FOLDS as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Grid, methods::folds::tests::estimates, sequence::tests::Cut};

    /// Normal numbers, by twelve uniform ones.
    fn noise(seed: &mut u64) -> f64 {
        let uniform = |seed: &mut u64| {
            *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (*seed >> 40) as f64 / 16_777_216.0
        };
        (0..12).map(|_| uniform(seed)).sum::<f64>() - 6.0
    }

    /// Lanes with I normal around 1, standard deviation 0.2, and folds with noise of this
    /// standard deviation around I.
    fn normal_lanes(deviation: f64) -> (Vec<f64>, Vec<[f32; FOLDS]>) {
        let mut seed = 1;
        let lane = |_| {
            let truth = 1.0 + 0.2 * noise(&mut seed);
            (truth, [0; FOLDS].map(|_| (truth + deviation * noise(&mut seed)) as f32))
        };
        (0..20_000).map(lane).unzip()
    }

    fn mse_ratio(truth: &[f64], lanes: &[[f32; FOLDS]]) -> f64 {
        let out = estimates(&Ridge, lanes);
        let identity = lanes.iter().map(|folds| folds.iter().sum::<f32>() / 4.0);
        let square = |x: f32, truth: &f64| (f64::from(x) - truth).powi(2);
        let t: f64 = out.values().iter().zip(truth).map(|(x, i)| square(*x, i)).sum();
        let s: f64 = identity.zip(truth).map(|(x, i)| square(x, i)).sum();
        t / s
    }

    /// For normal I and noise the best estimate is linear: it shrinks S towards
    /// the mean by v/(v + s²), v = Var I, s² = Var S, and the MSE by the same
    /// factor. Three folds of four shrink by v/(v + 4/3 s²); the difference, with the
    /// penalty, stays within 3 %.
    #[test]
    fn reaches_the_best_linear_estimate() {
        for deviation in [0.2, 0.4, 0.8] {
            let (truth, lanes) = normal_lanes(deviation);
            let best = 0.04 / (0.04 + deviation * deviation / 4.0);
            let ratio = mse_ratio(&truth, &lanes);
            assert!(ratio > 0.97 * best && ratio < 1.03 * best, "{deviation}: {ratio}, {best}");
        }
    }

    /// Without noise S is exact, and the fit must leave it alone.
    #[test]
    fn leaves_certain_lanes_alone() {
        let (truth, lanes) = normal_lanes(1e-4);
        let ratio = mse_ratio(&truth, &lanes);
        assert!(ratio < 1.05, "{ratio}");
    }

    #[test]
    fn few_lanes_and_zero_lanes() {
        let out = estimates(&Ridge, &[[1.0, 2.0, 3.0, 4.0]]);
        assert_eq!(out.values(), [2.5]);
        let out = estimates(&Ridge, &[[0.0; 4], [0.0; 4]]);
        assert_eq!(out.count(Status::Constant), 2);
    }

    /// A picture of an odd number of pixels: its channels share samples, and must be in
    /// the same half. The same bits, however it is cut.
    #[test]
    fn pixels_are_split_and_strips_make_no_difference() -> Result<(), Error> {
        let (width, rows, channels) = (7, 51, 3);
        let (_, pixels) = normal_lanes(0.4);
        let lanes: Vec<_> = (0..channels)
            .flat_map(|channel| {
                pixels[..width * rows].iter().map(move |folds| {
                    let tint = 1.0 + channel as f32;
                    folds.map(|x| tint * x)
                })
            })
            .collect();
        let mut batch = crate::methods::folds::tests::batch(&lanes);
        let [width, rows, channels] = [width, rows, channels].map(|x| x as u32);
        batch.set_grid(Grid::new(width, rows, channels, 0)?)?;
        let grid = *batch.grid().expect("it was set");
        for pixel in 0..grid.pixels() {
            let of_channel = |c: usize| batch.half(c * grid.pixels() + pixel);
            assert!((1..3).all(|c| of_channel(c) == of_channel(0)), "pixel {pixel}");
        }

        let mut whole = Estimates::default();
        Ridge.transform(&batch, &mut whole)?;
        for step in [1, 5, 16, 50] {
            let mut cut = Cut { batch: &batch, step, next: 0 };
            let fitted = Ridge.fit(&mut cut)?;
            let mut planes = vec![Vec::<f32>::new(); grid.channels()];
            cut.rewind(0)?;
            while let Some(strip) = cut.next_strip()? {
                let mut estimates = Estimates::default();
                fitted.apply(&strip, &mut estimates)?;
                let part = estimates.values().chunks(estimates.values().len() / grid.channels());
                planes.iter_mut().zip(part).for_each(|(plane, part)| plane.extend(part));
            }
            assert_eq!(planes.concat(), whole.values(), "strips of {step} rows");
        }
        Ok(())
    }
}

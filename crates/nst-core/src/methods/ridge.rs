//! Ridge regression on statistics of the folds, fitted on the batch itself.

use rayon::prelude::*;

use super::{
    folds::{CHUNK, FOLDS, folds, judge, sort_by},
    prior_mean::finite_mean,
};
use crate::{Error, Estimates, SequenceBatch, Status, Transform};

/// Learns from the batch how much of what three folds say of the fourth is noise.
///
/// The mean y of a held-out fold is an unbiased estimate of I that is independent
/// of the other three folds, so that least squares on it estimates
/// E[I | three folds], with no reference at all (the idea of Lehtinen et al.:
/// *Noise2Noise*, 2018). With features φ of the three and their mean x,
///
/// β = argmin Σ (y − x − β·φ)² + λ |β|², T = S_n + mean over the held-out fold of β·φ.
///
/// The sum is over lanes and over the four choices of y. Features are centred and
/// scaled to unit variance; λ draws T towards S_n. *Cross-fitted*: β for the even
/// lanes comes from the odd ones and the other way round, so that no lane is
/// corrected by what its own noise has taught. Lanes that share samples, such as
/// the channels of a pixel, should have indices of the same parity.
///
/// Wants folds that are independent: those of a low-discrepancy sequence are not.
/// As each prediction knows three quarters of the samples, T is drawn a little
/// more towards the batch's mean than n samples would need.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ridge;

/// Per lane and sample of the fit, λ = `RELATIVE` · samples + `ABSOLUTE`: the
/// first bounds the condition number, the second speaks where lanes are few.
const RELATIVE: f64 = 1e-3;
const ABSOLUTE: f64 = 100.0;

const FEATURES: usize = 8;

type Features = [f64; FEATURES];

impl Transform for Ridge {
    fn window(&self) -> usize {
        1
    }

    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let Some(folds) = folds(batch) else {
            out.fall_back(batch, Status::NoFolds);
            return Ok(());
        };
        let last = batch.last();
        let magnitudes: Vec<_> = last.iter().map(|s| s.abs()).collect();
        let unit = finite_mean(&magnitudes).max(f64::from(f32::MIN_POSITIVE));
        let lane = |lane: usize| folds.map(|fold| f64::from(fold[lane]) / unit);

        let chunks: Vec<_> = (0..batch.lanes()).step_by(CHUNK).collect();
        let moments: Vec<_> = chunks
            .par_iter()
            .map(|&first| {
                let mut halves = [Moments::default(), Moments::default()];
                for index in first..(first + CHUNK).min(batch.lanes()) {
                    halves[index % 2].add_lane(lane(index));
                }
                halves
            })
            .collect();
        // In the order of lanes, whatever the threads did.
        let fits = [1, 0].map(|other| {
            let mut sum = Moments::default();
            moments.iter().for_each(|halves| sum.merge(&halves[other]));
            sum.fit()
        });

        let (values, status) = out.reset(batch.lanes());
        let chunks = values.par_chunks_mut(CHUNK).zip(status.par_chunks_mut(CHUNK));
        chunks.enumerate().for_each(|(chunk, (values, status))| {
            for (i, (value, status)) in values.iter_mut().zip(status).enumerate() {
                let index = chunk * CHUNK + i;
                let means = lane(index);
                let correction = unit * fits[index % 2].correction(means);
                let estimate = (f64::from(last[index]) + correction) as f32;
                (*value, *status) = judge(last[index], means, estimate);
            }
        });
        Ok(())
    }
}

/// The features of three fold means, and their mean.
///
/// The means from dark to bright, for what is linear; the same compressed to (−1,
/// 1), as the mean of bright lanes says little of dark ones; how far the means
/// disagree, by itself and in bright lanes.
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
        // A feature that does not vary, to the precision of the sums, is left out.
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
        let solution = solve(matrix, targets);
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

/// Solves A x = b for a positive definite A, by Cholesky's A = L Lᵀ.
fn solve(mut a: [Features; FEATURES], mut b: Features) -> Features {
    for i in 0..FEATURES {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| a[i][k] * a[j][k]).sum();
            let rest = a[i][j] - dot;
            a[i][j] = if i == j { rest.sqrt() } else { rest / a[j][j] };
        }
        let dot: f64 = (0..i).map(|k| a[i][k] * b[k]).sum();
        b[i] = (b[i] - dot) / a[i][i];
    }
    for i in (0..FEATURES).rev() {
        let dot: f64 = (i + 1..FEATURES).map(|k| a[k][i] * b[k]).sum();
        b[i] = (b[i] - dot) / a[i][i];
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::folds::tests::estimates;

    /// Normal numbers, by twelve uniform ones.
    fn noise(seed: &mut u64) -> f64 {
        let uniform = |seed: &mut u64| {
            *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (*seed >> 40) as f64 / 16_777_216.0
        };
        (0..12).map(|_| uniform(seed)).sum::<f64>() - 6.0
    }

    /// Lanes with I normal around 1, standard deviation 0.2, and folds with noise
    /// of so much around I.
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

    #[test]
    fn cholesky() {
        let matrix: [Features; FEATURES] = std::array::from_fn(|i| {
            std::array::from_fn(|j| if i == j { 3.0 } else { 1.0 / (1.0 + (i + j) as f64) })
        });
        let x = [1.0, -2.0, 3.0, 0.5, 0.0, 7.0, -1.0, 2.0];
        let b = matrix.map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum());
        let solution = solve(matrix, b);
        assert!(solution.iter().zip(x).all(|(s, x)| (s - x).abs() < 1e-12), "{solution:?}");
    }
}

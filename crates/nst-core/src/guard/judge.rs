//! What the guard says about its own blend: how much each expert is trusted, and what that
//! gains.

use std::ops::Range;

use super::{
    sample::{GROUPS, dispersion},
    simplex::MOST,
    weights::{Changes, STRATA, Strata, Weights, cells, shared},
};

/// Half the width of the interval: standard errors of the sums, a constant, and a share of 1/n,
/// as it takes three quarters of few samples for all of them. Measured: with these it contained
/// nine of ten true ratios of renderings.
const ERRORS: f64 = 3.0;
const CONSTANT: f64 = 0.01;
const FEW_SAMPLES: f64 = 0.5;

/// What a [`Guard`](super::Guard) has found out on a batch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Judgement {
    /// The experts, and the mean of each one's weight over the lanes: from 0, not trusted at
    /// all, to 1.
    pub experts: Vec<(String, f64)>,
    /// The MSE ratio that is predicted, E[(T − I)²]/E[(S − I)²]: below 1 is a gain.
    pub ratio: f64,
    /// Its 95 % interval by the noise of samples. Beside that, it may err as it concludes from
    /// three quarters of the samples on all.
    pub interval: [f64; 2],
    /// What was left out, and why.
    pub notes: Vec<String>,
    /// Whether a [network](super::GuardMlp) has corrected the experts' weights.
    pub learned: bool,
}

impl Judgement {
    /// Nothing is blended.
    pub(super) fn plain(why: &str) -> Self {
        Self { ratio: 1.0, interval: [1.0; 2], notes: vec![why.to_owned()], ..Self::default() }
    }
}

/// The error of T in each stratum, relative to that of S if all samples were independent.
#[derive(Clone, Debug)]
pub(super) struct ErrorRatios([f64; STRATA]);

impl ErrorRatios {
    /// That of a lane.
    #[inline(always)]
    pub(super) fn at(&self, strata: Strata) -> f32 {
        cells(strata).iter().map(|&(cell, share)| share * self.0[cell] as f32).sum()
    }
}

/// What an estimated MSE ratio of a stratum may be, of T to S. That of S to what S would be if
/// all samples were independent may be any.
const RATIOS: [f64; 2] = [0.05, 1.2];

/// Judges weights by the half of the pixels that they were not learnt from. With the judgement
/// comes the error that T has in each stratum, relative to that of S if all samples were
/// independent, by which it is applied to lanes.
///
/// With the change d of a lane by its weights, δ = d² − 2 d (I − S) is what changes of its
/// squared error. Where fold j is held out, d_j (h_j − S_j) has the expectation of d_j (I − S_j),
/// of which an expert's [share](Weights::shares) is left with all folds.
///
/// The variance of S follows from that of the folds' means, which are independent of each other
/// even where the samples of one fold are not.
pub(super) fn judge(
    changes: &Changes<'_>,
    weights: &Weights,
    names: Vec<String>,
    notes: Vec<String>,
) -> (Judgement, ErrorRatios) {
    let sample = changes.sample;
    let parts = sample.in_tasks(|pixels| Judged::of(changes, weights, pixels));
    let mut judged = Judged::none();
    parts.into_iter().for_each(|part| judged.add(part));
    let lanes = sample.lanes().max(1) as f64;
    let trusted = judged.trust.iter().any(|&sum| sum > 0.0);
    let (ratio, interval) = interval(&judged.pixels, sample.counts.iter().sum(), trusted);
    let judgement = Judgement {
        experts: names.into_iter().zip(judged.trust.map(|sum| sum / lanes)).collect(),
        ratio,
        interval,
        notes,
        learned: false,
    };
    (judgement, judged.error_ratios())
}

/// The predicted MSE ratio and its interval, of draws that each have the change of the squared error
/// and the variance of S.
pub(super) fn interval(draws: &[[f64; 2]], samples: f64, trusted: bool) -> (f64, [f64; 2]) {
    let (gain, error) = ratio(draws);
    let ratio = (1.0 + gain).max(0.0);
    let half = if trusted { ERRORS * error + CONSTANT + FEW_SAMPLES / samples } else { 0.0 };
    (ratio, [(ratio - half).max(0.0), ratio + half])
}

/// What is judged of some pixels.
struct Judged {
    /// δ and the variance of S, of each pixel.
    pixels: Vec<[f64; 2]>,
    /// Sums of the weights of each expert.
    trust: [f64; MOST],
    /// Sums of δ, of the variance of S, and of what it would be if all samples were independent,
    /// by stratum.
    strata: [[f64; 3]; STRATA],
}

impl Judged {
    fn none() -> Self {
        Self { pixels: Vec::new(), trust: [0.0; MOST], strata: [[0.0; 3]; STRATA] }
    }

    /// Those of a task's pixels.
    fn of(changes: &Changes<'_>, weights: &Weights, pixels: Range<usize>) -> Self {
        let sample = changes.sample;
        let dispersion = dispersion(&sample.counts);
        let mut judged = Self::none();
        for pixel in pixels {
            let mut of_pixel = [0.0; 2];
            let half = sample.pixels[pixel].half.into();
            for lane in sample.lanes_of(pixel) {
                let of_lane = judged.take(changes, weights, &dispersion, lane, half);
                of_pixel.iter_mut().zip(of_lane).for_each(|(sum, of_lane)| *sum += of_lane);
            }
            judged.pixels.push(of_pixel);
        }
        judged
    }

    /// δ and the variance of a lane, which is added to the other sums.
    fn take(
        &mut self,
        changes: &Changes<'_>,
        weights: &Weights,
        dispersion: &[f64; GROUPS],
        lane: usize,
        half: usize,
    ) -> [f64; 2] {
        let all_folds = changes.missing.len();
        let weighted = |group: usize| {
            let w = weights.at(changes.strata[group][lane], half);
            let d = changes.of_lane(group, lane);
            (std::array::from_fn::<f64, MOST, _>(|expert| w[expert] * d[expert]), w)
        };
        let [mut product, mut variance] = [0.0; 2];
        for (group, missing) in changes.missing.iter().enumerate() {
            let missing = f64::from(missing[lane]);
            let of_experts = weighted(group).0.into_iter().zip(&weights.shares);
            product += of_experts.map(|(d, share)| share * d).sum::<f64>() * missing;
            variance += dispersion[group] * missing * missing;
        }
        let (of_experts, w) = weighted(all_folds);
        let d: f64 = of_experts.iter().sum();
        let change = d * d - 2.0 * product / GROUPS as f64;
        let of_samples = f64::from(changes.views[all_folds].variance[lane]);
        self.trust.iter_mut().zip(w).for_each(|(trust, w)| *trust += w);
        for (stratum, share) in cells(changes.strata[all_folds][lane]) {
            let sums = self.strata[stratum].iter_mut().zip([change, variance, of_samples]);
            sums.for_each(|(sum, of_lane)| *sum += f64::from(share) * of_lane);
        }
        [change, variance]
    }

    /// Those of the pixels that follow.
    fn add(&mut self, other: Self) {
        self.pixels.extend(other.pixels);
        self.trust.iter_mut().zip(other.trust).for_each(|(sum, more)| *sum += more);
        let sums = self.strata.iter_mut().flatten().zip(other.strata.into_iter().flatten());
        sums.for_each(|(sum, more)| *sum += more);
    }

    fn error_ratios(&self) -> ErrorRatios {
        let add = |sum: &mut [f64; 3], other: &[f64; 3], share: f64| {
            sum.iter_mut().zip(other).for_each(|(sum, other)| *sum += share * other);
        };
        ErrorRatios(shared(&self.strata, add).map(|[change, variance, of_samples]| {
            let [least, most] = RATIOS.map(|ratio| ratio * variance);
            let ratio = (variance + change).max(least).min(most) / of_samples;
            // What no lane is in has the error of S.
            if ratio.is_finite() { ratio.sqrt() } else { 1.0 }
        }))
    }
}

/// The ratio of the sums of two numbers of each pixel, and its standard error (Cochran, *Sampling
/// Techniques*, 2.11). Lanes of one pixel share samples, and are one draw.
fn ratio(pixels: &[[f64; 2]]) -> (f64, f64) {
    let [a, b] = [0, 1].map(|i| pixels.iter().map(|it| it[i]).sum::<f64>());
    if b <= 0.0 {
        return (0.0, 0.0);
    }
    let squares: f64 = pixels.iter().map(|it| (it[0] - a / b * it[1]).powi(2)).sum();
    (a / b, squares.sqrt() / b)
}

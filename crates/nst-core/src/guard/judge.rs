//! What the guard says about its own blend: how much each expert is trusted, and what that
//! gains.

use rayon::prelude::*;

use super::{
    sample::SHARE,
    simplex::MOST,
    weights::{Changes, Weights},
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
}

impl Judgement {
    /// Nothing is blended.
    pub(super) fn plain(why: &str) -> Self {
        Self { ratio: 1.0, interval: [1.0; 2], notes: vec![why.to_owned()], ..Self::default() }
    }
}

/// Judges weights by the half of the pixels that they were not learnt from.
///
/// With the change d of a lane by its weights, d² − 2 d (I − S) is what changes of its squared
/// error. Where fold j is held out, d_j (h_j − S_j) has the expectation of d_j (I − S_j), which
/// is taken to be larger than that of d (I − S) in proportion to the variances of S_j and S.
pub(super) fn judge(
    changes: &Changes<'_>,
    weights: &Weights,
    names: Vec<String>,
    notes: Vec<String>,
) -> Judgement {
    let sample = changes.sample;
    let all_folds = changes.missing.len();
    let judged: Vec<([f64; 2], [f64; MOST])> = sample
        .pixels
        .par_iter()
        .enumerate()
        .map(|(pixel, of_pixel)| {
            let [mut change, mut variance] = [0.0; 2];
            let mut trust = [0.0; MOST];
            for lane in pixel * sample.channels..(pixel + 1) * sample.channels {
                let blend = |group: usize| {
                    let w = weights.at(changes.strata[group][lane], of_pixel.half);
                    let d =
                        changes.of_lane(group, lane).into_iter().zip(w).map(|(d, w)| d * w).sum();
                    (d, w)
                };
                let products = changes.missing.iter().enumerate().map(|(group, missing)| {
                    let (d, _): (f64, _) = blend(group);
                    d * f64::from(missing[lane]) / all_folds as f64
                });
                let product: f64 = products.sum();
                let (d, w) = blend(all_folds);
                change += d * d - 2.0 * SHARE * product;
                variance += changes.views[all_folds].numbers[lane].variance;
                trust.iter_mut().zip(w).for_each(|(trust, w)| *trust += w);
            }
            ([change, variance], trust)
        })
        .collect();
    let pixels: Vec<[f64; 2]> = judged.iter().map(|(pixel, _)| *pixel).collect();
    let mut trust = [0.0; MOST];
    for (_, of_pixel) in &judged {
        trust.iter_mut().zip(of_pixel).for_each(|(sum, trust)| *sum += trust);
    }
    let lanes = sample.lanes.len().max(1) as f64;
    let samples: f64 = sample.counts.iter().sum();
    let (gain, error) = ratio(&pixels);
    let ratio = (1.0 + gain).max(0.0);
    let half = if trust.iter().all(|&sum| sum == 0.0) {
        0.0
    } else {
        ERRORS * error + CONSTANT + FEW_SAMPLES / samples
    };
    Judgement {
        experts: names.into_iter().zip(trust.map(|sum| sum / lanes)).collect(),
        ratio,
        interval: [(ratio - half).max(0.0), ratio + half],
        notes,
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

//! What the guard says about its own blend: how much each expert is trusted, and what that
//! gains.

use super::{
    sample::GROUPS,
    simplex::MOST,
    weights::{Changes, Weights},
};

/// The 97.5 % quantile of the normal distribution.
const QUANTILE: f64 = 1.96;

/// The variance of S relative to that of a mean without a fold.
const SHARE: f64 = 1.0 - 1.0 / GROUPS as f64;

/// What a [`Guard`](super::Guard) has found out on a batch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Judgement {
    /// The experts, and the mean of each one's weight over the lanes: from 0, not trusted at
    /// all, to 1.
    pub experts: Vec<(String, f64)>,
    /// The MSE ratio that is predicted, E[(T − I)²]/E[(S − I)²]: below 1 is a gain.
    pub ratio: f64,
    /// The 95 % interval of that.
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
/// error. Where fold j is held out, d_j (h_j − S_j) has the expectation of d_j (I − S_j): that
/// of d (I − S), but for the noise of S_j, which is that of fewer samples. The sum over a
/// pixel's channels is one draw, and the ratio of the sums of these and of the variances of S
/// has the interval of a ratio (Cochran, *Sampling Techniques*, 2.11).
pub(super) fn judge(
    changes: &Changes<'_>,
    weights: &Weights,
    names: Vec<String>,
    notes: Vec<String>,
) -> Judgement {
    let sample = changes.sample;
    let all_folds = changes.missing.len();
    let of_lane = |group: usize, lane: usize, half: usize| {
        let w = weights.at(&changes.place(group, lane), half);
        let d: f64 = changes.of_lane(group, lane).into_iter().zip(w).map(|(d, w)| d * w).sum();
        (d, w)
    };
    let mut trust = [0.0; MOST];
    let mut pixels: Vec<[f64; 2]> = Vec::with_capacity(sample.pixels.len());
    for (pixel, of_pixel) in sample.pixels.iter().enumerate() {
        let [mut change, mut variance] = [0.0; 2];
        for lane in pixel * sample.channels..(pixel + 1) * sample.channels {
            let (d, w) = of_lane(all_folds, lane, of_pixel.half);
            let products = changes.missing.iter().enumerate().map(|(group, missing)| {
                of_lane(group, lane, of_pixel.half).0 * f64::from(missing[lane])
            });
            let product = products.sum::<f64>() / all_folds as f64;
            change += d * d - 2.0 * SHARE * product;
            variance += changes.views[all_folds].variance(lane);
            trust.iter_mut().zip(w).for_each(|(trust, w)| *trust += w);
        }
        pixels.push([change, variance]);
    }
    let [change, variance] = [0, 1].map(|i| pixels.iter().map(|it| it[i]).sum::<f64>());
    let gain = if variance > 0.0 { change / variance } else { 0.0 };
    let squares: f64 = pixels.iter().map(|it| (it[0] - gain * it[1]).powi(2)).sum();
    let error = if variance > 0.0 { squares.sqrt() / variance } else { 0.0 };
    let lanes = sample.lanes.len().max(1) as f64;
    let ratio = (1.0 + gain).max(0.0);
    Judgement {
        experts: names.into_iter().zip(trust.map(|sum| sum / lanes)).collect(),
        ratio,
        interval: [-1.0, 1.0].map(|sign| (ratio + sign * QUANTILE * error).max(0.0)),
        notes,
    }
}

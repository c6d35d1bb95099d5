//! What the guard says about its own blend: how much each expert is trusted, and what that
//! gains.

use super::{
    sample::SHARE,
    simplex::MOST,
    weights::{Changes, Weights},
};

/// The 97.5 % quantile of the normal distribution.
const QUANTILE: f64 = 1.96;

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
/// error, and where fold j is held out, d_j (h_j − S_j) has the expectation of d_j (I − S_j).
/// So the sums of d_j² − 2 d_j (h_j − S_j) say what estimates without a fold gain. With all
/// folds, d is known, and d (I − S) is taken to be smaller in proportion to the variance of
/// S. The interval is that of both figures: how far they differ says how far that may err.
pub(super) fn judge(
    changes: &Changes<'_>,
    weights: &Weights,
    names: Vec<String>,
    notes: Vec<String>,
) -> Judgement {
    let sample = changes.sample;
    let all_folds = changes.missing.len();
    let mut trust = [0.0; MOST];
    let [mut without, mut with_all] = [0, 1].map(|_| Ratio::with_capacity(sample.pixels.len()));
    for (pixel, of_pixel) in sample.pixels.iter().enumerate() {
        let [mut without_a_fold, mut with_all_folds] = [[0.0; 2]; 2];
        for lane in pixel * sample.channels..(pixel + 1) * sample.channels {
            let change = |group: usize| {
                let w = weights.at(&changes.place(group, lane), of_pixel.half);
                let d = changes.of_lane(group, lane).into_iter().zip(w).map(|(d, w)| d * w).sum();
                (d, w)
            };
            let mut product = 0.0;
            for (group, missing) in changes.missing.iter().enumerate() {
                let (d, _): (f64, _) = change(group);
                let missing = f64::from(missing[lane]);
                product += d * missing / all_folds as f64;
                without_a_fold[0] += d * d - 2.0 * d * missing;
                without_a_fold[1] += changes.views[group].variance(lane);
            }
            let (d, w) = change(all_folds);
            with_all_folds[0] += d * d - 2.0 * SHARE * product;
            with_all_folds[1] += changes.views[all_folds].variance(lane);
            trust.iter_mut().zip(w).for_each(|(trust, w)| *trust += w);
        }
        without.pixels.push(without_a_fold);
        with_all.pixels.push(with_all_folds);
    }
    let [(low, _, high), (other_low, ratio, other_high)] =
        [without, with_all].map(|ratio| ratio.estimate());
    let lanes = sample.lanes.len().max(1) as f64;
    Judgement {
        experts: names.into_iter().zip(trust.map(|sum| sum / lanes)).collect(),
        ratio,
        interval: [low.min(other_low), high.max(other_high)],
        notes,
    }
}

/// A change of squared errors, and the variance of S, of each pixel: lanes of one pixel share
/// samples, and are one draw.
struct Ratio {
    pixels: Vec<[f64; 2]>,
}

impl Ratio {
    fn with_capacity(pixels: usize) -> Self {
        Self { pixels: Vec::with_capacity(pixels) }
    }

    /// 1 + the ratio of the sums, between the ends of its 95 % interval (Cochran, *Sampling
    /// Techniques*, 2.11).
    fn estimate(&self) -> (f64, f64, f64) {
        let [change, variance] = [0, 1].map(|i| self.pixels.iter().map(|it| it[i]).sum::<f64>());
        if variance <= 0.0 {
            return (1.0, 1.0, 1.0);
        }
        let gain = change / variance;
        let squares: f64 = self.pixels.iter().map(|it| (it[0] - gain * it[1]).powi(2)).sum();
        let error = QUANTILE * squares.sqrt() / variance;
        let [low, ratio, high] = [-error, 0.0, error].map(|it| (1.0 + gain + it).max(0.0));
        (low, ratio, high)
    }
}

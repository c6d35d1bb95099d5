//! Lanes as they look without a group of folds, in numbers that have no dimension.

use rayon::prelude::*;

use super::{
    hats::{Hats, Place},
    sample::{LaneMeans, shares_without},
    seen::Seen,
};
use crate::FOLDS;

/// Brightness, ln(|S|/u + [`FLOOR`]): from a hundredth of the unit to 55 times it.
pub(super) const BRIGHTNESS: Hats<10> = Hats { low: -4.6, high: 4.0 };

/// Spread, ln(v + [`FLOOR`]) with the relative variance v of a sample: from .018 to 400.
pub(super) const SPREAD: Hats<6> = Hats { low: -4.0, high: 6.0 };

/// Uncertainty, ln(SE/|S| + .001): from .7 % to 100 %.
pub(super) const UNCERTAINTY: Hats<4> = Hats { low: -5.0, high: 0.0 };

/// What brightness and spread do not tell from 0.
const FLOOR: f64 = 0.01;

/// Below this share of the unit a lane is dark: its spread would be rounding.
const DARK: f64 = 1e-9;

/// The most standard errors of S that a correction may be: what lies farther is no noise.
const MOST_ERRORS: f64 = 2.0;

/// Statistics of lanes over the folds that are not held out, `[lane]`.
#[derive(Clone, Debug)]
pub(super) struct View {
    samples: f64,
    /// The mean of |S| over all lanes of the batch.
    pub(super) unit: f64,
    pub(super) mean: Vec<f32>,
    root: Vec<f32>,
    square: Vec<f32>,
}

/// What corrections and strata are computed from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Numbers {
    /// S
    pub(super) mean: f64,
    /// s = |S| + .01 u, to which corrections are in proportion.
    pub(super) scale: f64,
    /// The variance of S, estimated.
    pub(super) variance: f64,
    /// The relative variance of the root of a sample: κ = 1 − (mean √y)²/S, from 0 to 1.
    pub(super) root_spread: f64,
    /// ln(s/u)
    pub(super) log_scale: f64,
    /// ln(v + .01) of the relative variance v of a sample, which counts as 0 in the dark.
    pub(super) log_spread: f64,
    /// Where S, v, and the standard error of S relative to S lie.
    pub(super) brightness: Place,
    pub(super) spread: Place,
    pub(super) uncertainty: Place,
}

impl View {
    /// Without a group of folds; of all folds, if there is no such group.
    pub(super) fn new(lanes: &[LaneMeans], counts: &[f64; FOLDS], group: usize, unit: f64) -> Self {
        let shares = shares_without(counts, group);
        let of_kind = |kind: usize| -> Vec<f32> {
            let mean = |lane: &LaneMeans| {
                lane[kind].iter().zip(shares).map(|(x, share)| share * f64::from(*x)).sum::<f64>()
            };
            lanes.iter().map(|lane| mean(lane) as f32).collect()
        };
        let samples = counts.iter().enumerate().filter(|(fold, _)| *fold != group);
        let samples = samples.map(|(_, count)| count).sum();
        Self { samples, unit, mean: of_kind(0), root: of_kind(1), square: of_kind(2) }
    }

    /// What an expert sees.
    pub(super) fn seen(&self) -> Seen<'_> {
        let Self { samples, unit, mean, root, square } = self;
        Seen { samples: *samples, unit: *unit, mean, root, square, further: &[] }
    }

    pub(super) fn numbers(&self, lane: usize) -> Numbers {
        let (mean, root) = (f64::from(self.mean[lane]), f64::from(self.root[lane]));
        let size = mean.abs();
        let variance = self.seen().variance(lane);
        let (mut spread, mut root_spread) = (0.0, 0.0);
        if size > DARK * self.unit {
            spread = variance * self.samples / (size * size);
            root_spread = (1.0 - root * root / size).clamp(0.0, 1.0);
        }
        let scale = size + FLOOR * self.unit;
        let (log_scale, log_spread) = ((scale / self.unit).ln(), (spread + FLOOR).ln());
        Numbers {
            mean,
            scale,
            variance,
            root_spread,
            log_scale,
            log_spread,
            brightness: BRIGHTNESS.place(log_scale),
            spread: SPREAD.place(log_spread),
            uncertainty: UNCERTAINTY.place(((spread / self.samples).sqrt() + 0.001).ln()),
        }
    }
}

/// Where the brightness of an estimate lies.
pub(super) fn brightness(estimate: f64, unit: f64) -> Place {
    BRIGHTNESS.place((estimate.abs() / unit + FLOOR).ln())
}

/// The numbers of all lanes of a view, `[lane]`.
#[derive(Clone, Debug)]
pub(super) struct Lanes {
    pub(super) unit: f64,
    pub(super) numbers: Vec<Numbers>,
}

impl Lanes {
    pub(super) fn of(view: &View) -> Self {
        let numbers = (0..view.mean.len()).into_par_iter().map(|lane| view.numbers(lane));
        Self { unit: view.unit, numbers: numbers.collect() }
    }
}

impl Numbers {
    /// A correction, within what may be noise of S. Towards 0 it ends there. Away from 0 it is
    /// the smaller the more S depends on few samples: those are bright by chance more often
    /// than others are dark.
    pub(super) fn bounded(&self, change: f64) -> f64 {
        let most = MOST_ERRORS * self.variance.sqrt();
        let (towards, away) = (most.min(self.mean.abs()), most * (1.0 - self.root_spread));
        if self.mean < 0.0 { change.clamp(-away, towards) } else { change.clamp(-towards, away) }
    }
}

//! Lanes as they look without a group of folds, in numbers that have no dimension.

use std::ops::Range;

use super::{
    hats::{Hats, Place},
    logarithm::ln,
    sample::{FoldMeans, FurtherMeans, shares_without},
    seen::Seen,
};
use crate::{FOLDS, Power, filter::write_mean};

/// Brightness, ln(|S|/u + [`FLOOR`]): from a hundredth of the unit to 55 times it.
pub(super) const BRIGHTNESS: Hats<10> = Hats { low: -4.6, high: 4.0 };

/// Spread, ln(v + [`FLOOR`]) with the relative variance v of a sample: from .018 to 400.
pub(super) const SPREAD: Hats<6> = Hats { low: -4.0, high: 6.0 };

/// Uncertainty, ln(SE/|S| + [`CERTAIN`]): from .7 % to 100 %.
pub(super) const UNCERTAINTY: Hats<4> = Hats { low: -5.0, high: 0.0 };

/// What brightness and spread do not tell from 0.
const FLOOR: f64 = 0.01;

/// What uncertainty does not tell from 0.
const CERTAIN: f64 = 0.001;

/// Below this share of the unit a lane is dark: its spread would be rounding.
const DARK: f64 = 1e-9;

/// The most standard errors of S that a correction may be: what lies farther is no noise.
const MOST_ERRORS: f32 = 2.0;

/// Statistics of lanes over the folds that are not held out, `[lane]`.
#[derive(Clone, Debug)]
pub(super) struct View {
    samples: f64,
    /// A unit: the mean of |S| over the lanes that are learnt from.
    pub(super) unit: f64,
    pub(super) mean: Vec<f32>,
    root: Vec<f32>,
    square: Vec<f32>,
    further: Vec<(Power, Vec<f32>)>,
}

/// What corrections and strata are computed from, `[lane]` each.
#[derive(Clone, Debug)]
pub(super) struct Lanes {
    pub(super) unit: f64,
    /// S
    pub(super) mean: Vec<f32>,
    /// The variance of S, estimated.
    pub(super) variance: Vec<f32>,
    /// The relative variance of the root of a sample: κ = 1 − (mean √y)²/S, from 0 to 1.
    pub(super) root_spread: Vec<f32>,
    /// ln(s/u), with the scale s = |S| + .01 u, to which corrections are in proportion.
    pub(super) log_scale: Vec<f32>,
    /// ln(v + .01) of the relative variance v of a sample, which counts as 0 in the dark.
    pub(super) log_spread: Vec<f32>,
    /// ln(SE/|S| + .001), in the same way.
    log_uncertainty: Vec<f32>,
}

impl View {
    /// Without a group of folds; of all folds, if there is no such group. Without a unit, it is
    /// that of these lanes.
    pub(super) fn new(
        means: &FoldMeans<'_>,
        further: &FurtherMeans<'_>,
        counts: &[f64; FOLDS],
        group: usize,
        unit: Option<f64>,
    ) -> Self {
        let shares = shares_without(counts, group);
        let [mean, root, square] = means.map(|folds| weighted(&folds, &shares));
        let samples = counts.iter().enumerate().filter(|(fold, _)| *fold != group);
        let samples = samples.map(|(_, count)| count).sum();
        let unit = unit.unwrap_or_else(|| {
            mean.iter().map(|&x| f64::from(x).abs()).sum::<f64>() / mean.len() as f64
        });
        let of_power = |(power, folds): &(Power, [&[f32]; FOLDS])| {
            (*power, power_means(*power, folds, &shares))
        };
        let further = further.iter().map(of_power).collect();
        Self { samples, unit, mean, root, square, further }
    }

    /// What an expert sees.
    pub(super) fn seen(&self) -> Seen<'_> {
        let Self { samples, unit, mean, root, square, further } = self;
        Seen { samples: *samples, unit: *unit, mean, root, square, further }
    }

    /// The numbers of all lanes. No loop has many arrays, so that the compiler vectorises it.
    pub(super) fn lanes(self) -> Lanes {
        let Self { samples, unit, mean, root, square, .. } = self;
        let [floor, certain, unit_size] = [FLOOR, CERTAIN, unit].map(|x| x as f32);
        let variance = variances(&mean, &square, samples);
        // In the dark, everything is rounding.
        let dark = (DARK * unit) as f32;
        let light = |size: f32| if size > dark { 1.0 } else { 0.0 };
        let root_spread = |(mean, &root): (&f32, &f32)| {
            let size = mean.abs();
            (light(size) * (1.0 - root * root / size.max(f32::MIN_POSITIVE))).clamp(0.0, 1.0)
        };
        let root_spread = mean.iter().zip(&root).map(root_spread).collect();
        let relative = |(mean, &variance): (&f32, &f32)| {
            let size = f64::from(mean.abs());
            let relative = f64::from(variance) / (size * size).max(f64::MIN_POSITIVE);
            light(mean.abs()) * relative as f32
        };
        let relative: Vec<f32> = mean.iter().zip(&variance).map(relative).collect();
        let log = |x: f32| ln(x + floor);
        let log_scale = mean.iter().map(|x| log(x.abs() / unit_size)).collect();
        let log_spread = relative.iter().map(|x| log(x * samples as f32)).collect();
        let log_uncertainty = relative.iter().map(|x| ln(x.sqrt() + certain)).collect();
        Lanes { unit, mean, variance, root_spread, log_scale, log_spread, log_uncertainty }
    }

    /// Whether all numbers are finite that a lane's corrections depend on, `[lane]`.
    pub(super) fn finite(&self) -> Vec<bool> {
        let numbers = self.mean.iter().zip(&self.root).zip(&self.square);
        numbers.map(|((a, b), c)| a.is_finite() & b.is_finite() & c.is_finite()).collect()
    }
}

/// The estimated variances of means of samples, `[lane]`.
fn variances(mean: &[f32], square: &[f32], samples: f64) -> Vec<f32> {
    let share = (samples - 1.0).max(1.0).recip();
    let variance = |(&mean, &square): (&f32, &f32)| {
        let (mean, square) = (f64::from(mean), f64::from(square));
        ((square - mean * mean).max(0.0) * share) as f32
    };
    mean.iter().zip(square).map(variance).collect()
}

/// The weighted mean over folds, `[lane]`.
fn weighted(folds: &[&[f32]; FOLDS], shares: &[f64; FOLDS]) -> Vec<f32> {
    let mut means = vec![0.0; folds[0].len()];
    write_mean(folds, shares, &mut means);
    means
}

/// The power mean over folds, weighted, `[lane]`.
fn power_means(power: Power, folds: &[&[f32]; FOLDS], shares: &[f64; FOLDS]) -> Vec<f32> {
    let of_lane = |lane: usize| {
        // A fold without a share may have no samples.
        let folds = folds.iter().zip(shares).filter(|(_, share)| **share > 0.0);
        power.mean_of(folds.map(|(fold, share)| share * power.of(fold[lane].into())).sum()) as f32
    };
    (0..folds[0].len()).map(of_lane).collect()
}

impl Lanes {
    /// s = |S| + .01 u
    pub(super) fn scale(&self, lane: usize) -> f64 {
        f64::from(self.mean[lane]).abs() + FLOOR * self.unit
    }

    /// The same of some lanes, rounded.
    #[inline(always)]
    pub(super) fn scales(&self, part: Range<usize>) -> impl Iterator<Item = f32> {
        let least = (FLOOR * self.unit) as f32;
        self.mean[part].iter().map(move |mean| mean.abs() + least)
    }

    /// Where the brightness of S lies.
    pub(super) fn brightness(&self, lane: usize) -> Place {
        BRIGHTNESS.place(self.log_scale[lane])
    }

    pub(super) fn spread(&self, lane: usize) -> Place {
        SPREAD.place(self.log_spread[lane])
    }

    pub(super) fn uncertainty(&self, lane: usize) -> Place {
        UNCERTAINTY.place(self.log_uncertainty[lane])
    }

    /// Where the brightness of estimates lies that differ from S by `changes`, `[lane]`; one below
    /// 0 lies where 0 is.
    pub(super) fn brightness_with(&self, changes: &[f32]) -> impl Iterator<Item = Place> + use<> {
        let (unit, floor) = (self.unit as f32, FLOOR as f32);
        let estimates = self.mean.iter().zip(changes).map(|(mean, change)| mean + change);
        let logs: Vec<f32> = estimates.map(|x| ln(x.max(0.0) / unit + floor)).collect();
        logs.into_iter().map(|log| BRIGHTNESS.place(log))
    }

    /// Keeps corrections, `[lane]`, within what may be noise of S. Towards 0 it ends there. Away
    /// from 0 it is the smaller the more S depends on few samples: those are bright by chance more
    /// often than others are dark.
    pub(super) fn bound(&self, corrections: &mut [f32]) {
        let lanes = self.mean.iter().zip(&self.variance).zip(&self.root_spread);
        for (correction, ((&mean, &variance), &root_spread)) in corrections.iter_mut().zip(lanes) {
            let most = MOST_ERRORS * variance.sqrt();
            let away = most * (1.0 - root_spread);
            let towards = most.min(mean.abs());
            let (down, up) = if mean < 0.0 { (away, towards) } else { (towards, away) };
            // A NaN is no change; and bounds may be one, in lanes that keep S.
            let change = if correction.is_nan() { 0.0 } else { *correction };
            *correction = change.max(-down).min(up);
        }
    }
}

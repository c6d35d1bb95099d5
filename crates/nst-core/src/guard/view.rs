//! Lanes as they look without a group of folds, in numbers that have no dimension.

use super::{
    hats::{Hats, Place},
    logarithm::ln,
    sample::{FoldMeans, FurtherMeans, shares_without},
    seen::Seen,
};
use crate::{FOLDS, Power};

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
const MOST_ERRORS: f64 = 2.0;

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

    /// The numbers of all lanes. `plain` estimates, where they are given, are S to the bit.
    pub(super) fn lanes(self) -> Lanes {
        let count = self.mean.len();
        let zeros = || vec![0.0; count];
        let mut lanes = Lanes {
            unit: self.unit,
            variance: zeros(),
            root_spread: zeros(),
            log_scale: zeros(),
            log_spread: zeros(),
            log_uncertainty: zeros(),
            mean: Vec::new(),
        };
        let (dark, unit, samples) = (DARK * self.unit, self.unit, self.samples);
        let freedom = (samples - 1.0).max(1.0);
        let (root, square) = (&self.root[..count], &self.square[..count]);
        let (variances, root_spread) =
            (&mut lanes.variance[..count], &mut lanes.root_spread[..count]);
        let (log_scale, log_spread) =
            (&mut lanes.log_scale[..count], &mut lanes.log_spread[..count]);
        let log_uncertainty = &mut lanes.log_uncertainty[..count];
        for lane in 0..count {
            let (mean, root) = (f64::from(self.mean[lane]), f64::from(root[lane]));
            let size = mean.abs();
            let variance = (f64::from(square[lane]) - mean * mean).max(0.0) / freedom;
            // In the dark, everything is rounding.
            let light = if size > dark { 1.0 } else { 0.0 };
            let spread = light * (variance / (size * size).max(f64::MIN_POSITIVE));
            variances[lane] = variance as f32;
            root_spread[lane] =
                (light * (1.0 - root * root / size.max(f64::MIN_POSITIVE))).clamp(0.0, 1.0) as f32;
            log_scale[lane] = ln((size / unit + FLOOR) as f32);
            log_spread[lane] = ln((spread * samples + FLOOR) as f32);
            log_uncertainty[lane] = ln((spread.sqrt() + CERTAIN) as f32);
        }
        lanes.mean = self.mean;
        lanes
    }
}

/// The weighted mean over folds, `[lane]`.
fn weighted(folds: &[&[f32]; FOLDS], shares: &[f64; FOLDS]) -> Vec<f32> {
    let [a, b, c, d] = folds;
    let quadruples = a.iter().zip(*b).zip(c.iter().zip(*d));
    let mean = |((&a, &b), (&c, &d)): ((&f32, &f32), (&f32, &f32))| {
        let [a, b, c, d] = [a, b, c, d].map(f64::from);
        (shares[0] * a + shares[1] * b + (shares[2] * c + shares[3] * d)) as f32
    };
    quadruples.map(mean).collect()
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

    /// Where the brightness of an estimate lies; one below 0 lies where 0 is.
    pub(super) fn brightness_of(&self, estimate: f64) -> Place {
        BRIGHTNESS.place(ln((estimate.max(0.0) / self.unit + FLOOR) as f32))
    }

    /// A correction, within what may be noise of S. Towards 0 it ends there. Away from 0 it is
    /// the smaller the more S depends on few samples: those are bright by chance more often
    /// than others are dark.
    pub(super) fn bounded(&self, lane: usize, change: f64) -> f32 {
        let mean = f64::from(self.mean[lane]);
        let most = MOST_ERRORS * f64::from(self.variance[lane]).sqrt();
        let away = most * (1.0 - f64::from(self.root_spread[lane]));
        let towards = most.min(mean.abs());
        let (down, up) = if mean < 0.0 { (away, towards) } else { (towards, away) };
        // A NaN is no change; and bounds may be one, in lanes that keep S.
        if change.is_nan() { 0.0 } else { change.max(-down).min(up) as f32 }
    }
}

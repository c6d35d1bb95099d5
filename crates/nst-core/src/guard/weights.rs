//! How far each expert is trusted, by strata of brightness and uncertainty.

use rayon::prelude::*;

use super::{
    hats::Place,
    sample::{SHARE, Sample},
    simplex::{MOST, Moments, best_weights, certainty},
    table::PIXELS_PER_TASK,
    view::{BRIGHTNESS, Lanes, Numbers, UNCERTAINTY, brightness},
};

const COLUMNS: usize = UNCERTAINTY.knots();
const ROWS: usize = BRIGHTNESS.knots();
const STRATA: usize = ROWS * COLUMNS;

/// How many variances of the noise are taken off a gain.
const CAUTION: f64 = 4.0;

/// The gain, relative to the variance of S, up to which a stratum keeps S: errors of pictures
/// are judged relative to their brightness, too, and there a small gain may be a loss.
const LEAST_GAIN: f64 = 0.05;

/// The share of its sums that a stratum gives to each of its neighbours.
const SHARED: f64 = 0.2;

/// What the experts change, `[group][lane]`, and where the lanes lie.
pub(super) struct Changes<'a> {
    pub(super) sample: &'a Sample,
    /// `[group]`; after the groups, that of all folds.
    pub(super) views: &'a [Lanes],
    /// The means of the groups held out minus the plain estimates, `[group][lane]`.
    pub(super) missing: &'a [Vec<f32>],
    /// `[expert][group][lane]`; after the groups, those of all folds.
    pub(super) changes: Vec<Vec<Vec<f32>>>,
    /// `[group][lane]`
    pub(super) strata: Vec<Vec<Strata>>,
}

/// The weights of the experts in each stratum, by the half that they were learnt from.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    strata: [[[f64; MOST]; STRATA]; 2],
}

/// Sums of a stratum.
#[derive(Clone, Copy, Default)]
struct Stratum {
    moments: Moments,
    /// The covariance of the noise of b, `[expert][expert]`.
    noise: [[f64; MOST]; MOST],
    /// Of S without a group, summed over lanes and groups.
    variance: f64,
}

impl<'a> Changes<'a> {
    pub(super) fn new(
        sample: &'a Sample,
        views: &'a [Lanes],
        missing: &'a [Vec<f32>],
        changes: Vec<Vec<Vec<f32>>>,
    ) -> Self {
        let of_view = |(view, changes): (&Lanes, &Vec<f32>)| {
            let lanes = view.numbers.par_iter().zip(changes);
            lanes.map(|(numbers, &change)| strata(view.unit, numbers, change.into())).collect()
        };
        let strata = views.iter().zip(&changes[0]).map(of_view).collect();
        Self { sample, views, missing, changes, strata }
    }

    /// By how much each expert's changes are smaller with all folds than without one: the root
    /// of the ratio of the sums of their squares.
    fn shrinkage(&self) -> Vec<f64> {
        let squares = |lanes: &Vec<f32>| lanes.iter().map(|&d| f64::from(d).powi(2)).sum::<f64>();
        let ratio = |of_expert: &Vec<Vec<f32>>| {
            let (with_all, without) = of_expert.split_last().expect("all folds are last");
            let without: f64 = without.iter().map(squares).sum();
            let ratio = (squares(with_all) * self.missing.len() as f64 / without).sqrt();
            // One that changes nothing has none.
            if ratio.is_finite() { ratio } else { 1.0 }
        };
        self.changes.iter().map(ratio).collect()
    }

    /// What each expert changes.
    pub(super) fn of_lane(&self, group: usize, lane: usize) -> [f64; MOST] {
        std::array::from_fn(|k| {
            self.changes.get(k).map_or(0.0, |groups| f64::from(groups[group][lane]))
        })
    }
}

impl Weights {
    pub(super) fn fit(changes: &Changes<'_>) -> Self {
        let tasks = changes.sample.pixels.len().div_ceil(PIXELS_PER_TASK);
        let parts: Vec<_> =
            (0..tasks).into_par_iter().map(|task| sums(changes, task * PIXELS_PER_TASK)).collect();
        let mut total = [[Stratum::default(); STRATA]; 2];
        for part in &parts {
            let strata = total.iter_mut().flatten().zip(part.iter().flatten());
            strata.for_each(|(sum, part)| sum.add(part, 1.0, 1.0));
        }
        let shrinkage = changes.shrinkage();
        Self { strata: total.map(|half| weights(&smoothed(&half), &shrinkage)) }
    }

    /// The weights of a lane whose pixel is in this half, learnt from the other.
    pub(super) fn at(&self, strata: Strata, half: usize) -> [f64; MOST] {
        let of_half = &self.strata[1 - half];
        let cells = cells(strata);
        std::array::from_fn(|k| cells.iter().map(|&(cell, share)| share * of_half[cell][k]).sum())
    }
}

/// Where a lane lies in brightness and in uncertainty.
pub(super) type Strata = [Place; 2];

/// The four strata that a lane lies between, and its shares of them.
fn cells([brightness, uncertainty]: Strata) -> [(usize, f64); 4] {
    let (rows, columns) = (brightness.knots(), uncertainty.knots());
    std::array::from_fn(|i| {
        let ((row, a), (column, b)) = (rows[i / 2], columns[i % 2]);
        (row * COLUMNS + column, a * b)
    })
}

/// The strata of a lane: the brightness is that of the first expert's estimate, which has less
/// noise than S.
pub(super) fn strata(unit: f64, numbers: &Numbers, first_change: f64) -> Strata {
    [brightness((numbers.mean + first_change).max(0.0), unit), numbers.uncertainty]
}

/// The sums of a task's pixels, `[half][stratum]`.
fn sums(changes: &Changes<'_>, first: usize) -> [[Stratum; STRATA]; 2] {
    let Changes { sample, missing, changes: experts, .. } = changes;
    let count = experts.len();
    let mut sums = [[Stratum::default(); STRATA]; 2];
    let end = sample.pixels.len().min(first + PIXELS_PER_TASK);
    for pixel in first..end {
        let sums = &mut sums[sample.pixels[pixel].half];
        // Channels share samples, and what is held out of a pixel in turn adds to 0: noise is
        // that of a pixel's sum.
        let mut of_pixel = [[0.0; MOST]; STRATA];
        for (group, missing) in missing.iter().enumerate() {
            for lane in pixel * sample.channels..(pixel + 1) * sample.channels {
                let d = changes.of_lane(group, lane);
                let variance = changes.views[group].numbers[lane].variance;
                for (stratum, share) in cells(changes.strata[group][lane]) {
                    sums[stratum].variance += share * variance;
                    for i in 0..count {
                        of_pixel[stratum][i] += share * d[i] * f64::from(missing[lane]);
                        for j in 0..count {
                            sums[stratum].moments.a[i][j] += share * d[i] * d[j];
                        }
                    }
                }
            }
        }
        for (sum, of_pixel) in sums.iter_mut().zip(&of_pixel) {
            for i in 0..count {
                sum.moments.b[i] += of_pixel[i];
                for j in 0..count {
                    sum.noise[i][j] += of_pixel[i] * of_pixel[j];
                }
            }
        }
    }
    sums
}

impl Stratum {
    /// Adds a share of another's moments, and a share of its noise.
    fn add(&mut self, other: &Self, share: f64, noise_share: f64) {
        self.variance += share * other.variance;
        for i in 0..MOST {
            self.moments.b[i] += share * other.moments.b[i];
            for j in 0..MOST {
                self.moments.a[i][j] += share * other.moments.a[i][j];
                self.noise[i][j] += noise_share * other.noise[i][j];
            }
        }
    }
}

/// Strata that share their sums with their neighbours in brightness, then in uncertainty; the
/// ends keep what has no neighbour.
fn smoothed(strata: &[Stratum; STRATA]) -> [Stratum; STRATA] {
    let by_row = shared(strata, |i| (i / COLUMNS, ROWS), COLUMNS);
    shared(&by_row, |i| (i % COLUMNS, COLUMNS), 1)
}

/// Shares sums along an axis: the place on it and its length, and the step between neighbours.
fn shared(
    strata: &[Stratum; STRATA],
    axis: impl Fn(usize) -> (usize, usize),
    step: usize,
) -> [Stratum; STRATA] {
    let mut smooth = [Stratum::default(); STRATA];
    for (i, stratum) in strata.iter().enumerate() {
        let (place, length) = axis(i);
        let kept = 1.0 - 2.0 * SHARED;
        smooth[i].add(stratum, kept, kept * kept);
        let before = if place == 0 { i } else { i - step };
        let after = if place + 1 == length { i } else { i + step };
        smooth[before].add(stratum, SHARED, SHARED * SHARED);
        smooth[after].add(stratum, SHARED, SHARED * SHARED);
    }
    smooth
}

/// The best weights of each stratum, drawn towards 0 by as much of the gain as may be noise.
fn weights(strata: &[Stratum; STRATA], shrinkage: &[f64]) -> [[f64; MOST]; STRATA] {
    let count = shrinkage.len();
    strata.map(|Stratum { mut moments, mut noise, variance }| {
        // What all samples lack is less than what those without a group lack, and so is what
        // the experts change.
        moments.b.iter_mut().for_each(|b| *b *= SHARE);
        for i in 0..count {
            for j in 0..count {
                moments.a[i][j] *= shrinkage[i] * shrinkage[j];
            }
        }
        noise.iter_mut().flatten().for_each(|noise| *noise *= SHARE * SHARE);
        let variance = SHARE * variance;
        let w = best_weights(&moments, &noise, count);
        let gain: f64 = (0..count).map(|i| w[i] * moments.b[i]).sum();
        let pairs = (0..count).flat_map(|i| (0..count).map(move |j| (i, j)));
        let chance: f64 = pairs.map(|(i, j)| w[i] * noise[i][j] * w[j]).sum();
        let worth = -moments.change(&w) / (LEAST_GAIN * variance) - 1.0;
        // A NaN is no gain.
        let worth = if worth > 0.0 { worth.min(1.0) } else { 0.0 };
        w.map(|w| w * certainty(gain, chance, CAUTION) * worth)
    })
}

//! How far each expert is trusted, by strata of brightness and uncertainty.

use std::ops::Range;

use rayon::prelude::*;

use super::{
    hats::{Place, grid_cells},
    sample::{GROUPS, SHARE, Sample, dispersion},
    simplex::{MOST, Moments, best_weights, certainty},
    view::{BRIGHTNESS, Lanes, UNCERTAINTY},
};

const COLUMNS: usize = UNCERTAINTY.knots();
const ROWS: usize = BRIGHTNESS.knots();
pub(super) const STRATA: usize = ROWS * COLUMNS;
const _: () = assert!(STRATA <= u64::BITS as usize, "sets of strata are in one number");

/// What the guard calls the experts that learn from the batch itself; they come before others.
pub(super) const CORRECTIONS: [&str; 3] = ["relative regression", "regression", "table"];

/// How many variances of the noise are taken off a gain.
const CAUTION: f64 = 4.0;

/// The gain, relative to the variance of S, up to which a stratum keeps S: errors of pictures
/// are judged relative to their brightness, too, and there a small gain may be a loss. Of the two
/// estimates of the variance, the less counts: where samples depend on each other it is that by the
/// folds; where bright samples are rare that is noise, and may be far too large. With the
/// folds' alone, relative errors were larger in pictures.
const LEAST_GAIN: f64 = 0.05;

/// The share of its sums that a stratum gives to each of its neighbours.
const SHARED: f64 = 0.2;

/// What the experts change in the lanes of a sample.
pub(super) struct Changes<'a> {
    pub(super) sample: &'a Sample,
    /// `[group]`; after the groups, that of all folds.
    pub(super) views: &'a [Lanes],
    /// The means of the groups held out minus the plain estimates, `[group][lane]`.
    pub(super) missing: &'a [Vec<f32>],
    /// `[group][expert][lane]`; after the groups, those of all folds.
    pub(super) changes: &'a [Vec<Vec<f32>>],
    /// `[group][lane]`; after the groups, those of all folds.
    pub(super) strata: Vec<Vec<Strata>>,
}

/// The weights of the experts in each stratum, by the half that they were learnt from.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    strata: [[[f32; MOST]; STRATA]; 2],
    /// What is left of E[d (I − S)] of each expert with all folds, of that without one.
    pub(super) shares: [f64; MOST],
}

/// Sums of a stratum.
#[derive(Clone, Copy, Default)]
struct Stratum {
    moments: Moments,
    /// The covariance of the noise of b, `[expert][expert]`.
    noise: [[f64; MOST]; MOST],
    /// That of S, summed over lanes and groups: by the samples, and by how folds differ.
    variances: [f64; 2],
}

impl<'a> Changes<'a> {
    pub(super) fn new(
        sample: &'a Sample,
        views: &'a [Lanes],
        missing: &'a [Vec<f32>],
        changes: &'a [Vec<Vec<f32>>],
    ) -> Self {
        let of_view = |(view, changes): (&Lanes, &Vec<Vec<f32>>)| strata(view, &changes[0]);
        let strata = views.par_iter().zip(changes).map(of_view).collect();
        Self { sample, views, missing, changes, strata }
    }

    /// How many experts there are.
    fn count(&self) -> usize {
        self.changes[0].len()
    }

    /// By how much each expert's changes are smaller with all folds than without one: the root
    /// of the ratio of the sums of their squares.
    fn shrinkage(&self) -> Vec<f64> {
        let squares = |lanes: &Vec<f32>| lanes.iter().map(|&d| f64::from(d).powi(2)).sum::<f64>();
        let (with_all, without) = self.changes.split_last().expect("all folds are last");
        let ratio = |expert: usize| {
            let all = squares(&with_all[expert]) * without.len() as f64;
            let held_out: f64 = without.iter().map(|experts| squares(&experts[expert])).sum();
            let ratio = (all / held_out).sqrt();
            // One that changes nothing has none.
            if ratio.is_finite() { ratio } else { 1.0 }
        };
        (0..self.count()).map(ratio).collect()
    }

    /// Whether what each expert changes with all folds goes with what it changes without one. What
    /// is held out speaks of the latter alone: where samples take few values, as where all are 0 or
    /// 1, lanes of all folds may be unlike any without one, and a regression says anything of them.
    fn agrees(&self) -> Vec<bool> {
        let (with_all, without) = self.changes.split_last().expect("all folds are last");
        let product = |(all, held_out): (&Vec<f32>, &Vec<f32>)| {
            let products = all.iter().zip(held_out).map(|(&a, &b)| f64::from(a) * f64::from(b));
            products.sum::<f64>()
        };
        let of_expert = |expert: usize| {
            let pairs = without.iter().map(|experts| (&with_all[expert], &experts[expert]));
            pairs.map(product).sum::<f64>() > 0.0
        };
        (0..self.count()).map(of_expert).collect()
    }

    /// What each expert changes.
    #[inline(always)]
    pub(super) fn of_lane(&self, group: usize, lane: usize) -> [f64; MOST] {
        let mut of_lane = [0.0; MOST];
        let changes = of_lane.iter_mut().zip(&self.changes[group]);
        changes.for_each(|(d, lanes)| *d = f64::from(lanes[lane]));
        of_lane
    }
}

impl Weights {
    pub(super) fn fit(changes: &Changes<'_>) -> Self {
        let parts = changes.sample.in_tasks(|pixels| sums(changes, pixels));
        let mut total = [[Stratum::default(); STRATA]; 2];
        for part in &parts {
            let strata = total.iter_mut().flatten().zip(part.iter().flatten());
            strata.for_each(|(sum, part)| sum.add(part, 1.0, 1.0));
        }
        let shrinkage = changes.shrinkage();
        let mut shares = shares(&shrinkage);
        let of_experts = shares.iter_mut().zip(changes.agrees());
        of_experts.filter(|(_, agrees)| !agrees).for_each(|(share, _)| *share = 0.0);
        let strata = total.map(|half| {
            weights(&smoothed(&half), &shrinkage, &shares).map(|of| of.map(|w| w as f32))
        });
        Self { strata, shares }
    }

    /// The weights of a lane whose pixel is in this half, learnt from the other.
    #[inline(always)]
    pub(super) fn at(&self, strata: Strata, half: usize) -> [f64; MOST] {
        let of_half = &self.strata[1 - half];
        let mut weights = [0.0; MOST];
        for (cell, share) in cells(strata) {
            for (weight, w) in weights.iter_mut().zip(&of_half[cell]) {
                *weight += f64::from(share * w);
            }
        }
        weights
    }

    /// S with the weighted changes of a lane, of `[expert][lane]`.
    #[inline(always)]
    pub(super) fn blend(
        &self,
        strata: Strata,
        half: usize,
        plain: f32,
        changes: &[Vec<f32>],
        lane: usize,
    ) -> f32 {
        let of_half = &self.strata[1 - half];
        let cells = cells(strata).map(|(cell, share)| (&of_half[cell], share));
        let mut estimate = plain;
        for (expert, of_expert) in changes.iter().enumerate().take(MOST) {
            let mut weight = 0.0;
            for (weights, share) in cells {
                weight += share * weights[expert];
            }
            estimate += weight * of_expert[lane];
        }
        estimate
    }
}

/// Where a lane lies in brightness and in uncertainty.
pub(super) type Strata = [Place; 2];

/// The four strata that a lane lies between, and its shares of them.
#[inline(always)]
pub(super) fn cells([brightness, uncertainty]: Strata) -> [(usize, f32); 4] {
    grid_cells(brightness, uncertainty, COLUMNS)
}

/// The strata of lanes: the brightness is that of the first expert's estimate, which has less
/// noise than S.
pub(super) fn strata(lanes: &Lanes, first_changes: &[f32]) -> Vec<Strata> {
    let brightness = lanes.brightness_with(first_changes).enumerate();
    brightness.map(|(lane, brightness)| [brightness, lanes.uncertainty(lane)]).collect()
}

/// The sums of a task's pixels, `[half][stratum]`.
fn sums(changes: &Changes<'_>, pixels: Range<usize>) -> [[Stratum; STRATA]; 2] {
    let Changes { sample, missing, .. } = changes;
    let count = changes.count();
    let dispersion = dispersion(&sample.counts);
    let mut sums = [[Stratum::default(); STRATA]; 2];
    // Channels share samples, and what is held out of a pixel in turn adds to 0: noise is that
    // of a pixel's sum.
    let mut of_pixel = [[0.0; MOST]; STRATA];
    for pixel in pixels {
        let sums = &mut sums[usize::from(sample.pixels[pixel].half)];
        let mut touched = 0_u64;
        for (group, missing) in missing.iter().enumerate() {
            for lane in sample.lanes_of(pixel) {
                let d = changes.of_lane(group, lane);
                let by_samples = SHARE * f64::from(changes.views[group].variance[lane]);
                let by_folds = GROUPS as f64 * dispersion[group] * f64::from(missing[lane]).powi(2);
                for (stratum, share) in cells(changes.strata[group][lane]) {
                    let share = f64::from(share);
                    touched |= 1 << stratum;
                    let variances = sums[stratum].variances.iter_mut().zip([by_samples, by_folds]);
                    variances.for_each(|(sum, variance)| *sum += share * variance);
                    for i in 0..count {
                        of_pixel[stratum][i] += share * d[i] * f64::from(missing[lane]);
                        for j in 0..count {
                            sums[stratum].moments.a[i][j] += share * d[i] * d[j];
                        }
                    }
                }
            }
        }
        while touched != 0 {
            let stratum = touched.trailing_zeros() as usize;
            touched &= touched - 1;
            sums[stratum].take(&std::mem::take(&mut of_pixel[stratum]), count);
        }
    }
    sums
}

impl Stratum {
    /// Adds the products of a pixel, which are one draw.
    fn take(&mut self, products: &[f64; MOST], count: usize) {
        for i in 0..count {
            self.moments.b[i] += products[i];
            for j in 0..count {
                self.noise[i][j] += products[i] * products[j];
            }
        }
    }

    /// Adds a share of another's moments, and a share of its noise.
    fn add(&mut self, other: &Self, share: f64, noise_share: f64) {
        let variances = self.variances.iter_mut().zip(other.variances);
        variances.for_each(|(sum, variance)| *sum += share * variance);
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
    let add = |sum: &mut Stratum, other: &Stratum, share: f64| sum.add(other, share, share * share);
    shared(strata, add)
}

/// Sums of strata that are smoothed in this way; `add` adds a share of a stratum to another.
pub(super) fn shared<T: Copy + Default>(
    strata: &[T; STRATA],
    add: impl Fn(&mut T, &T, f64),
) -> [T; STRATA] {
    let along = |strata: &[T; STRATA], step: usize, length: usize| {
        let mut smooth = [T::default(); STRATA];
        for (i, stratum) in strata.iter().enumerate() {
            let place = i / step % length;
            let before = if place == 0 { i } else { i - step };
            let after = if place + 1 == length { i } else { i + step };
            add(&mut smooth[i], stratum, 1.0 - 2.0 * SHARED);
            add(&mut smooth[before], stratum, SHARED);
            add(&mut smooth[after], stratum, SHARED);
        }
        smooth
    };
    along(&along(strata, COLUMNS, ROWS), 1, COLUMNS)
}

/// What is left of E[d (I − S)] with all folds, of that without one, by how much changes shrink.
///
/// Where the errors of S + d do not depend on those of S, it is S's variance V: ¾ of it is left.
/// But with few samples, the best T is mostly what it knows of such integrals; its error has no
/// correlation with anything known, E[(I − T) d] = 0, so that E[d (I − S)] = E[d²] = V − E[(I − T)²]
/// falls by more than V does. So an expert has the less of ¾ and of what is left of its d²; not the
/// corrections, which change little: where bright samples are rare, that is noise.
fn shares(shrinkage: &[f64]) -> [f64; MOST] {
    let mut shares = [SHARE; MOST];
    let of_experts = shares.iter_mut().zip(shrinkage).skip(CORRECTIONS.len());
    of_experts.for_each(|(share, shrinkage)| *share = share.min(shrinkage * shrinkage));
    shares
}

/// The best weights of each stratum, drawn towards 0 by as much of the gain as may be noise.
fn weights(
    strata: &[Stratum; STRATA],
    shrinkage: &[f64],
    shares: &[f64; MOST],
) -> [[f64; MOST]; STRATA] {
    let count = shrinkage.len();
    strata.map(|Stratum { mut moments, mut noise, variances }| {
        // What all samples lack is less than what those without a group lack, and so is what
        // the experts change.
        moments.b.iter_mut().zip(shares).for_each(|(b, share)| *b *= share);
        for i in 0..count {
            for j in 0..count {
                moments.a[i][j] *= shrinkage[i] * shrinkage[j];
                noise[i][j] *= shares[i] * shares[j];
            }
        }
        let variance = variances[0].min(variances[1]);
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

//! The layers of a strip, without a group of folds: what surfaces reflect, and the emission that
//! the camera sees directly. Denoisers smear lamps over what is around them, unless they get the
//! two one by one.

use rayon::prelude::*;

use super::{
    super::{
        sample::{FoldMeans, GROUPS, fold_means, shares_without},
        view::weighted,
    },
    seen::SeenFeature,
};
use crate::{FOLDS, Grid, SequenceBatch, Side, root};

/// What is read of a strip.
pub(super) struct Strip<'a> {
    pub(super) batch: &'a SequenceBatch,
    pub(super) grid: &'a Grid,
    means: FoldMeans<'a>,
    /// `[fold]`
    albedo: Option<[&'a [f32]; FOLDS]>,
    normal: Option<[&'a [f32]; FOLDS]>,
    emission: Option<[&'a [f32]; FOLDS]>,
}

/// A part of the radiance, over all folds but one group.
pub(super) struct Layer {
    /// How many draws the means are over.
    pub(super) samples: f64,
    /// `[lane]`
    pub(super) mean: Vec<f32>,
    /// The mean of the roots, `[lane]`.
    pub(super) root: Vec<f32>,
}

/// Both, with what else the camera sees.
pub(super) struct Layers {
    pub(super) reflected: Layer,
    /// If anything is known of it.
    pub(super) emitted: Option<Layer>,
    /// `[lane]`
    pub(super) albedo: Option<Feature>,
    /// `[coordinate][pixel]`
    pub(super) normal: Option<Feature>,
}

/// The means of a feature, and their variances.
pub(super) struct Feature {
    mean: Vec<f32>,
    variance: Vec<f32>,
}

impl Feature {
    /// Of folds, weighted.
    fn new(folds: &[&[f32]; FOLDS], shares: &[f64; FOLDS]) -> Self {
        let mean = weighted(folds, shares);
        let kept = shares.iter().filter(|share| **share > 0.0).count() as f32;
        let of_one = |i: usize| {
            let folds = folds.iter().zip(shares).filter(|(_, share)| **share > 0.0);
            let squares: f32 = folds.map(|(fold, _)| (fold[i] - mean[i]).powi(2)).sum();
            squares / (kept * (kept - 1.0))
        };
        let variance = (0..mean.len()).into_par_iter().map(of_one).collect();
        Self { mean, variance }
    }

    pub(super) fn seen(&self) -> SeenFeature<'_> {
        SeenFeature { mean: &self.mean, variance: &self.variance }
    }
}

impl<'a> Strip<'a> {
    /// `None` if the strip has no grid, or no statistics of folds.
    pub(super) fn new(batch: &'a SequenceBatch) -> Option<Self> {
        let [albedo, normal, emission] = Side::FEATURE_FOLDS.map(|sides| batch.of_folds(sides));
        Some(Self {
            batch,
            grid: batch.grid()?,
            means: fold_means(batch)?,
            albedo,
            normal,
            emission: emission.filter(|_| std::env::var("NOE").is_err()),
        })
    }

    /// The layers without a group; of all folds, if there is no such group.
    pub(super) fn layers(&self, counts: &[f64; FOLDS], group: usize) -> Layers {
        let shares = shares_without(counts, group);
        let samples = (0..FOLDS).filter(|fold| *fold != group).map(|fold| counts[fold]).sum();
        let mut mean = match group {
            GROUPS => self.batch.last().to_vec(),
            _ => weighted(&self.means[0], &shares),
        };
        let mut root = weighted(&self.means[1], &shares);
        let emitted = self.emission.map(|folds| emitted(&folds, &shares));
        if let Some(emitted) = &emitted {
            subtract(self.grid, emitted, &mut mean, &mut root);
        }
        let of_folds = |folds: Option<_>| folds.map(|it| Feature::new(&it, &shares));
        let [albedo, normal] = [self.albedo, self.normal].map(of_folds);
        Layers { reflected: Layer { samples, mean, root }, emitted, albedo, normal }
    }

    /// What the group held out says of each part beside the layers without it, `[lane]` of the
    /// inner rows: h − S.
    pub(super) fn missing(&self, group: usize, layers: &Layers) -> [Vec<f32>; 2] {
        let inner = |lanes: &[f32]| self.grid.inner(lanes).into_owned();
        let held_out = self.means[0][group];
        let Some(emitted) = &layers.emitted else {
            let missing = held_out.iter().zip(&layers.reflected.mean).map(|(h, s)| h - s);
            return [inner(&missing.collect::<Vec<_>>()), Vec::new()];
        };
        let of_emission = self.emission.expect("its layer exists")[group];
        let reflected = held_out.iter().zip(of_emission).zip(&layers.reflected.mean);
        let reflected: Vec<f32> = reflected.map(|((h, e), s)| h - e - s).collect();
        let emitted: Vec<f32> = of_emission.iter().zip(&emitted.mean).map(|(h, s)| h - s).collect();
        [inner(&reflected), inner(&emitted)]
    }
}

impl Strip<'_> {
    /// The variances of S if all samples were independent, up to a factor, `[lane]` of the inner rows.
    pub(super) fn variances(&self) -> Vec<f32> {
        let squares = weighted(&self.means[2], &[0.25; FOLDS]);
        let lanes = squares.iter().zip(self.batch.last());
        let variances: Vec<f32> = lanes.map(|(square, s)| (square - s * s).max(0.0)).collect();
        self.grid.inner(&variances).into_owned()
    }
}

/// The emission. Roots of its samples are not known, so that its draws are the folds.
fn emitted(folds: &[&[f32]; FOLDS], shares: &[f64; FOLDS]) -> Layer {
    let mean = weighted(folds, shares);
    let of_lane = |lane: usize| {
        let folds = folds.iter().zip(shares).filter(|(_, share)| **share > 0.0);
        folds.map(|(fold, share)| share * root(f64::from(fold[lane]))).sum::<f64>() as f32
    };
    let root = (0..mean.len()).into_par_iter().map(of_lane).collect();
    let samples = shares.iter().filter(|share| **share > 0.0).count() as f64;
    Layer { samples, mean, root }
}

/// Takes the emission out of means. Where there is any, roots of the rest are not known.
fn subtract(grid: &Grid, emitted: &Layer, mean: &mut [f32], root: &mut [f32]) {
    let pixels = grid.pixels();
    for (mean, emission) in mean.iter_mut().zip(&emitted.mean) {
        *mean -= emission;
    }
    for pixel in 0..pixels {
        let lanes = (pixel..mean.len()).step_by(pixels);
        if lanes.clone().any(|lane| emitted.mean[lane] != 0.0) {
            lanes.for_each(|lane| root[lane] = f32::NAN);
        }
    }
}

//! The layers of a strip, without a group of folds: what surfaces reflect, and the emission that
//! the camera sees directly. Denoisers smear lamps over what is around them, unless they get the
//! two one by one.

use rayon::prelude::*;

use super::{
    super::sample::{FoldMeans, GROUPS, fold_means, shares_without},
    seen::SeenFeature,
};
use crate::{FOLDS, Grid, SequenceBatch, Side, filter::mean_over_folds};

/// The features that are read where there are any: by fold, as they are as noisy as radiance where
/// a pixel sees several surfaces.
pub(super) const FEATURES: &[Side] = Side::FEATURES.split_at(4).1;

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

/// A part of the radiance.
pub(super) struct Layer {
    /// `[lane]`
    pub(super) mean: Vec<f32>,
    /// The mean of the roots, `[lane]`.
    pub(super) root: Vec<f32>,
}

/// Where the emission is in [`Layers::parts`].
pub(super) const EMITTED: usize = 1;

/// What the camera sees, over all folds but one group.
pub(super) struct Layers {
    /// How many samples of each lane.
    pub(super) samples: f64,
    /// What surfaces reflect; and the emission, if anything is known of it.
    pub(super) parts: Vec<Layer>,
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
        let mean = mean_over_folds(folds, shares);
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
            emission,
        })
    }

    /// The layers without a group; of all folds, if there is no such group.
    pub(super) fn layers(&self, counts: &[f64; FOLDS], group: usize) -> Layers {
        let shares = shares_without(counts, group);
        let samples = (0..FOLDS).filter(|fold| *fold != group).map(|fold| counts[fold]).sum();
        let mut mean = match group {
            GROUPS => self.batch.last().to_vec(),
            _ => mean_over_folds(&self.means[0], &shares),
        };
        let mut root = mean_over_folds(&self.means[1], &shares);
        let mut emitted = None;
        if let Some(folds) = &self.emission {
            let emission = mean_over_folds(folds, &shares);
            subtract(self.grid, &emission, &mut mean, &mut root);
            // Its roots are not known.
            emitted = Some(Layer { root: vec![f32::NAN; emission.len()], mean: emission });
        }
        let parts = [Layer { mean, root }].into_iter().chain(emitted).collect();
        let of_folds = |folds: Option<_>| folds.map(|it| Feature::new(&it, &shares));
        let [albedo, normal] = [self.albedo, self.normal].map(of_folds);
        Layers { samples, parts, albedo, normal }
    }

    /// What the group held out says of each part beside the layers without it, h − S, `[lane]` of
    /// the inner rows; nothing, if there is no such group.
    pub(super) fn missing(&self, group: usize, layers: &Layers) -> Vec<Vec<f32>> {
        if group == GROUPS {
            return vec![Vec::new(); layers.parts.len()];
        }
        let emission = self.emission.map(|folds| folds[group]);
        let mut reflected = self.means[0][group].to_vec();
        if let Some(emission) = emission {
            reflected.iter_mut().zip(emission).for_each(|(h, e)| *h -= e);
        }
        let held_out = [Some(&reflected[..]), emission].into_iter().flatten();
        let of_part = |(layer, held_out): (&Layer, &[f32])| {
            let missing = held_out.iter().zip(&layer.mean).map(|(h, s)| h - s);
            self.grid.inner(&missing.collect::<Vec<_>>()).into_owned()
        };
        layers.parts.iter().zip(held_out).map(of_part).collect()
    }

    /// The variances of S if all samples were independent, up to a factor, `[lane]` of the inner
    /// rows.
    pub(super) fn variances(&self) -> Vec<f32> {
        let squares = mean_over_folds(&self.means[2], &[1.0 / FOLDS as f64; FOLDS]);
        let lanes = squares.iter().zip(self.batch.last());
        let variances: Vec<f32> = lanes.map(|(square, s)| (square - s * s).max(0.0)).collect();
        self.grid.inner(&variances).into_owned()
    }
}

/// Takes the emission out of means. Where there is any, roots of the rest are not known.
fn subtract(grid: &Grid, emission: &[f32], mean: &mut [f32], root: &mut [f32]) {
    mean.iter_mut().zip(emission).for_each(|(mean, emission)| *mean -= emission);
    for pixel in 0..grid.pixels() {
        let lanes = (pixel..mean.len()).step_by(grid.pixels());
        if lanes.clone().any(|lane| emission[lane] != 0.0) {
            lanes.for_each(|lane| root[lane] = f32::NAN);
        }
    }
}

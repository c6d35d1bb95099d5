//! The layers of a strip, without a group of folds: what surfaces reflect, and the emission that
//! the camera sees directly. Denoisers smear lamps over what is around them, unless they get the
//! two one by one.

use std::borrow::Cow;

use rayon::prelude::*;

use super::{
    super::sample::{CHUNK, FoldMeans, GROUPS, fold_means, of_inner, shares_without},
    odd::{Odd, part_of},
    seen::SeenFeature,
};
use crate::{
    FOLDS, Grid, SequenceBatch, Side,
    filter::{mean_over_folds, write_mean},
};

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
    /// As far as it is a part of the radiance.
    emission: Option<[Cow<'a, [f32]>; FOLDS]>,
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
    /// Which pixels emit, `[pixel]`; none, if nothing is known of that.
    pub(super) emits: Vec<bool>,
    /// `[lane]`
    pub(super) albedo: Option<Feature>,
    /// `[coordinate][pixel]`
    pub(super) normal: Option<Feature>,
}

impl Layers {
    /// Whether no sample of a pixel has seen a surface, as far as normals tell.
    pub(super) fn sees_no_surface(&self, pixel: usize) -> bool {
        self.normal.as_ref().is_some_and(|Feature { mean, .. }| {
            mean.chunks_exact(mean.len() / 3).all(|plane| plane[pixel] == 0.0)
        })
    }

    /// Which of the inner rows have a pixel that emits.
    pub(super) fn rows_that_emit(&self, grid: &Grid) -> Vec<bool> {
        let rows = grid.inner_rows().map(|row| &self.emits[row * grid.width()..][..grid.width()]);
        rows.map(|row| row.contains(&true)).collect()
    }
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
        let kept = folds.iter().zip(shares).filter(|(_, share)| **share > 0.0);
        let kept: Vec<&[f32]> = kept.map(|(fold, _)| *fold).collect();
        let pairs = (kept.len() * (kept.len() - 1)) as f32;
        let mut variance = vec![0.0; mean.len()];
        let chunks = variance.par_chunks_mut(CHUNK).zip(mean.par_chunks(CHUNK));
        chunks.enumerate().for_each(|(number, (variances, means))| {
            for fold in &kept {
                let numbers = variances.iter_mut().zip(means).zip(&fold[number * CHUNK..]);
                numbers.for_each(|((sum, mean), x)| *sum += (x - mean) * (x - mean));
            }
            variances.iter_mut().for_each(|sum| *sum /= pairs);
        });
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
        let (grid, means) = (batch.grid()?, fold_means(batch)?);
        let part = |fold: usize, emission| part_of(emission, means[0][fold]);
        let emission = emission.map(|folds| std::array::from_fn(|fold| part(fold, folds[fold])));
        Some(Self { batch, grid, means, albedo, normal, emission })
    }

    /// Counts pixels of the inner rows whose features are not what they are called.
    pub(super) fn count_odd(&self, odd: &mut Odd) {
        let surfaces: Vec<&[f32]> =
            self.albedo.iter().chain(&self.normal).flatten().copied().collect();
        odd.add_surfaces(self.grid, &surfaces);
        let emission = self.batch.of_folds(Side::FEATURE_FOLDS[2]);
        if let (Some(emission), Some(parts)) = (&emission, &self.emission) {
            odd.add_emission(self.grid, emission, parts);
        }
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
        let (mut emitted, mut emits) = (None, Vec::new());
        if let Some(folds) = &self.emission {
            let emission = mean_over_folds(&folds.each_ref().map(|fold| &**fold), &shares);
            emits = self.emits(&emission);
            self.subtract(&emission, &emits, &mut mean, &mut root);
            // Its roots are not known.
            emitted = Some(Layer { root: vec![f32::NAN; emission.len()], mean: emission });
        }
        let parts = [Layer { mean, root }].into_iter().chain(emitted).collect();
        let of_folds = |folds: Option<_>| folds.map(|it| Feature::new(&it, &shares));
        let [albedo, normal] = [self.albedo, self.normal].map(of_folds);
        Layers { samples, parts, emits, albedo, normal }
    }

    /// Which pixels emit, `[pixel]`.
    fn emits(&self, emission: &[f32]) -> Vec<bool> {
        let mut emits = vec![false; self.grid.pixels()];
        emits.par_chunks_mut(CHUNK).enumerate().for_each(|(number, emits)| {
            for plane in emission.chunks_exact(self.grid.pixels()) {
                let pixels = emits.iter_mut().zip(&plane[number * CHUNK..]);
                pixels.for_each(|(emits, x)| *emits |= *x != 0.0);
            }
        });
        emits
    }

    /// Takes the emission out of means. Where there is any, roots of the rest are not known.
    fn subtract(&self, emission: &[f32], emits: &[bool], mean: &mut [f32], root: &mut [f32]) {
        mean.par_iter_mut().zip(emission).for_each(|(mean, emission)| *mean -= emission);
        for plane in root.chunks_exact_mut(self.grid.pixels()) {
            let roots = plane.par_iter_mut().zip(emits);
            roots.for_each(|(root, emits)| *root = if *emits { f32::NAN } else { *root });
        }
    }

    /// What the group held out says of each part beside the layers without it, h − S, `[lane]` of
    /// the inner rows; nothing, if there is no such group.
    pub(super) fn missing(&self, group: usize, layers: &Layers) -> Vec<Vec<f32>> {
        if group == GROUPS {
            return vec![Vec::new(); layers.parts.len()];
        }
        let held_out = self.means[0][group];
        let emission = self.emission.as_ref().map(|folds| &*folds[group]);
        let of_part = |(part, layer): (usize, &Layer)| match emission {
            Some(emission) if part == EMITTED => self.differences(emission, &layer.mean),
            Some(emission) => of_inner(self.grid, |lanes, out| {
                let numbers = held_out[lanes.clone()].iter().zip(&emission[lanes.clone()]);
                let numbers = out.iter_mut().zip(numbers).zip(&layer.mean[lanes]);
                numbers.for_each(|((out, (h, e)), s)| *out = h - e - s);
            }),
            None => self.differences(held_out, &layer.mean),
        };
        layers.parts.iter().enumerate().map(of_part).collect()
    }

    /// The differences of numbers of lanes, `[lane]` of the inner rows.
    fn differences(&self, a: &[f32], b: &[f32]) -> Vec<f32> {
        of_inner(self.grid, |lanes, out| {
            let numbers = out.iter_mut().zip(&a[lanes.clone()]).zip(&b[lanes]);
            numbers.for_each(|((out, a), b)| *out = a - b);
        })
    }

    /// The variances of S if all samples were independent, up to a factor, `[lane]` of the inner
    /// rows.
    pub(super) fn variances(&self) -> Vec<f32> {
        let squares = self.means[2];
        of_inner(self.grid, |lanes, out| {
            let last = &self.batch.last()[lanes.clone()];
            let folds = squares.map(|fold| &fold[lanes.clone()]);
            write_mean(&folds, &[1.0 / FOLDS as f64; FOLDS], out);
            out.iter_mut().zip(last).for_each(|(square, s)| *square = (*square - s * s).max(0.0));
        })
    }
}

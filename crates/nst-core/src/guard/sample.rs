//! One pass over a batch: its units, and a sample of its pixels small enough for memory.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use crate::{Error, FOLDS, LANES_PER_BLOCK, SequenceBatch, Side, Strips, fold_count, random::mix};

/// The most pixels that weights are fitted to. Their sums are far from noise then.
const MOST_PIXELS: usize = 1 << 15;

/// Means of y, √y and y² over each fold of a lane, `[kind][fold]`.
pub(super) type LaneMeans = [[f32; FOLDS]; 3];

/// How many groups of folds are held out in turn: each fold is one.
pub(super) const GROUPS: usize = FOLDS;

/// The variance of S relative to that of a mean without a group.
pub(super) const SHARE: f64 = 1.0 - 1.0 / GROUPS as f64;

/// Pixels of a batch, with what their lanes' folds say. Without a grid each lane is a pixel.
#[derive(Clone, Debug, Default)]
pub(super) struct Sample {
    /// `[pixel]`, by increasing number
    pub(super) pixels: Vec<Pixel>,
    /// `[pixel][channel]`
    pub(super) lanes: Vec<LaneMeans>,
    /// The variances of S, `[pixel][channel]`; empty if they are not known.
    variances: Vec<f32>,
    pub(super) channels: usize,
    /// How many samples are in each fold of a lane.
    pub(super) counts: [f64; FOLDS],
    /// The mean of |S| over all lanes of the batch, without each of the groups, and of all.
    pub(super) units: [f64; GROUPS + 1],
    /// How many lanes the batch has.
    pub(super) all_lanes: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pixel {
    /// Which half of the chessboard it is in.
    pub(super) half: usize,
    hash: u64,
    number: u64,
}

/// What a block of lanes contributes.
#[derive(Default)]
struct Part {
    pixels: Vec<Pixel>,
    lanes: Vec<LaneMeans>,
    variances: Vec<f32>,
    units: [f64; GROUPS + 1],
    finite: usize,
}

impl Sample {
    /// Goes over the strips once. `None` if they lack a side channel of folds.
    pub(super) fn take(strips: &mut dyn Strips) -> Result<Option<Self>, Error> {
        strips.rewind(0)?;
        let mut sample = Self::default();
        let (mut sums, mut finite, mut n) = ([0.0; GROUPS + 1], 0, 0);
        let limit = AtomicU64::new(u64::MAX);
        while let Some(strip) = strips.next_strip()? {
            let strip = &*strip;
            let Some(sides) = sides(strip) else { return Ok(None) };
            sample.channels = strip.grid().map_or(1, |grid| grid.channels());
            n = *strip.sample_counts().last().expect("a batch has a term");
            sample.counts = std::array::from_fn(|fold| fold_count(fold, n));
            let first = sample.all_lanes;
            let blocks = strip
                .grid()
                .map_or_else(|| strip.lanes().div_ceil(LANES_PER_BLOCK), |grid| grid.rows());
            let parts: Vec<Part> = (0..blocks)
                .into_par_iter()
                .map(|block| sample.part(strip, &sides, first, block, &limit))
                .collect();
            sample.all_lanes += strip.lanes();
            for part in parts {
                sample.pixels.extend(part.pixels);
                sample.lanes.extend(part.lanes);
                sample.variances.extend(part.variances);
                finite += part.finite;
                sums.iter_mut().zip(part.units).for_each(|(sum, part)| *sum += part);
            }
            sample.thin_out(&limit);
        }
        sample.units = sums.map(|sum| sum / finite.max(1) as f64);
        sample.count_pictures(n);
        Ok(Some(sample))
    }

    /// The pixels of a row, or of a block of lanes.
    fn part(
        &self,
        strip: &SequenceBatch,
        sides: &[[&[f32]; FOLDS]; 3],
        first: usize,
        block: usize,
        limit: &AtomicU64,
    ) -> Part {
        let limit = limit.load(Ordering::Relaxed);
        let mut part = Part::default();
        let shares: [_; GROUPS + 1] =
            std::array::from_fn(|group| shares_without(&self.counts, group));
        let (pixels, plane) = match strip.grid() {
            Some(grid) => (grid.width() * block..grid.width() * (block + 1), grid.pixels()),
            None => {
                let from = block * LANES_PER_BLOCK;
                (from..strip.lanes().min(from + LANES_PER_BLOCK), 0)
            }
        };
        for pixel in pixels {
            let of_pixel = (0..self.channels).map(|channel| channel * plane + pixel);
            let lanes =
                of_pixel.clone().map(|lane| sides.map(|folds| folds.map(|fold| fold[lane])));
            let number = (first / self.channels + pixel) as u64;
            let half = strip.half(pixel);
            if !lanes.clone().all(|lane| lane.iter().flatten().all(|x| x.is_finite())) {
                continue;
            }
            part.finite += self.channels;
            for lane in lanes.clone() {
                for (unit, shares) in part.units.iter_mut().zip(&shares) {
                    let mean: f64 =
                        lane[0].iter().zip(shares).map(|(x, share)| share * f64::from(*x)).sum();
                    *unit += mean.abs();
                }
            }
            let hash = mix(number);
            if hash <= limit {
                part.pixels.push(Pixel { half, hash, number });
                part.lanes.extend(lanes);
                let variance = strip.side(&Side::Variance);
                part.variances.extend(
                    variance.into_iter().flat_map(|it| of_pixel.clone().map(|lane| it[lane])),
                );
            }
        }
        part
    }

    /// Halves the share of pixels that are kept until they are few enough. Which are left does
    /// not depend on when this is done.
    fn thin_out(&mut self, limit: &AtomicU64) {
        while self.pixels.len() > MOST_PIXELS {
            let half = limit.load(Ordering::Relaxed) / 2;
            limit.store(half, Ordering::Relaxed);
            let keep: Vec<bool> = self.pixels.iter().map(|pixel| pixel.hash <= half).collect();
            let mut kept = keep.iter();
            self.pixels.retain(|_| *kept.next().expect("as many"));
            let mut kept = keep.iter().flat_map(|keep| std::iter::repeat_n(keep, self.channels));
            self.lanes.retain(|_| *kept.next().expect("as many"));
            let mut kept = keep.iter().flat_map(|keep| std::iter::repeat_n(keep, self.channels));
            self.variances.retain(|_| *kept.next().expect("as many"));
        }
    }

    /// Where pictures of several samples each were packed, folds have as many samples as
    /// pictures: how many these are follows from the variance of S, Σ(y² − y̅²)/(N − 1).
    fn count_pictures(&mut self, n: u32) {
        let shares = shares_without(&self.counts, GROUPS);
        let mean = |means: [f32; FOLDS]| -> f64 {
            means.iter().zip(shares).map(|(x, share)| share * f64::from(*x)).sum()
        };
        let [mut spread, mut variance] = [0.0; 2];
        for ([folds, _, squares], &of_mean) in self.lanes.iter().zip(&self.variances) {
            if of_mean.is_finite() {
                spread += (mean(*squares) - mean(*folds).powi(2)).max(0.0);
                variance += f64::from(of_mean);
            }
        }
        let pictures = 1.0 + spread / variance;
        // Means of folds are rounded: near n it is n.
        if pictures.is_finite() && pictures < 0.9 * f64::from(n) {
            let count = pictures.round().max(FOLDS as f64) as u32;
            self.counts = std::array::from_fn(|fold| fold_count(fold, count));
        }
    }
}

/// The side channels of folds of a strip, `[kind][fold][lane]`.
pub(super) fn sides(strip: &SequenceBatch) -> Option<[[&[f32]; FOLDS]; 3]> {
    let mut found = [[&[][..]; FOLDS]; 3];
    for (kind, sides) in Side::OF_FOLDS.into_iter().enumerate() {
        for (fold, side) in sides.iter().enumerate() {
            found[kind][fold] = strip.side(side)?;
        }
    }
    Some(found)
}

/// The shares of the folds in the mean without a group; of all, if there is no such group.
pub(super) fn shares_without(counts: &[f64; FOLDS], group: usize) -> [f64; FOLDS] {
    let kept = |fold: usize| if fold == group { 0.0 } else { counts[fold] };
    let count: f64 = (0..FOLDS).map(kept).sum();
    std::array::from_fn(|fold| kept(fold) / count)
}

//! One pass over a batch: a sample of its pixels, small enough to learn from it in no time.

use std::ops::Range;

use rayon::prelude::*;

use crate::{
    Error, FOLDS, FurtherPowers, Grid, Power, SequenceBatch, Side, Status, Strips, fold_count,
    random::mix,
};

/// The most pixels that weights are fitted to; of batches that have more, at least half as
/// many are. Their sums are far from noise then.
const MOST_PIXELS: usize = 20_000;

/// Pixels whose sums are one task of the thread pool, added in one order.
const PIXELS_PER_TASK: usize = 1024;

/// Lanes per task of the thread pool when estimates are made.
pub(super) const CHUNK: usize = 4096;

/// How many groups of folds are held out in turn: each fold is one.
pub(super) const GROUPS: usize = FOLDS;

/// The variance of S relative to that of a mean without a group.
pub(super) const SHARE: f64 = 1.0 - 1.0 / GROUPS as f64;

/// Means of y, √y and y² over each fold, `[kind][fold][lane]`.
pub(super) type FoldMeans<'a> = [[&'a [f32]; FOLDS]; 3];

/// Power means of further powers over each fold, `[fold][lane]`.
pub(super) type FurtherMeans<'a> = Vec<(Power, [&'a [f32]; FOLDS])>;

/// Pixels of a batch, with what their lanes' folds say. Without a grid each lane is a pixel.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    /// `[pixel]`, by increasing number
    pub(super) pixels: Vec<Pixel>,
    /// `[kind][fold]`, `[pixel][channel]`
    means: [[Vec<f32>; FOLDS]; 3],
    /// Those of further powers, `[fold]`, `[pixel][channel]`.
    further: Vec<(Power, [Vec<f32>; FOLDS])>,
    /// The variances of S, `[pixel][channel]`; empty if they are not known.
    variances: Vec<f32>,
    pub(super) channels: usize,
    /// How many samples are in each fold of a lane.
    pub(super) counts: [f64; FOLDS],
    /// How many samples of each lane there are.
    samples: u32,
    /// Whether a strip had no statistics of folds.
    lacks_folds: bool,
    /// Whether the strips are rows of a picture.
    pub(super) has_grid: bool,
    /// How many pixels the strips have had so far, by how many zeros their hashes begin with.
    zeros: [usize; ZEROS],
}

/// Hashes begin with 0 to 64 zeros.
const ZEROS: usize = u64::BITS as usize + 1;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pixel {
    /// Which half of the chessboard it is in.
    pub(super) half: u8,
    /// How many zeros the hash of its number begins with.
    zeros: u8,
}

impl Default for Sample {
    fn default() -> Self {
        Self {
            pixels: Vec::new(),
            means: Default::default(),
            further: Vec::new(),
            variances: Vec::new(),
            channels: 1,
            counts: [0.0; FOLDS],
            samples: 0,
            lacks_folds: false,
            has_grid: false,
            zeros: [0; ZEROS],
        }
    }
}

impl Sample {
    /// Of no strips yet. Of these further powers, it will have those that the strips have.
    pub(super) fn new(powers: FurtherPowers) -> Self {
        let further = powers.iter().map(|power| (power, Default::default())).collect();
        Self { further, ..Self::default() }
    }

    /// Adds the next strip. Returns whether it has what is needed; others make no difference
    /// if it has not.
    pub(super) fn add(&mut self, strip: &SequenceBatch) -> bool {
        self.samples = *strip.sample_counts().last().expect("a batch has a term");
        match fold_means(strip) {
            Some(means) => self.add_pixels(strip, &means),
            None => self.lacks_folds = true,
        }
        !self.lacks_folds
    }

    /// Adds all strips, which are read with such a halo.
    ///
    /// # Errors
    /// Those of `strips`.
    pub(super) fn add_all(&mut self, strips: &mut dyn Strips, halo: u32) -> Result<(), Error> {
        strips.rewind(halo)?;
        while let Some(strip) = strips.next_strip()?
            && self.add(&strip)
        {}
        Ok(())
    }

    /// The sample of all strips, or why nothing can be learnt from it: they lack a side channel
    /// of folds, a fold has no sample, or no pixel is finite.
    pub(super) fn finish(mut self) -> Result<Self, Status> {
        if self.lacks_folds {
            return Err(Status::NoFolds);
        }
        self.counts = std::array::from_fn(|fold| fold_count(fold, self.samples));
        self.count_pictures(self.samples);
        if self.counts.contains(&0.0) {
            return Err(Status::TooShort);
        }
        if self.pixels.is_empty() {
            return Err(Status::NotFinite);
        }
        Ok(self)
    }

    /// How many pixels the batch has.
    pub(super) fn pixels_of_batch(&self) -> usize {
        self.zeros.iter().sum()
    }

    /// How many lanes it has.
    pub(super) fn lanes(&self) -> usize {
        self.pixels.len() * self.channels
    }

    /// The lanes of a pixel.
    #[inline(always)]
    pub(super) fn lanes_of(&self, pixel: usize) -> Range<usize> {
        pixel * self.channels..(pixel + 1) * self.channels
    }

    /// Which half of the chessboard each lane is in.
    pub(super) fn halves(&self) -> Vec<u8> {
        let of_pixel = |pixel: &Pixel| std::iter::repeat_n(pixel.half, self.channels);
        self.pixels.iter().flat_map(of_pixel).collect()
    }

    /// What `task` makes of ranges of pixels, in their order: the ranges do not depend on the
    /// number of threads.
    pub(super) fn in_tasks<T: Send>(&self, task: impl Fn(Range<usize>) -> T + Sync) -> Vec<T> {
        let pixels = self.pixels.len();
        let first = (0..pixels).into_par_iter().step_by(PIXELS_PER_TASK);
        first.map(|first| task(first..pixels.min(first + PIXELS_PER_TASK))).collect()
    }

    /// What the folds of its lanes say.
    pub(super) fn means(&self) -> FoldMeans<'_> {
        self.means.each_ref().map(|folds| folds.each_ref().map(Vec::as_slice))
    }

    /// The same for further powers.
    pub(super) fn further(&self) -> FurtherMeans<'_> {
        let further = self.further.iter();
        further.map(|(power, folds)| (*power, folds.each_ref().map(Vec::as_slice))).collect()
    }

    /// Adds the pixels of the next strip's inner rows whose hashes begin with the most zeros. Which
    /// are left in the end does not depend on how the batch is cut.
    fn add_pixels(&mut self, strip: &SequenceBatch, means: &FoldMeans<'_>) {
        self.has_grid = strip.grid().is_some();
        self.channels = strip.grid().map_or(1, |grid| grid.channels());
        let pixels = strip.lanes() / self.channels;
        let inner = strip.grid().map_or(0..pixels, |grid| grid.lanes_of(0, grid.inner_rows()));
        let first = self.pixels_of_batch();
        let hashes = (0..inner.len()).into_par_iter().map(|pixel| mix((first + pixel) as u64));
        let zeros: Vec<u8> = hashes.map(|hash| hash.leading_zeros() as u8).collect();
        zeros.iter().for_each(|&zeros| self.zeros[usize::from(zeros)] += 1);
        let least = self.least_zeros();
        self.thin_out(least);
        let powers: Vec<_> = self.further.iter().map(|(power, _)| *power).collect();
        let further = further_means(strip, &powers);
        self.further.retain(|(power, _)| further.iter().any(|(known, _)| known == power));
        let channels = self.channels;
        let lanes_of = |pixel: usize| (0..channels).map(move |channel| channel * pixels + pixel);
        let finite = |pixel: usize| {
            let of_fold = |values: &&[f32]| lanes_of(pixel).all(|lane| values[lane].is_finite());
            means.iter().flatten().all(of_fold)
        };
        let wanted = inner.zip(zeros).filter(|(pixel, zeros)| *zeros >= least && finite(*pixel));
        let wanted: Vec<(usize, u8)> = wanted.collect();
        let pixel = |&(pixel, zeros)| Pixel { half: strip.half(pixel) as u8, zeros };
        self.pixels.extend(wanted.iter().map(pixel));
        let lanes: Vec<usize> = wanted.into_iter().flat_map(|(pixel, _)| lanes_of(pixel)).collect();
        let of_means = self.means.iter_mut().flatten().zip(means.iter().flatten());
        let of_powers = self.further.iter_mut().zip(&further);
        let of_powers = of_powers.flat_map(|((_, kept), (_, values))| kept.iter_mut().zip(values));
        let variances = strip.side(&Side::Variance);
        let of_variance = [&mut self.variances].into_iter().zip(&variances);
        for (kept, values) in of_means.chain(of_powers).chain(of_variance) {
            kept.extend(lanes.iter().map(|&lane| values[lane]));
        }
    }

    /// With how many zeros a hash must begin, so that there are few enough pixels.
    fn least_zeros(&self) -> u8 {
        let mut count = 0;
        let rarest = self.zeros.iter().rposition(|pixels| {
            count += pixels;
            count > MOST_PIXELS
        });
        rarest.map_or(0, |zeros| zeros as u8 + 1)
    }

    /// Keeps only pixels whose hashes begin with enough zeros.
    fn thin_out(&mut self, least: u8) {
        let keep: Vec<bool> = self.pixels.iter().map(|pixel| pixel.zeros >= least).collect();
        if keep.iter().all(|keep| *keep) {
            return;
        }
        let mut kept = keep.iter();
        self.pixels.retain(|_| *kept.next().expect("as many"));
        let further = self.further.iter_mut().flat_map(|(_, folds)| folds);
        let lanes = self.means.iter_mut().flatten().chain(further).chain([&mut self.variances]);
        for values in lanes {
            let mut kept = keep.iter().flat_map(|keep| std::iter::repeat_n(keep, self.channels));
            values.retain(|_| *kept.next().expect("as many"));
        }
    }

    /// Where pictures of several samples each were packed, folds have as many samples as
    /// pictures: how many these are follows from the variance of S, Σ(y² − y̅²)/(N − 1).
    fn count_pictures(&mut self, n: u32) {
        let shares = shares_without(&self.counts, GROUPS);
        let mean = |kind: usize, lane: usize| -> f64 {
            let folds = self.means[kind].iter().zip(shares);
            folds.map(|(fold, share)| share * f64::from(fold[lane])).sum()
        };
        let [mut spread, mut variance] = [0.0; 2];
        for (lane, &of_mean) in self.variances.iter().enumerate() {
            if of_mean.is_finite() {
                spread += (mean(2, lane) - mean(0, lane).powi(2)).max(0.0);
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

/// How many lanes of each channel are in the inner rows of a strip, and which are the first.
pub(super) fn inner_planes(grid: &Grid) -> (usize, Vec<usize>) {
    let rows = grid.inner_rows();
    let starts = (0..grid.channels()).map(|channel| grid.lanes_of(channel, rows.clone()).start);
    (rows.len() * grid.width(), starts.collect())
}

/// Numbers of the lanes of a strip's inner rows, [`CHUNK`] at a time: `write` gets lanes of the
/// strip, and where their numbers go. They are 0 unless it writes others.
pub(super) fn of_inner(grid: &Grid, write: impl Fn(Range<usize>, &mut [f32]) + Sync) -> Vec<f32> {
    let (of_plane, starts) = inner_planes(grid);
    let mut numbers = vec![0.0; of_plane * starts.len()];
    numbers.par_chunks_exact_mut(of_plane).zip(starts).for_each(|(plane, start)| {
        plane.par_chunks_mut(CHUNK).enumerate().for_each(|(number, part)| {
            let first = start + number * CHUNK;
            write(first..first + part.len(), part);
        });
    });
    numbers
}

/// The side channels of folds of a strip.
pub(super) fn fold_means(strip: &SequenceBatch) -> Option<FoldMeans<'_>> {
    let [Some(means), Some(roots), Some(squares)] =
        Side::OF_FOLDS.map(|sides| strip.of_folds(sides))
    else {
        return None;
    };
    Some([means, roots, squares])
}

/// The power means of those of these powers that a strip has.
pub(super) fn further_means<'a>(strip: &'a SequenceBatch, powers: &[Power]) -> FurtherMeans<'a> {
    let of_power = |&power: &Power| Some((power, strip.of_folds(&Side::power_means(power))?));
    powers.iter().filter_map(of_power).collect()
}

/// The power means of some lanes.
pub(super) fn part_of<'a>(further: &FurtherMeans<'a>, lanes: &Range<usize>) -> FurtherMeans<'a> {
    let mut part = Vec::with_capacity(further.len());
    for (power, folds) in further {
        part.push((*power, folds.map(|fold| &fold[lanes.clone()])));
    }
    part
}

/// What the squares of h_j − S_j are weighed by, so that their sum estimates the variance of S
/// without bias: with the share p of the samples in fold j they have the expectation
/// V/(p (1 − p)), if the variance of a fold's mean is in proportion to 1/p. Folds of a lane differ
/// by one sample at most, so that this is near enough for those whose variance falls faster.
pub(super) fn dispersion(counts: &[f64; GROUPS]) -> [f64; GROUPS] {
    let samples: f64 = counts.iter().sum();
    counts.map(|count| count / samples * (1.0 - count / samples) / GROUPS as f64)
}

/// The shares of the folds in the mean without a group; of all, if there is no such group.
pub(super) fn shares_without(counts: &[f64; FOLDS], group: usize) -> [f64; FOLDS] {
    let kept = |fold: usize| if fold == group { 0.0 } else { counts[fold] };
    let count: f64 = (0..FOLDS).map(kept).sum();
    std::array::from_fn(|fold| kept(fold) / count)
}

//! What the filter reads of a strip, in the order in which it reads it.

use std::ops::Range;

use rayon::prelude::*;

use crate::{FOLDS, Grid, mean_of_folds};

/// How far pixels count, in pixels.
pub(crate) const RADIUS: u32 = 10;

/// The quantile of the normal distribution that is exceeded, at either side, by 1 of 200.
const QUANTILE: f64 = 2.807;

/// How many rows above and below a pixel its variance depends on.
pub(super) const BLUR: u32 = 2;

/// The most pixels that are filtered at the same time: a register of AVX-512.
pub(super) const PACKET: usize = 16;

/// A binomial kernel with the variance of one pixel.
const BINOMIAL: [f32; 5] = [1.0, 4.0, 6.0, 4.0, 1.0];

/// The share of the variance around a pixel that its own is at least.
const FLOOR: f32 = 0.5;

/// Means over some samples of each lane.
pub(crate) struct Means<'a> {
    /// How many samples.
    pub(crate) samples: f64,
    /// Of y, `[lane]`.
    pub(crate) mean: &'a [f32],
    /// Of √y, `[lane]`.
    pub(crate) root: &'a [f32],
}

/// What tells pixels apart beside radiance.
#[derive(Clone, Copy)]
pub(crate) struct Guide<'a> {
    /// `[pixel]`
    pub(crate) values: &'a [f32],
    /// The variances of the values, `[pixel]`.
    pub(crate) variances: &'a [f32],
    /// σ_g
    pub(crate) scale: f32,
}

/// The planes of a strip: of each channel the mean, the mean root, and −t² times the variance
/// of the latter; then the guides g, in units in which their squares count, and Σ g² − v with their
/// variances v: distances are the sum of two of these and −2 Σ g g′.
pub(crate) struct Planes {
    pub(crate) grid: Grid,
    pub(crate) guides: usize,
    /// Of a row of a plane, with room for a packet that begins in the last column.
    pub(crate) stride: usize,
    /// `[row][plane][column]`, with [`RADIUS`] columns before the first and after the last.
    pub(crate) values: Vec<f32>,
}

/// Planes of a channel: the mean is the first, the mean root and −t² v follow.
pub(super) const OF_CHANNEL: usize = 3;
pub(super) const ROOT: usize = 1;
pub(super) const NOISE: usize = 2;

/// What a pixel that does not count has instead of −t² v: no test passes, as t² v is finite
/// elsewhere. Shaders need not know infinities.
const APART: f32 = f32::MAX;

/// The most that a guide may be, so that sums of squares tell distances of 1 well: 20 as an albedo.
const MOST_OF_GUIDE: f32 = 100.0;

/// Rows that are made together.
const BAND: usize = 16;

impl Planes {
    pub(crate) fn new(grid: &Grid, means: &Means<'_>, guides: &[Guide<'_>]) -> Self {
        let stride = grid.width().next_multiple_of(PACKET) + 2 * RADIUS as usize;
        let of_row = (OF_CHANNEL * grid.channels() + of_guides(guides.len())) * stride;
        let mut values = vec![0.0; grid.rows() * of_row];
        let bands = values.par_chunks_mut(BAND * of_row).enumerate();
        bands.for_each_init(
            || Band { grid, stride, own: Vec::new(), sums: Vec::new() },
            |band, (number, rows)| {
                let (first, count) = (number * BAND, rows.len() / of_row);
                for channel in 0..grid.channels() {
                    band.channel(means, channel, first, rows.chunks_exact_mut(of_row));
                }
                let guides_from = OF_CHANNEL * grid.channels() * stride;
                for (y, row) in (first..first + count).zip(rows.chunks_exact_mut(of_row)) {
                    let pixels = y * grid.width()..(y + 1) * grid.width();
                    write_guides(&mut row[guides_from..], stride, guides, &pixels);
                    band.set_apart(row);
                }
            },
        );
        Self { grid: *grid, guides: guides.len(), stride, values }
    }

    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        OF_CHANNEL * self.grid.channels() + of_guides(self.guides)
    }

    /// How many numbers a row has.
    pub(crate) fn of_row(&self) -> usize {
        self.count() * self.stride
    }
}

/// How many planes guides have.
fn of_guides(guides: usize) -> usize {
    guides + usize::from(guides > 0)
}

/// Writes the planes of guides into a row that has these pixels.
fn write_guides(row: &mut [f32], stride: usize, guides: &[Guide<'_>], pixels: &Range<usize>) {
    let (planes, noise) = row.split_at_mut(guides.len() * stride);
    for (plane, guide) in planes.chunks_exact_mut(stride).zip(guides) {
        // (g/(4 σ))² is g²/(2 σ²)/8.
        let factor = 0.25 / guide.scale;
        for (place, value) in plane[LEFT..].iter_mut().zip(&guide.values[pixels.clone()]) {
            let value = factor * value;
            // What is infinite is set apart.
            *place =
                if value.is_finite() { value.clamp(-MOST_OF_GUIDE, MOST_OF_GUIDE) } else { value };
        }
        let pairs = plane[LEFT..].iter().zip(&guide.variances[pixels.clone()]);
        for (sum, (guide, variance)) in noise[LEFT..].iter_mut().zip(pairs) {
            *sum += guide * guide - factor * factor * variance;
        }
    }
}

/// Columns before the first of the picture.
const LEFT: usize = RADIUS as usize;

/// What makes a few rows.
struct Band<'a> {
    grid: &'a Grid,
    stride: usize,
    /// t² v of each pixel by itself, in these rows and [`BLUR`] more on either side.
    own: Vec<f32>,
    /// Of a row, over those around it, with [`BLUR`] columns more on either side.
    sums: Vec<f32>,
}

impl Band<'_> {
    /// Writes the planes of a channel into rows from row `first` on.
    fn channel<'r>(
        &mut self,
        means: &Means<'_>,
        channel: usize,
        first: usize,
        rows: impl ExactSizeIterator<Item = &'r mut [f32]>,
    ) {
        let (width, height) = (self.grid.width(), self.grid.rows());
        let blur = BLUR as usize;
        let per_sample = threshold(means.samples) / (means.samples - 1.0).max(1.0) as f32;
        let lanes = |y: usize| channel * self.grid.pixels() + y * width..;
        self.own.clear();
        for y in first..first + rows.len() + 2 * blur {
            // At the edges of the picture, the nearest row counts.
            let lanes = lanes(y.saturating_sub(blur).min(height - 1));
            let pairs = means.mean[lanes.clone()].iter().zip(&means.root[lanes]).take(width);
            let own = pairs.map(|(mean, root)| per_sample * (mean - root * root).max(0.0));
            // A number that is not finite says nothing of those around it.
            self.own.extend(own.map(|own| if own.is_finite() { own } else { 0.0 }));
        }
        for (i, row) in rows.enumerate() {
            let planes = &mut row[channel * OF_CHANNEL * self.stride..];
            for (plane, source) in [(0, means.mean), (ROOT, means.root)] {
                let place = &mut planes[plane * self.stride + LEFT..][..width];
                place.copy_from_slice(&source[lanes(first + i)][..width]);
            }
            self.sums.clear();
            self.sums.resize(width + 2 * blur, 0.0);
            let inner = &mut self.sums[blur..][..width];
            for (weight, own) in BINOMIAL.iter().zip(self.own[i * width..].chunks_exact(width)) {
                inner.iter_mut().zip(own).for_each(|(sum, v)| *sum += weight / 16.0 * v);
            }
            let [left, right] = [inner[0], inner[width - 1]];
            self.sums[..blur].fill(left);
            self.sums[blur + width..].fill(right);
            let own = &self.own[(i + blur) * width..][..width];
            let noise = &mut planes[NOISE * self.stride + LEFT..][..width];
            for ((noise, own), sums) in noise.iter_mut().zip(own).zip(self.sums.windows(5)) {
                let around: f32 = BINOMIAL.iter().zip(sums).map(|(w, sum)| w / 16.0 * sum).sum();
                *noise = -own.max(FLOOR * around);
            }
        }
    }

    /// Keeps pixels beyond the row, and those with a number that is not finite, from all others.
    fn set_apart(&mut self, row: &mut [f32]) {
        let (width, stride) = (self.grid.width(), self.stride);
        // 0, or NaN where a number is not finite.
        self.sums.clear();
        self.sums.resize(stride, 0.0);
        for plane in row.chunks_exact(stride) {
            self.sums.iter_mut().zip(plane).for_each(|(sum, x)| *sum += 0.0 * x);
        }
        for channel in 0..self.grid.channels() {
            let noise = &mut row[(OF_CHANNEL * channel + NOISE) * stride..][..stride];
            noise[..LEFT].fill(APART);
            noise[LEFT + width..].fill(APART);
        }
        for (x, _) in self.sums.iter().enumerate().filter(|(_, sum)| sum.is_nan()) {
            row.iter_mut().skip(x).step_by(stride).for_each(|value| *value = 0.0);
            for channel in 0..self.grid.channels() {
                row[(OF_CHANNEL * channel + NOISE) * stride + x] = APART;
            }
        }
    }
}

/// The square of the quantile of Student's t at n − 1 degrees of freedom, the fewest that
/// Welch's test may have (Cornish and Fisher's expansion: Abramowitz and Stegun, 26.7.5).
pub(super) fn threshold(samples: f64) -> f32 {
    let (z, nu) = (QUANTILE, (samples - 1.0).max(1.0));
    let powers = [z.powi(3), z.powi(5), z.powi(7)];
    let terms = [
        (powers[0] + z) / 4.0,
        (5.0 * powers[1] + 16.0 * powers[0] + 3.0 * z) / 96.0,
        (3.0 * powers[2] + 19.0 * powers[1] + 17.0 * powers[0] - 15.0 * z) / 384.0,
    ];
    let t = z + terms[0] / nu + terms[1] / nu.powi(2) + terms[2] / nu.powi(3);
    (t * t) as f32
}

/// Lanes per task of the thread pool when means over folds are taken.
const LANES_PER_TASK: usize = 1 << 14;

/// The weighted mean over folds, `[lane]`.
pub(crate) fn mean_over_folds(folds: &[&[f32]; FOLDS], shares: &[f64; FOLDS]) -> Vec<f32> {
    let mut means = vec![0.0; folds[0].len()];
    means.par_chunks_mut(LANES_PER_TASK).enumerate().for_each(|(number, part)| {
        let first = number * LANES_PER_TASK;
        write_mean(&folds.map(|fold| &fold[first..first + part.len()]), shares, part);
    });
    means
}

/// Writes the weighted mean over folds of some lanes.
pub(crate) fn write_mean(folds: &[&[f32]; FOLDS], shares: &[f64; FOLDS], out: &mut [f32]) {
    let [a, b, c, d] = *folds;
    let lanes = a.iter().zip(b).zip(c.iter().zip(d));
    for (mean, ((&a, &b), (&c, &d))) in out.iter_mut().zip(lanes) {
        *mean = mean_of_folds([a, b, c, d], shares);
    }
}

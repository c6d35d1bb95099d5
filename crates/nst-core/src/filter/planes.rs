//! What the filter reads of a strip, in the order in which it reads it.

use rayon::prelude::*;

use super::{RADIUS, kernel::PACKET, threshold};
use crate::{FOLDS, Grid};

/// How many rows above and below a pixel its variance depends on.
pub(super) const BLUR: u32 = 2;

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
pub(crate) struct Guide<'a> {
    /// `[pixel]`
    pub(crate) values: &'a [f32],
    /// σ_g
    pub(crate) scale: f32,
}

/// The planes of a strip: of each channel the mean, the mean root, and −t² times the variance
/// of the latter; then the guides, in units in which their squares count.
pub(crate) struct Planes {
    pub(super) grid: Grid,
    pub(super) guides: usize,
    /// Of a row of a plane, with room for a packet that begins in the last column.
    pub(super) stride: usize,
    /// `[row][plane][column]`, with [`RADIUS`] columns before the first and after the last.
    pub(super) values: Vec<f32>,
}

/// Planes of a channel: the mean is the first, the mean root and −t² v follow.
pub(super) const OF_CHANNEL: usize = 3;
pub(super) const ROOT: usize = 1;
pub(super) const NOISE: usize = 2;

/// What a pixel that does not count has instead of −t² v: no test passes.
const APART: f32 = f32::INFINITY;

impl Planes {
    pub(crate) fn new(grid: &Grid, means: &Means<'_>, guides: &[Guide<'_>]) -> Self {
        let (width, pixels, channels) = (grid.width(), grid.pixels(), grid.channels());
        let stride = width.next_multiple_of(PACKET) + 2 * RADIUS as usize;
        let planes = OF_CHANNEL * channels + guides.len();
        let variances = variances(grid, means);
        let mut values = vec![0.0; grid.rows() * planes * stride];
        values.par_chunks_exact_mut(planes * stride).enumerate().for_each(|(y, row)| {
            let sources = (0..channels).flat_map(|channel| {
                let planes = [(means.mean, 1.0), (means.root, 1.0), (&variances, -1.0)];
                planes.map(|(plane, factor)| (&plane[channel * pixels..], factor))
            });
            // (g/(4 σ))² is g²/(2 σ²)/8.
            let guides = guides.iter().map(|guide| (guide.values, 0.25 / guide.scale));
            for (plane, (source, factor)) in sources.chain(guides).enumerate() {
                let source = &source[y * width..][..width];
                let place = &mut row[plane * stride + RADIUS as usize..][..width];
                place.iter_mut().zip(source).for_each(|(place, x)| *place = factor * x);
            }
            set_apart(row, stride, channels, RADIUS as usize..RADIUS as usize + width);
        });
        Self { grid: *grid, guides: guides.len(), stride, values }
    }

    /// How many there are.
    pub(super) fn count(&self) -> usize {
        OF_CHANNEL * self.grid.channels() + self.guides
    }
}

/// Keeps pixels beyond the row, and those with a number that is not finite, from all others.
fn set_apart(row: &mut [f32], stride: usize, channels: usize, inside: std::ops::Range<usize>) {
    for x in 0..stride {
        let finite = row.iter().skip(x).step_by(stride).all(|value| value.is_finite());
        if inside.contains(&x) && finite {
            continue;
        }
        row.iter_mut().skip(x).step_by(stride).for_each(|value| *value = 0.0);
        for channel in 0..channels {
            row[(OF_CHANNEL * channel + NOISE) * stride + x] = APART;
        }
    }
}

/// t² v, `[lane]`.
fn variances(grid: &Grid, means: &Means<'_>) -> Vec<f32> {
    let per_sample = f64::from(threshold(means.samples)) / (means.samples - 1.0).max(1.0);
    let own: Vec<f32> = means
        .mean
        .par_iter()
        .zip(means.root)
        .map(|(&mean, &root)| {
            let (mean, root) = (f64::from(mean), f64::from(root));
            (per_sample * (mean - root * root).max(0.0)) as f32
        })
        .collect();
    let (width, rows) = (grid.width(), grid.rows());
    let mut floored = vec![0.0; own.len()];
    let out = floored.par_chunks_exact_mut(width).enumerate();
    out.for_each_init(
        || vec![0.0; width],
        |sums, (row, out)| {
            let (first, y) = (row / rows * rows, row % rows);
            let own_row = |y: usize| &own[(first + y) * width..][..width];
            // At the edges of the picture, the nearest row counts.
            sums.fill(0.0);
            for (i, weight) in BINOMIAL.iter().enumerate() {
                let y = (y + i).saturating_sub(BLUR as usize).min(rows - 1);
                sums.iter_mut().zip(own_row(y)).for_each(|(sum, v)| *sum += weight / 16.0 * v);
            }
            for (x, (out, own)) in out.iter_mut().zip(own_row(y)).enumerate() {
                let at = |i: usize| sums[(x + i).saturating_sub(BLUR as usize).min(width - 1)];
                let around: f32 = BINOMIAL.iter().enumerate().map(|(i, w)| w / 16.0 * at(i)).sum();
                *out = own.max(FLOOR * around);
            }
        },
    );
    floored
}

/// The weighted mean over folds, `[lane]`.
pub(super) fn mean(folds: &[&[f32]; FOLDS], shares: &[f64; FOLDS]) -> Vec<f32> {
    let of_lane = |lane: usize| {
        folds.iter().zip(shares).map(|(fold, share)| share * f64::from(fold[lane])).sum::<f64>()
            as f32
    };
    (0..folds[0].len()).into_par_iter().map(of_lane).collect()
}

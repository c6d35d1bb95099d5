//! Accumulates radiance samples into each pixel's sequence.

use std::{
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

use glam::{Vec2, Vec3A};
use ndarray::Array2;
use nst_core::SequenceBatch;
use rayon::prelude::*;

use crate::{
    Error, PixelFilter, Sampler, SamplerKind, Scene, camera::Projection, path::PathTracer,
};

/// How many folds the samples of a pixel are split into: sample i belongs to fold i mod 4.
pub const FOLDS: usize = 4;

/// The side channel that holds the estimated variance of S_N.
pub const VARIANCE: &str = "Variance";

/// The side channel that holds the mean of a fold.
#[must_use]
pub fn fold_name(fold: usize) -> String {
    format!("fold{fold}")
}

/// Which terms of each pixel's sequence to keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// The last so many.
    Window(u32),
    /// All: S_1 … S_N.
    All,
}

/// How to render, as opposed to what.
#[derive(Clone, Copy, Debug)]
pub struct RenderSettings {
    /// Samples per pixel, at least 1.
    pub spp: u32,
    /// Which numbers to draw.
    pub sampler: SamplerKind,
    /// Seed of the sampler; different seeds give independent renderings.
    pub seed: u64,
    /// The terms to keep.
    pub keep: Keep,
}

/// What [`render()`] returns.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// The kept terms, the fold means (where spp ≥ [`FOLDS`]) and the variance of
    /// S_N (where spp ≥ 2); three planar channels of lanes.
    pub batch: SequenceBatch,
    /// How long it took, the acceleration structure included.
    pub time: Duration,
}

/// Pixels along the side of a tile, the unit of work.
const TILE: u32 = 16;
const CHANNELS: usize = 3;
/// Samples of each pixel of a tile that are traced side by side.
const BATCH: usize = 8;

/// Renders a scene. The result depends on the scene and the settings alone, not
/// on the number of threads. `progress` is called with the number of paths of
/// each tile that is done.
///
/// # Errors
/// [`Error::Settings`] if there are no samples, no pixels, or more than 2³¹ lanes.
pub fn render(
    scene: &Scene,
    settings: &RenderSettings,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Rendering, Error> {
    let start = Instant::now();
    let [width, height] = scene.size;
    let pixels = u64::from(width) * u64::from(height);
    if settings.spp == 0 || pixels == 0 {
        return Err(Error::Settings(format!(
            "nothing to render: {width}x{height} pixels with {} samples each",
            settings.spp
        )));
    }
    if pixels * CHANNELS as u64 > 1 << 31 {
        return Err(Error::Settings(format!("{width}x{height} pixels are too many")));
    }

    let planes = Planes::new(settings);
    let pixels = pixels as usize;
    let lanes = CHANNELS * pixels;
    let result = Mutex::new(Accumulated::new(planes, lanes));
    let frame = Frame {
        tracer: PathTracer::new(scene),
        projection: Projection::new(&scene.camera, scene.size),
        sampler: Sampler::new(settings.sampler, settings.seed),
        filter: scene.pixel_filter,
        width,
        planes,
    };
    let tiles_x = width.div_ceil(TILE);
    (0..tiles_x * height.div_ceil(TILE)).into_par_iter().for_each(|tile| {
        let tile = Tile::new(tile % tiles_x, tile / tiles_x, width, height);
        let values = frame.tile(&tile);
        let mut result = result.lock().unwrap_or_else(PoisonError::into_inner);
        for (image, values) in result.images(pixels).zip(values.chunks_exact(tile.pixels())) {
            for (y, row) in (tile.y..).zip(values.chunks_exact(tile.width as usize)) {
                let first = (y * width + tile.x) as usize;
                image[first..][..row.len()].copy_from_slice(row);
            }
        }
        drop(result);
        progress(tile.pixels() as u64 * u64::from(settings.spp));
    });
    let result = result.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Rendering { batch: result.batch(planes, lanes)?, time: start.elapsed() })
}

/// Which numbers are recorded per lane, in this order: the kept terms, the fold
/// means, the variance.
#[derive(Clone, Copy)]
struct Planes {
    spp: u32,
    /// Terms are kept from this sample count on.
    first_term: u32,
}

impl Planes {
    fn new(settings: &RenderSettings) -> Self {
        let spp = settings.spp;
        let first_term = match settings.keep {
            Keep::All => 1,
            // From spp − length + 1 on, without a step beyond u32.
            Keep::Window(length) => spp.saturating_sub(length.max(1) - 1).max(1),
        };
        Self { spp, first_term }
    }

    fn terms(&self) -> usize {
        (self.spp - self.first_term + 1) as usize
    }

    fn folds(&self) -> usize {
        if self.spp as usize >= FOLDS { FOLDS } else { 0 }
    }

    fn count(&self) -> usize {
        self.terms() + self.folds() + usize::from(self.spp >= 2)
    }
}

/// The recorded numbers of the whole picture, in the layout of a batch.
struct Accumulated {
    /// `[term][channel][pixel]`
    terms: Vec<f32>,
    /// Each `[channel][pixel]`.
    sides: Vec<Vec<f32>>,
}

impl Accumulated {
    fn new(planes: Planes, lanes: usize) -> Self {
        let sides = planes.count() - planes.terms();
        Self { terms: vec![0.0; planes.terms() * lanes], sides: vec![vec![0.0; lanes]; sides] }
    }

    /// The images of one channel of one plane, in the order of [`Frame::tile`].
    fn images(&mut self, pixels: usize) -> impl Iterator<Item = &mut [f32]> {
        let sides = self.sides.iter_mut().flat_map(move |side| side.chunks_exact_mut(pixels));
        self.terms.chunks_exact_mut(pixels).chain(sides)
    }

    fn batch(self, planes: Planes, lanes: usize) -> Result<SequenceBatch, Error> {
        let terms = Array2::from_shape_vec((planes.terms(), lanes), self.terms)
            .map_err(|error| Error::Settings(error.to_string()))?;
        let mut batch = SequenceBatch::new(terms, (planes.first_term..=planes.spp).collect())?;
        let names = (0..planes.folds()).map(fold_name).chain([VARIANCE.to_owned()]);
        for (name, values) in names.zip(self.sides) {
            batch.set_side(&name, values)?;
        }
        Ok(batch)
    }
}

/// A rectangle of pixels.
struct Tile {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

impl Tile {
    fn new(column: u32, row: u32, width: u32, height: u32) -> Self {
        let (x, y) = (column * TILE, row * TILE);
        Self { x, y, width: TILE.min(width - x), height: TILE.min(height - y) }
    }

    fn pixels(&self) -> usize {
        (self.width * self.height) as usize
    }
}

struct Frame<'a> {
    tracer: PathTracer<'a>,
    projection: Projection,
    sampler: Sampler,
    filter: PixelFilter,
    width: u32,
    planes: Planes,
}

impl Frame<'_> {
    /// The recorded numbers of a tile: `[plane][channel][pixel]`.
    fn tile(&self, tile: &Tile) -> Vec<f32> {
        let pixels = tile.pixels();
        let Planes { spp, first_term } = self.planes;
        let mut values = vec![0.0; self.planes.count() * CHANNELS * pixels];
        let mut record = |plane: usize, pixel: usize, rgb: [f64; CHANNELS]| {
            for (channel, value) in rgb.into_iter().enumerate() {
                values[(plane * CHANNELS + channel) * pixels + pixel] = value as f32;
            }
        };
        let mut sums = vec![Sums::default(); pixels];
        for first in (0..spp).step_by(BATCH) {
            let indices = first..spp.min(first.saturating_add(BATCH as u32));
            let mut samples = self.samples(tile, indices.clone()).into_iter();
            for (pixel, sums) in sums.iter_mut().enumerate() {
                for (index, sample) in indices.clone().zip(&mut samples) {
                    sums.add(index, sample.to_array().map(f64::from));
                    let n = index + 1;
                    if n >= first_term {
                        let mean = sums.sum.map(|s| s / f64::from(n));
                        record((n - first_term) as usize, pixel, mean);
                    }
                }
            }
        }
        for (pixel, sums) in sums.iter().enumerate() {
            let mut plane = self.planes.terms();
            for (fold, sum) in sums.folds.iter().enumerate().take(self.planes.folds()) {
                let count = (spp as usize - fold).div_ceil(FOLDS) as f64;
                record(plane, pixel, sum.map(|s| s / count));
                plane += 1;
            }
            if spp >= 2 {
                record(plane, pixel, sums.variance(spp));
            }
        }
        values
    }

    /// The radiance of some samples of each pixel of a tile: `[pixel][sample]`.
    fn samples(&self, tile: &Tile, indices: std::ops::Range<u32>) -> Vec<Vec3A> {
        let camera = |pixel: u32, index: u32| {
            let (x, y) = (tile.x + pixel % tile.width, tile.y + pixel / tile.width);
            let mut samples = self.sampler.stream(y * self.width + x, index);
            let within = match self.filter {
                PixelFilter::Box => samples.next_2d(),
                PixelFilter::Center => Vec2::splat(0.5),
            };
            (self.projection.direction(Vec2::new(x as f32, y as f32) + within), samples)
        };
        let pixels = 0..tile.pixels() as u32;
        let paths = pixels.flat_map(|pixel| indices.clone().map(move |index| camera(pixel, index)));
        self.tracer.radiances(self.sampler.kind(), self.projection.origin, paths)
    }
}

/// What is summed up over the samples of a pixel, in f64: the differences
/// between late terms are far below their size.
#[derive(Clone, Copy, Default)]
struct Sums {
    sum: [f64; CHANNELS],
    squares: [f64; CHANNELS],
    folds: [[f64; CHANNELS]; FOLDS],
}

impl Sums {
    fn add(&mut self, index: u32, sample: [f64; CHANNELS]) {
        for c in 0..CHANNELS {
            self.sum[c] += sample[c];
            self.squares[c] += sample[c] * sample[c];
            self.folds[index as usize % FOLDS][c] += sample[c];
        }
    }

    /// (Σy² − (Σy)²/N) / (N (N − 1)); rounding may take it below zero.
    fn variance(&self, spp: u32) -> [f64; CHANNELS] {
        let n = f64::from(spp);
        [0, 1, 2]
            .map(|c| (self.squares[c] - self.sum[c] * self.sum[c] / n).max(0.0) / (n * (n - 1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kept_terms() {
        let kept = |spp, keep| {
            let settings = RenderSettings { spp, sampler: SamplerKind::Random, seed: 0, keep };
            let planes = Planes::new(&settings);
            (planes.first_term, planes.terms())
        };
        assert_eq!(kept(64, Keep::Window(8)), (57, 8));
        assert_eq!(kept(64, Keep::All), (1, 64));
        assert_eq!(kept(8, Keep::Window(8)), (1, 8));
        assert_eq!(kept(5, Keep::Window(8)), (1, 5));
        assert_eq!(kept(5, Keep::Window(0)), (5, 1));
        assert_eq!(kept(u32::MAX, Keep::Window(8)), (u32::MAX - 7, 8));
    }
}

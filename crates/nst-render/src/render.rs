//! Accumulates radiance samples into each pixel's sequence, in passes over the
//! picture: between two of them a rendering can stop, and go on some other day.

use std::{
    ops::Range,
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

use glam::Vec2;
use ndarray::Array2;
use nst_core::SequenceBatch;
use rayon::prelude::*;

use crate::{
    Error, FOLDS, LaneSums, PixelFilter, Sampler, SamplerKind, Scene,
    camera::Projection,
    kept::Slots,
    path::{PathTracer, Workspace},
    sums::fold_count,
    tiles::{self, Tile},
};

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
    /// S_1, S_2, S_4, … and the last so many.
    Pow2(u32),
}

impl Keep {
    /// The sample counts of the terms that a rendering with `spp` samples keeps.
    #[must_use]
    pub fn sample_counts(self, spp: u32) -> Vec<u32> {
        Slots::new(self, spp).sample_counts(spp)
    }
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
    /// What the rendering can be continued from, `[lane]`.
    pub sums: Vec<LaneSums>,
    /// How long it took, from the loaded scene.
    pub time: Duration,
    /// How much of that went into what paths need of the scene: the acceleration
    /// structure, and tables for lights and materials.
    pub build_time: Duration,
}

/// What a rendering says and is told as it goes along.
#[derive(Clone, Copy)]
pub struct Control<'a> {
    /// Is called with the number of paths of each tile that is done.
    pub progress: &'a (dyn Fn(u64) + Sync),
    /// Is asked after each pass over the picture whether to stop there.
    pub stop: &'a (dyn Fn() -> bool + Sync),
}

const CHANNELS: usize = 3;
/// Samples of each pixel of a tile that are traced side by side.
const BATCH: u32 = 8;

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
    render_from(None, scene, settings, Control { progress, stop: &|| false })
}

/// Renders from where an earlier rendering of the same scene and settings ended,
/// but for the number of samples: the result is that of [`render()`], to the bit.
/// If it is told to stop, its last term tells the samples that were reached.
///
/// # Errors
/// As [`render()`]; and if `start` does not have fewer samples or has another size
/// or other terms.
pub fn render_from(
    start: Option<Rendering>,
    scene: &Scene,
    settings: &RenderSettings,
    control: Control<'_>,
) -> Result<Rendering, Error> {
    let begin = Instant::now();
    let spp = settings.spp;
    let [width, height] = scene.size;
    let pixels = u64::from(width) * u64::from(height);
    if spp == 0 || pixels == 0 {
        return Err(Error::Settings(format!(
            "nothing to render: {width}x{height} pixels with {spp} samples each"
        )));
    }
    if pixels * CHANNELS as u64 > 1 << 31 {
        return Err(Error::Settings(format!("{width}x{height} pixels are too many")));
    }

    let slots = Slots::new(settings.keep, spp);
    let mut accumulated = match start {
        None => Accumulated::new(slots, scene.size),
        Some(start) => Accumulated::from(start, settings, scene.size)?,
    };
    let build = Instant::now();
    let tracer = PathTracer::new(scene);
    let build_time = build.elapsed();
    let frame = Frame {
        tracer,
        projection: Projection::new(&scene.camera, scene.size),
        sampler: Sampler::new(settings.sampler, settings.seed),
        filter: scene.pixel_filter,
        width,
    };
    // A pass takes long enough for its end not to count, and Ctrl-C not too long.
    let step = (1_u64 << 20).div_ceil(pixels).clamp(1, 16) as u32;
    let mut n = accumulated.samples;
    let mut tiles = accumulated.tiles();
    let workspaces: Vec<Mutex<Workspace>> =
        (0..rayon::current_num_threads()).map(|_| Mutex::default()).collect();
    loop {
        let pass = n..spp.min(n.saturating_add(step));
        // Tiles differ in cost: none waits behind another while a thread is idle.
        tiles.par_iter_mut().with_max_len(1).for_each(|(tile, recorded)| {
            let thread = rayon::current_thread_index().unwrap_or_default();
            let mut workspace = workspaces[thread].lock().unwrap_or_else(PoisonError::into_inner);
            frame.trace(&mut workspace, tile, pass.clone(), |pixel, index, rgb| {
                recorded.add(slots, pixel, index, rgb, pass.end);
            });
            (control.progress)(tile.pixels() as u64 * pass.len() as u64);
        });
        n = pass.end;
        if n == spp || (control.stop)() {
            break;
        }
    }
    accumulated.samples = n;
    let (batch, sums) = accumulated.finish()?;
    Ok(Rendering { batch, sums, time: begin.elapsed(), build_time })
}

/// The recorded numbers of the whole picture; images are in the order of tiles.
struct Accumulated {
    size: [u32; 2],
    slots: Slots,
    samples: u32,
    /// `[slot][channel][pixel]`
    terms: Vec<f32>,
    /// `[channel][pixel]`
    sums: Vec<LaneSums>,
}

impl Accumulated {
    fn new(slots: Slots, size: [u32; 2]) -> Self {
        let lanes = CHANNELS * size[0] as usize * size[1] as usize;
        let terms = vec![0.0; slots.count() * lanes];
        Self { size, slots, samples: 0, terms, sums: vec![LaneSums::default(); lanes] }
    }

    /// Puts an earlier rendering's numbers in their places.
    fn from(start: Rendering, settings: &RenderSettings, size: [u32; 2]) -> Result<Self, Error> {
        let Rendering { batch, mut sums, .. } = start;
        let counts = batch.sample_counts().to_vec();
        let samples = counts[counts.len() - 1];
        let lanes = CHANNELS * size[0] as usize * size[1] as usize;
        let fits = batch.lanes() == lanes
            && sums.len() == lanes
            && samples < settings.spp
            && counts == Slots::new(settings.keep, samples).sample_counts(samples);
        if !fits {
            let message = format!(
                "a rendering of {} lanes and {samples} spp cannot be continued to {lanes} lanes and {} spp",
                batch.lanes(),
                settings.spp
            );
            return Err(Error::Settings(message));
        }
        let slots = Slots::new(settings.keep, settings.spp);
        let mut terms = vec![0.0; slots.count() * lanes];
        for (k, count) in counts.into_iter().enumerate() {
            for slot in slots.of(count, samples) {
                terms[slot * lanes..][..lanes].copy_from_slice(batch.term(k));
            }
        }
        drop(batch);
        tiles::to_tiles(&mut terms, size);
        tiles::to_tiles(&mut sums, size);
        Ok(Self { size, slots, samples, terms, sums })
    }

    /// The numbers of each tile.
    fn tiles(&mut self) -> Vec<(Tile, Recorded<'_>)> {
        let pixels = self.size[0] as usize * self.size[1] as usize;
        let sums = tiles::split(self.sums.chunks_exact_mut(pixels), self.size);
        let terms = tiles::split(self.terms.chunks_exact_mut(pixels), self.size);
        tiles::tiles(self.size)
            .zip(sums.into_iter().zip(terms))
            .map(|(tile, (sums, terms))| (tile, Recorded { sums, terms }))
            .collect()
    }

    fn finish(self) -> Result<(SequenceBatch, Vec<LaneSums>), Error> {
        let Self { size, slots, samples, mut terms, mut sums } = self;
        let lanes = sums.len();
        slots.sort(&mut terms, lanes, samples);
        tiles::to_rows(&mut terms, size);
        tiles::to_rows(&mut sums, size);
        let terms = Array2::from_shape_vec((terms.len() / lanes, lanes), terms)
            .map_err(|error| Error::Settings(error.to_string()))?;
        let mut batch = SequenceBatch::new(terms, slots.sample_counts(samples))?;
        if samples as usize >= FOLDS {
            for fold in 0..FOLDS {
                let count = fold_count(fold, samples);
                let mean = |lane: &LaneSums| (lane.folds[fold] / count) as f32;
                let means = sums.par_iter().map(mean).collect();
                batch.set_side(&fold_name(fold), means)?;
            }
        }
        if samples >= 2 {
            batch
                .set_side(VARIANCE, sums.par_iter().map(|lane| lane.variance(samples)).collect())?;
        }
        Ok((batch, sums))
    }
}

/// A tile's part of [`Accumulated`].
struct Recorded<'a> {
    /// `[channel][pixel]`
    sums: Vec<&'a mut [LaneSums]>,
    /// `[slot][channel][pixel]`
    terms: Vec<&'a mut [f32]>,
}

impl Recorded<'_> {
    /// Adds a sample to its pixel, in a pass that ends with S_`end`. Sums are in
    /// f64: the differences between late terms are far below their size.
    #[inline]
    fn add(&mut self, slots: Slots, pixel: usize, index: u32, rgb: [f64; CHANNELS], end: u32) {
        for (lanes, sample) in self.sums.iter_mut().zip(rgb) {
            lanes[pixel].add(index, sample);
        }
        let n = index + 1;
        for slot in slots.of(n, end) {
            let terms = self.terms[slot * CHANNELS..].iter_mut();
            for (term, sums) in terms.zip(&self.sums) {
                term[pixel] = (sums[pixel].total() / f64::from(n)) as f32;
            }
        }
    }
}

struct Frame<'a> {
    tracer: PathTracer<'a>,
    projection: Projection,
    sampler: Sampler,
    filter: PixelFilter,
    width: u32,
}

impl Frame<'_> {
    /// Traces some of the samples of a tile's pixels and hands each to `record`:
    /// the pixel of the tile, the sample's index, and its radiance. The indices
    /// of a pixel increase.
    fn trace(
        &self,
        workspace: &mut Workspace,
        tile: &Tile,
        indices: Range<u32>,
        mut record: impl FnMut(usize, u32, [f64; CHANNELS]),
    ) {
        let camera = |pixel: usize, index: u32| {
            let (x, y) = tile.pixel(pixel);
            let mut samples = self.sampler.stream(y * self.width + x, index);
            let within = match self.filter {
                PixelFilter::Box => samples.next_2d(),
                PixelFilter::Center => Vec2::splat(0.5),
            };
            (self.projection.direction(Vec2::new(x as f32, y as f32) + within), samples)
        };
        for first in indices.clone().step_by(BATCH as usize) {
            let batch = first..indices.end.min(first.saturating_add(BATCH));
            let paths = || {
                let batch = &batch;
                (0..tile.pixels())
                    .flat_map(move |pixel| batch.clone().map(move |index| (pixel, index)))
            };
            let rays = paths().map(|(pixel, index)| camera(pixel, index));
            let radiances =
                self.tracer.radiances(workspace, self.sampler.kind(), self.projection.origin, rays);
            for ((pixel, index), radiance) in paths().zip(radiances) {
                record(pixel, index, radiance.to_array().map(f64::from));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::{
        path::Path,
        sync::atomic::{AtomicU32, Ordering},
    };

    use super::*;

    fn scene() -> Scene {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/cornell/cornell.obj");
        Scene { size: [37, 18], ..Scene::load(&path).expect("the scene") }
    }

    /// Stops after so many passes.
    fn stopped(start: Option<Rendering>, settings: &RenderSettings, passes: u32) -> Rendering {
        let done = AtomicU32::new(0);
        let stop = || done.fetch_add(1, Ordering::Relaxed) + 1 == passes;
        let control = Control { progress: &|_| {}, stop: &stop };
        render_from(start, &scene(), settings, control).expect("the scene renders")
    }

    #[test]
    fn a_rendering_goes_on_where_it_stopped() {
        for keep in [Keep::Window(8), Keep::All, Keep::Pow2(3)] {
            for sampler in [SamplerKind::Random, SamplerKind::Halton] {
                let settings = RenderSettings { spp: 41, sampler, seed: 3, keep };
                let whole = render(&scene(), &settings, &|_| {}).expect("the scene renders");
                let mut part = stopped(None, &settings, 1);
                assert_eq!(part.batch.sample_counts().last(), Some(&16));
                part = stopped(Some(part), &RenderSettings { spp: 18, ..settings }, 9);
                part = stopped(Some(part), &RenderSettings { spp: 19, ..settings }, 9);
                assert_ne!(part.batch, whole.batch);
                let part = stopped(Some(part), &settings, 9);
                assert_eq!(part.batch, whole.batch);
                assert_eq!(part.sums, whole.sums);
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_not_continued() {
        let settings =
            RenderSettings { spp: 9, sampler: SamplerKind::Random, seed: 3, keep: Keep::Window(4) };
        let whole = || render(&scene(), &settings, &|_| {}).expect("the scene renders");
        let more = RenderSettings { spp: 12, ..settings };
        let control = Control { progress: &|_| {}, stop: &|| false };
        assert!(render_from(Some(whole()), &scene(), &more, control).is_ok());
        assert!(render_from(Some(whole()), &scene(), &settings, control).is_err());
        let other = RenderSettings { keep: Keep::All, ..more };
        assert!(render_from(Some(whole()), &scene(), &other, control).is_err());
        let other = Scene { size: [18, 36], ..scene() };
        assert!(render_from(Some(whole()), &other, &more, control).is_err());
    }
}

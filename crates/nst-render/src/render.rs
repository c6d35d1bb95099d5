//! Renders a scene in passes over the picture. After each, a rendering can stop, and be
//! continued later.

use std::{
    ops::Range,
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

use glam::Vec2;
use nst_core::random::mix;
use rayon::prelude::*;

use crate::{
    Error, PixelFilter, Sampler, Scene,
    bands::{Consumer, trace_and_hand},
    camera::Projection,
    film::{Film, TileFilm},
    packet::PACKET,
    path::{PathTracer, Workspace},
    rendering::Rendering,
    settings::{RenderSettings, Start},
    tiles::{BATCH, Tile},
};

/// How a rendering reports its progress, and how it is stopped.
#[derive(Clone, Copy)]
pub struct Control<'a> {
    /// Is called with the number of paths of each tile that is done.
    pub progress: &'a (dyn Fn(u64) + Sync),
    /// Is asked after each pass over the picture whether to stop there: every few tenths of
    /// a second, or as long as one sample per pixel takes.
    pub stop: &'a (dyn Fn() -> bool + Sync),
}

/// The paths of the first pass, unless that is less than one sample per pixel, or more than
/// [`MOST_FIRST_SPP`]: some tenths of a second for most scenes.
const FIRST_PATHS: u64 = 1 << 18;
const MOST_FIRST_SPP: u64 = 16;

/// How long a pass should take. A rendering can only stop after one, which users are told takes
/// at most two seconds; but each takes the whole film through memory once, and threads wait for
/// each other at its end.
const PASS_TIME: Duration = Duration::from_millis(600);

/// Renders a scene. The result depends on the scene and the settings alone, not
/// on the number of threads. `progress` is called with the number of paths of
/// each tile that is done.
///
/// # Errors
/// [`Error::Settings`] if there are no samples, no pixels, or more lanes than a
/// [`Grid`](nst_core::Grid) has; [`Error::Memory`] if they do not fit the memory.
pub fn render(
    scene: &Scene,
    settings: &RenderSettings,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Rendering, Error> {
    render_from(None, scene, settings, Control { progress, stop: &|| false })
}

/// Continues an earlier rendering of the same scene with the same settings, except for the
/// number of samples: all bits of the result are those of [`render()`]. If it is stopped,
/// the last sample count of the result says how many samples there are.
///
/// # Errors
/// As [`render()`]; and if `start` has as many samples already, another size, or other
/// terms.
pub fn render_from(
    start: Option<Start>,
    scene: &Scene,
    settings: &RenderSettings,
    control: Control<'_>,
) -> Result<Rendering, Error> {
    render_to(None, start, scene, settings, control)
}

/// As [`render_from()`], and gives a consumer, if there is one, rows that are finished while
/// others are still traced.
///
/// # Errors
/// As [`render_from()`].
pub fn render_to(
    consumer: Option<Consumer<'_>>,
    start: Option<Start>,
    scene: &Scene,
    settings: &RenderSettings,
    control: Control<'_>,
) -> Result<Rendering, Error> {
    let begin = Instant::now();
    if settings.spp == 0 {
        return Err(Error::Settings("nothing to render: no samples per pixel".into()));
    }
    let mut film = match start {
        None => Film::new(settings, scene.size)?,
        Some(start) => Film::of(start, settings, scene.size)?,
    };
    let build = Instant::now();
    let frame = Frame::new(scene, settings);
    let build_time = build.elapsed();
    let samples = film.samples;
    let mut tiles = film.tiles();
    // In an order that jumps over the picture, so that the first tiles of a long pass tell
    // how long the others will take.
    tiles.sort_by_cached_key(|(tile, _)| mix(tile.index(0, scene.size[0]) as u64));
    film.samples = frame.trace_passes(samples, tiles, settings.spp, control, consumer);
    Ok(Rendering::new(film, begin.elapsed(), build_time))
}

/// What the pixels of a picture have in common.
struct Frame<'a> {
    tracer: PathTracer<'a>,
    projection: Projection,
    sampler: Sampler,
    filter: PixelFilter,
    size: [u32; 2],
}

impl<'a> Frame<'a> {
    fn new(scene: &'a Scene, settings: &RenderSettings) -> Self {
        Self {
            tracer: PathTracer::new(scene),
            projection: Projection::new(&scene.camera, scene.size),
            sampler: Sampler::new(settings.sampler, settings.seed),
            filter: scene.pixel_filter,
            size: scene.size,
        }
    }

    /// Renders passes from the sample number `first` on, until each pixel has `spp`
    /// samples, or until `control` stops it. Returns the number of samples of each pixel.
    fn trace_passes(
        &self,
        first: u32,
        mut tiles: Vec<(Tile, TileFilm<'_>)>,
        spp: u32,
        control: Control<'_>,
        mut consumer: Option<Consumer<'_>>,
    ) -> u32 {
        let pixels = u64::from(self.size[0]) * u64::from(self.size[1]);
        let mut step = FIRST_PATHS.div_ceil(pixels).clamp(1, MOST_FIRST_SPP) as u32;
        let workspaces: Vec<Mutex<Workspace>> =
            (0..rayon::current_num_threads()).map(|_| Mutex::default()).collect();
        let mut n = first;
        loop {
            let pass = n..spp.min(n.saturating_add(step));
            let begin = Instant::now();
            let trace = |tile: &Tile, film: &mut TileFilm<'_>| {
                let thread = rayon::current_thread_index().unwrap_or_default();
                let workspace = workspaces[thread].lock();
                let mut workspace = workspace.unwrap_or_else(PoisonError::into_inner);
                if pass.start == 0 {
                    film.clear();
                }
                if film.has_features() {
                    self.trace::<true>(&mut workspace, tile, pass.clone(), film);
                } else {
                    self.trace::<false>(&mut workspace, tile, pass.clone(), film);
                }
                (control.progress)(tile.pixels() as u64 * pass.len() as u64);
            };
            if pass.end == spp
                && let Some(consumer) = &mut consumer
            {
                trace_and_hand(tiles, self.size, spp, consumer, trace);
                return spp;
            }
            // Tiles differ in cost: each is a task of its own, so that no thread is idle
            // while tiles wait.
            tiles.par_iter_mut().with_max_len(1).for_each(|(tile, film)| trace(tile, film));
            n = pass.end;
            if n == spp || (control.stop)() {
                return n;
            }
            step = next_step(step, begin.elapsed());
        }
    }

    /// Traces a pass of samples of a tile's pixels, and adds them to the film. The indices of a
    /// pixel increase.
    fn trace<const FEATURES: bool>(
        &self,
        workspace: &mut Workspace,
        tile: &Tile,
        indices: Range<u32>,
        film: &mut TileFilm<'_>,
    ) {
        let camera = |pixel: usize, index: u32| {
            let (x, y) = tile.pixel(pixel);
            let mut samples = self.sampler.stream(y * self.size[0] + x, index);
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
            let (kind, origin) = (self.sampler.kind(), self.projection.origin);
            let (radiances, features) =
                self.tracer.trace::<FEATURES>(workspace, kind, origin, rays);
            for (i, ((pixel, index), radiance)) in paths().zip(radiances).enumerate() {
                let rgb = radiance.to_array().map(f64::from);
                let is_finite = film.add(pixel, index, rgb, indices.end);
                if FEATURES && !is_finite {
                    // The camera sees no light directly, either.
                    features[i / PACKET].darken(i % PACKET);
                }
            }
            if FEATURES {
                film.add_features(batch, features);
            }
        }
    }
}

/// The samples per pixel of the next pass, after one of `step` that took `time`: about as
/// many as take [`PASS_TIME`], and whole batches if that is more than one.
fn next_step(step: u32, time: Duration) -> u32 {
    let factor = PASS_TIME.as_secs_f64() / time.as_secs_f64();
    let next = (f64::from(step) * factor.clamp(0.25, 4.0)).round() as u32;
    if next > BATCH { next / BATCH * BATCH } else { next.max(1) }
}

#[cfg(test)]
mod tests {
    use std::{
        path::Path,
        sync::atomic::{AtomicU32, Ordering},
    };

    use nst_core::{FurtherPowers, Keep, Power, SampleSums, Side};

    use super::*;
    use crate::SamplerKind;

    fn all_powers() -> FurtherPowers {
        FurtherPowers::of(&Power::all().collect::<Vec<_>>())
    }

    fn scene() -> Scene {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/cornell/cornell.obj");
        Scene { size: [37, 18], ..Scene::load(&path).expect("the scene") }
    }

    fn start(rendering: &Rendering) -> Start {
        let [_, height] = rendering.size();
        Start { batch: rendering.batch(), sums: rendering.sums(0..height) }
    }

    /// Stops after some passes.
    fn stopped(start: Option<Start>, settings: &RenderSettings, passes: u32) -> Rendering {
        let done = AtomicU32::new(0);
        let stop = || done.fetch_add(1, Ordering::Relaxed) + 1 == passes;
        let control = Control { progress: &|_| {}, stop: &stop };
        render_from(start, &scene(), settings, control).expect("the scene renders")
    }

    #[test]
    fn a_rendering_goes_on_where_it_stopped() {
        for keep in [Keep::Window(8), Keep::All, Keep::Pow2(3)] {
            for sampler in [SamplerKind::Random, SamplerKind::Halton, SamplerKind::HaltonFolds] {
                let features = sampler != SamplerKind::Halton;
                let powers = if keep == Keep::All { FurtherPowers::NONE } else { all_powers() };
                let settings = RenderSettings { spp: 41, sampler, seed: 3, keep, powers, features };
                let whole = render(&scene(), &settings, &|_| {}).expect("the scene renders");
                let mut part = stopped(None, &settings, 1);
                assert_eq!(part.samples(), 16);
                part = stopped(Some(start(&part)), &RenderSettings { spp: 18, ..settings }, 9);
                part = stopped(Some(start(&part)), &RenderSettings { spp: 19, ..settings }, 9);
                assert_ne!(part.batch(), whole.batch());
                let part = stopped(Some(start(&part)), &settings, 9);
                assert_eq!(part.batch(), whole.batch());
                assert_eq!(part.sums(0..18), whole.sums(0..18));
                let SampleSums { features: of_features, powers: of_powers, .. } = whole.sums(0..18);
                assert_eq!(of_features.is_some(), features);
                assert!(of_powers.are_of(powers, 3 * 37 * 18));
            }
        }
    }

    #[test]
    fn other_sums_than_the_settings_ask_for_are_refused() {
        let powers = all_powers();
        let (sampler, keep, features) = (SamplerKind::Random, Keep::Window(2), false);
        let settings = RenderSettings { spp: 5, sampler, seed: 3, keep, powers, features };
        let longer = RenderSettings { spp: 6, ..settings };
        let part = render(&scene(), &settings, &|_| {}).expect("the scene renders");
        let goes_on = |start: Start, settings: &RenderSettings| {
            let control = Control { progress: &|_| {}, stop: &|| false };
            render_from(Some(start), &scene(), settings, control).is_ok()
        };
        assert!(goes_on(start(&part), &longer));
        let none = RenderSettings { powers: FurtherPowers::NONE, ..longer };
        assert!(!goes_on(start(&part), &none));
        let mut without = start(&part);
        without.sums.powers = Default::default();
        assert!(goes_on(without.clone(), &none) && !goes_on(without, &longer));
        // Of a row less.
        let mut fewer = start(&part);
        fewer.sums.powers = part.sums(0..17).powers;
        assert!(!goes_on(fewer, &longer));
        let with_features = RenderSettings { features: true, ..longer };
        assert!(!goes_on(start(&part), &with_features));
    }

    /// All terms, sums and side channels are those without features; and the light that is seen
    /// directly is that of paths of one vertex.
    #[test]
    fn features_come_beside_the_same_sequences() {
        let keep = Keep::All;
        let with = RenderSettings {
            spp: 6,
            sampler: SamplerKind::Random,
            seed: 3,
            keep,
            powers: FurtherPowers::NONE,
            features: true,
        };
        let without = RenderSettings { features: false, ..with };
        let of = |scene: &Scene, settings| {
            render(scene, settings, &|_| {}).expect("the scene renders").batch()
        };
        let (all, plain) = (of(&scene(), &with), of(&scene(), &without));
        assert_eq!(all.terms(), plain.terms());
        let features: Vec<&Side> = Side::FEATURES.iter().collect();
        let (of_features, others): (Vec<_>, Vec<_>) =
            all.sides().partition(|(side, _)| features.contains(side));
        assert!(others.into_iter().eq(plain.sides()));
        assert!(of_features.iter().map(|(side, _)| *side).eq(features));
        let lamps = of(&Scene { max_depth: 1, ..scene() }, &without);
        let emission = all.side(&Side::Emission).expect("it is asked for");
        assert_eq!(emission, lamps.last());
        assert_ne!(emission, all.last());
        for fold in 0..4 {
            let seen = all.side(&Side::EmissionFold(fold)).expect("there are enough samples");
            assert_eq!(Some(seen), lamps.side(&Side::Fold(fold)));
            assert_ne!(Some(seen), all.side(&Side::Fold(fold)));
        }
    }

    #[test]
    fn passes_take_about_the_same_time() {
        let after = |step, milliseconds| next_step(step, Duration::from_millis(milliseconds));
        assert_eq!([after(16, 600), after(16, 1200), after(1, 1200)], [16, 8, 1]);
        assert_eq!([after(2, 600), after(2, 200), after(3, 200)], [2, 6, 8]);
        // Neither a moment nor an hour changes much at once.
        assert_eq!([after(16, 0), after(160, 3_600_000)], [64, 40]);
        assert_eq!(after(u32::MAX, 0), u32::MAX / BATCH * BATCH);
    }

    #[test]
    fn what_does_not_fit_is_not_continued() {
        let settings = RenderSettings {
            spp: 9,
            sampler: SamplerKind::Random,
            seed: 3,
            keep: Keep::Window(4),
            features: false,
            powers: FurtherPowers::NONE,
        };
        let whole = || start(&render(&scene(), &settings, &|_| {}).expect("the scene renders"));
        let more = RenderSettings { spp: 12, ..settings };
        let control = Control { progress: &|_| {}, stop: &|| false };
        assert!(render_from(Some(whole()), &scene(), &more, control).is_ok());
        assert!(render_from(Some(whole()), &scene(), &settings, control).is_err());
        let other = RenderSettings { features: true, ..more };
        assert!(render_from(Some(whole()), &scene(), &other, control).is_err());
        let other = RenderSettings { keep: Keep::All, ..more };
        assert!(render_from(Some(whole()), &scene(), &other, control).is_err());
        let other = Scene { size: [18, 36], ..scene() };
        assert!(render_from(Some(whole()), &other, &more, control).is_err());
    }
}

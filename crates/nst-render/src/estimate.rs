//! [`Estimator`]: a method at work on a rendering, from its first finished rows on.

use std::{borrow::Cow, ops::Range};

use nst_core::{Error, Estimates, Fit, Fitted, SequenceBatch, Side, Strips, Support, Transform};

use crate::Rendering;

/// Applies a method to a rendering, rows of which it may get while others are still traced. All
/// bits are those of the method on the whole.
pub struct Estimator<'a, F> {
    transform: &'a dyn Transform,
    stage: Stage<'a>,
    /// The first row that it did not get yet.
    next: u32,
    estimates: Estimates,
    put: F,
}

enum Stage<'a> {
    /// Learns from the rows, in one pass.
    Learns(Box<dyn Fit<'a> + 'a>),
    /// Has nothing to learn.
    Applies(Box<dyn Fitted + 'a>),
    /// Needs more than the rows themselves, or more than one pass over them.
    Waits,
}

impl<'a, F: FnMut(Range<usize>, &Estimates)> Estimator<'a, F> {
    /// Begins. `put` gets the rows of the picture that have been estimated, and their estimates,
    /// from the top.
    ///
    /// # Errors
    /// Those of the method.
    pub fn new(transform: &'a dyn Transform, put: F) -> Result<Self, Error> {
        let needs = transform.requires();
        let of_rows = matches!(needs.support, Support::Lane | Support::Pixel);
        let stage = match transform.start() {
            Some(fit) => Stage::Learns(fit),
            None if of_rows && !needs.fits => Stage::Applies(transform.fit(&mut Nothing)?),
            None => Stage::Waits,
        };
        Ok(Self { transform, stage, next: 0, estimates: Estimates::default(), put })
    }

    /// The side channels that it reads in rows of a rendering that goes on; `None` if it can
    /// only begin when all is there.
    #[must_use]
    pub fn sides(&self) -> Option<Vec<Side>> {
        match self.stage {
            Stage::Learns(_) => {
                let further = self.transform.requires().powers.sides();
                Some(Side::of_sums(u32::MAX).cloned().chain(further).collect())
            }
            Stage::Applies(_) => Some(self.transform.requires().all_sides()),
            Stage::Waits => None,
        }
    }

    /// Takes the next rows, from the top.
    ///
    /// # Errors
    /// Those of the method.
    pub fn add(&mut self, rows: &SequenceBatch) -> Result<(), Error> {
        match &mut self.stage {
            Stage::Learns(fit) => fit.add(rows)?,
            Stage::Applies(fitted) => {
                fitted.apply(rows, &mut self.estimates)?;
                (self.put)(rows_of(rows), &self.estimates);
            }
            Stage::Waits => return Ok(()),
        }
        self.next = rows_of(rows).end as u32;
        Ok(())
    }

    /// Does what is left to do, with all threads; returns the method as it was fitted.
    ///
    /// # Errors
    /// Those of the method.
    pub fn finish(mut self, rendering: &Rendering) -> Result<Box<dyn Fitted + 'a>, Error> {
        let needs = self.transform.requires();
        let read = needs.all_sides();
        // To learn from a picture, a method may read more than it does later, but no more features.
        let mut seen = rendering.sides();
        seen.retain(|side| !side.is_feature() || read.contains(side));
        let strips = rendering.strips().with_least_rows(needs.least_rows());
        let mut strips = strips.with_sides(&seen);
        let (fitted, next) = match self.stage {
            Stage::Learns(mut fit) => {
                strips.skip_to(self.next);
                while let Some(strip) = strips.next_strip()? {
                    fit.add(&strip)?;
                }
                (fit.finish()?, 0)
            }
            Stage::Applies(fitted) => (fitted, self.next),
            Stage::Waits => (self.transform.fit(&mut strips)?, 0),
        };
        let mut strips = strips.with_sides(&read);
        strips.rewind(needs.halo())?;
        strips.skip_to(next);
        while let Some(strip) = strips.next_strip()? {
            fitted.apply(&strip, &mut self.estimates)?;
            (self.put)(rows_of(&strip), &self.estimates);
        }
        Ok(fitted)
    }
}

/// The rows of the picture that a strip has, without its halo.
fn rows_of(strip: &SequenceBatch) -> Range<usize> {
    strip.grid().expect("strips of renderings have a grid").picture_rows()
}

/// What a method that learns nothing is fitted to.
struct Nothing;

impl Strips for Nothing {
    fn rewind(&mut self, _: u32) -> Result<(), Error> {
        Ok(())
    }

    fn next_strip(&mut self) -> Result<Option<Cow<'_, SequenceBatch>>, Error> {
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use std::{
        path::Path,
        sync::{
            Mutex,
            atomic::{AtomicUsize, Ordering},
        },
        thread::sleep,
        time::{Duration, Instant},
    };

    use nst_core::{
        FurtherPowers, Keep, MlpCpu, Network, Power, SampleMlp, SampleNetwork,
        guard::{Alone, Expert, Guard, Judgement},
        methods::{METHODS, method},
    };

    use super::*;
    use crate::{Band, Consumer, Control, RenderSettings, SamplerKind, Scene, render_to};

    const SIZE: [u32; 2] = [40, 90];
    const SPP: u32 = 12;

    fn scene() -> Scene {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/cornell/cornell.obj");
        Scene { size: SIZE, ..Scene::load(&path).expect("the scene") }
    }

    fn all_powers() -> FurtherPowers {
        FurtherPowers::of(&Power::all().collect::<Vec<_>>())
    }

    /// A network that sees samples, by further powers.
    fn of_samples() -> SampleMlp {
        let network = SampleNetwork::builtin("gaussian-samples").expect("it exists");
        SampleMlp::new("gaussian-samples", network.expect("it is sound"))
    }

    fn settings() -> RenderSettings {
        let keep = Keep::Window(10);
        RenderSettings {
            spp: SPP,
            sampler: SamplerKind::Random,
            seed: 3,
            keep,
            powers: all_powers(),
            features: false,
        }
    }

    fn all_methods() -> Vec<(&'static str, Box<dyn Transform>)> {
        let network = Network::builtin("families").expect("it exists").expect("it is sound");
        let listed = METHODS.iter().map(|&(name, _)| (name, method(name).expect("it is listed")));
        let experts: Vec<Box<dyn Expert>> = vec![Box::new(of_samples().with_refit())];
        let guarded = Guard::new(experts).expect("one expert, and refitted");
        let others: [(_, Box<dyn Transform>); 4] = [
            ("families", Box::new(MlpCpu::new(network))),
            ("guard", Box::new(Guard::default())),
            ("gaussian-samples", Box::new(Alone::new(of_samples()))),
            ("guard over gaussian-samples", Box::new(guarded)),
        ];
        listed.chain(others).collect()
    }

    /// Waits for something that another thread does soon, unless it waits for this one.
    fn wait(until: impl Fn() -> bool) {
        let begin = Instant::now();
        while !until() && begin.elapsed() < Duration::from_secs(2) {
            sleep(Duration::from_millis(1));
        }
    }

    /// Planar estimates.
    struct Planes(Vec<f32>);

    impl Planes {
        fn put(&mut self, rows: Range<usize>, estimates: &Estimates) {
            let [width, height] = SIZE.map(|length| length as usize);
            let values = estimates.values().chunks_exact(rows.len() * width);
            for (plane, values) in self.0.chunks_exact_mut(width * height).zip(values) {
                plane[rows.start * width..rows.end * width].copy_from_slice(values);
            }
        }
    }

    /// Renders and estimates at the same time, as far as the method can; the picture, what the
    /// method says, and how many rows it got while others were traced.
    fn estimate(transform: &dyn Transform, stop: bool) -> (Vec<f32>, Option<Judgement>, usize) {
        let mut planes = Planes(vec![f32::NAN; 3 * (SIZE[0] * SIZE[1]) as usize]);
        let put = |rows, estimates: &_| planes.put(rows, estimates);
        let mut estimator = Estimator::new(transform, put).expect("nothing fails");
        let handed = AtomicUsize::new(0);
        let sides = estimator.sides();
        let (expects, tiles) = (sides.is_some() && !stop, AtomicUsize::new(0));
        let mut take = |band: Band| {
            let rows = rows_of(&band.rows);
            assert_eq!(rows.start, handed.load(Ordering::Relaxed), "rows in their order");
            estimator.add(&band.rows).expect("nothing fails");
            handed.store(rows.end, Ordering::Relaxed);
        };
        // The first two rows of three tiles are handed before the last one is traced, unless a
        // tile of theirs is late, and waits here.
        let progress = |_| {
            if tiles.fetch_add(1, Ordering::Relaxed) + 1 == 15 && expects {
                wait(|| handed.load(Ordering::Relaxed) >= 32);
            }
        };
        let control = Control { progress: &progress, stop: &|| stop };
        let consumer = sides.map(|sides| Consumer { sides, take: &mut take });
        // A rendering that is stopped has one pass of sixteen samples.
        let settings = RenderSettings { spp: if stop { 40 } else { SPP }, ..settings() };
        let rendering = render_to(consumer, None, &scene(), &settings, control).expect("it fits");
        assert_eq!(rendering.samples(), if stop { 16 } else { SPP });
        let judgement = estimator.finish(&rendering).expect("nothing fails").judgement().cloned();

        let mut whole = Estimates::default();
        let batch = rendering.batch();
        let fitted = transform.fit(&mut nst_core::Whole::new(&batch)).expect("nothing fails");
        fitted.apply(&batch, &mut whole).expect("nothing fails");
        assert_eq!(judgement.as_ref(), fitted.judgement());
        let same = planes.0.iter().zip(whole.values()).all(|(a, b)| a.to_bits() == b.to_bits());
        assert!(same, "other estimates than of the whole picture");
        (planes.0, judgement, handed.load(Ordering::Relaxed))
    }

    #[test]
    fn estimates_are_those_of_the_whole_picture() {
        let mut early = Vec::new();
        for (name, transform) in all_methods() {
            let alone = estimate(&*transform, false);
            let mut handed = alone.2;
            for threads in [1, 3] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                let pool = pool.expect("some threads");
                let again = pool.install(|| estimate(&*transform, false));
                assert_eq!((&again.0, &again.1), (&alone.0, &alone.1), "{name}, {threads}");
                handed = handed.max(again.2);
            }
            early.extend((handed > 0).then_some(name));
            let stopped = estimate(&*transform, true);
            assert_eq!(stopped.2, 0, "{name}: no pass was known to be the last");
            assert_ne!(stopped.0, alone.0, "{name}: of more samples");
        }
        // All but those that go over the picture twice, and the one that looks at neighbours.
        assert_eq!(early.len(), METHODS.len() + 4 - 3, "{early:?}");
        assert!(!early.contains(&"filter"));
        assert!(early.contains(&"guard") && early.contains(&"families"));
    }

    #[test]
    fn tracing_waits_for_no_consumer() {
        let (tiles, taken) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
        let progress = |_| {
            tiles.fetch_add(1, Ordering::Relaxed);
        };
        let mut take = |band: Band| {
            taken.lock().expect("no panic").push(rows_of(&band.rows));
            wait(|| tiles.load(Ordering::Relaxed) == 18);
            assert_eq!(tiles.load(Ordering::Relaxed), 18, "tracing waits");
        };
        let consumer = Consumer { sides: Vec::new(), take: &mut take };
        let control = Control { progress: &progress, stop: &|| false };
        let rendering = render_to(Some(consumer), None, &scene(), &settings(), control);
        assert!(rendering.is_ok());
        // What it does not take in time is left to the caller.
        assert!(!taken.into_inner().expect("no panic").is_empty());
    }

    #[test]
    fn a_panic_of_the_consumer_is_passed_on() {
        let mut take = |_: Band| panic!("not this");
        let tiles = AtomicUsize::new(0);
        // The last tile is traced after the panic, or a second later.
        let progress = |_| {
            if tiles.fetch_add(1, Ordering::Relaxed) + 1 == 17 {
                sleep(Duration::from_secs(1));
            }
        };
        let consumer = Consumer { sides: Vec::new(), take: &mut take };
        let control = Control { progress: &progress, stop: &|| false };
        let render = || render_to(Some(consumer), None, &scene(), &settings(), control).is_ok();
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(render));
        assert!(result.is_err());
    }
}

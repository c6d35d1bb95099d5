//! What a rendering gives.

use std::{borrow::Cow, ops::Range, time::Duration};

use nst_core::{FOLDS, SampleSums, SequenceBatch, Side, Strips};

use crate::{develop::Buffers, film::Film, tiles::TILE};

/// What [`render()`](crate::render()) returns: sequences of three planar channels of lanes, in
/// a grid. In memory are the kept terms, and the sums from which it can be continued; side
/// channels are made where they are asked for: the means of the folds (from
/// [`FOLDS`] samples on), those of further powers that were asked for, the variance of S_N (from
/// two on), and the number of samples that were not finite (where any was).
#[derive(Clone, Debug)]
pub struct Rendering {
    film: Film,
    /// How long it took, without loading the scene.
    pub time: Duration,
    /// The part of that time in which the acceleration structure, and tables for lights and
    /// materials, were built.
    pub build_time: Duration,
}

impl Rendering {
    /// What is on the film.
    pub(crate) fn new(film: Film, time: Duration, build_time: Duration) -> Self {
        Self { film, time, build_time }
    }

    /// Width and height in pixels.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        self.film.size
    }

    /// Samples per pixel.
    #[must_use]
    pub fn samples(&self) -> u32 {
        self.film.samples
    }

    /// The number of samples behind each term that is kept.
    #[must_use]
    pub fn sample_counts(&self) -> Vec<u32> {
        self.film.slots.sample_counts(self.film.samples)
    }

    /// All side channels, in the order of [`Side`].
    #[must_use]
    pub fn sides(&self) -> Vec<Side> {
        let skipped = (self.skipped() > 0).then_some(&Side::Skipped);
        let features = self.film.has_features().then(|| Side::of_features(self.film.samples));
        let of_powers = self.film.powers.sides().filter(|_| self.samples() as usize >= FOLDS);
        let of_sums = Side::of_sums(self.film.samples).chain(skipped);
        let kept = of_sums.chain(features.into_iter().flatten()).cloned();
        let mut sides: Vec<Side> = kept.chain(of_powers).collect();
        sides.sort_unstable();
        sides
    }

    /// The number of samples that were not finite, and count as black.
    #[must_use]
    pub fn skipped(&self) -> u64 {
        self.film.skipped()
    }

    /// The sequences with all side channels, some rows at a time.
    #[must_use]
    pub fn strips(&self) -> RenderingStrips<'_> {
        let height = self.film.size[1];
        let step = (STRIP_ROWS * rayon::current_num_threads() as u32).min(height);
        let sides = self.sides();
        RenderingStrips { film: &self.film, sides, step, next: 0, halo: 0, given: None }
    }

    /// All at once.
    #[must_use]
    pub fn batch(&self) -> SequenceBatch {
        let rows = self.film.rows(0..self.film.size[1]);
        rows.batch([0; 2], &self.sides(), &mut Buffers::default())
    }

    /// The last term of each lane, S_N.
    #[must_use]
    pub fn last(&self) -> Vec<f32> {
        self.film.rows(0..self.film.size[1]).last()
    }

    /// The sums of some rows: what the rendering can be continued from.
    #[must_use]
    pub fn sums(&self, rows: Range<u32>) -> SampleSums {
        self.film.rows(rows).sums()
    }
}

/// Rows of a strip for each thread: files are compressed in blocks of as many as a tile has.
const STRIP_ROWS: u32 = TILE;

/// A [`Rendering`], some rows at a time: those are made when they are asked for.
#[derive(Clone, Debug)]
pub struct RenderingStrips<'a> {
    film: &'a Film,
    sides: Vec<Side>,
    /// Rows of a strip.
    step: u32,
    /// The first row of the next strip.
    next: u32,
    /// Rows above and below a strip that are given with it.
    halo: u32,
    /// The strip that was given last.
    given: Option<SequenceBatch>,
}

impl RenderingStrips<'_> {
    /// The same with these of its side channels alone.
    #[must_use]
    pub fn with_sides(mut self, wanted: &[Side]) -> Self {
        self.sides.retain(|side| wanted.contains(side));
        self
    }

    /// Strips of this many rows, rounded up to a multiple of 16, instead of as many as all
    /// threads have work with.
    #[must_use]
    pub fn with_rows(self, rows: u32) -> Self {
        Self { step: rows.clamp(1, 1 << 30).next_multiple_of(TILE), ..self }
    }

    /// Strips of at least this many rows, rounded up likewise.
    #[must_use]
    pub fn with_least_rows(self, rows: u32) -> Self {
        let rows = rows.max(self.step);
        self.with_rows(rows)
    }

    /// Goes on with the strip that begins at a row.
    pub fn skip_to(&mut self, row: u32) {
        self.next = row;
    }

    /// The next strip; `None` after the last.
    pub fn next_rows(&mut self) -> Option<SequenceBatch> {
        self.next_in(&mut Buffers::default())
    }

    /// The same in the memory of other strips.
    fn next_in(&mut self, buffers: &mut Buffers) -> Option<SequenceBatch> {
        let height = self.film.size[1];
        let inner = self.next..height.min(self.next.saturating_add(self.step));
        if inner.is_empty() {
            return None;
        }
        self.next = inner.end;
        let first = inner.start.saturating_sub(self.halo);
        let end = height.min(inner.end.saturating_add(self.halo));
        let halo = [inner.start - first, end - inner.end];
        Some(self.film.rows(first..end).batch(halo, &self.sides, buffers))
    }
}

impl Strips for RenderingStrips<'_> {
    fn rewind(&mut self, halo: u32) -> Result<(), nst_core::Error> {
        (self.next, self.halo) = (0, halo);
        Ok(())
    }

    fn next_strip(&mut self) -> Result<Option<Cow<'_, SequenceBatch>>, nst_core::Error> {
        let mut buffers = Buffers::of(self.given.take());
        self.given = self.next_in(&mut buffers);
        Ok(self.given.as_ref().map(Cow::Borrowed))
    }
}

#[cfg(test)]
mod tests {
    use nst_core::{FurtherPowers, Keep, Power};

    use super::*;
    use crate::{RenderSettings, SamplerKind, Scene, render};

    fn rendering(spp: u32, keep: Keep) -> Rendering {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        let scene = Scene::load(&path.join("../../scenes/cornell/cornell.obj"));
        let scene = Scene { size: [37, 50], ..scene.expect("the scene") };
        let settings = RenderSettings {
            spp,
            sampler: SamplerKind::Random,
            seed: 3,
            keep,
            powers: FurtherPowers::NONE,
            features: true,
        };
        render(&scene, &settings, &|_| {}).expect("the scene renders")
    }

    /// The planes of some rows of values `[lane]` or `[pixel]` of the whole picture.
    fn rows_of(values: &[f32], rows: &Range<usize>) -> Vec<f32> {
        let planes = values.chunks(37 * 50);
        planes.flat_map(|plane| &plane[37 * rows.start..37 * rows.end]).copied().collect()
    }

    /// As the whole, whatever their length and halo; and the whole is what the sums say.
    #[test]
    fn strips_are_rows_of_the_whole() {
        for (spp, keep) in
            [(9, Keep::Window(1)), (9, Keep::All), (9, Keep::Pow2(2)), (1, Keep::Window(8))]
        {
            let rendering = rendering(spp, keep);
            let (whole, sums) = (rendering.batch(), rendering.sums(0..50));
            assert_eq!(whole.sample_counts(), keep.sample_counts(spp));
            assert_eq!(whole.last(), rendering.last());
            let means = sums.lanes.iter().map(|lane| (lane.total() / f64::from(spp)) as f32);
            assert!(means.eq(whole.last().iter().copied()), "{keep}");
            let mut again = SequenceBatch::from_last(whole.last(), spp).expect("means");
            again.set_sums(&sums.lanes, spp).expect("as many lanes");
            let of_sums = |(side, _): &(&Side, _)| !side.is_feature();
            assert!(again.sides().eq(whole.sides().filter(of_sums)), "{keep}");
            assert!(whole.sides().map(|(side, _)| side).eq(&rendering.sides()));
            let of_pixels = sums.features.expect("features were asked for");
            let y = of_pixels
                .iter()
                .map(|pixel| (pixel.normal[1].iter().sum::<f64>() / f64::from(spp)) as f32);
            let normals = whole.side(&Side::Normal).expect("normals");
            assert!(y.eq(normals[37 * 50..2 * 37 * 50].iter().copied()), "{keep}");

            for (rows, halo) in [(16, 0), (16, 3), (32, 20), (1000, 5)] {
                let mut strips = rendering.strips().with_rows(rows);
                strips.rewind(halo).expect("a halo of any size");
                let mut next = 0;
                while let Some(strip) = strips.next_strip().expect("nothing fails") {
                    let grid = *strip.grid().expect("a picture");
                    let first = grid.first_row() as usize;
                    let all = first..first + grid.rows();
                    let inner = grid.inner_rows();
                    assert_eq!(first + inner.start, next);
                    next = first + inner.end;
                    let reach = halo as usize;
                    assert_eq!(
                        all,
                        (first + inner.start).saturating_sub(reach)..50.min(next + reach)
                    );
                    for k in 0..whole.sample_counts().len() {
                        assert_eq!(strip.term(k), rows_of(whole.term(k), &all));
                    }
                    let sides: Vec<_> =
                        whole.sides().map(|(side, values)| (side, rows_of(values, &all))).collect();
                    assert!(strip.sides().eq(sides.iter().map(|(s, values)| (*s, &values[..]))));
                }
                assert_eq!(next, 50);
            }
        }
    }

    /// Of one sample in each fold the power means are the sample; of several, a larger power has a
    /// larger mean. The estimates are the same bits.
    #[test]
    fn means_of_further_powers() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        let scene = Scene::load(&path.join("../../scenes/cornell/cornell.obj"));
        let scene = Scene { size: [37, 18], ..scene.expect("the scene") };
        let [quarter, four] = [0.25, 4.0].map(|p| Power::of_value(p).expect("a power of two"));
        for spp in [3, 4, 9] {
            let (sampler, keep) = (SamplerKind::Random, Keep::Window(2));
            let usual = RenderSettings {
                spp,
                sampler,
                seed: 3,
                keep,
                powers: FurtherPowers::NONE,
                features: false,
            };
            let settings = RenderSettings { powers: FurtherPowers::of(&[four, quarter]), ..usual };
            let of =
                |settings| render(&scene, settings, &|_| {}).expect("the scene renders").batch();
            let (batch, usual) = (of(&settings), of(&usual));
            assert_eq!(batch.terms(), usual.terms());
            assert_eq!(batch.sides().count(), usual.sides().count() + if spp < 4 { 0 } else { 8 });
            for fold in (0..4).filter(|_| spp >= 4) {
                let side = |side: Side| batch.side(&side).expect("a mean of a fold").to_vec();
                let [low, mean, high] =
                    [Side::PowerMean(quarter, fold), Side::Fold(fold), Side::PowerMean(four, fold)]
                        .map(side);
                // Means are rounded to f32.
                let at_most = |a: f32, b: f32| a <= b * (1.0 + 2.0 * f32::EPSILON);
                let lanes = low.iter().zip(&mean).zip(&high);
                let rising = |((&a, &b), &c): ((&f32, &f32), &f32)| at_most(a, b) && at_most(b, c);
                assert!(lanes.clone().all(rising), "{spp} spp, fold {fold}");
                let equal = |((&a, &b), &c): ((&f32, &f32), &f32)| at_most(c, b) && at_most(b, a);
                // Nine samples are three in the first fold, and two in the others.
                assert_eq!(lanes.clone().all(equal), spp == 4, "{spp} spp, fold {fold}");
            }
        }
    }

    #[test]
    fn side_channels_can_be_left_out() {
        let rendering = rendering(5, Keep::Window(1));
        let wanted = [Side::Variance, Side::Skipped];
        let strip = rendering.strips().with_sides(&wanted).next_rows().expect("rows");
        assert!(strip.sides().map(|(side, _)| side).eq([&Side::Variance]), "no sample is skipped");
    }
}

//! The film: accumulates radiance samples into each pixel's sequence.

use std::{collections::BTreeMap, ops::Range};

use nst_core::{FOLDS, FurtherPowers, Grid, LaneSums, Power, SampleSums, SequenceBatch, Side};

use crate::{
    Error,
    develop::{Skipped, Strip, TileView},
    feature_planes::{FeaturePlanes, TileFeatures},
    memory,
    path::FeaturePacket,
    settings::{CHANNELS, RenderSettings, Start},
    slots::Slots,
    tiles::{self, Tile},
};

/// The recorded numbers of the whole picture. The pixels of each plane are in the order of
/// tiles.
#[derive(Clone, Debug)]
pub(crate) struct Film {
    grid: Grid,
    pub(crate) size: [u32; 2],
    pub(crate) slots: Slots,
    /// How many samples each pixel has.
    pub(crate) samples: u32,
    /// `[slot][channel][pixel]`
    terms: Vec<f32>,
    /// `[channel][pixel]`
    sums: Vec<LaneSums>,
    /// If they are wanted.
    features: Option<FeaturePlanes>,
    pub(crate) powers: FurtherPowers,
    /// Their sums of each fold, `[power][channel][pixel]`.
    further: Vec<[f64; FOLDS]>,
    /// By tile: the pixels with samples that counted as black, and their number.
    skipped: Vec<Skipped>,
}

impl Film {
    /// An empty film for a picture of a size.
    ///
    /// # Errors
    /// [`Error::Settings`] if there are no pixels or too many, [`Error::Memory`] if they
    /// do not fit.
    pub(crate) fn new(settings: &RenderSettings, size: [u32; 2]) -> Result<Self, Error> {
        let film = Self::without_sums(settings, size, 0)?;
        let (lanes, needed) = (film.grid.lanes(), memory::needed(size, settings));
        Ok(Self {
            sums: memory::zeros(lanes, needed)?,
            further: memory::zeros(settings.powers.count() * lanes, needed)?,
            ..film
        })
    }

    /// The same without the sums of lanes, if it fits together with them; so many bytes of it
    /// are in memory already.
    fn without_sums(
        settings: &RenderSettings,
        size: [u32; 2],
        present: usize,
    ) -> Result<Self, Error> {
        let grid = Grid::new(size[0], size[1], CHANNELS as u32, 0).map_err(|_| {
            let [width, height] = size;
            let why = if width == 0 || height == 0 { "nothing to render" } else { "too many" };
            Error::Settings(format!("{width}x{height} pixels are {why}; give another size"))
        })?;
        let slots = Slots::new(settings.keep, settings.spp);
        memory::check_further(size, settings, present)?;
        let needed = memory::needed(size, settings);
        let features = settings.features.then(|| FeaturePlanes::new(grid.pixels(), needed));
        Ok(Self {
            grid,
            size,
            slots,
            samples: 0,
            terms: memory::zeros(slots.count().saturating_mul(grid.lanes()), needed)?,
            sums: Vec::new(),
            features: features.transpose()?,
            powers: settings.powers,
            further: Vec::new(),
            skipped: vec![Skipped::new(); tiles::tiles(size).count()],
        })
    }

    /// The film of an earlier rendering, to be continued.
    ///
    /// # Errors
    /// As [`Self::new`]; [`Error::Settings`] if the rendering has another size or other
    /// terms, other features or powers, or has all samples already.
    pub(crate) fn of(
        start: Start,
        settings: &RenderSettings,
        size: [u32; 2],
    ) -> Result<Self, Error> {
        let present = memory::of_start(&start);
        let Start { batch, sums } = start;
        let SampleSums { lanes: mut sums, features, powers } = sums;
        let counts = batch.sample_counts();
        let samples = counts[counts.len() - 1];
        let lanes = CHANNELS * size[0] as usize * size[1] as usize;
        let fits = batch.lanes() == lanes
            && sums.len() == lanes
            && samples < settings.spp
            && counts == settings.keep.sample_counts(samples)
            && features.is_some() == settings.features
            && features.as_ref().is_none_or(|pixels| CHANNELS * pixels.len() == lanes)
            && powers.are_of(settings.powers, lanes);
        if !fits {
            let message = format!(
                "a rendering of {} lanes and {samples} spp cannot be continued to {lanes} lanes \
                 and {} spp, or has other terms, or features or powers that are not wanted, or \
                 lacks them",
                batch.lanes(),
                settings.spp
            );
            return Err(Error::Settings(message));
        }
        let mut film = Self::without_sums(settings, size, present)?;
        if let Some(skipped) = batch.side(&Side::Skipped) {
            for (tile, pixels) in tiles::tiles(size).zip(&mut film.skipped) {
                *pixels = (0..tile.pixels())
                    .map(|i| (i as u32, skipped[tile.index(i, size[0])] as u32))
                    .filter(|&(_, count)| count > 0)
                    .collect();
            }
        }
        film.take_terms(batch);
        if let (Some(planes), Some(features)) = (&mut film.features, features) {
            planes.take(features, size);
        }
        let mut further = powers.into_sums();
        tiles::to_tiles(&mut sums, size);
        tiles::to_tiles(&mut further, size);
        Ok(Self { samples, sums, further, ..film })
    }

    /// Fills zeros with the terms that are kept. The batch shrinks as the film grows, so that
    /// no more than a term is in memory twice.
    fn take_terms(&mut self, batch: SequenceBatch) {
        let (counts, lanes) = (batch.sample_counts().to_vec(), self.grid.lanes());
        let mut terms = batch.into_terms();
        for (k, count) in counts.iter().enumerate().rev() {
            for slot in self.slots.of(*count, counts[counts.len() - 1]) {
                self.terms[slot * lanes..][..lanes].copy_from_slice(&terms[k * lanes..]);
            }
            memory::cut(&mut terms, k * lanes);
        }
        tiles::to_tiles(&mut self.terms, self.size);
    }

    /// The tiles of the picture, each with its part of the film.
    pub(crate) fn tiles(&mut self) -> Vec<(Tile, TileFilm<'_>)> {
        let (pixels, slots) = (self.grid.pixels(), self.slots);
        let sums = tiles::split(self.sums.chunks_exact_mut(pixels), self.size);
        let terms = tiles::split(self.terms.chunks_exact_mut(pixels), self.size);
        let further = tiles::split(self.further.chunks_exact_mut(pixels), self.size);
        let features = self.features.as_mut().map(|planes| planes.tiles(self.size));
        let mut features = features.into_iter().flatten();
        let powers: Vec<Power> = self.powers.iter().collect();
        let parts = sums.into_iter().zip(terms).zip(further).zip(&mut self.skipped);
        tiles::tiles(self.size)
            .zip(parts)
            .map(|(tile, (((sums, terms), further), skipped))| {
                let (powers, features) = (powers.clone(), features.next());
                (tile, TileFilm { slots, sums, terms, powers, further, features, skipped })
            })
            .collect()
    }

    /// Some rows, as far as they are recorded.
    pub(crate) fn rows(&self, rows: Range<u32>) -> Strip<'_> {
        let width = self.size[0];
        let tiles = tiles::tiles(self.size).zip(&self.skipped);
        let tiles =
            tiles.filter(|(tile, _)| tile.y < rows.end && rows.start < tile.y + tile.height);
        let view = |(tile, skipped): (Tile, _)| TileView {
            tile,
            sums: parts(&self.sums, self.grid.pixels(), &tile.place(width)),
            terms: parts(&self.terms, self.grid.pixels(), &tile.place(width)),
            features: self.features.as_ref().map(|planes| planes.view(&tile.place(width))),
            further: parts(&self.further, self.grid.pixels(), &tile.place(width)),
            skipped,
        };
        let tiles = tiles.map(view).collect();
        let Self { slots, samples, powers, .. } = *self;
        Strip { rows, width, slots, samples, powers, tiles }
    }

    /// Whether features are kept.
    pub(crate) fn has_features(&self) -> bool {
        self.features.is_some()
    }

    /// How many samples of the whole picture count as black.
    pub(crate) fn skipped(&self) -> u64 {
        self.skipped.iter().flat_map(BTreeMap::values).map(|&count| u64::from(count)).sum()
    }
}

/// The same part of each image.
fn parts<'a, T>(images: &'a [T], pixels: usize, place: &Range<usize>) -> Vec<&'a [T]> {
    images.chunks_exact(pixels).map(|image| &image[place.clone()]).collect()
}

/// A tile's part of the [`Film`].
pub(crate) struct TileFilm<'a> {
    pub(crate) slots: Slots,
    /// `[channel][pixel]`
    sums: Vec<&'a mut [LaneSums]>,
    /// `[slot][channel][pixel]`
    terms: Vec<&'a mut [f32]>,
    /// If they are wanted.
    features: Option<TileFeatures<'a>>,
    pub(crate) powers: Vec<Power>,
    /// `[power][channel][pixel]`
    further: Vec<&'a mut [[f64; FOLDS]]>,
    skipped: &'a mut Skipped,
}

impl TileFilm<'_> {
    /// What is recorded of the tile that it is of.
    pub(crate) fn view(&self, tile: Tile) -> TileView<'_> {
        let sums = self.sums.iter().map(|lanes| &**lanes).collect();
        let terms = self.terms.iter().map(|term| &**term).collect();
        let further = self.further.iter().map(|sums| &**sums).collect();
        let features = self.features.as_ref().map(TileFeatures::view);
        TileView { tile, sums, terms, further, features, skipped: self.skipped }
    }

    /// Whether features are wanted.
    pub(crate) fn has_features(&self) -> bool {
        self.features.is_some()
    }

    /// Writes to the memory of an empty film's sums. To read them first, as adding does, costs
    /// twice as many page faults.
    pub(crate) fn clear(&mut self) {
        self.sums.iter_mut().for_each(|lanes| lanes.fill(LaneSums::default()));
        if let Some(features) = &mut self.features {
            features.clear();
        }
        self.further.iter_mut().for_each(|lanes| lanes.fill([0.0; FOLDS]));
    }

    /// Adds a sample to its pixel, in a pass that ends with S_`end`. Sums are in f64: the
    /// differences between late terms are far below their size. A sample that is not finite
    /// counts as black, as it would spoil the sums of all others. Returns whether it is finite.
    #[inline]
    pub(crate) fn add(
        &mut self,
        pixel: usize,
        index: u32,
        mut rgb: [f64; CHANNELS],
        end: u32,
    ) -> bool {
        let is_finite = rgb.iter().all(|x| x.is_finite());
        if !is_finite {
            *self.skipped.entry(pixel as u32).or_default() += 1;
            rgb = [0.0; CHANNELS];
        }
        for (lanes, sample) in self.sums.iter_mut().zip(rgb) {
            lanes[pixel].add(index, sample);
        }
        let fold = index as usize % FOLDS;
        for (power, lanes) in self.powers.iter().zip(self.further.chunks_exact_mut(CHANNELS)) {
            for (lanes, sample) in lanes.iter_mut().zip(rgb) {
                lanes[pixel][fold] += power.of(sample);
            }
        }
        let n = index + 1;
        for slot in self.slots.of(n, end) {
            let terms = self.terms[slot * CHANNELS..].iter_mut();
            for (term, sums) in terms.zip(&self.sums) {
                term[pixel] = (sums[pixel].total() / f64::from(n)) as f32;
            }
        }
        is_finite
    }

    /// Adds the features of the samples with some indices of each pixel, `[pixel][index]`, if
    /// they are kept.
    pub(crate) fn add_features(&mut self, indices: Range<u32>, packets: &[FeaturePacket]) {
        if let Some(features) = &mut self.features {
            features.add(indices, packets);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use glam::Vec3;
    use nst_core::Keep;

    use super::*;
    use crate::{Rendering, SamplerKind, packet::PACKET, path::FeatureSample};

    fn settings(spp: u32) -> RenderSettings {
        RenderSettings {
            spp,
            sampler: SamplerKind::Random,
            seed: 0,
            keep: Keep::Window(2),
            features: false,
            powers: FurtherPowers::NONE,
        }
    }

    /// What every sample sees.
    const SEEN: FeatureSample = FeatureSample {
        albedo: Vec3::new(0.25, 0.5, 0.75),
        normal: Vec3::Y,
        depth: 3.0,
        emission: Vec3::splat(0.5),
        is_settled: true,
    };

    /// Adds some samples of all pixels, of which those of pixel (20, 3) are `odd`.
    fn expose(film: &mut Film, samples: std::ops::Range<u32>, odd: impl Fn(u32) -> f64) {
        for (tile, mut part) in film.tiles() {
            let mut seen = vec![FeaturePacket::of(&[SEEN; PACKET]); tile.pixels()];
            let paths =
                (0..tile.pixels()).flat_map(|i| samples.clone().map(move |index| (i, index)));
            for (number, (pixel, index)) in paths.enumerate() {
                let value = match tile.pixel(pixel) {
                    (20, 3) => odd(index),
                    _ => f64::from(index),
                };
                if !part.add(pixel, index, [1.0, value, 2.0], samples.end) {
                    seen[number / PACKET].darken(number % PACKET);
                }
            }
            part.add_features(samples.clone(), &seen);
        }
        film.samples = samples.end;
    }

    /// One bad sample must not spoil its pixel, nor be forgotten when the rendering is
    /// continued.
    #[test]
    fn samples_that_are_not_finite_count_as_black_and_are_counted() -> Result<(), Error> {
        let (size, width) = ([37, 18], 37);
        let odd = |index: u32| match index {
            1 => f64::NAN,
            6 => f64::INFINITY,
            _ => f64::from(index),
        };
        let settings = RenderSettings { features: true, ..settings(8) };
        let mut film = Film::new(&settings, size)?;
        expose(&mut film, 0..5, odd);
        assert_eq!(film.skipped(), 1);
        let part = Rendering::new(film, Duration::ZERO, Duration::ZERO);
        let start = Start { batch: part.batch(), sums: part.sums(0..size[1]) };
        let mut film = Film::of(start, &settings, size)?;
        expose(&mut film, 5..8, odd);
        assert_eq!(film.skipped(), 2);
        let whole = Rendering::new(film, Duration::ZERO, Duration::ZERO).batch();
        let (pixel, pixels) = (3 * width + 20, 37 * 18);
        let counts = whole.side(&Side::Skipped).expect("a count per pixel");
        assert_eq!((counts[pixel], counts.iter().sum::<f32>()), (2.0, 2.0));
        // All channels of a sample are left out: 6 of 8 remain of 1 and of 2.
        let of_channel = |channel: usize| whole.last()[channel * pixels + pixel];
        assert_eq!([0, 1, 2].map(of_channel), [0.75, (28.0 - 1.0 - 6.0) / 8.0, 1.5]);
        let variance = whole.side(&Side::Variance).expect("a variance");
        assert!(variance[pixels + pixel] > 0.0 && variance.iter().all(|v| v.is_finite()));
        // It has no radiance, but a surface.
        let feature = |side: Side| whole.side(&side).expect("features are kept")[pixel];
        assert_eq!([feature(Side::Emission), feature(Side::EmissionFold(1))], [0.375, 0.25]);
        assert_eq!([feature(Side::Albedo), feature(Side::Depth)], [0.25, 3.0]);
        assert_eq!(feature(Side::AlbedoFold(1)), 0.25);
        Ok(())
    }

    #[test]
    fn what_does_not_fit_the_memory_is_refused() {
        for (size, spp, keep) in [
            ([16_000, 16_000], 4_000_000_000, Keep::All),
            ([64, 64], 4_000_000_000, Keep::All),
            ([26_000, 26_000], 1 << 20, Keep::Window(1 << 20)),
        ] {
            let settings = RenderSettings { keep, ..settings(spp) };
            let error = Film::new(&settings, size).expect_err("too large").to_string();
            assert!(error.contains("GiB"), "{error}");
        }
        let error = Film::new(&settings(1), [60_000, 60_000]).expect_err("too many pixels");
        assert!(error.to_string().contains("too many"), "{error}");
    }
}

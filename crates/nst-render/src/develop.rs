//! Rows of a picture, made from what is recorded of its tiles: sequences and side channels.

use std::{collections::BTreeMap, ops::Range, vec};

use ndarray::Array2;
use nst_core::{
    Extent, FOLDS, FeatureSums, FurtherPowers, Grid, LaneSums, PowerSums, SampleSums,
    SequenceBatch, Side, fold_count,
};
use rayon::prelude::*;

use crate::{
    feature_planes::FeaturesView,
    settings::CHANNELS,
    slots::Slots,
    tiles::{TILE, Tile},
};

/// How many samples of a pixel counted as black, by its index in the tile.
pub(crate) type Skipped = BTreeMap<u32, u32>;

/// What is recorded of a tile.
pub(crate) struct TileView<'a> {
    pub(crate) tile: Tile,
    /// `[channel][pixel]`
    pub(crate) sums: Vec<&'a [LaneSums]>,
    /// `[slot][channel][pixel]`
    pub(crate) terms: Vec<&'a [f32]>,
    /// If they are kept.
    pub(crate) features: Option<FeaturesView<'a>>,
    /// Sums of further powers, `[power][channel][pixel]`.
    pub(crate) further: Vec<&'a [[f64; FOLDS]]>,
    pub(crate) skipped: &'a Skipped,
}

/// Memory of a strip that is no longer used, for the next one: the system has to clear what is new.
#[derive(Default)]
pub(crate) struct Buffers(vec::IntoIter<Vec<f32>>);

impl Buffers {
    /// That of a strip.
    pub(crate) fn of(strip: Option<SequenceBatch>) -> Self {
        Self(strip.map(SequenceBatch::into_buffers).unwrap_or_default().into_iter())
    }

    /// So many numbers, all of which are to be written. They come in the order of the strip's, so
    /// that most fit.
    fn take(&mut self, count: usize) -> Vec<f32> {
        let Some(mut values) = self.0.next() else { return vec![0.0; count] };
        values.resize(count, 0.0);
        values
    }
}

/// Some rows of a picture.
pub(crate) struct Strip<'a> {
    pub(crate) rows: Range<u32>,
    /// Of the picture.
    pub(crate) width: u32,
    pub(crate) slots: Slots,
    /// How many samples each pixel has.
    pub(crate) samples: u32,
    pub(crate) powers: FurtherPowers,
    /// All tiles that have some of these rows, from the top, and from the left.
    pub(crate) tiles: Vec<TileView<'a>>,
}

impl Strip<'_> {
    /// The rows with these side channels, as far as the samples have them. Each of them that
    /// follows from the sums is given only from enough samples on.
    pub(crate) fn batch(
        &self,
        [above, below]: [u32; 2],
        sides: &[Side],
        buffers: &mut Buffers,
    ) -> SequenceBatch {
        const FITS: &str = "a strip has a number for each lane of its grid";
        let rows = self.rows.len() as u32;
        let grid = Grid::new(self.width, rows, CHANNELS as u32, self.rows.start);
        let grid = grid.and_then(|grid| grid.with_halo(above, below)).expect(FITS);
        let slots = self.slots.sorted(self.samples);
        let mut terms = buffers.take(slots.len() * grid.lanes());
        self.fill(&mut [&mut terms[..]], |tile, plane, pixels, out| {
            let term = tile.terms[slots[plane / CHANNELS] * CHANNELS + plane % CHANNELS];
            out[0].copy_from_slice(&term[pixels]);
        });
        let terms = Array2::from_shape_vec((slots.len(), grid.lanes()), terms).expect(FITS);
        let batch = SequenceBatch::new(terms, self.slots.sample_counts(self.samples));
        let mut batch = batch.expect("a rendering has a sample");
        batch.set_grid(grid).expect(FITS);
        for (side, values) in self.sides(&grid, sides, buffers) {
            batch.set_side(side, values).expect(FITS);
        }
        batch
    }

    /// The last term, `[lane]`.
    pub(crate) fn last(&self) -> Vec<f32> {
        let slots = self.slots.sorted(self.samples);
        let slot = *slots.last().expect("a rendering has a sample");
        let mut last = vec![0.0; self.lanes()];
        self.fill(&mut [&mut last[..]], |tile, channel, pixels, out| {
            out[0].copy_from_slice(&tile.terms[slot * CHANNELS + channel][pixels]);
        });
        last
    }

    /// All sums.
    pub(crate) fn sums(&self) -> SampleSums {
        let (lanes, features) = (self.lane_sums(), self.feature_sums());
        SampleSums { lanes, features, powers: self.power_sums() }
    }

    /// Those of the samples, `[lane]`.
    fn lane_sums(&self) -> Vec<LaneSums> {
        let mut sums = vec![LaneSums::default(); self.lanes()];
        self.fill(&mut [&mut sums[..]], |tile, channel, pixels, out| {
            out[0].copy_from_slice(&tile.sums[channel][pixels]);
        });
        sums
    }

    /// Those of their further powers.
    fn power_sums(&self) -> PowerSums {
        let mut sums = vec![[0.0; FOLDS]; self.powers.count() * self.lanes()];
        self.fill(&mut [&mut sums[..]], |tile, plane, pixels, out| {
            out[0].copy_from_slice(&tile.further[plane][pixels]);
        });
        PowerSums::from_sums(self.powers, sums).expect("sums of each power of each lane")
    }

    /// The sums of the features, `[pixel]`, if they are kept.
    fn feature_sums(&self) -> Option<Vec<FeatureSums>> {
        self.tiles.first()?.features.as_ref()?;
        let mut sums = vec![FeatureSums::default(); self.lanes() / CHANNELS];
        self.fill(&mut [&mut sums[..]], |tile, _, pixels, out| {
            if let Some(features) = &tile.features {
                features.write_sums(pixels, out[0]);
            }
        });
        Some(sums)
    }

    fn lanes(&self) -> usize {
        CHANNELS * self.rows.len() * self.width as usize
    }

    /// Those of some side channels that can be given.
    fn sides(&self, grid: &Grid, wanted: &[Side], buffers: &mut Buffers) -> Vec<(Side, Vec<f32>)> {
        let of_sums = Side::of_sums(self.samples).filter(|side| wanted.contains(side));
        let of_sums: Vec<&Side> = of_sums.collect();
        let mut planes: Vec<_> = of_sums.iter().map(|_| buffers.take(grid.lanes())).collect();
        let mut outs: Vec<&mut [f32]> = planes.iter_mut().map(Vec::as_mut_slice).collect();
        // They come first, if they are wanted at all.
        let all_folds =
            of_sums.iter().copied().take(Side::EVERY_OF_FOLDS.len()).eq(Side::EVERY_OF_FOLDS);
        let at_once = if all_folds { Side::EVERY_OF_FOLDS.len() } else { 0 };
        self.fill(&mut outs, |tile, channel, pixels, outs| {
            let sums = &tile.sums[channel][pixels];
            let (folds, others) = outs.split_at_mut(at_once);
            if all_folds {
                LaneSums::write_folds(sums, self.samples, folds);
            }
            for (side, out) in of_sums[at_once..].iter().zip(others) {
                LaneSums::write_side(sums, side, self.samples, out);
            }
        });
        let mut sides: Vec<_> = of_sums.into_iter().cloned().zip(planes).collect();
        sides.extend(self.power_means(grid, wanted));
        if wanted.contains(&Side::Skipped) {
            sides.push((Side::Skipped, self.skipped(grid)));
        }
        if self.tiles.iter().all(|tile| tile.features.is_some()) {
            sides.extend(self.features(grid, wanted, buffers));
        }
        sides
    }

    /// Those of the features.
    fn features(
        &self,
        grid: &Grid,
        wanted: &[Side],
        buffers: &mut Buffers,
    ) -> Vec<(Side, Vec<f32>)> {
        let features = Side::of_features(self.samples).filter(|side| wanted.contains(side));
        let mut features: Vec<&Side> = features.collect();
        let mut sides = Vec::new();
        for folds in Side::FEATURE_FOLDS {
            if !folds.iter().all(|side| features.contains(&side)) {
                continue;
            }
            features.retain(|side| !folds.contains(side));
            let mut means = [(); FOLDS].map(|()| buffers.take(3 * grid.pixels()));
            let mut outs = means.each_mut().map(Vec::as_mut_slice);
            self.fill(&mut outs, |tile, channel, pixels, outs| {
                if let (Some(features), Ok(outs)) = (&tile.features, outs.try_into()) {
                    features.write_folds(pixels, folds, channel, self.samples, outs);
                }
            });
            sides.extend(folds.iter().cloned().zip(means));
        }
        let others =
            features.into_iter().map(|side| (side.clone(), self.feature(grid, side, buffers)));
        sides.extend(others);
        sides
    }

    /// A feature of all pixels.
    fn feature(&self, grid: &Grid, side: &Side, buffers: &mut Buffers) -> Vec<f32> {
        let channels = match side.extent() {
            Extent::Lane => CHANNELS,
            Extent::Pixel => 1,
            Extent::Vector => 3,
        };
        let mut means = buffers.take(channels * grid.pixels());
        self.fill(&mut [&mut means[..]], |tile, channel, pixels, out| {
            if let Some(features) = &tile.features {
                features.write_side(pixels, side, channel, self.samples, out[0]);
            }
        });
        means
    }

    /// Those of the means of further powers, if each fold has a sample.
    fn power_means(&self, grid: &Grid, wanted: &[Side]) -> Vec<(Side, Vec<f32>)> {
        let mut sides = Vec::new();
        if (self.samples as usize) < FOLDS {
            return sides;
        }
        for (index, power) in self.powers.iter().enumerate() {
            for (fold, side) in Side::power_means(power).into_iter().enumerate() {
                if !wanted.contains(&side) {
                    continue;
                }
                let (mut means, count) = (vec![0.0; grid.lanes()], fold_count(fold, self.samples));
                self.fill(&mut [&mut means[..]], |tile, channel, pixels, out| {
                    let sums = &tile.further[index * CHANNELS + channel][pixels];
                    for (out, sums) in out[0].iter_mut().zip(sums) {
                        *out = power.mean_of(sums[fold] / count) as f32;
                    }
                });
                sides.push((side, means));
            }
        }
        sides
    }

    /// How many samples of each pixel count as black.
    fn skipped(&self, grid: &Grid) -> Vec<f32> {
        let mut counts = vec![0.0; grid.pixels()];
        for TileView { tile, skipped, .. } in &self.tiles {
            for (&i, &count) in *skipped {
                let (x, y) = tile.pixel(i as usize);
                if self.rows.contains(&y) {
                    counts[((y - self.rows.start) * self.width + x) as usize] = count as f32;
                }
            }
        }
        counts
    }

    /// Fills images `[plane][row][x]`. `write` gets a tile, the number of the plane, pixels of
    /// the tile, and the place of these in each of `outs`.
    fn fill<T: Send>(
        &self,
        outs: &mut [&mut [T]],
        write: impl Fn(&TileView<'_>, usize, Range<usize>, &mut [&mut [T]]) + Sync,
    ) {
        let width = self.width as usize;
        // `[plane][row][image]`
        let mut parts: Vec<Vec<&mut [T]>> = Vec::new();
        for out in outs {
            let rows = out.chunks_exact_mut(width);
            parts.resize_with(rows.len(), Vec::new);
            parts.iter_mut().zip(rows).for_each(|(part, row)| part.push(row));
        }
        let across = self.width.div_ceil(TILE) as usize;
        let first = self.rows.start / TILE;
        parts.into_par_iter().enumerate().for_each(|(i, mut outs)| {
            let (plane, y) = (i / self.rows.len(), self.rows.start + (i % self.rows.len()) as u32);
            let tiles = &self.tiles[(y / TILE - first) as usize * across..][..across];
            let mut part: Vec<&mut [T]> = Vec::with_capacity(outs.len());
            for tile in tiles {
                part.clear();
                for out in &mut outs {
                    let rest = std::mem::take(out);
                    let (left, right) = rest.split_at_mut(tile.tile.width as usize);
                    part.push(left);
                    *out = right;
                }
                write(tile, plane, tile.tile.row(y), &mut part);
            }
        });
    }
}

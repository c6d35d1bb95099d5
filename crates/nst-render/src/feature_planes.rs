//! The sums of features of a picture, plane by plane: most tiles see no light directly, and the
//! memory of what nobody writes to is never taken.

use std::ops::Range;

use nst_core::{FOLDS, FeatureSum, FeatureSums, Side, write_fold_means};

use crate::{
    Error, memory,
    packet::PACKET,
    path::FeaturePacket,
    tiles::{self, BATCH, TILE},
};

/// [Planes](FeatureSums::planes) with sums of folds.
const PLANES: usize = FeatureSums::PLANES;
/// The first that is of emission; they come last.
const EMISSION: usize = 6;
/// How many samples of a pixel come at once most often.
const USUAL_COUNT: usize = BATCH as usize;

/// [`FeatureSums`] of the whole picture. The pixels of each plane are in the order of tiles.
#[derive(Clone, Debug)]
pub(crate) struct FeaturePlanes {
    /// `[plane][pixel]`
    folds: Vec<[f64; FOLDS]>,
    /// `[pixel]`
    depth: Vec<f64>,
}

impl FeaturePlanes {
    /// Zeros.
    ///
    /// # Errors
    /// [`Error::Memory`] if they do not fit.
    pub(crate) fn new(pixels: usize, needed: u128) -> Result<Self, Error> {
        let folds = memory::zeros(PLANES.saturating_mul(pixels), needed)?;
        Ok(Self { folds, depth: memory::zeros(pixels, needed)? })
    }

    /// Fills planes of zeros with the sums of a picture of this size, row by row. They shrink as
    /// the planes grow, so that no more than a row of tiles is in memory twice.
    pub(crate) fn take(&mut self, mut sums: Vec<FeatureSums>, [width, _]: [u32; 2]) {
        let row_of_tiles = (TILE * width) as usize;
        while !sums.is_empty() {
            let first = (sums.len() - 1) / row_of_tiles * row_of_tiles;
            let rows = &mut sums[first..];
            let height = rows.len() as u32 / width;
            tiles::to_tiles(rows, [width, height]);
            self.fill(first, rows);
            memory::cut(&mut sums, first);
        }
    }

    /// Fills zeros with sums in the order of tiles, from a pixel on.
    fn fill(&mut self, first: usize, sums: &[FeatureSums]) {
        for (pixel, sums) in (first..).zip(sums) {
            for (plane, folds) in sums.planes().into_iter().enumerate() {
                // Zeros are there already.
                if *folds != [0.0; FOLDS] {
                    self.folds[plane * self.depth.len() + pixel] = *folds;
                }
            }
            self.depth[pixel] = sums.depth;
        }
    }

    /// The part of each tile of a picture of this size.
    pub(crate) fn tiles(&mut self, size: [u32; 2]) -> Vec<TileFeatures<'_>> {
        let pixels = self.depth.len();
        let folds = tiles::split(self.folds.chunks_exact_mut(pixels), size);
        let depths = tiles::split([&mut self.depth[..]].into_iter(), size);
        let depths = depths.into_iter().flatten();
        folds.into_iter().zip(depths).map(|(folds, depth)| TileFeatures { folds, depth }).collect()
    }

    /// Those of some pixels.
    pub(crate) fn view(&self, place: &Range<usize>) -> FeaturesView<'_> {
        let folds = self.folds.chunks_exact(self.depth.len());
        let folds = folds.map(|plane| &plane[place.clone()]).collect();
        FeaturesView { folds, depth: &self.depth[place.clone()] }
    }
}

/// A tile's part of [`FeaturePlanes`].
pub(crate) struct TileFeatures<'a> {
    /// `[plane][pixel]`
    folds: Vec<&'a mut [[f64; FOLDS]]>,
    /// `[pixel]`
    depth: &'a mut [f64],
}

impl TileFeatures<'_> {
    /// Writes zeros where each sample will add something: to read that memory first costs more.
    pub(crate) fn clear(&mut self) {
        self.folds[..EMISSION].iter_mut().for_each(|plane| plane.fill([0.0; FOLDS]));
        self.depth.fill(0.0);
    }

    /// Adds the samples with some indices of each pixel, `[pixel][index]`, those of a pixel in
    /// their order: so no bit depends on how many come at once.
    pub(crate) fn add(&mut self, indices: Range<u32>, packets: &[FeaturePacket]) {
        let mut values = Vec::with_capacity(packets.len() * PACKET);
        packets.iter().for_each(|packet| values.extend_from_slice(&packet.depth));
        for (depth, values) in self.depth.iter_mut().zip(values.chunks_exact(indices.len())) {
            *depth = values.iter().fold(*depth, |sum, &value| sum + f64::from(value));
        }
        let add = match indices.start as usize % FOLDS {
            0 => add_folds::<0>,
            1 => add_folds::<1>,
            2 => add_folds::<2>,
            _ => add_folds::<3>,
        };
        let emits = packets.iter().any(|packet| packet.emits);
        let planes = if emits { PLANES } else { EMISSION };
        for (plane, sums) in self.folds[..planes].iter_mut().enumerate() {
            values.clear();
            for packet in packets {
                values.extend_from_slice(plane_of(packet, plane));
            }
            add(sums, &values, indices.len());
        }
    }

    pub(crate) fn view(&self) -> FeaturesView<'_> {
        let folds = self.folds.iter().map(|plane| &**plane).collect();
        FeaturesView { folds, depth: self.depth }
    }
}

/// Adds this many values of each pixel, `[pixel][index]`, the first of which is of a fold.
fn add_folds<const FIRST: usize>(sums: &mut [[f64; FOLDS]], values: &[f32], count: usize) {
    // Of most batches, the count is known to the compiler.
    if count == USUAL_COUNT {
        let (values, _) = values.as_chunks::<USUAL_COUNT>();
        sums.iter_mut().zip(values).for_each(|(sums, values)| add_pixel::<FIRST>(sums, values));
    } else {
        let values = values.chunks_exact(count);
        sums.iter_mut().zip(values).for_each(|(sums, values)| add_pixel::<FIRST>(sums, values));
    }
}

/// Adds values to the sums of a pixel, the first to those of a fold. Folds side by side become
/// vector instructions.
#[inline(always)]
fn add_pixel<const FIRST: usize>(sums: &mut [f64; FOLDS], values: &[f32]) {
    let mut folds: [f64; FOLDS] = std::array::from_fn(|i| sums[(FIRST + i) % FOLDS]);
    let (rounds, rest) = values.as_chunks::<FOLDS>();
    for round in rounds {
        folds = std::array::from_fn(|i| folds[i] + f64::from(round[i]));
    }
    // In registers: what is written to memory one by one is not soon read side by side.
    folds = std::array::from_fn(|i| match rest.get(i) {
        Some(&value) => folds[i] + f64::from(value),
        None => folds[i],
    });
    *sums = std::array::from_fn(|fold| folds[(fold + FOLDS - FIRST) % FOLDS]);
}

/// What a packet adds to a plane of folds.
#[inline(always)]
fn plane_of(packet: &FeaturePacket, plane: usize) -> &[f32; PACKET] {
    match plane / 3 {
        0 => packet.albedo.coordinate(plane),
        1 => packet.normal.coordinate(plane - 3),
        _ if packet.emits => packet.emission.coordinate(plane - EMISSION),
        _ => &[0.0; PACKET],
    }
}

/// The sums of some pixels.
pub(crate) struct FeaturesView<'a> {
    /// `[plane][pixel]`
    folds: Vec<&'a [[f64; FOLDS]]>,
    /// `[pixel]`
    depth: &'a [f64],
}

impl FeaturesView<'_> {
    /// Those of some of the pixels.
    pub(crate) fn write_sums(&self, pixels: Range<usize>, out: &mut [FeatureSums]) {
        for (pixel, out) in pixels.zip(out) {
            *out = FeatureSums::of_planes(|plane| self.folds[plane][pixel], self.depth[pixel]);
        }
    }

    /// Writes a channel of all folds of a feature of some of the pixels, which have n samples, at
    /// once: what [`Self::write_side`] does for each.
    pub(crate) fn write_folds(
        &self,
        pixels: Range<usize>,
        folds: &[Side; FOLDS],
        channel: usize,
        n: u32,
        outs: &mut [&mut [f32]; FOLDS],
    ) {
        if let Some(FeatureSum::Fold(plane, _)) = FeatureSum::of(&folds[0], channel) {
            write_fold_means(&self.folds[plane][pixels], |folds| folds, n, outs);
        }
    }

    /// Writes a channel of a feature of some of the pixels, which have n samples; leaves `out` as
    /// it is if the side channel is another.
    pub(crate) fn write_side(
        &self,
        pixels: Range<usize>,
        side: &Side,
        channel: usize,
        n: u32,
        out: &mut [f32],
    ) {
        let Some(sum) = FeatureSum::of(side, channel) else { return };
        let count = sum.count(n);
        let mean = |sum: f64| (sum / count) as f32;
        match sum {
            FeatureSum::Plane(plane) => {
                let sums = &self.folds[plane][pixels];
                let sums = out.iter_mut().zip(sums);
                sums.for_each(|(out, &[a, b, c, d])| *out = mean(a + b + c + d));
            }
            FeatureSum::Fold(plane, fold) => {
                let sums = &self.folds[plane][pixels];
                out.iter_mut().zip(sums).for_each(|(out, sums)| *out = mean(sums[fold]));
            }
            FeatureSum::Depth => {
                let sums = &self.depth[pixels];
                out.iter_mut().zip(sums).for_each(|(out, sum)| *out = mean(*sum));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::path::FeatureSample;

    const SIZE: [u32; 2] = [5, 3];
    const PIXELS: usize = 15;

    /// A sample that tells its pixel and index. A third of the pixels see light directly.
    fn sample(pixel: usize, index: u32) -> FeatureSample {
        let x = (pixel as f32 + 1.0) / 7.0 + index as f32 / 3.0;
        let emission = if pixel.is_multiple_of(3) { Vec3::new(x, 0.0, -x) } else { Vec3::ZERO };
        FeatureSample {
            albedo: Vec3::new(0.1 * x, 0.01, 1.0 / (1.0 + x)),
            normal: Vec3::new(x.sin(), -x, x.cos()),
            depth: 3.0 + x,
            emission,
            is_settled: true,
        }
    }

    fn add(planes: &mut FeaturePlanes, indices: Range<u32>) {
        let paths: Vec<FeatureSample> = (0..PIXELS)
            .flat_map(|pixel| indices.clone().map(move |index| sample(pixel, index)))
            .collect();
        let packets: Vec<FeaturePacket> = paths.chunks(PACKET).map(FeaturePacket::of).collect();
        planes.tiles(SIZE)[0].add(indices, &packets);
    }

    /// One by one.
    fn expected(n: u32) -> Vec<FeatureSums> {
        let mut pixels = vec![FeatureSums::default(); PIXELS];
        for (pixel, sums) in pixels.iter_mut().enumerate() {
            for index in 0..n {
                let (sample, fold) = (sample(pixel, index), index as usize % FOLDS);
                for channel in 0..3 {
                    sums.albedo[channel][fold] += f64::from(sample.albedo[channel]);
                    sums.normal[channel][fold] += f64::from(sample.normal[channel]);
                    sums.emission[channel][fold] += f64::from(sample.emission[channel]);
                }
                sums.depth += f64::from(sample.depth);
            }
        }
        pixels
    }

    fn sums(planes: &FeaturePlanes) -> Vec<FeatureSums> {
        let mut sums = vec![FeatureSums::default(); PIXELS];
        planes.view(&(0..PIXELS)).write_sums(0..PIXELS, &mut sums);
        sums
    }

    /// All bits, also if they are continued from sums.
    #[test]
    fn sums_are_those_of_samples_one_by_one() {
        for ends in [&[8, 16, 24][..], &[24], &[3, 11, 12, 20, 24], &[1, 2, 3, 4, 12, 24]] {
            let mut planes = FeaturePlanes::new(PIXELS, 0).expect("some memory");
            planes.tiles(SIZE)[0].clear();
            let mut first = 0;
            for &end in ends {
                add(&mut planes, first..end);
                assert_eq!(sums(&planes), expected(end), "{ends:?}");
                let sums = sums(&planes);
                planes = FeaturePlanes::new(PIXELS, 0).expect("some memory");
                planes.fill(0, &sums);
                first = end;
            }
        }
    }

    #[test]
    fn side_channels_are_those_of_the_sums() {
        let mut planes = FeaturePlanes::new(PIXELS, 0).expect("some memory");
        add(&mut planes, 0..7);
        let sums = expected(7);
        for side in Side::FEATURES.iter().chain([&Side::Skipped]) {
            for channel in 0..if *side == Side::Depth { 1 } else { 3 } {
                let (mut means, mut expected) = ([9.0; 10], [9.0; 10]);
                planes.view(&(1..13)).write_side(1..11, side, channel, 7, &mut means);
                for (expected, sums) in expected.iter_mut().zip(&sums[2..12]) {
                    if let Some(sum) = sums.sum(side, channel) {
                        *expected = (sum / FeatureSums::count(side, 7)) as f32;
                    }
                }
                assert_eq!(means, expected, "{side:?}");
            }
        }
    }

    #[test]
    fn all_folds_at_once_are_those_one_by_one() {
        let mut planes = FeaturePlanes::new(PIXELS, 0).expect("some memory");
        add(&mut planes, 0..7);
        let view = planes.view(&(1..13));
        for sides in Side::FEATURE_FOLDS {
            for channel in 0..3 {
                let mut at_once = [[9.0; 10]; FOLDS];
                let mut outs = at_once.each_mut().map(|out| &mut out[..]);
                view.write_folds(1..11, sides, channel, 7, &mut outs);
                for (side, means) in sides.iter().zip(at_once) {
                    let mut expected = [8.0; 10];
                    view.write_side(1..11, side, channel, 7, &mut expected);
                    assert_eq!(means, expected, "{side}");
                }
            }
        }
    }
}

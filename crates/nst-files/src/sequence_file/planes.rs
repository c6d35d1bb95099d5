//! What strips are read into. Strips with a halo overlap; the rows that two of them share are
//! kept, so that each block of a file is decompressed once.

use std::ops::Range;

use nst_core::Grid;
use rayon::prelude::*;

/// Values of a strip.
pub(super) struct Planes {
    /// Of the terms, then of each side channel, `[channel][pixel]`.
    pub(super) layers: Vec<Vec<f32>>,
    pub(super) grid: Grid,
}

impl Planes {
    /// Room for layers of so many channels.
    pub(super) fn new(channels: impl Iterator<Item = usize>, grid: Grid) -> Self {
        Self { layers: channels.map(|count| vec![0.0; count * grid.pixels()]).collect(), grid }
    }

    /// The images of all channels, from a row of the picture on.
    pub(super) fn images(&mut self, row: u32) -> Vec<&mut [u32]> {
        let start = (row - self.grid.first_row()) as usize * self.grid.width();
        let pixels = self.grid.pixels();
        let images = self.layers.iter_mut().flat_map(|values| values.chunks_exact_mut(pixels));
        images.map(|image| bytemuck::cast_slice_mut(&mut image[start..])).collect()
    }
}

/// The last rows that were read for a strip, which the next one begins with.
#[derive(Default)]
pub(super) struct KeptRows {
    /// Which rows of the picture.
    pub(super) rows: Range<u32>,
    /// `[channel][pixel]`, the bits of f32.
    values: Vec<u32>,
}

impl KeptRows {
    /// Room for rows of so many channels.
    pub(super) fn new(rows: Range<u32>, channels: usize, width: usize) -> Self {
        Self { values: vec![0; channels * rows.len() * width], rows }
    }

    /// The images of all channels, from a row of the picture on.
    pub(super) fn images(&mut self, row: u32, width: usize) -> Vec<&mut [u32]> {
        let start = (row - self.rows.start) as usize * width;
        // Without rows there are no images.
        let images = self.values.chunks_exact_mut((self.rows.len() * width).max(1));
        images.map(|image| &mut image[start..]).collect()
    }

    /// Copies the rows to a strip that begins with them.
    pub(super) fn put(&mut self, strip: &mut Planes) {
        let images = self.images(self.rows.start, strip.grid.width());
        let of_strip = strip.images(strip.grid.first_row());
        images.into_par_iter().zip(of_strip).for_each(|(kept, image)| {
            image[..kept.len()].copy_from_slice(kept);
        });
    }

    /// Copies the last rows of a strip, from the first of these on.
    pub(super) fn take(&mut self, strip: &mut Planes) {
        let first = self.rows.start;
        let images = self.images(first, strip.grid.width());
        images.into_par_iter().zip(strip.images(first)).for_each(|(kept, image)| {
            kept[..image.len()].copy_from_slice(image);
        });
    }
}

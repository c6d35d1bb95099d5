//! The tiles of a picture: the units of work of threads, and the order of pixels in memory
//! during a rendering.

use std::ops::Range;

use rayon::prelude::*;

/// Pixels along the side of a tile: enough to fill packets, and small enough that all
/// threads have work almost until the end.
pub(crate) const TILE: u32 = 16;

/// Samples of each pixel of a tile that are traced side by side: 2048 paths of a tile,
/// enough to fill packets of sixteen.
pub(crate) const BATCH: u32 = 8;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tile {
    pub(crate) x: u32,
    pub(crate) y: u32,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

impl Tile {
    pub(crate) fn pixels(&self) -> usize {
        (self.width * self.height) as usize
    }

    /// Where its pixels are in an image that is stored tile by tile.
    pub(crate) fn place(&self, width: u32) -> Range<usize> {
        let start = self.y as usize * width as usize + self.x as usize * self.height as usize;
        start..start + self.pixels()
    }

    /// The pixels of the tile, counted row by row, that are in a row of the picture.
    pub(crate) fn row(&self, y: u32) -> Range<usize> {
        let start = ((y - self.y) * self.width) as usize;
        start..start + self.width as usize
    }

    /// The index in the picture of a pixel of the tile, row by row.
    pub(crate) fn index(&self, i: usize, width: u32) -> usize {
        let (x, y) = self.pixel(i);
        y as usize * width as usize + x as usize
    }

    /// The coordinates of a pixel of the tile, which are counted row by row.
    pub(crate) fn pixel(&self, i: usize) -> (u32, u32) {
        (self.x + i as u32 % self.width, self.y + i as u32 / self.width)
    }
}

/// The tiles of a picture: rows of tiles from the top.
pub(crate) fn tiles([width, height]: [u32; 2]) -> impl Iterator<Item = Tile> {
    let starts = |length: u32| (0..length).step_by(TILE as usize);
    starts(height).flat_map(move |y| {
        starts(width).map(move |x| Tile {
            x,
            y,
            width: TILE.min(width - x),
            height: TILE.min(height - y),
        })
    })
}

/// Splits images in the order of tiles into the parts of each tile, `[tile][image]`.
pub(crate) fn split<'a, T>(
    images: impl Iterator<Item = &'a mut [T]>,
    size: [u32; 2],
) -> Vec<Vec<&'a mut [T]>> {
    let mut parts: Vec<Vec<&mut [T]>> = tiles(size).map(|_| Vec::new()).collect();
    for mut rest in images {
        for (tile, parts) in tiles(size).zip(&mut parts) {
            let (part, others) = rest.split_at_mut(tile.pixels());
            parts.push(part);
            rest = others;
        }
    }
    parts
}

/// Turns images that are stored row by row into images that are stored tile by tile. In both
/// orders a row of tiles is the same part of the image, so that each can be reordered alone.
pub(crate) fn to_tiles<T: Copy + Send>(images: &mut [T], [width, height]: [u32; 2]) {
    let pixels = width as usize * height as usize;
    images.par_chunks_exact_mut(pixels).for_each(|image| {
        let mut rows = Vec::new();
        for band in image.chunks_mut(TILE as usize * width as usize) {
            rows.clear();
            rows.extend_from_slice(band);
            let height = (band.len() / width as usize) as u32;
            for tile in tiles([width, height]) {
                let part = band[tile.place(width)].iter_mut().enumerate();
                part.for_each(|(i, pixel)| *pixel = rows[tile.index(i, width)]);
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_where_their_tile_says() {
        for size in [[1, 1], [16, 16], [40, 21], [7, 33]] {
            let pixels = size[0] as usize * size[1] as usize;
            // Two images whose values are the numbers of their pixels.
            let rows: Vec<usize> = (0..pixels).chain(0..pixels).collect();
            let mut images = rows.clone();
            to_tiles(&mut images, size);
            let image = images[..pixels].to_vec();
            let parts = split(images.chunks_exact_mut(pixels), size);
            assert_eq!(parts.len(), tiles(size).count());
            for (tile, parts) in tiles(size).zip(parts) {
                let numbers = (0..tile.pixels()).map(|i| {
                    let (x, y) = tile.pixel(i);
                    (y * size[0] + x) as usize
                });
                let numbers: Vec<usize> = numbers.collect();
                assert!(parts.iter().all(|part| **part == numbers));
                assert_eq!(image[tile.place(size[0])], numbers);
                for y in tile.y..tile.y + tile.height {
                    let first = (y * size[0] + tile.x) as usize;
                    let row: Vec<usize> = (first..first + tile.width as usize).collect();
                    assert_eq!(numbers[tile.row(y)], row);
                }
            }
        }
    }
}

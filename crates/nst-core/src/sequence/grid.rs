//! [`Grid`]: how lanes lie in a picture.

use std::{borrow::Cow, ops::Range};

use crate::Error;

/// The place of a batch in a picture: all of it, or a strip of whole rows.
///
/// Lanes are planar, rows from the top: lane = (channel · rows + y) · width + x. With a
/// grid, methods may look at a lane's neighbours; sequences that do not come from a picture
/// have no grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    width: u32,
    rows: u32,
    channels: u32,
    first_row: u32,
    halo: [u32; 2],
}

impl Grid {
    /// The most lanes of a grid. One term of more lanes would take over 8 GiB; a file whose
    /// header promises that is probably damaged.
    pub const MOST_LANES: u64 = 1 << 31;

    /// Rows of a picture `width` pixels wide, of which the first is row `first_row`.
    ///
    /// # Errors
    /// [`Error::Batch`] if there is no lane, or more than [`Self::MOST_LANES`].
    pub fn new(width: u32, rows: u32, channels: u32, first_row: u32) -> Result<Self, Error> {
        let lanes = [width, rows, channels].map(u64::from).into_iter().fold(1, u64::saturating_mul);
        if lanes == 0 || lanes > Self::MOST_LANES || first_row.checked_add(rows).is_none() {
            return Err(Error::Batch(format!(
                "{width}x{rows} pixels of {channels} channels are {}",
                if lanes == 0 { "nothing" } else { "too many" }
            )));
        }
        Ok(Self { width, rows, channels, first_row, halo: [0; 2] })
    }

    /// The same rows, of which the first `above` and the last `below` are a halo: methods
    /// read them as neighbours of the others, and return no estimates for them.
    ///
    /// # Errors
    /// [`Error::Batch`] if no other row remains.
    pub fn with_halo(self, above: u32, below: u32) -> Result<Self, Error> {
        if u64::from(above) + u64::from(below) >= u64::from(self.rows) {
            let message = format!("{} rows, {above} and {below} of them a halo", self.rows);
            return Err(Error::Batch(message));
        }
        Ok(Self { halo: [above, below], ..self })
    }

    /// Pixels in a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width as usize
    }

    /// Rows of the batch, including its halo.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows as usize
    }

    /// Lanes of a pixel.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels as usize
    }

    /// The picture's row that the batch begins with.
    #[must_use]
    pub fn first_row(&self) -> u32 {
        self.first_row
    }

    /// Pixels of the batch.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.width() * self.rows()
    }

    /// Lanes of the batch.
    #[must_use]
    pub fn lanes(&self) -> usize {
        self.channels() * self.pixels()
    }

    /// The rows of the batch that get estimates: all but the halo.
    #[must_use]
    pub fn inner_rows(&self) -> Range<usize> {
        let [above, below] = self.halo;
        above as usize..(self.rows - below) as usize
    }

    /// The same rows, as they are counted in the picture.
    #[must_use]
    pub fn picture_rows(&self) -> Range<usize> {
        let (first, inner) = (self.first_row as usize, self.inner_rows());
        first + inner.start..first + inner.end
    }

    /// Of values `[lane]` of the batch, or of other planes of its pixels, those of the
    /// [inner rows](Self::inner_rows).
    #[must_use]
    pub fn inner<'a>(&self, lanes: &'a [f32]) -> Cow<'a, [f32]> {
        if self.halo == [0; 2] {
            return Cow::Borrowed(lanes);
        }
        let planes =
            (0..lanes.len() / self.pixels()).map(|c| &lanes[self.lanes_of(c, self.inner_rows())]);
        Cow::Owned(planes.collect::<Vec<_>>().concat())
    }

    /// The lanes of one channel of some rows of the batch.
    #[must_use]
    pub fn lanes_of(&self, channel: usize, rows: Range<usize>) -> Range<usize> {
        let row = |y: usize| channel * self.pixels() + y * self.width();
        row(rows.start)..row(rows.end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_and_halo() -> Result<(), Error> {
        let grid = Grid::new(5, 4, 3, 16)?;
        assert_eq!((grid.pixels(), grid.lanes(), grid.inner_rows()), (20, 60, 0..4));
        assert_eq!(grid.lanes_of(1, 2..4), 30..40);
        assert_eq!(grid.with_halo(1, 2)?.inner_rows(), 1..2);
        let lanes: Vec<f32> = (0..60_u8).map(f32::from).collect();
        assert_eq!(grid.inner(&lanes), lanes);
        let inner = grid.with_halo(1, 2)?.inner(&lanes).into_owned();
        assert_eq!((inner.len(), inner[0], inner[5], inner[14]), (15, 5.0, 25.0, 49.0));
        assert_eq!(grid.with_halo(1, 2)?.inner(&lanes[20..40])[..], [25.0, 26.0, 27.0, 28.0, 29.0]);
        assert!(grid.with_halo(2, 2).is_err());
        Ok(())
    }

    #[test]
    fn empty_and_uncountable_grids_are_refused() {
        for [width, rows, channels] in [[0, 1, 1], [1, 0, 1], [1, 1, 0], [u32::MAX; 3]] {
            assert!(Grid::new(width, rows, channels, 0).is_err(), "{width} {rows} {channels}");
        }
        assert!(Grid::new(1, 2, 1, u32::MAX).is_err());
    }
}

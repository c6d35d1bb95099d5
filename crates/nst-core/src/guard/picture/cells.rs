//! Sums over lanes that are alike: near each other in the picture, and as bright.

use rayon::prelude::*;

use super::{
    super::{
        hats::{Hats, Place},
        sample::{GROUPS, SHARE, dispersion},
    },
    simplex::{MOST, Moments},
};
use crate::FOLDS;

/// Brightness, ln(|E|/u + .01) of an estimate E that has less noise than S, in steps of a half:
/// from a hundredth of the unit to 130 times it.
pub(super) const BRIGHTNESS: Hats<20> = Hats { low: -4.6, high: 4.9 };

/// Sums of one brightness.
pub(super) const KNOTS: usize = BRIGHTNESS.knots();

/// The halves of the chessboard.
pub(super) const HALVES: usize = 2;

/// The least width and height of a cell, in pixels.
const LEAST_SIZE: usize = 8;

/// The most cells: of large pictures, cells are larger.
const MOST_CELLS: usize = 1 << 16;

/// Cells of a row that are one task of the thread pool.
const CELLS_PER_TASK: usize = 32;

/// What b of one of the groups adds to that of S with all folds.
const OF_S: f64 = SHARE / GROUPS as f64;

/// Sums over lanes and groups.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    pub(super) moments: Moments,
    /// Of the variance of S.
    pub(super) variance: f64,
    /// How many lanes.
    pub(super) count: f64,
}

impl Sums {
    /// Whether no lane was near.
    pub(super) fn is_empty(&self) -> bool {
        self.count == 0.0 && self.variance == 0.0
    }

    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self, share: f64) {
        self.add_of_group::<MOST>(other, share);
        self.add_of_all::<MOST>(other, share);
    }

    /// The same of b, the variance and the count.
    #[inline(always)]
    pub(super) fn add_errors(&mut self, other: &Self, share: f64) {
        self.add_of_group::<MOST>(other, share);
        self.count += share * other.count;
    }

    /// The same of what groups add to: b of so many experts, and the variance.
    #[inline(always)]
    fn add_of_group<const N: usize>(&mut self, other: &Self, share: f64) {
        self.moments.add_b::<N>(&other.moments, share);
        self.variance += share * other.variance;
    }

    /// The same of what all folds add to: A, and the count.
    #[inline(always)]
    fn add_of_all<const N: usize>(&mut self, other: &Self, share: f64) {
        self.moments.add_a::<N>(&other.moments, share);
        self.count += share * other.count;
    }
}

/// How a picture is divided.
#[derive(Clone, Copy, Debug)]
pub(super) struct Division {
    /// Columns and rows of pixels in a cell.
    pub(super) size: usize,
    /// Cells in a row.
    pub(super) across: usize,
    /// Rows of cells.
    pub(super) down: usize,
}

impl Division {
    pub(super) fn new(width: usize, height: usize) -> Self {
        let mut size = LEAST_SIZE;
        while width.div_ceil(size) * height.div_ceil(size) > MOST_CELLS {
            size *= 2;
        }
        Self { size, across: width.div_ceil(size), down: height.div_ceil(size) }
    }

    /// How many sums a row of cells has.
    pub(super) fn of_row(&self) -> usize {
        self.across * HALVES * KNOTS
    }

    /// Where the sums of a cell begin, in its row.
    #[inline(always)]
    pub(super) fn place(column: usize, half: usize, knot: usize) -> usize {
        (column * HALVES + half) * KNOTS + knot
    }
}

/// The sums of a picture, `[row][column][half][knot]`.
pub(super) struct Cells {
    pub(super) division: Division,
    pub(super) sums: Vec<Sums>,
}

/// What experts say of the inner rows of a strip, without a group.
pub(super) struct Held {
    /// What they change, `[expert][lane]`.
    pub(super) changes: Vec<Vec<f32>>,
    /// h − S, `[lane]`.
    pub(super) missing: Vec<f32>,
    /// Where the brightness of a pixel lies, `[pixel]`.
    pub(super) places: Vec<Place>,
}

/// The inner rows of a strip.
pub(super) struct Rows<'a> {
    pub(super) width: usize,
    pub(super) channels: usize,
    /// In the picture.
    pub(super) first: usize,
    /// `[pixel]`
    pub(super) halves: &'a [u8],
    /// `[group]`; after the groups, that of all folds.
    pub(super) held: [&'a Held; GROUPS + 1],
}

impl Rows<'_> {
    fn pixels(&self) -> usize {
        self.halves.len()
    }

    /// How many rows.
    fn count(&self) -> usize {
        self.pixels() / self.width
    }
}

impl Cells {
    pub(super) fn new(division: Division) -> Self {
        // By all threads: the first to write to memory waits for it.
        let sums = (0..division.down * division.of_row()).into_par_iter();
        Self { division, sums: sums.map(|_| Sums::default()).collect() }
    }

    /// The sums of a row of cells, `[column][half][knot]`.
    pub(super) fn row(&self, row: usize) -> &[Sums] {
        let of_row = self.division.of_row();
        &self.sums[row * of_row..][..of_row]
    }

    /// Adds rows. Each cell gets its pixels row by row, and the groups of each pixel in turn, so
    /// that its sums do not depend on how the picture is cut.
    pub(super) fn add(&mut self, rows: &Rows<'_>, counts: &[f64; FOLDS]) {
        // The compiler leaves out what fewer experts have none of.
        match rows.held[GROUPS].changes.len() {
            0 => self.add_of::<0>(rows, counts),
            1 => self.add_of::<1>(rows, counts),
            2 => self.add_of::<2>(rows, counts),
            3 => self.add_of::<3>(rows, counts),
            MOST => self.add_of::<MOST>(rows, counts),
            more => unreachable!("{more} experts of one layer"),
        }
    }

    /// Of so many experts.
    fn add_of<const N: usize>(&mut self, rows: &Rows<'_>, counts: &[f64; FOLDS]) {
        let Division { size, .. } = self.division;
        let (held, dispersion) = (rows.held.map(HeldOf::<N>::new), dispersion(counts));
        let (end, pixels) = (rows.first + rows.count(), rows.pixels());
        let all = self.sums.par_chunks_mut(self.division.of_row()).enumerate();
        all.skip(rows.first / size).take(end.div_ceil(size) - rows.first / size).for_each(
            |(row, sums)| {
                let range = rows.first.max(row * size)..end.min((row + 1) * size);
                let parts = sums.par_chunks_mut(CELLS_PER_TASK * HALVES * KNOTS).enumerate();
                parts.for_each(|(part, sums)| {
                    let left = part * CELLS_PER_TASK * size;
                    let columns = left..rows.width.min(left + CELLS_PER_TASK * size);
                    for y in range.clone() {
                        let first = (y - rows.first) * rows.width;
                        for x in columns.clone() {
                            let half = usize::from(rows.halves[first + x]);
                            let place = Division::place((x - left) / size, half, 0);
                            let cell = &mut sums[place..][..KNOTS];
                            let lanes = (first + x..rows.channels * pixels).step_by(pixels);
                            add_pixel(cell, &held, first + x, lanes, &dispersion);
                        }
                    }
                });
            },
        );
    }
}

/// The numbers of [`Held`], of so many experts.
struct HeldOf<'a, const N: usize> {
    changes: [&'a [f32]; N],
    missing: &'a [f32],
    places: &'a [Place],
}

impl<'a, const N: usize> HeldOf<'a, N> {
    fn new(held: &'a Held) -> Self {
        let changes = std::array::from_fn(|expert| held.changes[expert].as_slice());
        Self { changes, missing: &held.missing, places: &held.places }
    }

    /// What the experts change in a lane.
    #[inline(always)]
    fn changes(&self, lane: usize) -> [f64; N] {
        self.changes.map(|lanes| lanes[lane].into())
    }
}

/// Adds a pixel, with its lanes, to the sums of its cell.
#[inline(always)]
fn add_pixel<const N: usize>(
    cell: &mut [Sums],
    held: &[HeldOf<'_, N>; GROUPS + 1],
    pixel: usize,
    lanes: impl Iterator<Item = usize> + Clone,
    dispersion: &[f64; GROUPS],
) {
    let [groups @ .., all] = held;
    for (held, dispersion) in groups.iter().zip(dispersion) {
        let mut sums = Sums::default();
        for lane in lanes.clone() {
            let missing = f64::from(held.missing[lane]);
            sums.variance += dispersion * missing * missing;
            sums.moments.add_products(&held.changes(lane), OF_S * missing);
        }
        // What is not finite says nothing, and where nothing is missing, as in most pixels that see no
        // lamp, sums are 0.
        if sums.variance.is_finite() && sums.variance > 0.0 {
            for (knot, share) in held.places[pixel].knots() {
                cell[knot].add_of_group::<N>(&sums, share.into());
            }
        }
    }
    let mut sums = Sums::default();
    for lane in lanes {
        sums.count += 1.0;
        sums.moments.add_squares(&all.changes(lane));
    }
    if sums.moments.trace().is_finite() {
        for (knot, share) in all.places[pixel].knots() {
            cell[knot].add_of_all::<N>(&sums, share.into());
        }
    }
}

//! Sums smoothed over what is near in the picture, and over brightness.

use std::sync::Arc;

use rayon::prelude::*;

use super::cells::{Cells, Division, HALVES, KNOTS, Sums};

/// σ of the distance, in pixels, up to which lanes are alike, and of a wider view.
const DISTANCE: f64 = 8.0;
const WIDE: f64 = 24.0;

/// σ of the brightness, in knots: of what is near, and of the whole picture or of much of it.
const BRIGHTNESS: f64 = 0.7;
const BRIGHTNESS_OF_ALL: f64 = 1.0;

/// What is not near contributes less than this: exp(−x²/2) at three σ.
const REACH: f64 = 3.0;

/// Shares of the neighbours in a row, from −reach to reach; they add up to 1.
fn gaussian(sigma: f64) -> Vec<f64> {
    let reach = (REACH * sigma).ceil() as i32;
    let weights = (-reach..=reach).map(|i| (-0.5 * (f64::from(i) / sigma).powi(2)).exp());
    let weights: Vec<f64> = weights.collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

/// The sums of the whole picture, as means over its cells, `[half][knot]`.
pub(super) fn of_all(cells: &Cells) -> [[Sums; KNOTS]; HALVES] {
    let mut all = [[Sums::default(); KNOTS]; HALVES];
    let share = 1.0 / (cells.division.across * cells.division.down) as f64;
    for cell in cells.sums.chunks_exact(HALVES * KNOTS) {
        for (sum, sums) in all.as_flattened_mut().iter_mut().zip(cell) {
            sum.add(sums, share);
        }
    }
    all.map(|of_half| over_brightness(&of_half))
}

/// The sums of the whole picture at each knot, smoothed.
pub(super) fn over_brightness(sums: &[Sums; KNOTS]) -> [Sums; KNOTS] {
    let mut smooth = [Sums::default(); KNOTS];
    along(&gaussian(BRIGHTNESS_OF_ALL), sums, &mut smooth, Sums::add);
    smooth
}

/// The variance of S in cells of one half, `[knot]`, and their lanes, smoothed over brightness as
/// what is near; b, too.
pub(super) fn errors_over_brightness(sums: &[Sums]) -> [Sums; KNOTS] {
    let mut smooth = [Sums::default(); KNOTS];
    along(&gaussian(BRIGHTNESS), sums, &mut smooth, Sums::add_errors);
    smooth
}

/// Smooths sums over their knots; what falls beyond the ends is lost.
#[inline(always)]
fn along(kernel: &[f64], from: &[Sums], to: &mut [Sums], add: impl Fn(&mut Sums, &Sums, f64)) {
    let reach = kernel.len() / 2;
    for (i, from) in from.iter().enumerate().filter(|(_, sums)| !sums.is_empty()) {
        for (k, share) in kernel.iter().enumerate() {
            if let Some(sums) = (i + k).checked_sub(reach).and_then(|i| to.get_mut(i)) {
                add(sums, from, *share);
            }
        }
    }
}

/// Which sums of a cell are not empty, by their place. Most are empty, and reading them takes longest.
type Occupied = u64;

const OF_CELL: usize = HALVES * KNOTS;
const _: () = assert!(OF_CELL <= Occupied::BITS as usize);

/// The places, in their order.
#[inline(always)]
fn places(mut occupied: Occupied) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = occupied.trailing_zeros() as usize;
        (occupied != 0).then(|| {
            occupied &= occupied - 1;
            place
        })
    })
}

/// Adds a share of the sums of a cell.
#[inline(always)]
fn add_cell(
    to: &mut [Sums],
    from: &[Sums],
    occupied: Occupied,
    share: f64,
    add: impl Fn(&mut Sums, &Sums, f64),
) {
    let (to, from) = (&mut to[..OF_CELL], &from[..OF_CELL]);
    places(occupied).for_each(|place| add(&mut to[place], &from[place], share));
}

/// Sums over what is near each cell.
pub(super) struct Near<'a> {
    cells: &'a Cells,
    /// `[row][column]`
    occupied: Arc<[Occupied]>,
    of_distance: Vec<f64>,
    of_brightness: Vec<f64>,
}

impl<'a> Near<'a> {
    pub(super) fn new(cells: &'a Cells) -> Self {
        let occupied = cells.sums.par_chunks_exact(OF_CELL).map(|cell| {
            let of_place =
                |(place, sums): (usize, &Sums)| Occupied::from(!sums.is_empty()) << place;
            cell.iter().enumerate().map(of_place).sum()
        });
        let occupied: Vec<Occupied> = occupied.collect();
        Self::over(cells, occupied.into(), DISTANCE, BRIGHTNESS)
    }

    /// The same three times as far, of which [`Self::errors`] are asked.
    pub(super) fn wide(&self) -> Self {
        Self::over(self.cells, self.occupied.clone(), WIDE, BRIGHTNESS_OF_ALL)
    }

    fn over(cells: &'a Cells, occupied: Arc<[Occupied]>, distance: f64, brightness: f64) -> Self {
        let of_distance = gaussian(distance / cells.division.size as f64);
        Self { cells, occupied, of_distance, of_brightness: gaussian(brightness) }
    }

    /// Writes the sums of a row of cells, `[column][half][knot]`.
    pub(super) fn row(&self, row: usize, out: &mut Vec<Sums>) {
        self.smooth(row, out, Sums::add);
    }

    /// The same without A, which takes most of the time.
    pub(super) fn errors(&self, row: usize, out: &mut Vec<Sums>) {
        self.smooth(row, out, Sums::add_errors);
    }

    #[inline(always)]
    fn smooth(&self, row: usize, out: &mut Vec<Sums>, add: impl Fn(&mut Sums, &Sums, f64) + Copy) {
        let Division { across, down, .. } = self.cells.division;
        let reach = self.of_distance.len() / 2;
        let clamp = |i: usize, k: usize, count: usize| (i + k).saturating_sub(reach).min(count - 1);
        let mut column_sums = vec![Sums::default(); across * OF_CELL];
        let mut occupied = vec![0; across];
        for (k, share) in self.of_distance.iter().enumerate() {
            let row = clamp(row, k, down);
            let cells =
                self.cells.row(row).chunks_exact(OF_CELL).zip(&self.occupied[row * across..]);
            let sums = column_sums.chunks_exact_mut(OF_CELL).zip(&mut occupied);
            for ((to, all), (from, of_cell)) in sums.zip(cells) {
                *all |= of_cell;
                add_cell(to, from, *of_cell, *share, add);
            }
        }
        out.clear();
        out.resize(across * OF_CELL, Sums::default());
        let mut cell = [Sums::default(); OF_CELL];
        for (column, out) in out.chunks_exact_mut(OF_CELL).enumerate() {
            cell.fill(Sums::default());
            for (k, share) in self.of_distance.iter().enumerate() {
                let column = clamp(column, k, across);
                let from = &column_sums[column * OF_CELL..];
                add_cell(&mut cell, from, occupied[column], *share, add);
            }
            for (from, to) in cell.chunks_exact(KNOTS).zip(out.chunks_exact_mut(KNOTS)) {
                along(&self.of_brightness, from, to, add);
            }
        }
    }
}

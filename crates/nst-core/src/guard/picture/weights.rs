//! How far each expert is trusted, cell by cell, and what that gains.

use rayon::prelude::*;

use super::{
    super::hats::Place,
    cells::{Cells, Division, HALVES, KNOTS, Sums},
    simplex::{MOST, Moments},
};

/// σ of the distance, in pixels, up to which lanes are alike.
const DISTANCE: f64 = 4.0;

/// σ of the brightness, in knots: of what is near, and of the whole picture.
const BRIGHTNESS: f64 = 0.7;
const BRIGHTNESS_OF_ALL: f64 = 1.0;

/// The weight of the whole picture at the same brightness, relative to what is near.
const OF_ALL: f64 = 0.05;

/// What is not near contributes less than this: exp(−x²/2) at three σ.
const REACH: f64 = 3.0;

/// The least variance of T in a cell, relative to that of S: what sums say below is noise.
const LEAST_ERROR: f64 = 0.05;

/// Pixels in a row of a block, whose changes count as one draw: experts err alike in neighbours.
const BLOCK: usize = 16;

/// Weights for each cell and brightness.
pub(super) struct Weights {
    division: Division,
    /// Learnt from a half, `[row][column][half][knot]`.
    weights: Vec<[f32; MOST]>,
    /// Near a cell, `[row][column][knot]`: the sum of what T's variance is, and the count.
    errors: Vec<[f32; 2]>,
}

/// What the weights of one layer gain.
pub(super) struct Gain {
    /// The changes of the sums of squared errors, and the variances of S, of each block.
    pub(super) blocks: Vec<[f64; 2]>,
    /// The mean of each expert's weight.
    pub(super) trust: [f64; MOST],
}

/// What one row of cells yields.
struct Row {
    weights: Vec<[f32; MOST]>,
    errors: Vec<[f32; 2]>,
    /// δ and the variance, by cell.
    gains: Vec<[f64; 2]>,
    /// Sums of the experts' weights, and the count.
    trust: [f64; MOST],
    count: f64,
}

/// Shares of the neighbours in a row, from −reach to reach; they add up to 1.
fn gaussian(sigma: f64) -> Vec<f64> {
    let reach = (REACH * sigma).ceil() as i32;
    let weights = (-reach..=reach).map(|i| (-0.5 * (f64::from(i) / sigma).powi(2)).exp());
    let weights: Vec<f64> = weights.collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

impl Weights {
    /// Fits weights of the first `count` experts to what one half says, and judges them by the
    /// other. Where that says that they lose, S stays.
    pub(super) fn fit(cells: &Cells, count: usize) -> (Self, Gain) {
        let division = cells.division;
        let of_all = of_all(cells, count);
        let near = Near::new(cells);
        let rows: Vec<Row> = (0..division.down)
            .into_par_iter()
            .map_init(Vec::new, |buffer, row| {
                near.row(row, buffer);
                Row::new(&cells.sums[row * division.of_row()..], &*buffer, &of_all, division, count)
            })
            .collect();
        let gain = Gain::new(&rows, division);
        if gain.blocks.iter().map(|block| block[0]).sum::<f64>() > 0.0 {
            return Self::fit(cells, 0);
        }
        let (mut weights, mut errors) = (Vec::new(), Vec::new());
        for row in rows {
            weights.extend(row.weights);
            errors.extend(row.errors);
        }
        (Self { division, weights, errors }, gain)
    }

    /// The weights of a pixel that is in this half, learnt from the other, and the variance that
    /// T has near it, relative to its lanes' number.
    #[inline(always)]
    pub(super) fn at(&self, x: usize, y: usize, half: usize, place: Place) -> ([f32; MOST], f32) {
        let Division { size, across, down } = self.division;
        let between = |x: usize, count: usize| {
            let at = ((x as f32 + 0.5) / size as f32 - 0.5).clamp(0.0, (count - 1) as f32);
            let first = (at as usize).min(count.saturating_sub(2));
            let share = at - first as f32;
            [(first, 1.0 - share), ((first + 1).min(count - 1), share)]
        };
        let (columns, rows) = (between(x, across), between(y, down));
        let (mut weights, mut errors) = ([0.0; MOST], [0.0; 2]);
        for (row, of_row) in rows {
            for (column, of_column) in columns {
                let cell = row * across + column;
                for (knot, of_knot) in place.knots() {
                    let share = of_row * of_column * of_knot as f32;
                    let own = self.weights[(cell * HALVES + 1 - half) * KNOTS + knot];
                    weights.iter_mut().zip(own).for_each(|(sum, weight)| *sum += share * weight);
                    let own = self.errors[cell * KNOTS + knot];
                    errors.iter_mut().zip(own).for_each(|(sum, error)| *sum += share * error);
                }
            }
        }
        (weights, errors[0] / errors[1])
    }
}

/// The sums of the whole picture with weights fitted to them, `[half][knot]`.
type OfAll = [[(Moments, [f64; MOST]); KNOTS]; HALVES];

/// Sums of the whole picture, as means over its cells.
fn of_all(cells: &Cells, count: usize) -> OfAll {
    let mut all = [[Sums::default(); KNOTS]; HALVES];
    for cell in cells.sums.chunks_exact(HALVES * KNOTS) {
        for (sum, sums) in all.as_flattened_mut().iter_mut().zip(cell) {
            sum.add(sums, 1.0);
        }
    }
    let kernel = gaussian(BRIGHTNESS_OF_ALL);
    let cells = (cells.division.across * cells.division.down) as f64;
    all.map(|of_half| {
        let mut smooth = [Sums::default(); KNOTS];
        along(&kernel, &of_half, &mut smooth);
        smooth.map(|sums| {
            let mut mean = Sums::default();
            mean.add(&sums, 1.0 / cells);
            (mean.moments, sums.moments.best_weights(count))
        })
    })
}

/// Smooths sums over their knots; what falls beyond the ends is lost.
fn along(kernel: &[f64], from: &[Sums], to: &mut [Sums]) {
    let reach = kernel.len() / 2;
    for (i, from) in from.iter().enumerate().filter(|(_, sums)| !sums.is_empty()) {
        for (k, share) in kernel.iter().enumerate() {
            if let Some(sums) = (i + k).checked_sub(reach).and_then(|i| to.get_mut(i)) {
                sums.add(from, *share);
            }
        }
    }
}

/// Sums over what is near each cell.
struct Near<'a> {
    cells: &'a Cells,
    of_distance: Vec<f64>,
    of_brightness: Vec<f64>,
}

impl<'a> Near<'a> {
    fn new(cells: &'a Cells) -> Self {
        let of_distance = gaussian(DISTANCE / cells.division.size as f64);
        Self { cells, of_distance, of_brightness: gaussian(BRIGHTNESS) }
    }

    /// Writes the sums of a row of cells, `[column][half][knot]`.
    fn row(&self, row: usize, out: &mut Vec<Sums>) {
        let Division { across, down, .. } = self.cells.division;
        let (of_row, of_cell) = (self.cells.division.of_row(), HALVES * KNOTS);
        let reach = self.of_distance.len() / 2;
        let clamp = |i: usize, k: usize, count: usize| (i + k).saturating_sub(reach).min(count - 1);
        let mut rows = vec![Sums::default(); of_row];
        for (k, share) in self.of_distance.iter().enumerate() {
            let from = &self.cells.sums[clamp(row, k, down) * of_row..][..of_row];
            let sums = rows.iter_mut().zip(from).filter(|(_, from)| !from.is_empty());
            sums.for_each(|(sum, from)| sum.add(from, *share));
        }
        out.clear();
        out.resize(of_row, Sums::default());
        let mut cell = vec![Sums::default(); of_cell];
        for (column, out) in out.chunks_exact_mut(of_cell).enumerate() {
            cell.fill(Sums::default());
            for (k, share) in self.of_distance.iter().enumerate() {
                let from = &rows[clamp(column, k, across) * of_cell..][..of_cell];
                let sums = cell.iter_mut().zip(from).filter(|(_, from)| !from.is_empty());
                sums.for_each(|(sum, from)| sum.add(from, *share));
            }
            for (from, to) in cell.chunks_exact(KNOTS).zip(out.chunks_exact_mut(KNOTS)) {
                along(&self.of_brightness, from, to);
            }
        }
    }
}

impl Row {
    /// Of the sums of a row of cells themselves, and near them.
    fn new(own: &[Sums], near: &[Sums], of_all: &OfAll, division: Division, count: usize) -> Self {
        let mut row = Self {
            weights: Vec::with_capacity(division.of_row()),
            errors: Vec::with_capacity(division.across * KNOTS),
            gains: Vec::with_capacity(division.across),
            trust: [0.0; MOST],
            count: 0.0,
        };
        for column in 0..division.across {
            let mut weights = [[[0.0; MOST]; KNOTS]; HALVES];
            for half in 0..HALVES {
                for knot in 0..KNOTS {
                    let near = &near[Division::place(column, half, knot)];
                    weights[half][knot] = best(near, &of_all[half][knot], count);
                }
            }
            let single = |w: [f64; MOST]| w.map(|w| w as f32);
            row.weights.extend(weights.as_flattened().iter().copied().map(single));
            row.judge(own, near, &weights, column);
        }
        row
    }

    /// Judges weights by the half that they were not fitted to.
    fn judge(
        &mut self,
        own: &[Sums],
        near: &[Sums],
        weights: &[[[f64; MOST]; KNOTS]; HALVES],
        column: usize,
    ) {
        let mut gain = [0.0; 2];
        for knot in 0..KNOTS {
            let mut error = [0.0; 2];
            for half in 0..HALVES {
                let w = &weights[1 - half][knot];
                let place = Division::place(column, half, knot);
                let (own, near) = (&own[place], &near[place]);
                gain[0] += own.moments.change(w);
                gain[1] += own.variance;
                self.trust.iter_mut().zip(w).for_each(|(sum, w)| *sum += own.count * w);
                self.count += own.count;
                let change = near.moments.change(w);
                error[0] += (near.variance + change).max(LEAST_ERROR * near.variance);
                error[1] += near.count;
            }
            self.errors.push(error.map(|x| x as f32));
        }
        self.gains.push(gain);
    }
}

/// The weights of a cell, by what is near it and some of the whole picture's sums.
fn best(near: &Sums, (of_all, prior): &(Moments, [f64; MOST]), count: usize) -> [f64; MOST] {
    if near.moments.trace() <= 1e-9 * of_all.trace() {
        return *prior;
    }
    let mut moments = near.moments;
    let of_prior = of_all.times(prior);
    moments.a.iter_mut().zip(&of_all.a).for_each(|(sum, all)| *sum += OF_ALL * all);
    moments.b.iter_mut().zip(&of_prior).for_each(|(sum, all)| *sum += OF_ALL * all);
    moments.best_weights(count)
}

impl Gain {
    fn new(rows: &[Row], division: Division) -> Self {
        let per_block = BLOCK.div_ceil(division.size);
        let across = division.across.div_ceil(per_block);
        let mut blocks = vec![[0.0; 2]; across * division.down.div_ceil(per_block)];
        for (y, row) in rows.iter().enumerate() {
            for (x, gain) in row.gains.iter().enumerate() {
                let block = &mut blocks[y / per_block * across + x / per_block];
                block.iter_mut().zip(gain).for_each(|(sum, gain)| *sum += gain);
            }
        }
        let count: f64 = rows.iter().map(|row| row.count).sum();
        let trust = |expert: usize| rows.iter().map(|row| row.trust[expert]).sum::<f64>() / count;
        Self { blocks, trust: std::array::from_fn(trust) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums of a picture of one brightness in which one expert changes all lanes by 1, and these
    /// are missing in the lanes of the halves.
    fn cells(missing: [f64; HALVES]) -> Cells {
        let division = Division::new(32, 32);
        let mut cells = Cells::new(division);
        for cell in cells.sums.chunks_exact_mut(HALVES * KNOTS) {
            for (half, missing) in missing.into_iter().enumerate() {
                let sums = &mut cell[half * KNOTS + 9];
                (sums.count, sums.variance) = (24.0, 24.0);
                sums.moments.add_squares(&[24.0_f64.sqrt(), 0.0, 0.0, 0.0]);
                sums.moments.add_products(&[24.0, 0.0, 0.0, 0.0], missing);
            }
        }
        cells
    }

    #[test]
    fn one_half_says_how_much_the_other_may_change() {
        let place = super::super::cells::BRIGHTNESS.place(-0.1);
        let (weights, gain) = Weights::fit(&cells([0.5, 0.25]), 1);
        let of = |half: usize| f64::from(weights.at(13, 22, half, place).0[0]);
        // The ridge takes a ten-thousandth off.
        assert!((of(0) - 0.25).abs() < 1e-3 && (of(1) - 0.5).abs() < 1e-3);
        // w² − 2 w b of each half, 64 cells of 24 lanes.
        let changes = 64.0 * 24.0 * (0.0625 - 0.25 + 0.25 - 0.25);
        let told: f64 = gain.blocks.iter().map(|block| block[0]).sum();
        assert!((told / changes - 1.0).abs() < 1e-3, "{told} {changes}");
        assert_eq!(gain.blocks.len(), 4);
    }

    #[test]
    fn what_loses_by_the_other_half_is_not_blended() {
        let (weights, gain) = Weights::fit(&cells([0.9, -0.5]), 1);
        assert_eq!(gain.trust, [0.0; MOST]);
        assert!(weights.weights.iter().all(|w| *w == [0.0; MOST]));
    }
}

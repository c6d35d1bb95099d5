//! How far each expert is trusted, cell by cell, and what that gains.
//!
//! What is near fits best where experts differ from place to place, and what the whole picture
//! says at a brightness has less noise, least where it weighs one expert alone. Weights of these
//! three kinds are blended in turn, by brightness, as each half of the chessboard judges those that were fitted to the other (stacking: Wolpert,
//! *Stacked Generalization*, Neural Networks 1992). Where none helps, S stays. What is used is the
//! mean of what both halves say.

use rayon::prelude::*;

use super::{
    super::hats::Place,
    cells::{Cells, Division, HALVES, KNOTS, Sums},
    near::{Near, of_all, over_brightness},
    simplex::{MOST, Moments},
};

/// The weight of the whole picture at the same brightness, relative to what is near.
const OF_ALL: f64 = 0.05;

/// The least variance of T in a cell, relative to that of S: what sums say below is noise.
const LEAST_ERROR: f64 = 0.05;

/// Pixels in a row of a block, whose changes count as one draw: experts err alike in neighbours.
const BLOCK: usize = 16;

/// Weights for each cell and brightness.
pub(super) struct Weights {
    division: Division,
    /// The mean of those learnt from both halves, `[row][column][knot]`. Those of one half, used
    /// on the other, would draw the chessboard where they differ.
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

/// Kinds of weights: near a cell, of the whole picture, and of the last expert alone there.
const KINDS: usize = 3;

/// What is fitted to a half of the whole picture at a brightness.
#[derive(Clone, Copy)]
struct Whole {
    moments: Moments,
    /// Those of the last two kinds.
    weights: [[f64; MOST]; KINDS - 1],
}

/// `[half][knot]`
type Wholes = [[Whole; KNOTS]; HALVES];

/// Weights of a cell, learnt from a half, `[half][knot]`.
type OfCell = [[[f64; MOST]; KNOTS]; HALVES];

impl Weights {
    /// Fits weights of the first `count` experts to what one half says, and judges them by the
    /// other.
    pub(super) fn fit(cells: &Cells, count: usize) -> (Self, Gain) {
        let division = cells.division;
        let whole: Wholes =
            of_all(cells).map(|half| half.map(|sums| Whole::new(sums.moments, count)));
        let near = Near::new(cells);
        let own = |row: usize| &cells.sums[row * division.of_row()..][..division.of_row()];
        let fits: Vec<RowFit> = (0..division.down)
            .into_par_iter()
            .map_init(Vec::new, |buffer, row| {
                near.row(row, buffer);
                RowFit::new(own(row), buffer, &whole, count)
            })
            .collect();
        let shares = Shares::new(&fits);
        let rows: Vec<Row> = (0..division.down)
            .into_par_iter()
            .map_init(Vec::new, |buffer, row| {
                near.row(row, buffer);
                Row::new(own(row), buffer, &fits[row].weights, &whole, &shares)
            })
            .collect();
        let gain = Gain::new(&rows, division);
        let (mut weights, mut errors) = (Vec::new(), Vec::new());
        for row in rows {
            weights.extend(row.weights);
            errors.extend(row.errors);
        }
        (Self { division, weights, errors }, gain)
    }

    /// The weights of a pixel, and the variance that T has near it, relative to its lanes' number.
    #[inline(always)]
    pub(super) fn at(&self, x: usize, y: usize, place: Place) -> ([f32; MOST], f32) {
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
                    let own = self.weights[cell * KNOTS + knot];
                    weights.iter_mut().zip(own).for_each(|(sum, weight)| *sum += share * weight);
                    let own = self.errors[cell * KNOTS + knot];
                    errors.iter_mut().zip(own).for_each(|(sum, error)| *sum += share * error);
                }
            }
        }
        (weights, errors[0] / errors[1])
    }
}

impl Whole {
    fn new(moments: Moments, count: usize) -> Self {
        let mut alone = [0.0; MOST];
        if let Some(last) = count.checked_sub(1) {
            alone[last] = moments.best_weight(last);
        }
        Self { moments, weights: [moments.best_weights(count), alone] }
    }
}

/// Weights by what is near, of a row of cells.
struct RowFit {
    /// `[column]`
    weights: Vec<OfCell>,
    /// The kinds of weights as experts, by what a half says of those fitted to the other.
    kinds: [[Sums; KNOTS]; HALVES],
}

/// Shares of the kinds of weights, then zeros, `[knot]`.
type OfKinds = [[f64; MOST]; KNOTS];

/// How the kinds of weights are blended.
struct Shares {
    /// By what both halves say of the weights fitted to the other.
    both: OfKinds,
    /// By what this half alone says, `[half]`. Weights learnt from a half with shares that it
    /// said are judged by the other: the shares of both halves have seen what judges them.
    one: [OfKinds; HALVES],
}

impl RowFit {
    /// To the sums near a row of cells; `own` are those of the cells themselves.
    fn new(own: &[Sums], near: &[Sums], whole: &Wholes, count: usize) -> Self {
        let columns = near.len() / (HALVES * KNOTS);
        let mut row = Self { weights: Vec::with_capacity(columns), kinds: Default::default() };
        for column in 0..columns {
            let mut weights = OfCell::default();
            for half in 0..HALVES {
                for knot in 0..KNOTS {
                    let near = &near[Division::place(column, half, knot)];
                    weights[half][knot] = best(near, &whole[half][knot], count);
                }
            }
            for half in 0..HALVES {
                for (knot, kinds) in row.kinds[half].iter_mut().enumerate() {
                    let own = &own[Division::place(column, half, knot)];
                    if !own.is_empty() {
                        let [all, alone] = whole[1 - half][knot].weights;
                        let of_kinds = [weights[1 - half][knot], all, alone];
                        let moments = own.moments.of_blends(&of_kinds);
                        kinds.add(&Sums { moments, ..*own }, 1.0);
                    }
                }
            }
            row.weights.push(weights);
        }
        row
    }
}

impl Shares {
    fn new(fits: &[RowFit]) -> Self {
        let mut kinds = [[Sums::default(); KNOTS]; HALVES];
        for fit in fits {
            let sums = kinds.as_flattened_mut().iter_mut().zip(fit.kinds.as_flattened());
            sums.for_each(|(sum, of_row)| sum.add(of_row, 1.0));
        }
        let best = |sums| over_brightness(sums).map(|sums| sums.moments.best_weights(KINDS));
        let one = kinds.each_ref().map(best);
        let [mut both, other] = kinds;
        both.iter_mut().zip(&other).for_each(|(sum, other)| sum.add(other, 1.0));
        Self { both: best(&both), one }
    }
}

/// The weights of a cell: those of all kinds, blended.
fn blended(near: &OfCell, whole: &Wholes, shares: [&OfKinds; HALVES]) -> OfCell {
    let mut blend = OfCell::default();
    for half in 0..HALVES {
        for (knot, weights) in blend[half].iter_mut().enumerate() {
            let [all, alone] = &whole[half][knot].weights;
            for (of_kind, share) in
                [&near[half][knot], all, alone].into_iter().zip(shares[half][knot])
            {
                weights.iter_mut().zip(of_kind).for_each(|(sum, w)| *sum += share * w);
            }
        }
    }
    blend
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

impl Row {
    /// Of the sums of a row of cells themselves, and near them.
    fn new(
        own: &[Sums],
        near: &[Sums],
        fitted: &[OfCell],
        whole: &Wholes,
        shares: &Shares,
    ) -> Self {
        let mut row = Self {
            weights: Vec::with_capacity(fitted.len() * KNOTS),
            errors: Vec::with_capacity(fitted.len() * KNOTS),
            gains: Vec::with_capacity(fitted.len()),
            trust: [0.0; MOST],
            count: 0.0,
        };
        for (column, fitted) in fitted.iter().enumerate() {
            let [one, other] = blended(fitted, whole, [&shares.both; HALVES]);
            for (knot, (one, other)) in one.iter().zip(&other).enumerate() {
                let w = std::array::from_fn(|expert| 0.5 * (one[expert] + other[expert]));
                row.weights.push(w.map(|w| w as f32));
                row.count(own, &w, column, knot);
            }
            let weights = blended(fitted, whole, shares.one.each_ref());
            row.judge(own, near, &weights, column);
        }
        row
    }

    /// Counts the lanes that weights are for.
    fn count(&mut self, own: &[Sums], w: &[f64; MOST], column: usize, knot: usize) {
        for half in 0..HALVES {
            let count = own[Division::place(column, half, knot)].count;
            self.trust.iter_mut().zip(w).for_each(|(sum, w)| *sum += count * w);
            self.count += count;
        }
    }

    /// Judges weights by the half that they were not fitted to.
    fn judge(&mut self, own: &[Sums], near: &[Sums], weights: &OfCell, column: usize) {
        let mut gain = [0.0; 2];
        for knot in 0..KNOTS {
            let mut error = [0.0; 2];
            for half in 0..HALVES {
                let w = &weights[1 - half][knot];
                let place = Division::place(column, half, knot);
                let (own, near) = (&own[place], &near[place]);
                gain[0] += own.moments.change(w);
                gain[1] += own.variance;
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
fn best(near: &Sums, whole: &Whole, count: usize) -> [f64; MOST] {
    let Whole { moments: of_all, weights: [prior, _] } = whole;
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
        let w = f64::from(weights.at(13, 22, place).0[0]);
        // Of 0.25 and 0.5, the share 0.8 is best for both. The ridge takes a ten-thousandth off.
        assert!((w - 0.3).abs() < 1e-3, "{w}");
        // What is told is of all of 0.5, and of half of 0.25: w² − 2 w b of each half, 16 cells
        // of 24 lanes.
        let changes = 16.0 * 24.0 * (0.25 - 0.25 + 0.015625 - 0.125);
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

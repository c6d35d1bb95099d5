//! How far each expert is trusted, cell by cell, and what that gains: [`Fits`], judged by the half
//! of the chessboard that they were not fitted to. What is used is the mean of what both halves
//! say.

use rayon::prelude::*;

use super::{
    super::{hats::Place, judge::interval},
    cells::{Cells, Division, HALVES, KNOTS, Sums},
    fits::{Fits, OfCell},
    learned::Learned,
    simplex::MOST,
};
use crate::Error;

/// The least variance of T in a cell, relative to that of S: what sums say below is noise.
const LEAST_ERROR: f64 = 0.05;

/// How far behind the closed form a network may be predicted to be, at most, relative to the MSE of
/// S. Where light is rare, predictions may be off by many times that, and would excuse anything.
const MOST_BEHIND: f64 = 0.1;

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

/// Weights, and what they gain.
pub(super) struct Fit {
    pub(super) weights: Weights,
    pub(super) gain: Gain,
    /// Whether a network has corrected them; or why the closed form is used instead of what it
    /// says.
    pub(super) learned: Result<bool, String>,
}

impl Fit {
    /// Fits weights of the first `count` experts to what one half says, lets a network correct
    /// them, and judges both by the other half.
    pub(super) fn new(cells: &Cells, count: usize, learned: Option<&Learned<'_>>) -> Self {
        let division = cells.division;
        let fits = Fits::new(cells, count);
        let samples = learned.map_or(0.0, Learned::samples);
        let learned = learned.map(|learned| (learned, learned.inputs(&fits)));
        let rows: (Vec<Row>, Vec<Option<Result<Row, Error>>>) = (0..division.down)
            .into_par_iter()
            .map_init(Vec::new, |near, row| {
                fits.near(row, near);
                let closed = [fits.by_both(row), fits.by_one(row)];
                let of = |[used, judged]: &[Vec<OfCell>; 2]| {
                    Row::new(cells.row(row), near, used, judged)
                };
                let corrected = learned.as_ref().map(|(learned, inputs)| {
                    let mut numbers = inputs.row(row, near);
                    let mut weights = |closed: &[OfCell]| {
                        inputs.blend(&mut numbers, closed);
                        learned.weights(&numbers, closed)
                    };
                    let [used, judged] = &closed;
                    Ok(of(&[weights(used)?, weights(judged)?]))
                });
                (of(&closed), corrected)
            })
            .unzip();
        let (closed, corrected) = rows;
        let closed = Self::of_rows(closed, division, Ok(false));
        match corrected.into_iter().collect::<Option<Result<Vec<Row>, Error>>>() {
            None => closed,
            Some(Err(error)) => Self { learned: Err(error.to_string()), ..closed },
            // Where no expert gains what is beyond chance, S stays.
            Some(Ok(_)) if closed.gain.is_plain() => closed,
            Some(Ok(rows)) => {
                let corrected = Self::of_rows(rows, division, Ok(true));
                match corrected.gain.loses_to(&closed.gain, samples) {
                    true => Self { learned: Err(LOST.to_owned()), ..closed },
                    false => corrected,
                }
            }
        }
    }

    fn of_rows(rows: Vec<Row>, division: Division, learned: Result<bool, String>) -> Self {
        let gain = Gain::new(&rows, division);
        let (mut weights, mut errors) = (Vec::new(), Vec::new());
        for row in rows {
            weights.extend(row.weights);
            errors.extend(row.errors);
        }
        Self { weights: Weights { division, weights, errors }, gain, learned }
    }
}

/// Why the closed form is used, where a network was judged.
const LOST: &str = "samples that were held out say that it loses here";

impl Weights {
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
                    let share = of_row * of_column * of_knot;
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
    /// With weights that are used, and those that are judged, of the sums of a row of cells
    /// themselves, and near them.
    fn new(own: &[Sums], near: &[Sums], used: &[OfCell], judged: &[OfCell]) -> Self {
        let mut row = Self {
            weights: Vec::with_capacity(used.len() * KNOTS),
            errors: Vec::with_capacity(used.len() * KNOTS),
            gains: Vec::with_capacity(used.len()),
            trust: [0.0; MOST],
            count: 0.0,
        };
        for (column, ([one, other], judged)) in used.iter().zip(judged).enumerate() {
            for (knot, (one, other)) in one.iter().zip(other).enumerate() {
                let w = std::array::from_fn(|expert| 0.5 * (one[expert] + other[expert]));
                row.weights.push(w.map(|w| w as f32));
                row.count(own, &w, column, knot);
            }
            row.judge(own, near, judged, column);
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
                // As most: then its own sums are, too.
                if near.is_empty() {
                    continue;
                }
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

impl Gain {
    /// Whether these weights gain less than others by more than the [prediction](interval) may be off,
    /// or lose to S, and the others less. No one gains more than all of S's errors.
    fn loses_to(&self, other: &Self, samples: f64) -> bool {
        let pairs = self.blocks.iter().zip(&other.blocks);
        let beside: Vec<_> = pairs.map(|(own, other)| [own[0] - other[0], own[1]]).collect();
        let [own, other] = [self, other].map(|gain| interval(&gain.blocks, samples, true).0);
        let (ratio, [_, high]) = interval(&beside, samples, true);
        let chance = high - ratio;
        chance.is_nan() || own - other > chance.min(MOST_BEHIND) || own > other.max(1.0)
    }

    /// Whether nobody is trusted anywhere.
    fn is_plain(&self) -> bool {
        self.trust.iter().all(|trust| *trust == 0.0)
    }

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
        let Fit { weights, gain, .. } = Fit::new(&cells([0.5, 0.25]), 1, None);
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
    fn a_loss_is_more_than_chance() {
        let gain = |changes: &[f64]| Gain {
            blocks: changes.iter().map(|change| [*change, 1.0]).collect(),
            trust: [0.0; MOST],
        };
        let is_loss =
            |own: &[f64], other: f64| gain(own).loses_to(&gain(&vec![other; own.len()]), 1024.0);
        assert!(is_loss(&[-0.2, -0.3, -0.1, -0.2, -0.2], -0.5));
        assert!(!is_loss(&[-0.5, -0.4, -0.6, -0.5, -0.5], -0.2));
        // What differs may be chance, but no tenth and no loss to S is.
        assert!(!is_loss(&[-0.9, -0.1, -0.7, -0.1, -0.5], -0.5));
        assert!(is_loss(&[-0.9, 0.6, -0.7, 0.1, -0.9], -0.5));
        assert!(is_loss(&[0.9, -0.1, 0.1, -0.1, -0.5], 0.0));
        // Where both are predicted to lose, the lesser loss is taken.
        assert!(!is_loss(&[0.9, 0.1, 0.1, 0.1, 0.5], 0.4) && is_loss(&[0.9; 5], 0.8));
        assert!(is_loss(&[f64::NAN; 2], 0.0));
    }

    #[test]
    fn nobody_gains_more_than_all() {
        let gain = |change: f64| Gain { blocks: vec![[change, 1.0]; 40], trust: [0.0; MOST] };
        assert!(gain(-0.5).loses_to(&gain(-0.9), 8.0) && !gain(-0.9).loses_to(&gain(-0.5), 8.0));
        assert!(!gain(-1.0).loses_to(&gain(-1.4), 8.0) && gain(0.6).loses_to(&gain(0.5), 8.0));
    }

    #[test]
    fn what_loses_by_the_other_half_is_not_blended() {
        let Fit { weights, gain, .. } = Fit::new(&cells([0.9, -0.5]), 1, None);
        assert_eq!(gain.trust, [0.0; MOST]);
        assert!(weights.weights.iter().all(|w| *w == [0.0; MOST]));
    }
}

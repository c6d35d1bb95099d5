//! What the network reads of a cell at a brightness, in numbers without a unit.

use super::super::{
    cells::{BRIGHTNESS, Division, HALVES, KNOTS, Sums},
    fits::{Fits, OfCell},
    near::{Near, errors_over_brightness},
    simplex::MOST,
};
use crate::GuardNetwork;

/// How many numbers: of each of three slots for experts, the weights of what is near, of the whole
/// picture, and of the closed form; how large the error of S is at this brightness, and the
/// brightness; that error in the cell alone, in a wider view, in the whole picture at this
/// brightness, and at all; and of each slot what is missing in the wider view goes with what the
/// expert changes.
pub(crate) const INPUTS: usize = 18;

/// The most experts.
const SLOTS: usize = GuardNetwork::MOST_EXPERTS;

/// Weights of so many kinds come before those of the closed form.
const BLEND: usize = 2;

/// Below this knot, a hundredth of the picture's mean, one brightness is not told from another that
/// is a million times it: there, the closed form stays.
pub(super) const DARK: usize = 2;

/// What two errors differ by at most, in the logarithm.
const ERRORS: f64 = 6.0;
const RELATIVE_ERRORS: [f64; 2] = [-8.0, 4.0];

/// The share of the variance near a cell in what b of a wider view is divided by: it may be 0.
const OF_NEAR: f64 = 0.02;

/// What makes the logarithm of 0 finite.
const TINY: f64 = 1e-30;

/// Of a cell at a brightness.
pub(in super::super) struct Input {
    pub(in super::super) column: usize,
    pub(in super::super) half: usize,
    pub(in super::super) knot: usize,
    pub(in super::super) numbers: [f32; INPUTS],
}

/// What makes inputs of the sums of a picture.
pub(in super::super) struct Inputs<'a> {
    fits: &'a Fits<'a>,
    wide: Near<'a>,
    /// The slot of each expert.
    slots: &'a [usize],
    unit: f64,
    /// The logarithm of the whole picture's error, `[half]`.
    all: [f64; HALVES],
}

impl<'a> Inputs<'a> {
    /// In a picture whose mean is `unit`.
    pub(in super::super) fn new(fits: &'a Fits<'a>, slots: &'a [usize], unit: f64) -> Self {
        let all = fits.whole().each_ref().map(|knots| {
            let mut all = Sums::default();
            knots.iter().for_each(|whole| all.add_errors(&whole.sums, 1.0));
            log_error(&all, unit)
        });
        Self { fits, wide: fits.wide(), slots, unit, all }
    }

    /// Of a row of cells, with the sums near them, wherever anything is near. The closed form's
    /// weights are [still missing](Self::blend).
    pub(in super::super) fn row(&self, row: usize, near: &[Sums]) -> Vec<Input> {
        let mut wide = Vec::new();
        self.wide.errors(row, &mut wide);
        let own = self.fits.cells().row(row);
        let mut inputs = Vec::new();
        for (column, of_near) in self.fits.by_near(row).iter().enumerate() {
            for half in 0..HALVES {
                let first = Division::place(column, half, 0);
                let [own, near, wide] =
                    [own, near, &wide].map(|sums: &[Sums]| &sums[first..][..KNOTS]);
                let own = errors_over_brightness(own);
                for knot in (0..KNOTS).filter(|&knot| near[knot].count > 0.0) {
                    let sums = [&own[knot], &near[knot], &wide[knot]];
                    let weights = [&of_near[half][knot], &self.fits.whole()[half][knot].weights[0]];
                    let numbers = self.numbers(half, knot, sums, weights);
                    inputs.push(Input { column, half, knot, numbers });
                }
            }
        }
        inputs
    }

    /// Writes the closed form's weights of the row into its inputs.
    pub(in super::super) fn blend(&self, inputs: &mut [Input], closed: &[OfCell]) {
        for Input { column, half, knot, numbers } in inputs {
            let closed = &closed[*column][*half][*knot];
            self.fill(&mut numbers[BLEND * SLOTS..][..SLOTS], closed);
        }
    }

    /// Writes weights into the slots of their experts.
    fn fill(&self, numbers: &mut [f32], weights: &[f64; MOST]) {
        for (slot, weight) in self.slots.iter().zip(weights) {
            numbers[*slot] = *weight as f32;
        }
    }

    fn numbers(
        &self,
        half: usize,
        knot: usize,
        [own, near, wide]: [&Sums; 3],
        weights: [&[f64; MOST]; BLEND],
    ) -> [f32; INPUTS] {
        let mut numbers = [0.0; INPUTS];
        let (of_weights, rest) = numbers.split_at_mut((BLEND + 1) * SLOTS);
        for (out, weights) in of_weights.chunks_exact_mut(SLOTS).zip(weights) {
            self.fill(out, weights);
        }
        let [own_error, error, wide_error, whole_error] =
            [own, near, wide, &self.fits.whole()[half][knot].sums]
                .map(|sums| log_error(sums, self.unit));
        let brightness = f64::from(BRIGHTNESS.knot(knot));
        let [low, high] = RELATIVE_ERRORS;
        let third = |x: f64| (x / 3.0) as f32;
        let beside = |x: f64| third(x.clamp(-ERRORS, ERRORS));
        let (of_errors, of_missing) = rest.split_at_mut(6);
        of_errors.copy_from_slice(&[
            third((error - brightness).clamp(low, high)),
            third(brightness),
            beside(own_error - error),
            beside(wide_error - error),
            beside(whole_error - error),
            beside(self.all[half]),
        ]);
        let variance = (wide.variance + OF_NEAR * near.variance).max(f64::MIN_POSITIVE);
        for (slot, b) in self.slots.iter().zip(&wide.moments.b) {
            let of_variance = b / variance;
            of_missing[*slot] = (of_variance / (1.0 + of_variance.abs())) as f32;
        }
        numbers
    }
}

/// The logarithm of the error of S, relative to the picture's mean.
fn log_error(sums: &Sums, unit: f64) -> f64 {
    0.5 * (sums.variance / (sums.count.max(1e-9) * unit * unit) + TINY).ln()
}

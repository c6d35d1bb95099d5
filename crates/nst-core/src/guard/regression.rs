//! The regressions: experts that learn from the very batch how the plain estimate errs, as
//! quadratic functions of what is known of a lane.
//!
//! With the lane's scale s, the relative variance κ of √y and the relative variance v of y,
//!
//! ```text
//! x = (1, ln(s/u)/2, √κ, ln(v + .01)/3, |S|/(|S| + u)),   d = s Σ_{j ≤ i} c_ij x_i x_j,
//! ```
//!
//! where c is the solution of weighted least squares against h − S of folds held out. Both κ
//! and v are needed: with one of them alone, much less is learnt. There are two regressions:
//! one weighs errors by 1/(s + .1 u), the other, for which errors count relative to the
//! brightness, by the square of that.
//! What half of the chessboard teaches is applied to the other half.

use std::ops::Range;

use super::{sample::Sample, view::Lanes};
use crate::cholesky::solve_in_place;

const INPUTS: usize = 5;
const FEATURES: usize = INPUTS * (INPUTS + 1) / 2;

/// What is added to the diagonal of the normal equations, whose columns are scaled to 1.
const PENALTY: f64 = 1e-4;

type Features = [f64; FEATURES];

/// The features of a lane, and what is to be learnt from them.
const COLUMNS: usize = FEATURES + 1;

/// The powers of 1/(s + .1 u) by which the regressions weigh errors.
const POWERS: [i32; 2] = [2, 1];

/// c of each regression, by the half that it was learnt from.
#[derive(Clone, Debug)]
pub(super) struct Regressions {
    /// `[half][feature][regression]`
    coefficients: [[[f64; POWERS.len()]; FEATURES]; 2],
}

/// The normal equations of one regression and one half.
#[derive(Clone)]
struct Equations {
    /// Σ W f fᵀ, and in the last column Σ W f (h − S).
    rows: [[f64; COLUMNS]; FEATURES],
}

/// What a lane adds to the equations.
struct Row {
    /// f, h − S
    columns: [f64; COLUMNS],
    /// The weight W in each regression.
    weights: [f64; POWERS.len()],
}

/// `[regression][half]`
type AllEquations = [[Equations; 2]; POWERS.len()];

impl Regressions {
    /// Learns from views without each of the groups, and the means of those groups minus the
    /// plain estimates, `[group][lane]`.
    pub(super) fn fit(sample: &Sample, views: &[Lanes], missing: &[Vec<f32>]) -> Self {
        let parts = sample.in_tasks(|pixels| equations(sample, views, missing, pixels));
        let mut total = AllEquations::default();
        for part in &parts {
            let pairs = total.iter_mut().flatten().zip(part.iter().flatten());
            pairs.for_each(|(sum, part)| sum.add(part));
        }
        let solved = total.map(|halves| halves.map(Equations::solve));
        let of_half =
            |half: usize| std::array::from_fn(|f| solved.each_ref().map(|halves| halves[half][f]));
        Self { coefficients: [0, 1].map(of_half) }
    }

    /// The changes of a lane whose pixel is in this half, learnt from the other half.
    #[inline(always)]
    pub(super) fn changes(&self, lanes: &Lanes, lane: usize, half: usize) -> [f64; POWERS.len()] {
        let x = inputs(lanes, lane);
        let coefficients = &self.coefficients[1 - half];
        let mut sums = [0.0; POWERS.len()];
        let mut first = 0;
        for i in 0..INPUTS {
            // c_i0 + c_i1 x_1 + … + c_ii x_i
            let mut factors = coefficients[first];
            for j in 1..=i {
                let more = factors.iter_mut().zip(&coefficients[first + j]);
                more.for_each(|(factor, c)| *factor += c * x[j]);
            }
            sums.iter_mut().zip(factors).for_each(|(sum, factor)| *sum += factor * x[i]);
            first += i + 1;
        }
        sums.map(|sum| sum * lanes.scale(lane))
    }
}

/// x of a lane.
#[inline(always)]
fn inputs(lanes: &Lanes, lane: usize) -> [f64; INPUTS] {
    let size = f64::from(lanes.mean[lane]).abs();
    [
        1.0,
        f64::from(lanes.log_scale[lane]) / 2.0,
        lanes.root_spread[lane].sqrt().into(),
        f64::from(lanes.log_spread[lane]) / 3.0,
        size / (size + lanes.unit),
    ]
}

/// What a lane of a view adds to the equations: s x_i x_j are its features.
#[inline(always)]
fn row(view: &Lanes, lane: usize, missing: f32) -> Row {
    let (x, scale) = (inputs(view, lane), view.scale(lane));
    let mut columns = [0.0; COLUMNS];
    let mut next = 0;
    for i in 0..INPUTS {
        for j in 0..=i {
            columns[next] = scale * x[i] * x[j];
            next += 1;
        }
    }
    columns[next] = missing.into();
    let weight = (scale + 0.1 * view.unit).recip();
    Row { columns, weights: POWERS.map(|power| weight.powi(power)) }
}

/// The equations of a task's pixels.
fn equations(
    sample: &Sample,
    views: &[Lanes],
    missing: &[Vec<f32>],
    pixels: Range<usize>,
) -> AllEquations {
    let mut equations = AllEquations::default();
    let mut rows = Vec::new();
    for pixel in pixels {
        rows.clear();
        for (view, missing) in views.iter().zip(missing) {
            rows.extend(sample.lanes_of(pixel).map(|lane| row(view, lane, missing[lane])));
        }
        let half = usize::from(sample.pixels[pixel].half);
        for (regression, halves) in equations.iter_mut().enumerate() {
            halves[half].take(&rows, regression);
        }
    }
    equations
}

impl Default for Equations {
    fn default() -> Self {
        Self { rows: [[0.0; COLUMNS]; FEATURES] }
    }
}

impl Equations {
    /// Adds the lanes of a pixel. Rows of sums stay in registers meanwhile: that is faster than to
    /// compute half of the symmetric matrix, lane by lane.
    fn take(&mut self, lanes: &[Row], regression: usize) {
        for (i, sums) in self.rows.iter_mut().enumerate() {
            let mut row = *sums;
            for lane in lanes {
                let weighted = lane.weights[regression] * lane.columns[i];
                row.iter_mut().zip(&lane.columns).for_each(|(sum, x)| *sum += weighted * x);
            }
            *sums = row;
        }
    }

    fn add(&mut self, other: &Self) {
        let pairs = self.rows.iter_mut().flatten().zip(other.rows.iter().flatten());
        pairs.for_each(|(sum, more)| *sum += more);
    }

    /// Ridge regression; zeros where that breaks down.
    fn solve(mut self) -> Features {
        let scale: Features = std::array::from_fn(|i| {
            let diagonal = self.rows[i][i];
            if diagonal > 0.0 { diagonal.sqrt().recip() } else { 0.0 }
        });
        let mut right = [0.0; FEATURES];
        for i in 0..FEATURES {
            right[i] = self.rows[i][FEATURES] * scale[i];
            for j in 0..=i {
                self.rows[i][j] *= scale[i] * scale[j];
            }
            self.rows[i][i] += PENALTY;
        }
        solve_in_place(&mut self.rows, &mut right);
        let solution: Features = std::array::from_fn(|i| right[i] * scale[i]);
        if solution.iter().all(|c| c.is_finite()) { solution } else { [0.0; FEATURES] }
    }
}

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

use std::{array::from_fn, ops::Range};

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
    /// `[half][regression][feature]`
    coefficients: [[[f32; FEATURES]; POWERS.len()]; 2],
}

/// Lanes that are computed together, so that the compiler makes vector instructions of it.
const PACKET: usize = 16;

/// Numbers of these lanes.
type Packet = [f32; PACKET];

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
        let coefficients =
            from_fn(|half| solved.each_ref().map(|halves| halves[half].map(|c| c as f32)));
        Self { coefficients }
    }

    /// What they change, `[lane]` each, by the half that each lane is in: the other half teaches.
    pub(super) fn changes(&self, lanes: &Lanes, halves: &[u8]) -> [Vec<f32>; POWERS.len()] {
        let mut changes = POWERS.map(|_| vec![0.0; halves.len()]);
        for first in (0..halves.len()).step_by(PACKET) {
            let part = first..halves.len().min(first + PACKET);
            let x = inputs(lanes, part.clone());
            let mut scales = [0.0; PACKET];
            let of_lanes = scales.iter_mut().zip(lanes.scales(part.clone()));
            of_lanes.for_each(|(place, scale)| *place = scale);
            for (regression, changes) in changes.iter_mut().enumerate() {
                let both = self.coefficients.each_ref().map(|of| quadratic(&of[regression], &x));
                let of_lanes = changes[part.clone()].iter_mut().zip(&halves[part.clone()]);
                for (k, (change, half)) in of_lanes.enumerate() {
                    let relative = if *half == 0 { both[1][k] } else { both[0][k] };
                    *change = relative * scales[k];
                }
            }
        }
        changes
    }
}

/// Σ_{j ≤ i} c_ij x_i x_j
#[inline(always)]
fn quadratic(coefficients: &[f32; FEATURES], x: &[Packet; INPUTS]) -> Packet {
    let mut sums = [0.0; PACKET];
    let mut first = 0;
    for i in 0..INPUTS {
        // c_i0 + c_i1 x_1 + … + c_ii x_i
        let mut factors = [coefficients[first]; PACKET];
        for j in 1..=i {
            for k in 0..PACKET {
                factors[k] += coefficients[first + j] * x[j][k];
            }
        }
        for k in 0..PACKET {
            sums[k] += factors[k] * x[i][k];
        }
        first += i + 1;
    }
    sums
}

/// x of some lanes, then zeros.
#[inline(always)]
fn inputs(lanes: &Lanes, part: Range<usize>) -> [Packet; INPUTS] {
    let packet = |numbers: &[f32]| {
        let mut packet = [0.0; PACKET];
        packet[..part.len()].copy_from_slice(&numbers[part.clone()]);
        packet
    };
    let unit = lanes.unit as f32;
    [
        [1.0; PACKET],
        packet(&lanes.log_scale).map(|x| x / 2.0),
        packet(&lanes.root_spread).map(f32::sqrt),
        packet(&lanes.log_spread).map(|x| x / 3.0),
        packet(&lanes.mean).map(|mean| mean.abs() / (mean.abs() + unit)),
    ]
}

/// What a lane of a view adds to the equations: s x_i x_j are its features.
#[inline(always)]
fn row(view: &Lanes, lane: usize, missing: f32) -> Row {
    let x: [f64; INPUTS] = inputs(view, lane..lane + 1).map(|x| x[0].into());
    let scale = view.scale(lane);
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

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
use crate::cholesky::solve;

const INPUTS: usize = 5;
const FEATURES: usize = INPUTS * (INPUTS + 1) / 2;

/// What is added to the diagonal of the normal equations, whose columns are scaled to 1.
const PENALTY: f64 = 1e-4;

type Features = [f64; FEATURES];

/// The powers of 1/(s + .1 u) by which the regressions weigh errors.
const POWERS: [i32; 2] = [2, 1];

/// c of each regression, by the half that it was learnt from.
#[derive(Clone, Debug)]
pub(super) struct Regressions {
    /// `[regression][half]`
    coefficients: [[Features; 2]; POWERS.len()],
}

/// The normal equations of one regression and one half.
#[derive(Clone)]
struct Equations {
    /// Σ W f fᵀ, the lower half.
    matrix: [Features; FEATURES],
    /// Σ W f (h − S)
    right: Features,
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
        Self { coefficients: total.map(|halves| halves.map(Equations::solve)) }
    }

    /// The changes of a lane whose pixel is in this half, learnt from the other half.
    #[inline(always)]
    pub(super) fn changes(&self, lanes: &Lanes, lane: usize, half: usize) -> [f32; POWERS.len()] {
        let features = features(lanes, lane);
        let mut changes = [0.0; POWERS.len()];
        for (change, halves) in changes.iter_mut().zip(&self.coefficients) {
            let mut sum = 0.0;
            for (f, c) in features.iter().zip(&halves[1 - half]) {
                sum += f * c;
            }
            *change = lanes.bounded(lane, sum);
        }
        changes
    }
}

/// s x_i x_j of a lane.
#[inline(always)]
fn features(lanes: &Lanes, lane: usize) -> Features {
    let size = f64::from(lanes.mean[lane]).abs();
    let scale = lanes.scale(lane);
    let x = [
        1.0,
        f64::from(lanes.log_scale[lane]) / 2.0,
        f64::from(lanes.root_spread[lane]).sqrt(),
        f64::from(lanes.log_spread[lane]) / 3.0,
        size / (size + lanes.unit),
    ];
    let mut features = [0.0; FEATURES];
    let mut next = 0;
    for i in 0..INPUTS {
        for j in 0..=i {
            features[next] = scale * x[i] * x[j];
            next += 1;
        }
    }
    features
}

/// The equations of a task's pixels.
fn equations(
    sample: &Sample,
    views: &[Lanes],
    missing: &[Vec<f32>],
    pixels: Range<usize>,
) -> AllEquations {
    let mut equations = AllEquations::default();
    for pixel in pixels {
        let half = usize::from(sample.pixels[pixel].half);
        for (view, missing) in views.iter().zip(missing) {
            for lane in sample.lanes_of(pixel) {
                let f = features(view, lane);
                for (equations, power) in equations.iter_mut().zip(POWERS) {
                    let weight = (view.scale(lane) + 0.1 * view.unit).powi(-power);
                    equations[half].take(&f, weight, f64::from(missing[lane]));
                }
            }
        }
    }
    equations
}

impl Default for Equations {
    fn default() -> Self {
        Self { matrix: [[0.0; FEATURES]; FEATURES], right: [0.0; FEATURES] }
    }
}

impl Equations {
    /// Adds a lane.
    fn take(&mut self, f: &Features, weight: f64, missing: f64) {
        for i in 0..FEATURES {
            let weighted = weight * f[i];
            self.right[i] += weighted * missing;
            for j in 0..=i {
                self.matrix[i][j] += weighted * f[j];
            }
        }
    }

    fn add(&mut self, other: &Self) {
        for i in 0..FEATURES {
            self.right[i] += other.right[i];
            (0..=i).for_each(|j| self.matrix[i][j] += other.matrix[i][j]);
        }
    }

    /// Ridge regression; zeros where that breaks down.
    fn solve(mut self) -> Features {
        let scale: Features = std::array::from_fn(|i| {
            let diagonal = self.matrix[i][i];
            if diagonal > 0.0 { diagonal.sqrt().recip() } else { 0.0 }
        });
        for i in 0..FEATURES {
            self.right[i] *= scale[i];
            for j in 0..=i {
                self.matrix[i][j] *= scale[i] * scale[j];
            }
            self.matrix[i][i] += PENALTY;
        }
        let x = solve(self.matrix, self.right, FEATURES);
        let solution: Features = std::array::from_fn(|i| x[i] * scale[i]);
        if solution.iter().all(|c| c.is_finite()) { solution } else { [0.0; FEATURES] }
    }
}

//! The regression: an expert that learns from the very batch how the plain estimate errs, as
//! a quadratic function of what is known of a lane.
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

use rayon::prelude::*;

use super::{
    Correction,
    sample::Sample,
    table::PIXELS_PER_TASK,
    view::{Lanes, Numbers},
};

const INPUTS: usize = 5;
const FEATURES: usize = INPUTS * (INPUTS + 1) / 2;

/// What is added to the diagonal of the normal equations, whose columns are scaled to 1.
const PENALTY: f64 = 1e-4;

type Features = [f64; FEATURES];

/// c, by the half that it was learnt from.
#[derive(Clone, Debug)]
pub(super) struct Regression {
    coefficients: [Features; 2],
}

/// The normal equations of one half.
#[derive(Clone)]
struct Equations {
    /// Σ W f fᵀ, the lower half.
    matrix: [Features; FEATURES],
    /// Σ W f (h − S)
    right: Features,
}

impl Regression {
    /// Learns from views without each of the groups, and the means of those groups minus the
    /// plain estimates, `[group][lane]`. Errors are weighed by 1/(s + .1 u) to this power.
    pub(super) fn fit(sample: &Sample, views: &[Lanes], missing: &[Vec<f32>], power: i32) -> Self {
        let tasks = sample.pixels.len().div_ceil(PIXELS_PER_TASK);
        let parts: Vec<[Equations; 2]> = (0..tasks)
            .into_par_iter()
            .map(|task| equations(sample, views, missing, power, task * PIXELS_PER_TASK))
            .collect();
        let mut total = [Equations::default(), Equations::default()];
        for part in &parts {
            total.iter_mut().zip(part).for_each(|(sum, part)| sum.add(part));
        }
        Self { coefficients: total.map(|half| half.solve()) }
    }
}

impl Correction for Regression {
    fn change(&self, unit: f64, numbers: &Numbers, half: usize) -> f64 {
        let features = features(unit, numbers);
        let change: f64 =
            features.iter().zip(&self.coefficients[1 - half]).map(|(f, c)| f * c).sum();
        numbers.bounded(change)
    }
}

/// s x_i x_j of a lane.
fn features(unit: f64, numbers: &Numbers) -> Features {
    let Numbers { mean, scale, root_spread, log_spread, .. } = *numbers;
    let size = mean.abs();
    let x = [
        1.0,
        (scale / unit).ln() / 2.0,
        root_spread.sqrt(),
        log_spread / 3.0,
        size / (size + unit),
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

/// The equations of a task's pixels, of both halves.
fn equations(
    sample: &Sample,
    views: &[Lanes],
    missing: &[Vec<f32>],
    power: i32,
    first: usize,
) -> [Equations; 2] {
    let mut halves = [Equations::default(), Equations::default()];
    let end = sample.pixels.len().min(first + PIXELS_PER_TASK);
    for pixel in first..end {
        let equations = &mut halves[sample.pixels[pixel].half];
        for (view, missing) in views.iter().zip(missing) {
            for lane in pixel * sample.channels..(pixel + 1) * sample.channels {
                let numbers = &view.numbers[lane];
                let f = features(view.unit, numbers);
                let weight = (numbers.scale + 0.1 * view.unit).powi(-power);
                let target = weight * f64::from(missing[lane]);
                for i in 0..FEATURES {
                    equations.right[i] += target * f[i];
                    let weighted = weight * f[i];
                    for j in 0..=i {
                        equations.matrix[i][j] += weighted * f[j];
                    }
                }
            }
        }
    }
    halves
}

impl Default for Equations {
    fn default() -> Self {
        Self { matrix: [[0.0; FEATURES]; FEATURES], right: [0.0; FEATURES] }
    }
}

impl Equations {
    fn add(&mut self, other: &Self) {
        for i in 0..FEATURES {
            self.right[i] += other.right[i];
            (0..=i).for_each(|j| self.matrix[i][j] += other.matrix[i][j]);
        }
    }

    /// Ridge regression by Cholesky's A = L Lᵀ; zeros where that breaks down.
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
        let (l, x) = (&mut self.matrix, &mut self.right);
        for i in 0..FEATURES {
            for j in 0..=i {
                let dot: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
                let rest = l[i][j] - dot;
                l[i][j] = if i == j { rest.sqrt() } else { rest / l[j][j] };
            }
            let dot: f64 = (0..i).map(|k| l[i][k] * x[k]).sum();
            x[i] = (x[i] - dot) / l[i][i];
        }
        for i in (0..FEATURES).rev() {
            let dot: f64 = (i + 1..FEATURES).map(|k| l[k][i] * x[k]).sum();
            x[i] = (x[i] - dot) / l[i][i];
        }
        let solution: Features = std::array::from_fn(|i| x[i] * scale[i]);
        if solution.iter().all(|c| c.is_finite()) { solution } else { [0.0; FEATURES] }
    }
}

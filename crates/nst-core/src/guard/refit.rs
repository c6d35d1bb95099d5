//! An expert whose last layer is fitted again, to the very batch.
//!
//! The change of an expert that [adapts](Expert::adapts) is d = Σ c_i x_i with features x of a
//! lane. Other coefficients are learnt by ridge regression against means h that are held out,
//!
//! ```text
//! c' = argmin Σ W (h − S − Σ c'_i x_i)² + λ Σ (c'_i − c_i)² Σ W x_i²,   W = 1/(s + .1 u),
//! ```
//!
//! with the lane's scale s and the unit u. What half of the chessboard teaches is applied to the
//! other half.

use std::ops::Range;

use super::{
    sample::{GROUPS, SHARE, Sample},
    seen::{Expert, Features},
    view::{Lanes, View},
};
use crate::{Error, cholesky::solve_in_place};

/// λ: with much less, batches of some hundred lanes are learnt by heart; with much more, what
/// was not trained on stays wrong.
const PENALTY: f64 = 1e-3;

/// An expert that adapts, and its features.
pub(super) struct Adapting<'a> {
    expert: &'a dyn Expert,
    features: &'a dyn Features,
    /// `[group]`, after the groups those of all folds; `[lane][feature]`
    pub(super) of_views: Vec<Vec<f32>>,
}

impl<'a> Adapting<'a> {
    /// Asks for the features of views without each of the groups, and of all folds; `None` if
    /// the expert does not adapt.
    pub(super) fn ask(expert: &'a dyn Expert, views: &[View]) -> Result<Option<Self>, Error> {
        let Some(of) = expert.adapts() else { return Ok(None) };
        let of_view = |(group, view)| features(of, view, group == GROUPS);
        let of_views = views.iter().enumerate().map(of_view).collect::<Result<_, _>>()?;
        Ok(Some(Self { expert, features: of, of_views }))
    }
}

/// A fitted expert.
pub(super) struct Refit<'a> {
    pub(super) name: String,
    features: &'a dyn Features,
    /// c', by the half that it was learnt from.
    coefficients: [Vec<f64>; 2],
}

/// The normal equations of one half, around the expert's own coefficients.
#[derive(Clone)]
struct Equations {
    /// Σ W x xᵀ, the lower half.
    matrix: Vec<Vec<f64>>,
    /// Σ W x (h − S − Σ c x)
    right: Vec<f64>,
}

impl<'a> Refit<'a> {
    /// Learns from views without each of the groups, and the means of those groups minus the
    /// plain estimates, `[group][lane]`.
    pub(super) fn fit(
        adapting: &Adapting<'a>,
        sample: &Sample,
        views: &[Lanes],
        missing: &[Vec<f32>],
    ) -> Self {
        let Adapting { expert, features, of_views } = adapting;
        let own: Vec<f64> = features.coefficients().iter().map(|&c| c.into()).collect();
        let part = |pixels: Range<usize>| {
            let mut halves = [Equations::new(own.len()), Equations::new(own.len())];
            for pixel in pixels {
                let equations = &mut halves[usize::from(sample.pixels[pixel].half)];
                for ((view, missing), x) in views.iter().zip(missing).zip(of_views) {
                    for lane in sample.lanes_of(pixel) {
                        let x = &x[lane * own.len()..(lane + 1) * own.len()];
                        let weight = (view.scale(lane) + 0.1 * view.unit).recip();
                        equations.take(x, &own, weight, missing[lane].into());
                    }
                }
            }
            halves
        };
        let mut total = [Equations::new(own.len()), Equations::new(own.len())];
        for part in &sample.in_tasks(part) {
            total.iter_mut().zip(part).for_each(|(sum, part)| sum.add(part));
        }
        let coefficients = total.map(|equations| equations.solve(&own));
        Self { name: format!("{}, refitted", expert.name()), features: *features, coefficients }
    }

    /// What it changes, `[lane]`, by features `[lane][feature]`; `half` says in which half a lane
    /// is, and the other half teaches.
    pub(super) fn changes(&self, features: &[f32], half: impl Fn(usize) -> usize) -> Vec<f32> {
        let rows = features.chunks_exact(self.coefficients[0].len());
        let change = |(lane, x): (usize, &[f32])| {
            let coefficients = &self.coefficients[1 - half(lane)];
            let change: f64 = x.iter().zip(coefficients).map(|(&x, c)| f64::from(x) * c).sum();
            let change = change as f32;
            if change.is_finite() { change } else { 0.0 }
        };
        rows.enumerate().map(change).collect()
    }

    /// The same for the lanes of a view of all folds.
    pub(super) fn changes_of(
        &self,
        view: &View,
        half: impl Fn(usize) -> usize,
    ) -> Result<Vec<f32>, Error> {
        Ok(self.changes(&features(self.features, view, true)?, half))
    }
}

/// The features of a view, `[lane][feature]`. Of all folds, they are told to be of as few
/// samples as there are without a group: what depends on n alone would not be learnt.
fn features(of: &dyn Features, view: &View, of_all_folds: bool) -> Result<Vec<f32>, Error> {
    let mut features = vec![0.0; view.mean.len() * of.coefficients().len()];
    let mut seen = view.seen();
    if of_all_folds {
        seen.samples *= SHARE;
    }
    of.features(&seen, &mut features)?;
    features.iter_mut().filter(|x| !x.is_finite()).for_each(|x| *x = 0.0);
    Ok(features)
}

impl Equations {
    fn new(count: usize) -> Self {
        Self { matrix: (1..=count).map(|row| vec![0.0; row]).collect(), right: vec![0.0; count] }
    }

    /// Adds a lane.
    fn take(&mut self, x: &[f32], own: &[f64], weight: f64, missing: f64) {
        let change: f64 = x.iter().zip(own).map(|(&x, c)| f64::from(x) * c).sum();
        let rest = weight * (missing - change);
        for ((row, right), &xi) in self.matrix.iter_mut().zip(&mut self.right).zip(x) {
            *right += rest * f64::from(xi);
            let weighted = weight * f64::from(xi);
            row.iter_mut().zip(x).for_each(|(sum, &xj)| *sum += weighted * f64::from(xj));
        }
    }

    fn add(&mut self, other: &Self) {
        let numbers = self.matrix.iter_mut().flatten().chain(&mut self.right);
        let more = other.matrix.iter().flatten().chain(&other.right);
        numbers.zip(more).for_each(|(sum, more)| *sum += more);
    }

    /// c'; the expert's own coefficients where the equations break down.
    fn solve(mut self, own: &[f64]) -> Vec<f64> {
        let scale = |i: usize| {
            let diagonal = self.matrix[i][i];
            if diagonal > 0.0 { diagonal.sqrt().recip() } else { 0.0 }
        };
        let scale: Vec<f64> = (0..own.len()).map(scale).collect();
        for (i, row) in self.matrix.iter_mut().enumerate() {
            self.right[i] *= scale[i];
            row.iter_mut().zip(&scale).for_each(|(x, scale_j)| *x *= scale[i] * scale_j);
            row[i] += PENALTY;
        }
        solve_in_place(&mut self.matrix, &mut self.right);
        let changes = self.right.iter().zip(&scale).map(|(x, scale)| x * scale);
        let fitted: Vec<f64> = own.iter().zip(changes).map(|(c, change)| c + change).collect();
        if fitted.iter().all(|c| c.is_finite()) { fitted } else { own.to_vec() }
    }
}

//! Features that are not what they are called.

use std::borrow::Cow;

use rayon::prelude::*;

use super::super::sample::CHUNK;
use crate::{FOLDS, Grid};

/// By what share of the radiance emission may exceed it: both may have been rounded to half floats.
const ROUNDING: f32 = 1e-3;

/// Emission of lanes, as far as it is a part of their radiance: not below 0, and not above it.
/// Otherwise the two layers could be much larger than their sum, and of opposite noise: a blend
/// that improves one of them alone would be far off.
pub(super) fn part_of<'a>(emission: &'a [f32], radiance: &[f32]) -> Cow<'a, [f32]> {
    let is_part = |e: f32, y: f32| (e >= 0.0) & (e <= (1.0 + ROUNDING) * y.max(0.0));
    let are_parts =
        |(e, y): (&[f32], &[f32])| e.iter().zip(y).fold(true, |all, (e, y)| all & is_part(*e, *y));
    if emission.par_chunks(CHUNK).zip(radiance.par_chunks(CHUNK)).all(are_parts) {
        return Cow::Borrowed(emission);
    }
    // What is no number counts as 0.
    let part = |(&e, &y): (&f32, &f32)| if is_part(e, y) { e } else { e.max(0.0).min(y.max(0.0)) };
    Cow::Owned(emission.par_iter().zip(radiance).map(part).collect())
}

/// In how many pixels features are not what they are called.
#[derive(Default)]
pub(super) struct Odd {
    /// Albedo or normals.
    surfaces: usize,
    emission: usize,
}

impl Odd {
    /// Adds the inner rows of a strip: pixels whose albedo or normals are not finite, by fold.
    pub(super) fn add_surfaces(&mut self, grid: &Grid, folds: &[&[f32]]) {
        self.surfaces += count(grid, |pixel| {
            let of_pixel = |fold: &&[f32]| {
                fold[pixel..].iter().step_by(grid.pixels()).any(|number| !number.is_finite())
            };
            folds.iter().any(of_pixel)
        });
    }

    /// The same for pixels whose emission is no [part](part_of) of the radiance.
    pub(super) fn add_emission(
        &mut self,
        grid: &Grid,
        emission: &[&[f32]; FOLDS],
        parts: &[Cow<'_, [f32]>; FOLDS],
    ) {
        let pairs = emission.iter().zip(parts);
        let others = pairs.filter(|(_, part)| matches!(part, Cow::Owned(_)));
        let others: Vec<(&[f32], &[f32])> = others.map(|(e, part)| (*e, &**part)).collect();
        if !others.is_empty() {
            let is_odd = |lane| others.iter().any(|(e, part)| e[lane] != part[lane]);
            let lanes = |pixel| (pixel..grid.lanes()).step_by(grid.pixels());
            self.emission += count(grid, |pixel| lanes(pixel).any(is_odd));
        }
    }

    /// What the user should know of a picture of so many pixels.
    pub(super) fn notes(&self, pixels: usize) -> impl Iterator<Item = String> {
        let emission = "emission is no part of the radiance (below 0, above it, or no number)";
        let counts = [
            (self.surfaces, "albedo or normals are not finite", "and tell nothing there"),
            (self.emission, emission, "and counts there as far as it can be one"),
        ];
        let counts = counts.into_iter().filter(|(count, ..)| *count > 0);
        counts.map(move |(count, what, so)| format!("in {count} of {pixels} pixels, {what}, {so}"))
    }
}

/// How many pixels of the inner rows are odd.
fn count(grid: &Grid, is_odd: impl Fn(usize) -> bool + Sync) -> usize {
    let rows = grid.inner_rows();
    let pixels = (rows.start * grid.width()..rows.end * grid.width()).into_par_iter();
    pixels.filter(|pixel| is_odd(*pixel)).count()
}

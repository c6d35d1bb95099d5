//! The filter: averages pixels that a statistical test cannot tell apart.
//!
//! Around a pixel p, all pixels q at most [`RADIUS`] away count whose mean √y is equal to that
//! of p for all one can tell: in each channel, Welch's t-test of
//!
//! ```text
//! t² = (m_p − m_q)² / (v_p + v_q),   v = (mean y − m²) / (n − 1),   m = mean √y,
//! ```
//!
//! stays below its quantile. On roots, as these are closer to a normal distribution than y is;
//! and the variance of their mean needs no further sum. As the samples of a pixel may all have
//! missed a rare light, v is at least half of what it is around it. Pixels that pass count by
//! their distance, and by what tells them apart beside radiance (*guides*: albedo, normal):
//!
//! ```text
//! w = (1 − s/8)⁸₊ ≈ exp(−s),   s = |p − q|²/(2 σ²) + (Σ ((g_p − g_q)² − v_p − v_q)/(2 σ_g²))₊,
//! ```
//!
//! where v is the variance of a guide: what may be noise does not tell pixels apart.
//!
//! After Sakai, Freude, Auzinger, Hahn, Wimmer: *A Statistical Approach to Monte Carlo
//! Denoising* (SIGGRAPH Asia 2024).

mod kernel;
mod planes;

use kernel::Kernel;
pub(crate) use planes::{Guide, Means, Planes, RADIUS, mean_over_folds, write_mean};

use crate::{
    Error, Estimates, Fitted, FurtherPowers, Instructions, Requirements, SequenceBatch, Side,
    Status, Strips, Support, Transform, fold_count,
};

/// How many rows above and below a lane its estimate depends on.
pub(crate) const REACH: u32 = RADIUS + planes::BLUR;

/// The filter as a method of its own.
#[derive(Clone, Copy, Debug)]
pub struct WelchFilter {
    instructions: Instructions,
}

impl Default for WelchFilter {
    fn default() -> Self {
        Self::new(Instructions::detect())
    }
}

impl WelchFilter {
    /// The filter with these instructions.
    #[must_use]
    pub fn new(instructions: Instructions) -> Self {
        Self { instructions }
    }

    /// Writes the filtered means of the inner rows of `planes`, `[channel][pixel]`.
    pub(crate) fn run(&self, planes: &Planes, out: &mut [f32]) {
        Kernel::new(planes).run(self.instructions, out);
    }
}

impl Transform for WelchFilter {
    fn requires(&self) -> Requirements {
        let support = Support::Radius(REACH);
        let powers = FurtherPowers::NONE;
        Requirements {
            window: 1,
            sides: Side::EVERY_OF_FOLDS,
            optional: &[],
            powers,
            support,
            fits: false,
        }
    }

    fn fit(&self, _: &mut dyn Strips) -> Result<Box<dyn Fitted + '_>, Error> {
        Ok(Box::new(self))
    }
}

impl Fitted for WelchFilter {
    /// Without a grid there are no neighbours, and all lanes keep S. Where pictures of several
    /// samples each were packed, v is smaller than it should be, and less is averaged.
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        filter_strip(strip, out, |planes, values| {
            self.run(planes, values);
            Ok(())
        })
    }
}

/// Filters a strip by `run`, which writes the means of the inner rows of planes.
pub(crate) fn filter_strip(
    strip: &SequenceBatch,
    out: &mut Estimates,
    run: impl FnOnce(&Planes, &mut [f32]) -> Result<(), Error>,
) -> Result<(), Error> {
    let n = *strip.sample_counts().last().expect("a batch has a term");
    let (Some(grid), Some(folds)) = (strip.grid(), strip.of_folds(Side::OF_FOLDS[1])) else {
        out.fall_back(strip, Status::NoFolds);
        return Ok(());
    };
    let shares = std::array::from_fn(|fold| fold_count(fold, n) / f64::from(n));
    let root = mean_over_folds(&folds, &shares);
    let means = Means { samples: n.into(), mean: strip.last(), root: &root };
    let planes = Planes::new(grid, &means, &[]);
    let last = grid.inner(strip.last());
    let (values, status) = out.reset(last.len());
    run(&planes, values)?;
    for ((value, status), &last) in values.iter_mut().zip(status).zip(&*last) {
        if !value.is_finite() {
            (*value, *status) = (last, Status::NotFinite);
        }
    }
    Ok(())
}

#[cfg(test)]
pub(crate) mod tests;

//! Outlier re-weighting, after Zirr, Hanika, Dachsbacher: *Re-Weighting Firefly
//! Samples for Improved Finite-Sample Monte Carlo Estimates* (CGF 37(6), 2018).

use super::folds::{OfFolds, of_folds, sort_by};
use crate::FOLDS;

/// κ: how many times brighter than the mean of the darker ones a fold mean may be before it
/// counts less. Our choice; the paper leaves κ to the user.
const KAPPA: f64 = 4.0;

/// Fold means that are far brighter than the darker ones count less.
///
/// From dark to bright, with the weighted mean m_i of the magnitudes before x_i,
///
/// w_i = min(1, κ m_i / |x_i|), w_1 = 1, κ = 4, T = S_n − (1/K) Σ_i (1 − w_i) x_i.
///
/// As in the paper, what is not reliable yet is left out, not spread over the
/// rest: T is too dark, but tends to S_n as the fold means agree.
///
/// Adapted: the paper sorts samples into cascades by their brightness, and trusts
/// a cascade by how many samples it has, in the pixel and its neighbours, and by
/// how its brightness compares with that of the darker cascades. A sequence file
/// has no cascades; the second criterion is applied to its four fold means.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reweight;

impl OfFolds for Reweight {
    fn estimate(last: f64, folds: [f64; FOLDS]) -> f64 {
        let sorted = sort_by(folds, f64::abs);
        let (mut darker, mut excess) = (sorted[0].abs(), 0.0);
        for (i, &x) in sorted.iter().enumerate().skip(1) {
            // For x_i = 0 the weight does not matter; `min` then drops 0/0.
            let weight = (KAPPA * darker / i as f64 / x.abs()).min(1.0);
            darker += weight * x.abs();
            excess += (1.0 - weight) * x;
        }
        last - excess / FOLDS as f64
    }
}

of_folds!(Reweight);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::folds::tests::estimates;

    #[test]
    fn weights() {
        let lanes = [
            [1.0, 2.0, 3.0, 4.0],    // all are trusted
            [1.0, 1.0, 1.0, 41.0],   // the last one counts as 4
            [5.0, 1.0, 0.0, 0.0],    // nothing vouches for the bright ones
            [-1.0, 1.0, -41.0, 1.0], // signs are kept
        ];
        let out = estimates(&Reweight, &lanes);
        assert_eq!(out.values(), [2.5, 1.75, 0.0, -0.75]);
    }
}

//! G-MoN: between the mean and the median of means, by the Gini coefficient
//! (Buisine, Delepoulle, Renaud: *Firefly Removal in Monte Carlo Rendering with
//! Adaptive Median of meaNs*, EGSR 2021).

use super::folds::{OfFolds, of_folds, sort};
use crate::FOLDS;

/// G-MoN of the K = 4 fold means: with their Gini coefficient
///
/// G = Σ_i (2i − K − 1) x_(i) / (K Σ_i |x_i|), x_(1) ≤ … ≤ x_(K),
///
/// ⌊G ⌊K/2⌋⌋ of the largest and as many of the smallest are left out of the mean.
///
/// Adapted: the paper accumulates as many means as the user likes, and averages G
/// over the channels of a pixel; a sequence file has four means, and a lane knows
/// no other. So either none is left out (G < 1/2, and T = S_n) or one at each end,
/// which is the median of means. The magnitudes in the denominator change nothing
/// for radiance, and keep G in [0, 1] for values of any sign.
/// Where all means are 0, G would be 0/0; such lanes are constant.
#[derive(Clone, Copy, Debug, Default)]
pub struct Gmon;

impl OfFolds for Gmon {
    fn estimate(last: f64, folds: [f64; FOLDS]) -> f64 {
        let [a, b, c, d] = sort(folds);
        let magnitude = a.abs() + b.abs() + c.abs() + d.abs();
        let gini = (3.0 * (d - a) + (c - b)) / (FOLDS as f64 * magnitude);
        if gini < 0.5 { last } else { 0.5 * (b + c) }
    }
}

of_folds!(Gmon);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Status, methods::folds::tests::estimates};

    #[test]
    fn trims_where_the_means_are_unequal() {
        let lanes = [[1.0, 1.0, 1.0, 2.0], [1.0, 1.0, 1.0, 9.0], [0.0; 4], [-8.0, 1.0, 1.0, 8.0]];
        let out = estimates(&Gmon, &lanes);
        // G = 3/20, 24/48 = 1/2, 0/0, 48/72.
        assert_eq!(out.values(), [1.25, 1.0, 0.0, 1.0]);
        assert_eq!(out.status()[2], Status::Constant);
    }
}

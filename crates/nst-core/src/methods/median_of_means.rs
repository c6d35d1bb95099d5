//! The median of means (Nemirovsky and Yudin 1983).

use super::folds::{OfFolds, of_folds, sort};
use crate::FOLDS;

/// T = the median of the four fold means: the mean of the middle two.
///
/// One fold may contain any outlier without harm. The price: on skewed samples the median
/// of means lies below the mean, and on normal ones its variance is 1.19 times that of the
/// mean.
#[derive(Clone, Copy, Debug, Default)]
pub struct MedianOfMeans;

impl OfFolds for MedianOfMeans {
    fn estimate(_: f64, folds: [f64; FOLDS]) -> f64 {
        let [_, second, third, _] = sort(folds);
        0.5 * (second + third)
    }
}

of_folds!(MedianOfMeans);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::folds::tests::estimates;

    #[test]
    fn an_outlier_is_ignored() {
        let out = estimates(&MedianOfMeans, &[[1.0, 1e9, 2.0, 4.0], [1.0, 2.0, -1e9, 4.0]]);
        assert_eq!(out.values(), [3.0, 1.5]);
    }
}

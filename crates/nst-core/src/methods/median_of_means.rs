//! The median of means (Nemirovsky and Yudin 1983).

use super::folds::{OF_FOLDS, map_folds, sort};
use crate::{Error, Estimates, Fitted, Requirements, SequenceBatch, Strips, Transform};

/// T = the median of the four fold means: the mean of the middle two.
///
/// One fold may contain any outlier without harm. The price: on skewed samples the median
/// of means lies below the mean, and on normal ones its variance is 1.19 times that of the
/// mean.
#[derive(Clone, Copy, Debug, Default)]
pub struct MedianOfMeans;

impl Fitted for MedianOfMeans {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        map_folds(strip, out, |_, folds| {
            let [_, second, third, _] = sort(folds);
            0.5 * (second + third)
        })
    }
}

impl Transform for MedianOfMeans {
    fn requires(&self) -> Requirements {
        OF_FOLDS
    }

    fn fit(&self, _: &mut dyn Strips) -> Result<Box<dyn Fitted + '_>, Error> {
        Ok(Box::new(self))
    }
}

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

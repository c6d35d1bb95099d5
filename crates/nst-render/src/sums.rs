//! The sums of a rendering's samples, from which it can be continued.

/// How many folds the samples of a pixel are split into: sample i belongs to fold i mod 4.
pub const FOLDS: usize = 4;

/// Σy of each fold and Σy² over all samples of each lane, in f64. Σy of all
/// samples is fold 0 + fold 1 + fold 2 + fold 3, added in this order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sums {
    /// `[fold][lane]`
    pub folds: [Vec<f64>; FOLDS],
    /// `[lane]`
    pub squares: Vec<f64>,
}

impl Sums {
    /// Of no samples.
    pub(crate) fn zero(lanes: usize) -> Self {
        Self { folds: std::array::from_fn(|_| vec![0.0; lanes]), squares: vec![0.0; lanes] }
    }

    /// The folds, then the squares, each `[lane]`.
    pub(crate) fn planes(&self) -> impl Iterator<Item = &[f64]> {
        self.folds.iter().chain([&self.squares]).map(Vec::as_slice)
    }

    /// As [`Sums::planes`], to be written.
    pub(crate) fn planes_mut(&mut self) -> impl Iterator<Item = &mut [f64]> {
        self.folds.iter_mut().chain([&mut self.squares]).map(Vec::as_mut_slice)
    }

    /// The variance of S_n of each lane, for n ≥ 2.
    pub(crate) fn variance(&self, n: u32) -> Vec<f32> {
        let [a, b, c, d] = &self.folds;
        let lanes = a.iter().zip(b).zip(c).zip(d).zip(&self.squares);
        lanes
            .map(|((((a, b), c), d), squares)| {
                // (Σy² − (Σy)²/n) / (n (n − 1)); rounding may take it below zero.
                let (n, sum) = (f64::from(n), total([*a, *b, *c, *d]));
                ((squares - sum * sum / n).max(0.0) / (n * (n - 1.0))) as f32
            })
            .collect()
    }
}

/// Σy of all samples.
pub(crate) fn total([a, b, c, d]: [f64; FOLDS]) -> f64 {
    a + b + c + d
}

/// How many of a lane's n samples are in a fold.
pub(crate) fn fold_count(fold: usize, n: u32) -> f64 {
    (n as usize).saturating_sub(fold).div_ceil(FOLDS) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folds_share_all_samples() {
        for n in 0..20 {
            let counts: Vec<f64> = (0..FOLDS).map(|fold| fold_count(fold, n)).collect();
            assert_eq!(counts.iter().sum::<f64>(), f64::from(n));
            assert!(
                counts.windows(2).all(|pair| pair[0] >= pair[1]) && counts[0] - counts[3] <= 1.0
            );
        }
    }

    #[test]
    fn the_variance_of_known_samples() {
        // 1, 2, 3, 4, 5: the variance of the samples is 2.5, of their mean 0.5.
        let folds = [6.0, 2.0, 3.0, 4.0].map(|sum| vec![sum]);
        let sums = Sums { folds, squares: vec![55.0] };
        assert_eq!(sums.variance(5), [0.5]);
    }
}

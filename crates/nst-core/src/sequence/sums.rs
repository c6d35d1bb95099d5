//! The sums of a lane's samples, from which its sequence can be continued.

use super::{FOLDS, Side, fold_count, root};

/// What is kept of all samples y of a lane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LaneSums {
    /// Σy of each fold. Σy of all samples is their sum, added in this order.
    pub folds: [f64; FOLDS],
    /// Σ√y of each fold, by [`root`].
    pub roots: [f64; FOLDS],
    /// Σy² of each fold.
    pub squares: [f64; FOLDS],
}

#[allow(unsafe_code)]
// SAFETY: all fields are f64, for which zero bytes are 0.
unsafe impl bytemuck::Zeroable for LaneSums {}

impl LaneSums {
    /// Adds the sample with an index. It must be finite, as a NaN would spoil the sums of
    /// all others.
    #[inline]
    pub fn add(&mut self, index: u32, sample: f64) {
        let fold = index as usize % FOLDS;
        self.folds[fold] += sample;
        self.roots[fold] += root(sample);
        self.squares[fold] += sample * sample;
    }

    /// The sums of the folds, of their roots and of their squares, in the order of
    /// [`Side::OF_FOLDS`](super::Side::OF_FOLDS).
    #[must_use]
    pub fn of_folds(&self) -> [&[f64; FOLDS]; 3] {
        [&self.folds, &self.roots, &self.squares]
    }

    /// Σy of all samples.
    #[inline]
    #[must_use]
    pub fn total(&self) -> f64 {
        sum(self.folds)
    }

    /// The variance of S_n, for n ≥ 2; infinite where a sum is not finite, as nothing is
    /// known of the lane then.
    #[must_use]
    pub fn variance(&self, n: u32) -> f32 {
        // (Σy² − (Σy)²/n) / (n (n − 1)); rounding may take it below zero.
        let (n, total) = (f64::from(n), self.total());
        let deviations = sum(self.squares) - total * total / n;
        if deviations.is_finite() {
            (deviations.max(0.0) / (n * (n - 1.0))) as f32
        } else {
            f32::INFINITY
        }
    }

    /// Writes a side channel that [follows from the sums](Side::of_sums) of n samples of each
    /// lane, `[lane]`; leaves `out` as it is if the side channel is another.
    pub fn write_side(lanes: &[Self], side: &Side, n: u32, out: &mut [f32]) {
        let means = |sums: fn(&Self) -> &[f64; FOLDS], fold: u8, out: &mut [f32]| {
            let (fold, count) = (usize::from(fold), fold_count(fold.into(), n));
            out.iter_mut().zip(lanes).for_each(|(out, lane)| {
                *out = (sums(lane)[fold] / count) as f32;
            });
        };
        match *side {
            Side::Fold(fold) => means(|lane| &lane.folds, fold, out),
            Side::Root(fold) => means(|lane| &lane.roots, fold, out),
            Side::Square(fold) => means(|lane| &lane.squares, fold, out),
            Side::Variance => {
                out.iter_mut().zip(lanes).for_each(|(out, lane)| *out = lane.variance(n));
            }
            _ => {}
        }
    }

    /// Writes the means of all folds of n samples of each lane at once, `[side][lane]` in the order
    /// of [`Side::EVERY_OF_FOLDS`]: what [`Self::write_side`] does for each.
    ///
    /// # Panics
    /// If `outs` are not as many as the side channels.
    pub fn write_folds(lanes: &[Self], n: u32, outs: &mut [&mut [f32]]) {
        let ([folds, roots, squares], []) = outs.as_chunks_mut() else {
            panic!("{} side channels of folds", outs.len());
        };
        write_fold_means(lanes, |lane| &lane.folds, n, folds);
        write_fold_means(lanes, |lane| &lane.roots, n, roots);
        write_fold_means(lanes, |lane| &lane.squares, n, squares);
    }
}

/// Writes the means of four folds of n samples at once, `[fold][item]`. Divisions of neighbours in
/// memory become vector instructions.
#[inline(always)]
pub fn write_fold_means<T>(
    items: &[T],
    sums: impl Fn(&T) -> &[f64; FOLDS],
    n: u32,
    [a, b, c, d]: &mut [&mut [f32]; FOLDS],
) {
    let counts: [f64; FOLDS] = std::array::from_fn(|fold| fold_count(fold, n));
    let outs = a.iter_mut().zip(b.iter_mut()).zip(c.iter_mut().zip(d.iter_mut()));
    for (item, ((a, b), (c, d))) in items.iter().zip(outs) {
        let sums = sums(item);
        let means: [f64; FOLDS] = std::array::from_fn(|fold| sums[fold] / counts[fold]);
        [*a, *b, *c, *d] = means.map(|mean| mean as f32);
    }
}

/// The mean over folds with these shares of the samples.
#[inline(always)]
pub(crate) fn mean_of_folds(folds: [f32; FOLDS], shares: &[f64; FOLDS]) -> f32 {
    let [a, b, c, d] = folds.map(f64::from);
    (shares[0] * a + shares[1] * b + (shares[2] * c + shares[3] * d)) as f32
}

fn sum([a, b, c, d]: [f64; FOLDS]) -> f64 {
    a + b + c + d
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
        let mut sums = LaneSums::default();
        (0..5).for_each(|i| sums.add(i, f64::from(i + 1)));
        let squares = [26.0, 4.0, 9.0, 16.0];
        let roots = [1.0 + 5.0_f64.sqrt(), 2.0_f64.sqrt(), 3.0_f64.sqrt(), 2.0];
        assert_eq!(sums, LaneSums { folds: [6.0, 2.0, 3.0, 4.0], roots, squares });
        assert_eq!([root(-4.0), root(0.0), root(9.0)], [-2.0, 0.0, 3.0]);
        assert_eq!((sums.total(), sums.variance(5)), (15.0, 0.5));
    }

    #[test]
    fn side_channels_follow_from_the_sums() {
        let mut lanes = [LaneSums::default(); 2];
        (0..5).for_each(|i| lanes[0].add(i, f64::from(i + 1)));
        (0..5).for_each(|i| lanes[1].add(i, 4.0));
        let of = |side: Side, n: u32| {
            let mut out = [9.0; 2];
            LaneSums::write_side(&lanes, &side, n, &mut out);
            out
        };
        assert_eq!((of(Side::Fold(0), 5), of(Side::Fold(3), 5)), ([3.0, 4.0], [4.0, 4.0]));
        assert_eq!((of(Side::Root(3), 5), of(Side::Square(0), 5)), ([2.0, 2.0], [13.0, 16.0]));
        assert_eq!(of(Side::Variance, 5), [0.5, 0.0]);
        assert_eq!(of(Side::Skipped, 5), [9.0, 9.0]);
        assert_eq!([1, 2, 3, 4].map(|n| Side::of_sums(n).count()), [0, 1, 1, 13]);

        let each = Side::EVERY_OF_FOLDS.each_ref().map(|side| of(side.clone(), 5));
        let mut at_once = [[9.0; 2]; 3 * FOLDS];
        LaneSums::write_folds(&lanes, 5, &mut at_once.each_mut().map(|out| &mut out[..]));
        assert_eq!(at_once, each);
    }

    #[test]
    fn nothing_is_certain_of_sums_that_are_not_finite() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut sums = LaneSums::default();
            [1.0, bad, 2.0].into_iter().zip(0..).for_each(|(y, i)| sums.add(i, y));
            assert_eq!(sums.variance(3), f32::INFINITY);
        }
    }
}

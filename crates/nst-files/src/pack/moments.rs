//! Running means, folds and variance of pictures that come one after the other.

use nst_core::{FOLDS, Side, root};

/// Sums over pictures by lane, in f64. Values that are not finite are left out: their true
/// values are not known, and one of them would spoil the sums.
pub(super) struct Moments {
    /// How many pictures have been added.
    pictures: usize,
    folds: [Fold; FOLDS],
    /// The sum of squared deviations from the mean so far (Welford 1962).
    deviations: Vec<f64>,
}

/// The finite values of a fold, by lane.
struct Fold {
    sum: Vec<f64>,
    /// The sums of the roots and of the squares.
    roots: Vec<f64>,
    squares: Vec<f64>,
    count: Vec<u32>,
}

impl Moments {
    /// What is kept of each lane.
    pub(super) const BYTES_PER_LANE: usize =
        FOLDS * (3 * size_of::<f64>() + size_of::<u32>()) + size_of::<f64>();

    pub(super) fn new(lanes: usize) -> Self {
        let zeros = || vec![0.0; lanes];
        let fold =
            |_| Fold { sum: zeros(), roots: zeros(), squares: zeros(), count: vec![0; lanes] };
        Self { pictures: 0, folds: std::array::from_fn(fold), deviations: vec![0.0; lanes] }
    }

    /// Adds a picture, and the mean so far to `terms`.
    pub(super) fn push(&mut self, values: &[f32], terms: &mut Vec<f32>) {
        for (lane, &value) in values.iter().enumerate() {
            let value = f64::from(value);
            if value.is_finite() {
                let before = self.mean(lane);
                let fold = &mut self.folds[self.pictures % FOLDS];
                fold.sum[lane] += value;
                fold.roots[lane] += root(value);
                fold.squares[lane] += value * value;
                fold.count[lane] += 1;
                if self.count(lane) > 1.0 {
                    self.deviations[lane] += (value - before) * (value - self.mean(lane));
                }
            }
            terms.push(self.mean(lane) as f32);
        }
        self.pictures += 1;
    }

    /// How many values of a lane are finite.
    fn count(&self, lane: usize) -> f64 {
        self.folds.iter().map(|fold| f64::from(fold.count[lane])).sum()
    }

    /// The mean of the finite values of a lane, NaN if there are none.
    fn mean(&self, lane: usize) -> f64 {
        self.folds.iter().map(|fold| fold.sum[lane]).sum::<f64>() / self.count(lane)
    }

    /// The mean that a side channel of a fold is, NaN where the fold has no finite value;
    /// `None` for other side channels.
    pub(super) fn of_fold(&self, side: &Side) -> Option<Vec<f32>> {
        let (fold, sums): (_, fn(&Fold) -> &Vec<f64>) = match side {
            Side::Fold(fold) => (fold, |fold| &fold.sum),
            Side::Root(fold) => (fold, |fold| &fold.roots),
            Side::Square(fold) => (fold, |fold| &fold.squares),
            _ => return None,
        };
        let fold = &self.folds[usize::from(*fold)];
        let mean = |(sum, count): (&f64, &u32)| (sum / f64::from(*count)) as f32;
        Some(sums(fold).iter().zip(&fold.count).map(mean).collect())
    }

    /// The estimated variance of the mean of all R pictures: Σ (x − x̄)² / (R (R − 1));
    /// infinite where fewer than two values are finite.
    pub(super) fn variance(&self) -> Vec<f32> {
        let of_lane = |(lane, sum): (usize, &f64)| {
            let count = self.count(lane);
            if count > 1.0 { (sum / (count * (count - 1.0))) as f32 } else { f32::INFINITY }
        };
        self.deviations.iter().enumerate().map(of_lane).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A value that is not finite spoils only what would depend on it alone.
    #[test]
    fn values_that_are_not_finite_are_left_out() {
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        // By picture: lanes that are bad never, once, at first, and but for one value.
        let pictures = [
            [1.0, 1.0, nan, nan],
            [2.0, inf, 2.0, nan],
            [3.0, 3.0, 3.0, -inf],
            [4.0, 4.0, 4.0, 4.0],
            [6.0, 6.0, 6.0, nan],
        ];
        let mut moments = Moments::new(4);
        let mut terms = Vec::new();
        pictures.iter().for_each(|values| moments.push(values, &mut terms));
        let last = &terms[16..];
        assert_eq!(last, [3.2, 3.5, 3.75, 4.0]);
        assert!(terms[2].is_nan(), "nothing is known after the first picture");
        let mean = |fold: u8| moments.of_fold(&Side::Fold(fold)).expect("the mean of a fold");
        assert_eq!((mean(0)[1], mean(0)[2]), (3.5, 6.0));
        assert!(mean(1)[1].is_nan(), "its only value was infinite");
        // 1, 3, 4, 6: squared deviations of 13 in all, over 4 · 3.
        let variance = moments.variance();
        assert!((f64::from(variance[1]) - 13.0 / 12.0).abs() < 1e-6, "{}", variance[1]);
        assert_eq!(variance[3], f32::INFINITY, "one value says nothing of its error");
    }
}

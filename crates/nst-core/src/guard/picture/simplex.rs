//! The best blend of very few experts, as it is computed for each cell.

use crate::cholesky::solve;

/// The most experts of one layer.
pub(super) const MOST: usize = 4;

/// What is added to the diagonal of A, relative to its mean: experts that agree share a weight.
const RIDGE: f64 = 1e-4;

/// The places of the lower half of A, row by row.
const TRIANGLE: usize = MOST * (MOST + 1) / 2;

/// A, symmetric, of which the lower half is stored, and b.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Moments {
    pub(super) a: [f64; TRIANGLE],
    pub(super) b: [f64; MOST],
}

/// The place of a row and a column of A, the column not above the row.
#[inline(always)]
const fn place(row: usize, column: usize) -> usize {
    row * (row + 1) / 2 + column
}

impl Moments {
    /// Adds d dᵀ to A.
    #[inline(always)]
    pub(super) fn add_squares<const N: usize>(&mut self, changes: &[f64; N]) {
        for i in 0..N {
            for j in 0..=i {
                self.a[place(i, j)] += changes[i] * changes[j];
            }
        }
    }

    /// Adds b of others, of which the first experts have some.
    #[inline(always)]
    pub(super) fn add_b<const N: usize>(&mut self, other: &Self, share: f64) {
        let numbers = self.b[..N].iter_mut().zip(&other.b[..N]);
        numbers.for_each(|(sum, more)| *sum += share * more);
    }

    /// Adds A of others likewise.
    #[inline(always)]
    pub(super) fn add_a<const N: usize>(&mut self, other: &Self, share: f64) {
        let numbers = self.a[..place(N, 0)].iter_mut().zip(&other.a[..place(N, 0)]);
        numbers.for_each(|(sum, more)| *sum += share * more);
    }

    /// Adds d (h − S) to b.
    #[inline(always)]
    pub(super) fn add_products<const N: usize>(&mut self, changes: &[f64; N], missing: f64) {
        self.b.iter_mut().zip(changes).for_each(|(sum, change)| *sum += change * missing);
    }

    /// A w
    pub(super) fn times(&self, w: &[f64; MOST]) -> [f64; MOST] {
        std::array::from_fn(|i| {
            (0..MOST).map(|j| self.a[place(i.max(j), i.min(j))] * w[j]).sum::<f64>()
        })
    }

    /// The change of the sum of squared errors by these weights: wᵀA w − 2 bᵀw.
    pub(super) fn change(&self, w: &[f64; MOST]) -> f64 {
        let of_a = self.times(w);
        (0..MOST).map(|i| w[i] * (of_a[i] - 2.0 * self.b[i])).sum()
    }

    /// Those of at most [`MOST`] blends by these weights, as if they were experts.
    pub(super) fn of_blends(&self, blends: &[[f64; MOST]]) -> Self {
        let mut moments = Self::default();
        for (i, w) in blends.iter().enumerate() {
            let of_a = self.times(w);
            for (j, other) in blends[..=i].iter().enumerate() {
                moments.a[place(i, j)] = of_a.iter().zip(other).map(|(a, w)| a * w).sum();
            }
            moments.b[i] = self.b.iter().zip(w).map(|(b, w)| b * w).sum();
        }
        moments
    }

    /// The sum of the diagonal of A.
    pub(super) fn trace(&self) -> f64 {
        (0..MOST).map(|i| self.a[place(i, i)]).sum()
    }

    /// The weights w ≥ 0, Σw ≤ 1 of the first `count` experts with the least change, by trying all
    /// sets of experts that may have a weight, with Σw free and with Σw = 1. Never worse than
    /// w = 0; sums that are not finite give w = 0.
    pub(super) fn best_weights(&self, count: usize) -> [f64; MOST] {
        let mut ridged = *self;
        let ridge = RIDGE * self.trace() / count.max(1) as f64;
        (0..count).for_each(|i| ridged.a[place(i, i)] += ridge);
        let (mut best, mut least) = ([0.0; MOST], 0.0);
        for set in 1..1_u32 << count {
            let free = ridged.solve(set, &ridged.b);
            let sum: f64 = free.iter().sum();
            let weights = if sum <= 1.0 {
                free
            } else {
                // Along A⁻¹1 down to Σw = 1.
                let along = ridged.solve(set, &[1.0; MOST]);
                let step = (sum - 1.0) / along.iter().sum::<f64>();
                std::array::from_fn(|i| free[i] - step * along[i])
            };
            let change = ridged.change(&weights);
            // A NaN is no gain.
            if weights.iter().all(|&w| w >= 0.0) && change < least {
                (best, least) = (weights, change);
            }
        }
        best
    }

    /// The weight in [0, 1] of one expert alone with the least change; 0 if nothing is known of it.
    pub(super) fn best_weight(&self, expert: usize) -> f64 {
        let weight = self.b[expert] / ((1.0 + RIDGE) * self.a[place(expert, expert)]);
        if weight > 0.0 { weight.min(1.0) } else { 0.0 }
    }

    /// The solution of A x = right for the experts of a set, 0 elsewhere.
    fn solve(&self, set: u32, right: &[f64; MOST]) -> [f64; MOST] {
        let mut members = [0; MOST];
        let mut count = 0;
        for i in (0..MOST).filter(|i| set >> i & 1 == 1) {
            members[count] = i;
            count += 1;
        }
        let (mut rows, mut values) = ([[0.0; MOST]; MOST], [0.0; MOST]);
        for i in 0..count {
            values[i] = right[members[i]];
            (0..=i).for_each(|j| rows[i][j] = self.a[place(members[i], members[j])]);
        }
        let solution = solve(rows, values, count);
        let mut x = [0.0; MOST];
        (0..count).for_each(|i| x[members[i]] = solution[i]);
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;

    /// The least change at the points of a grid over the simplex: slow, and right.
    fn slowly(moments: &Moments, w: &mut [f64; MOST], i: usize, left: u32, least: &mut f64) {
        const STEPS: f64 = 20.0;
        if i == MOST {
            *least = least.min(moments.change(w));
            return;
        }
        for k in 0..=left {
            w[i] = f64::from(k) / STEPS;
            slowly(moments, w, i + 1, left - k, least);
        }
        w[i] = 0.0;
    }

    #[test]
    fn no_weights_on_the_simplex_are_better() {
        let mut random = SplitMix64(7);
        for count in 1..=MOST {
            for _ in 0..40 {
                let mut moments = Moments::default();
                for _ in 0..6 {
                    let missing = 2.0 * random.uniform() - 1.0;
                    let change = |i| if i < count { missing + random.uniform() - 0.3 } else { 0.0 };
                    let changes = [0, 1, 2, 3].map(change);
                    moments.add_squares(&changes);
                    moments.add_products(&changes, missing);
                }
                let w = moments.best_weights(count);
                assert!(w.iter().all(|&w| w >= 0.0) && w.iter().sum::<f64>() < 1.0 + 1e-9, "{w:?}");
                assert!(w[count..].iter().all(|&w| w == 0.0), "{w:?}");
                let mut least = 0.0;
                slowly(&moments, &mut [0.0; MOST], 0, 20, &mut least);
                // The ridge costs a ten-thousandth of A.
                assert!(moments.change(&w) < least + 2e-4 * moments.trace(), "{w:?}");
                // The comparison would see weights that are a little off.
                let off = w.map(|w| 0.7 * w);
                let worse = moments.change(&off) > moments.change(&w) + 4e-4 * moments.trace();
                assert!(worse || w.iter().sum::<f64>() < 0.1, "{w:?}");
            }
        }
    }

    #[test]
    fn sums_that_say_nothing_give_no_weights() {
        let mut moments = Moments::default();
        assert_eq!(moments.best_weights(4), [0.0; MOST]);
        moments.add_squares(&[1.0; MOST]);
        moments.add_products(&[f64::NAN, 1.0, 1.0, 1.0], 1.0);
        assert_eq!(moments.best_weights(1), [0.0; MOST]);
    }
}

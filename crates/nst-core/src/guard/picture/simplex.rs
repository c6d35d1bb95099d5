//! The best blend of very few experts, as it is computed for each cell.

use crate::cholesky::solve;

/// The most experts of one layer.
pub(super) const MOST: usize = 4;

/// What is added to the diagonal of A, relative to its mean: experts that agree share a weight.
const RIDGE: f64 = 1e-4;

/// The places of the lower half of A, row by row.
pub(super) const TRIANGLE: usize = MOST * (MOST + 1) / 2;

/// A, symmetric, of which the lower half is stored, and b.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Moments {
    pub(super) a: [f64; TRIANGLE],
    pub(super) b: [f64; MOST],
}

/// The place of a row and a column of A, the column not above the row.
#[inline(always)]
pub(super) const fn place(row: usize, column: usize) -> usize {
    row * (row + 1) / 2 + column
}

impl Moments {
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

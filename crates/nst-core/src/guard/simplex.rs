//! The best blend of a few experts: a small quadratic problem on the simplex.

use crate::cholesky::solve;

/// The most experts of one blend: all sets of them are tried.
pub(super) const MOST: usize = 8;

/// What is added to the diagonal of A, relative to itself: experts that agree share a weight.
const RIDGE: f64 = 1e-4;

/// Second moments of the experts' changes d of the plain estimate, and how they go with what
/// is missing to the true value: A = Σ d dᵀ, b = Σ d (h − S).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Moments {
    /// `[expert][expert]`, symmetric; the lower half is used.
    pub(super) a: [[f64; MOST]; MOST],
    /// `[expert]`
    pub(super) b: [f64; MOST],
}

impl Moments {
    /// The change of the sum of squared errors by these weights: wᵀA w − 2 bᵀw.
    pub(super) fn change(&self, w: &[f64; MOST]) -> f64 {
        let mut sum = 0.0;
        for i in 0..MOST {
            sum -= 2.0 * self.b[i] * w[i];
            for j in 0..i {
                sum += 2.0 * self.a[i][j] * w[i] * w[j];
            }
            sum += self.a[i][i] * w[i] * w[i];
        }
        sum
    }
}

/// The weights w ≥ 0, Σw ≤ 1 of the first `count` experts with the least
/// [`change`](Moments::change), by trying all sets of experts that may have a weight, with
/// Σw free and with Σw = 1. Never worse than w = 0; sums that are not finite give w = 0.
///
/// `noise` is the covariance of b. Weights that follow it seem to gain tr(A⁻¹ noise), and lose
/// as much: both are counted against a set of experts, as by Mallows' C_p (*Some Comments on
/// C_p*, Technometrics 1973), and twice, so that an expert must gain what is beyond two
/// standard errors of nothing. One that adds nothing gets no weight.
pub(super) fn best_weights(
    moments: &Moments,
    noise: &[[f64; MOST]; MOST],
    count: usize,
) -> [f64; MOST] {
    let mut ridged = *moments;
    (0..count).for_each(|i| ridged.a[i][i] *= 1.0 + RIDGE);
    let (mut best, mut least) = ([0.0; MOST], 0.0);
    for set in 1..1_u32 << count {
        let members = Members::of(set);
        let Some(free) = members.solve(&ridged.a, &ridged.b) else { continue };
        let sum: f64 = free.iter().sum();
        let weights = if sum <= 1.0 {
            free
        } else {
            // Along A⁻¹1 down to Σw = 1.
            let Some(along) = members.solve(&ridged.a, &[1.0; MOST]) else { continue };
            let step = (sum - 1.0) / along.iter().sum::<f64>();
            std::array::from_fn(|i| free[i] - step * along[i])
        };
        let Some(chance) = members.trace(&ridged.a, noise) else { continue };
        let change = ridged.change(&weights) + 4.0 * chance;
        // A NaN is no gain.
        if weights.iter().all(|&w| w >= 0.0) && change < least {
            (best, least) = (weights, change);
        }
    }
    best
}

/// The share of a gain that is kept if `noise` is its variance: 1 − c V/gain², at least 0.
pub(super) fn certainty(gain: f64, noise: f64, caution: f64) -> f64 {
    let kept = 1.0 - caution * noise / (gain * gain);
    // A NaN is no gain.
    if kept > 0.0 { kept.min(1.0) } else { 0.0 }
}

/// A set of experts, by their numbers in increasing order.
struct Members {
    list: [usize; MOST],
    count: usize,
}

impl Members {
    fn of(set: u32) -> Self {
        let mut members = Self { list: [0; MOST], count: 0 };
        for i in (0..MOST).filter(|i| set >> i & 1 == 1) {
            members.list[members.count] = i;
            members.count += 1;
        }
        members
    }

    /// tr(A⁻¹ N) over the members.
    fn trace(&self, a: &[[f64; MOST]; MOST], noise: &[[f64; MOST]; MOST]) -> Option<f64> {
        let columns = self.list[..self.count].iter();
        columns.map(|&i| Some(self.solve(a, &noise[i])?[i])).sum()
    }

    /// The solution of A x = b for the members, 0 elsewhere; `None` where A is not positive
    /// definite.
    fn solve(&self, a: &[[f64; MOST]; MOST], b: &[f64; MOST]) -> Option<[f64; MOST]> {
        let list = &self.list[..self.count];
        let (mut rows, mut right) = ([[0.0; MOST]; MOST], [0.0; MOST]);
        for (i, &row) in list.iter().enumerate() {
            right[i] = b[row];
            list.iter().enumerate().for_each(|(j, &column)| rows[i][j] = a[row][column]);
        }
        let solution = solve(rows, right, self.count);
        let mut x = [0.0; MOST];
        list.iter().zip(solution).for_each(|(&member, value)| x[member] = value);
        x.iter().all(|value| value.is_finite()).then_some(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: [[f64; MOST]; MOST] = [[0.0; MOST]; MOST];

    /// Moments of some random changes, of which the first are those of real experts.
    fn random(seed: &mut u64, count: usize) -> Moments {
        let mut uniform = || {
            *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (*seed >> 40) as f64 / 8_388_608.0 - 1.0
        };
        let mut moments = Moments::default();
        let bias: [f64; MOST] = std::array::from_fn(|_| uniform());
        let sense = if uniform() < -0.5 { -0.7 } else { 0.7 };
        for _ in 0..3 * count {
            let missing = uniform();
            let d: [f64; MOST] = std::array::from_fn(|i| {
                if i < count { sense * missing + bias[i] * uniform() } else { 0.0 }
            });
            for i in 0..count {
                moments.b[i] += d[i] * (missing + 0.5 * uniform());
                (0..count).for_each(|j| moments.a[i][j] += d[i] * d[j]);
            }
        }
        moments
    }

    /// The least change at the points of a grid over the simplex: slow, and right.
    fn slowly(moments: &Moments, count: usize) -> f64 {
        let mut least = 0.0_f64;
        let steps = 12;
        let mut w = [0.0; MOST];
        fn grid(
            moments: &Moments,
            w: &mut [f64; MOST],
            i: usize,
            count: usize,
            left: usize,
            steps: usize,
            least: &mut f64,
        ) {
            if i == count {
                *least = least.min(moments.change(w));
                return;
            }
            for k in 0..=left {
                w[i] = k as f64 / steps as f64;
                grid(moments, w, i + 1, count, left - k, steps, least);
            }
            w[i] = 0.0;
        }
        grid(moments, &mut w, 0, count, steps, steps, &mut least);
        least
    }

    #[test]
    fn nothing_on_the_simplex_is_better() {
        let mut seed = 3;
        let mut kinds = [0; 3];
        for round in 0..60 {
            let count = 1 + round % 4;
            let moments = random(&mut seed, count);
            let w = best_weights(&moments, &NONE, count);
            let sum: f64 = w.iter().sum();
            assert!(w.iter().all(|&w| w >= 0.0) && sum <= 1.0 + 1e-12, "{w:?}");
            kinds[if sum == 0.0 {
                0
            } else if sum < 1.0 - 1e-9 {
                1
            } else {
                2
            }] += 1;
            let trace: f64 = (0..count).map(|i| moments.a[i][i]).sum();
            // The ridge costs at most RIDGE × Σ A_ii w_i².
            let slack = RIDGE * trace;
            let (found, expected) = (moments.change(&w), slowly(&moments, count));
            assert!(found <= expected + slack, "{count}: {found} {expected}");
            // The comparison notices other weights.
            let wrong = w.map(|x| 0.8 * x);
            assert!(sum == 0.0 || moments.change(&wrong) > found);
        }
        assert!(kinds.iter().all(|&count| count > 3), "all kinds of solutions: {kinds:?}");
    }

    #[test]
    fn one_expert_by_hand() {
        let mut moments = Moments::default();
        moments.a[0][0] = 4.0;
        for (b, expected) in [(2.0, 0.5), (-1.0, 0.0), (8.0, 1.0)] {
            moments.b[0] = b;
            assert!((best_weights(&moments, &NONE, 1)[0] - expected).abs() <= RIDGE, "{b}");
        }
    }

    /// Two experts whose b has the same chance to be noise: the one that gains less than that
    /// gets no weight; nor does any where the noise is larger than all gains.
    #[test]
    fn what_may_be_noise_gets_no_weight() {
        let mut moments = Moments::default();
        let mut noise = NONE;
        for i in 0..2 {
            (moments.a[i][i], noise[i][i]) = (1.0, 0.01);
        }
        moments.b[..2].copy_from_slice(&[0.5, 0.1]);
        let w = best_weights(&moments, &noise, 2);
        assert!((w[0] - 0.5).abs() < 1e-3 && w[1] == 0.0, "{w:?}");
        assert!(best_weights(&moments, &NONE, 2)[1] > 0.0);
        noise[0][0] = 0.2;
        assert_eq!(best_weights(&moments, &noise, 1), [0.0; MOST]);
    }

    /// Experts that agree, and sums that are no numbers.
    #[test]
    fn degenerate_sums() {
        let mut twins = Moments::default();
        for i in 0..2 {
            twins.b[i] = 1.0;
            (0..2).for_each(|j| twins.a[i][j] = 2.0);
        }
        let w = best_weights(&twins, &NONE, 2);
        assert!((w[0] + w[1] - 0.5).abs() < 1e-3 && w[2..] == [0.0; MOST - 2], "{w:?}");
        assert_eq!(best_weights(&Moments::default(), &NONE, 3), [0.0; MOST]);
        for bad in [f64::NAN, f64::INFINITY] {
            let mut moments = twins;
            moments.a[1][1] = bad;
            moments.b[1] = bad;
            let w = best_weights(&moments, &NONE, 2);
            assert!(w.iter().all(|w| w.is_finite()), "{w:?}");
        }
    }
}

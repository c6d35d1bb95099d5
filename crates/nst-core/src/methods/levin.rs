//! Levin's u-transformation (Levin 1973), by Sidi's W-algorithm.

use super::extrapolation::{Extrapolation, MAX_TERMS, Tile, WIDTH, difference};

/// Levin's u-transformation of the last eight terms.
///
/// The model is S_n = S + ω_n Σ_{i<k} β_i n^{−i} with the remainder estimate
/// ω_n = n ΔS_{n−1}; here k = 6, as the oldest term serves only to give ω.
/// Dividing by ω_n and taking the divided difference of order k with respect to
/// t = 1/n removes the sum, and leaves S as a quotient (the W-algorithm: Sidi
/// 2003, section 7.2):
///
/// T = δ^k(S_n / ω_n) / δ^k(1 / ω_n).
///
/// For consecutive terms this is Levin's formula with weights n^{k−1}. Sample counts are
/// read: for steps longer than one, ΔS_{n−1} becomes the mean step (S_n − S_m)/(n − m), as
/// in Sidi's d^{(1)}-transformation, but that one takes the last single step. Steps should
/// be equal; where they vary, ω_n is not a smooth function of n, and T gains little.
#[derive(Clone, Copy, Debug, Default)]
pub struct LevinU;

impl Extrapolation for LevinU {
    fn terms(&self) -> usize {
        8
    }

    fn limits(&self, counts: &[f64], terms: &mut [Tile]) -> Tile {
        let order = terms.len() - 2;
        let last = terms[terms.len() - 1];
        // Rows j = 0 … k stand for the terms 1 … k + 1. The last term is subtracted from
        // each S_n and added at the end: its digits would cancel in the quotient.
        let mut numerator = [[0.0; WIDTH]; MAX_TERMS];
        let mut denominator = [[0.0; WIDTH]; MAX_TERMS];
        for j in 0..=order {
            let scale = (counts[j + 1] - counts[j]) / counts[j + 1];
            for lane in 0..WIDTH {
                let inverse = scale / difference(terms[j + 1][lane], terms[j][lane]);
                numerator[j][lane] = (terms[j + 1][lane] - last[lane]) * inverse;
                denominator[j][lane] = inverse;
            }
        }
        for p in 1..=order {
            for j in 0..=order - p {
                let scale = 1.0 / (1.0 / counts[j + p + 1] - 1.0 / counts[j + 1]);
                for lane in 0..WIDTH {
                    let step = numerator[j + 1][lane] - numerator[j][lane];
                    numerator[j][lane] = step * scale;
                    let step = difference(denominator[j + 1][lane], denominator[j][lane]);
                    denominator[j][lane] = step * scale;
                }
            }
        }
        std::array::from_fn(|lane| {
            let limit = last[lane] + numerator[0][lane] / denominator[0][lane];
            if limit.is_finite() { limit } else { f64::NAN }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// For S_n = Σ 1/i², n a_n (β_0 + β_1/n + …) is the true form of the remainder.
    #[test]
    fn zeta_2_with_equal_and_unequal_steps() {
        let zeta = std::f64::consts::PI.powi(2) / 6.0;
        let sum = |n: u32| (1..=n).map(|i| f64::from(i).powi(-2)).sum::<f64>();
        let error = |counts: [u32; 8]| {
            let terms = counts.map(sum);
            let last = zeta - terms[7];
            (LevinU.limit(&counts, &terms).unwrap_or(f64::NAN) - zeta).abs() / last
        };
        let consecutive = error([1, 2, 3, 4, 5, 6, 7, 8]);
        let equal = error([3, 6, 9, 12, 15, 18, 21, 24]);
        assert!(consecutive < 1e-4 && equal < 1e-4, "{consecutive} {equal}");
        let unequal = error([1, 2, 3, 4, 6, 8, 10, 12]);
        assert!(unequal > 0.1, "{unequal}");
    }
}

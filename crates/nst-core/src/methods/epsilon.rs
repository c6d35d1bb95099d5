//! Wynn's ε-algorithm (Wynn 1956), the recursion for Shanks' transformation.

use super::extrapolation::{Extrapolation, MAX_TERMS, Tile, WIDTH, difference};

/// Wynn's ε-algorithm on the last seven terms:
///
/// ε_{−1}^{(j)} = 0, ε_0^{(j)} = S_j,
/// ε_{k+1}^{(j)} = ε_{k−1}^{(j+1)} + 1 / (ε_k^{(j+1)} − ε_k^{(j)}), T = ε_6^{(0)}.
///
/// Exact for S_j = S + c_1 λ_1^j + c_2 λ_2^j + c_3 λ_3^j. Does not read sample counts. If a
/// difference vanishes, T is the newest element of the last complete even column.
#[derive(Clone, Copy, Debug, Default)]
pub struct WynnEpsilon;

impl Extrapolation for WynnEpsilon {
    fn terms(&self) -> usize {
        7
    }

    fn limits(&self, _: &[f64], terms: &mut [Tile]) -> Tile {
        let count = terms.len();
        // ε_{k−1} and ε_k; the latter is kept in `terms`.
        let mut before = [[0.0; WIDTH]; MAX_TERMS];
        let mut result = [f64::NAN; WIDTH];
        let mut sound = [true; WIDTH];
        for k in 1..count {
            for j in 0..count - k {
                for lane in 0..WIDTH {
                    let step = difference(terms[j + 1][lane], terms[j][lane]);
                    sound[lane] &= step != 0.0;
                    let next = before[j + 1][lane] + 1.0 / step;
                    before[j][lane] = terms[j][lane];
                    terms[j][lane] = next;
                }
            }
            before[count - k] = terms[count - k];
            if k % 2 == 0 {
                let newest = terms[count - k - 1];
                for lane in 0..WIDTH {
                    sound[lane] &= newest[lane].is_finite();
                    result[lane] = if sound[lane] { newest[lane] } else { result[lane] };
                }
            }
        }
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_for_three_geometric_remainders() {
        let counts: Vec<u32> = (1..=7).collect();
        let remainder = |k| 0.9_f64.powi(k) - 2.0 * (-0.5_f64).powi(k) + 0.3_f64.powi(k);
        let terms: Vec<_> = (0..7).map(|k| 5.0 + remainder(k)).collect();
        let limit = WynnEpsilon.limit(&counts, &terms).unwrap_or(f64::NAN);
        // The table magnifies f64's rounding by the squares of 1/(1 − λ).
        assert!((limit - 5.0).abs() < 1e-10, "{limit}");
        // Four are one too many.
        let terms: Vec<_> = terms.iter().zip(0..).map(|(s, k)| s + 0.7_f64.powi(k)).collect();
        let limit = WynnEpsilon.limit(&counts, &terms).unwrap_or(f64::NAN);
        assert!((limit - 5.0).abs() > 1e-4, "{limit}");
    }

    #[test]
    fn a_converged_column_stands() {
        // ε_2 is exactly 2, so ε_3 would divide by zero.
        let counts: Vec<u32> = (1..=7).collect();
        let terms: Vec<_> = (0..7).map(|k| 2.0 - 0.5_f64.powi(k)).collect();
        assert_eq!(WynnEpsilon.limit(&counts, &terms), Some(2.0));
    }
}

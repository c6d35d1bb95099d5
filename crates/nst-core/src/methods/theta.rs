//! Brezinski's θ-algorithm (Brezinski 1971).

use super::extrapolation::{Extrapolation, MAX_TERMS, Tile, WIDTH, difference};

/// Brezinski's θ-algorithm on the last seven terms:
///
/// θ_{−1}^{(j)} = 0, θ_0^{(j)} = S_j,
/// θ_{2k+1}^{(j)} = θ_{2k−1}^{(j+1)} + 1 / Δθ_{2k}^{(j)},
/// θ_{2k+2}^{(j)} = θ_{2k}^{(j+1)} + Δθ_{2k}^{(j+1)} Δθ_{2k+1}^{(j+1)} / Δ²θ_{2k+1}^{(j)},
/// T = θ_4^{(0)}, where Δ acts on j.
///
/// Accelerates linear and many logarithmic sequences (Weniger 1989, section 10). It does
/// not read sample counts, and its derivation assumes equal steps. Where θ_4 breaks down, T
/// is the newest θ_2.
#[derive(Clone, Copy, Debug, Default)]
pub struct BrezinskiTheta;

impl Extrapolation for BrezinskiTheta {
    fn terms(&self) -> usize {
        7
    }

    fn limits(&self, _: &[f64], terms: &mut [Tile]) -> Tile {
        // θ_{2k} is kept in `terms`, θ_{2k−1} in `odd`.
        let mut odd = [[0.0; WIDTH]; MAX_TERMS];
        let mut result = [f64::NAN; WIDTH];
        let mut sound = [true; WIDTH];
        let mut length = terms.len();
        while length >= 4 {
            for j in 0..length - 1 {
                for lane in 0..WIDTH {
                    let step = difference(terms[j + 1][lane], terms[j][lane]);
                    sound[lane] &= step != 0.0;
                    odd[j][lane] = odd[j + 1][lane] + 1.0 / step;
                }
            }
            length -= 3;
            for j in 0..length {
                for lane in 0..WIDTH {
                    let step = terms[j + 2][lane] - terms[j + 1][lane];
                    let newer = odd[j + 2][lane] - odd[j + 1][lane];
                    let second = difference(newer, odd[j + 1][lane] - odd[j][lane]);
                    sound[lane] &= second != 0.0;
                    terms[j][lane] = terms[j + 1][lane] + step * (newer / second);
                    sound[lane] &= terms[j][lane].is_finite();
                }
            }
            for lane in 0..WIDTH {
                result[lane] = if sound[lane] { terms[length - 1][lane] } else { result[lane] };
            }
        }
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_for_geometric_and_for_logarithmic_remainders() {
        let counts: Vec<u32> = (1..=7).collect();
        let geometric: Vec<_> = (0..7).map(|k| 1.0 - 0.8_f64.powi(k)).collect();
        let logarithmic: Vec<_> = (1..=7).map(|n| 1.0 - 1.0 / (f64::from(n) + 0.3)).collect();
        for terms in [geometric, logarithmic] {
            let limit = BrezinskiTheta.limit(&counts, &terms).unwrap_or(f64::NAN);
            assert!((limit - 1.0).abs() < 1e-11, "{limit}");
        }
        let alternating: Vec<_> = (1..=7).map(|n| (-1.0_f64).powi(n) / f64::from(n)).collect();
        let limit = BrezinskiTheta.limit(&counts, &alternating).unwrap_or(f64::NAN);
        assert!(limit.abs() < 1e-3 && limit.abs() > 1e-11, "{limit}");
    }
}

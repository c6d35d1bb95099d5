//! Euler's transformation of alternating series.

use super::extrapolation::{Extrapolation, Tile, WIDTH};

/// Euler's transformation of the last eight terms: the mean of neighbours, taken seven
/// times,
///
/// T = 2^{−k} Σ_j C(k, j) S_j, k = 7.
///
/// It halves a remainder (−1)^j c, and multiplies (−λ)^j by (1 − λ)/2, at each of
/// the seven steps. Linear, with positive weights that sum to 1: it cannot break
/// down, and on sequences that do not alternate it merely goes back to older
/// terms. Does not read sample counts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Euler;

impl Extrapolation for Euler {
    fn terms(&self) -> usize {
        8
    }

    fn limits(&self, _: &[f64], terms: &mut [Tile]) -> Tile {
        for length in (1..terms.len()).rev() {
            for j in 0..length {
                for lane in 0..WIDTH {
                    terms[j][lane] = 0.5 * terms[j][lane] + 0.5 * terms[j + 1][lane];
                }
            }
        }
        terms[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn binomial_weights() {
        let counts: Vec<u32> = (1..=8).collect();
        for (j, binomial) in [1, 7, 21, 35, 35, 21, 7, 1].into_iter().enumerate() {
            let mut terms = [0.0; 8];
            terms[j] = 128.0;
            assert_eq!(Euler.limit(&counts, &terms), Some(f64::from(binomial)));
        }
    }
}

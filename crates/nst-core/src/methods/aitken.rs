//! Aitken's Δ² (Aitken 1926), once and iterated.

use super::extrapolation::{Extrapolation, Tile, WIDTH, difference};

/// Aitken's Δ² of the last three terms:
///
/// T = S_{k+2} − (ΔS_{k+1})² / Δ²S_k.
///
/// Exact for S_k = S + c λ^k with λ ≠ 1, linear convergence *in the index*: it
/// does not read sample counts. Equal steps suit sequences that converge
/// linearly; counts that double would make a remainder c/n linear.
#[derive(Clone, Copy, Debug, Default)]
pub struct Aitken;

impl Extrapolation for Aitken {
    fn terms(&self) -> usize {
        3
    }

    fn limits(&self, _: &[f64], terms: &mut [Tile]) -> Tile {
        std::array::from_fn(|lane| aitken(terms[0][lane], terms[1][lane], terms[2][lane]))
    }
}

/// Aitken's Δ² applied to its own results, three times: 7 terms → 5 → 3 → 1 (Weniger 1989,
/// section 5.1). Where a later iteration has a vanishing denominator, usually because the
/// one before has converged, T is the result of the one before.
#[derive(Clone, Copy, Debug, Default)]
pub struct IteratedAitken;

impl Extrapolation for IteratedAitken {
    fn terms(&self) -> usize {
        7
    }

    fn limits(&self, _: &[f64], terms: &mut [Tile]) -> Tile {
        let mut result = [f64::NAN; WIDTH];
        let mut sound = [true; WIDTH];
        let mut length = terms.len();
        while length >= 3 {
            length -= 2;
            for j in 0..length {
                for lane in 0..WIDTH {
                    let limit = aitken(terms[j][lane], terms[j + 1][lane], terms[j + 2][lane]);
                    terms[j][lane] = limit;
                    sound[lane] &= limit.is_finite();
                }
            }
            for lane in 0..WIDTH {
                result[lane] = if sound[lane] { terms[length - 1][lane] } else { result[lane] };
            }
        }
        result
    }
}

#[inline(always)]
fn aitken(a: f64, b: f64, c: f64) -> f64 {
    let denominator = difference(c - b, b - a);
    // Divided first, as the square may overflow.
    let limit = c - (c - b) * ((c - b) / denominator);
    if denominator == 0.0 { f64::NAN } else { limit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_for_one_and_for_two_geometric_remainders() {
        let counts: Vec<u32> = (1..=7).collect();
        let one: Vec<_> = (0..7).map(|k| 3.0 - 2.0 * 0.7_f64.powi(k)).collect();
        assert!((Aitken.limit(&counts, &one).unwrap_or(0.0) - 3.0).abs() < 1e-13);
        assert!((IteratedAitken.limit(&counts, &one).unwrap_or(0.0) - 3.0).abs() < 1e-13);
        // Two remainders: once is not enough, iterating helps.
        let two: Vec<_> = one.iter().zip(0..).map(|(s, k)| s + 0.2_f64.powi(k)).collect();
        let error = |limit: Option<f64>| (limit.unwrap_or(f64::NAN) - 3.0).abs();
        let (once, iterated) =
            (error(Aitken.limit(&counts, &two)), error(IteratedAitken.limit(&counts, &two)));
        assert!(iterated < 0.5 * once, "{once} {iterated}");
    }
}

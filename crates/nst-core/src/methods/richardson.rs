//! Richardson's extrapolation (Richardson 1911) to 1/n = 0.

use super::extrapolation::{Extrapolation, Tile, WIDTH};

/// Richardson's extrapolation: the value at x = 0 of the cubic in x = 1/n through
/// the last four terms, by Neville's scheme,
///
/// T_j^{(k)} = T_{j+1}^{(k−1)} + (T_{j+1}^{(k−1)} − T_j^{(k−1)}) n_j / (n_{j+k} − n_j).
///
/// Exact for S_n = S + c_1/n + c_2/n² + c_3/n³. Reads the sample counts, which
/// may have any steps. The weights of the terms grow as n³, and so do rounding
/// and noise; further terms would gain nothing in f32.
#[derive(Clone, Copy, Debug, Default)]
pub struct Richardson;

impl Extrapolation for Richardson {
    fn terms(&self) -> usize {
        4
    }

    fn limits(&self, counts: &[f64], terms: &mut [Tile]) -> Tile {
        for k in 1..terms.len() {
            for j in 0..terms.len() - k {
                let factor = counts[j] / (counts[j + k] - counts[j]);
                for lane in 0..WIDTH {
                    let (older, newer) = (terms[j][lane], terms[j + 1][lane]);
                    terms[j][lane] = newer + (newer - older) * factor;
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
    fn exact_for_cubics_with_any_steps() {
        for counts in [[5, 6, 7, 8], [2, 4, 8, 16], [3, 10, 11, 40]] {
            let cubic = |n: u32| {
                let x = 1.0 / f64::from(n);
                4.0 + x - 2.0 * x * x + 3.0 * x * x * x
            };
            let terms = counts.map(cubic);
            let limit = Richardson.limit(&counts, &terms).unwrap_or(f64::NAN);
            assert!((limit - 4.0).abs() < 1e-11, "{counts:?}: {limit}");
            // Read as consecutive, the terms of other steps mislead.
            let limit = Richardson.limit(&[1, 2, 3, 4], &terms).unwrap_or(f64::NAN);
            assert!((limit - 4.0).abs() > 1e-6, "{counts:?}: {limit}");
        }
    }
}

//! The a_n g_n transformation (Brezinski and Redivo Zaglia 1991).

use super::extrapolation::{Extrapolation, Tile};

/// The a_n g_n transformation of the last two terms, equation 2 of *Neural
/// Sequence Transformation*:
///
/// T = S_n − (S_m − S_n) g_n / (g_m − g_n), where m > n is the last sample count.
///
/// Exact for S_n = S + c g_n. On means of independent samples it raises the
/// variance, by 1 + (g_m / (g_m − g_n))²/n for m = n + 1 (Proposition 2 there),
/// whatever g is. Reads the sample counts.
#[derive(Clone, Copy, Debug)]
pub struct AnGn(
    /// The sequence g_n.
    pub Scale,
);

/// A sequence g_n.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// 1/n. For consecutive terms, T is then the very last sample.
    Inverse,
    /// 1/n².
    InverseSquare,
    /// 2^{−n}: T = 2 S_{n+1} − S_n.
    Geometric,
}

impl Scale {
    /// g_m / g_n.
    fn ratio(self, n: f64, m: f64) -> f64 {
        match self {
            Self::Inverse => n / m,
            Self::InverseSquare => (n / m) * (n / m),
            Self::Geometric => (n - m).exp2(),
        }
    }
}

impl Extrapolation for AnGn {
    fn terms(&self) -> usize {
        2
    }

    fn limits(&self, counts: &[f64], terms: &mut [Tile]) -> Tile {
        let ratio = self.0.ratio(counts[0], counts[1]);
        let factor = 1.0 / (1.0 - ratio);
        std::array::from_fn(|lane| terms[0][lane] + (terms[1][lane] - terms[0][lane]) * factor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCALES: [Scale; 3] = [Scale::Inverse, Scale::InverseSquare, Scale::Geometric];

    #[test]
    fn exact_for_remainders_like_g() {
        for (n, m) in [(1, 2), (6, 7), (6, 12)] {
            for scale in SCALES {
                let g = |n: u32| scale.ratio(1.0, f64::from(n));
                let terms = [2.0 + 3.0 * g(n), 2.0 + 3.0 * g(m)];
                let limit = AnGn(scale).limit(&[n, m], &terms).unwrap_or(f64::NAN);
                assert!((limit - 2.0).abs() < 1e-12, "{scale:?} {n} {m}: {limit}");
                // The right g at the wrong counts is wrong.
                let limit = AnGn(scale).limit(&[n, m + 1], &terms).unwrap_or(f64::NAN);
                assert!((limit - 2.0).abs() > 1e-9, "{scale:?} {n} {m}: {limit}");
            }
        }
    }

    #[test]
    fn one_over_n_returns_the_last_sample() {
        let samples = [3.0, 1.0, 4.0, 1.5];
        let mean = |n: usize| samples[..n].iter().sum::<f64>() / n as f64;
        let limit = AnGn(Scale::Inverse).limit(&[3, 4], &[mean(3), mean(4)]);
        assert!((limit.unwrap_or(f64::NAN) - 1.5).abs() < 1e-14);
    }
}

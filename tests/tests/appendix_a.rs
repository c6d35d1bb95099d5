//! A numerical companion to Appendix A of *Neural Sequence Transformation*: its
//! ratios of expectations, measured on uniform samples.
//!
//! For samples Y_i with mean I and variance 1 per sample, S_n their mean:
//!
//! - Proposition 1: E(S_{n+1} − I)² / E(S_n − I)² = n/(n + 1), and
//!   E(S_{n+1} − S_n)² / E(S_n − S_{n−1})² = (n − 1)/(n + 1). The paper prints
//!   (n + 1)(n − 1)/n² for the second; the limit, 1, is the same.
//! - Proposition 2: Var T_{n+1} / Var S_{n+1} = 1 + (g_{n+1}/(g_{n+1} − g_n))²/n
//!   for the a_n g_n transformation.

use nst_core::{
    methods::{AnGn, Extrapolation, Scale},
    random::SplitMix64,
};

const RUNS: usize = 400_000;
const LAST: usize = 17;

/// S_1 … S_17 of each run, of samples uniform on [0, 1).
fn runs() -> impl Iterator<Item = [f64; LAST]> {
    let mut random = SplitMix64(7);
    (0..RUNS).map(move |_| {
        let mut sum = 0.0;
        std::array::from_fn(|i| {
            sum += random.uniform();
            sum / (i + 1) as f64
        })
    })
}

/// A ratio of two means of squares over the runs, and its standard error by the
/// delta method: Var(ā/b̄) ≈ Var(a − r b) / (runs · b̄²).
struct Ratio {
    value: f64,
    error: f64,
}

impl Ratio {
    fn of(pair: impl Fn(&[f64; LAST]) -> (f64, f64)) -> Self {
        let (mut a, mut b, mut aa, mut ab, mut bb) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for s in runs() {
            let (x, y) = pair(&s);
            let (x, y) = (x * x, y * y);
            (a, b) = (a + x, b + y);
            (aa, ab, bb) = (aa + x * x, ab + x * y, bb + y * y);
        }
        let value = a / b;
        let variance = aa - 2.0 * value * ab + value * value * bb;
        Self { value, error: variance.sqrt() / b }
    }

    /// Within 4 standard errors: 1 in 16,000 fails by chance, and seeds are fixed.
    fn is(&self, expected: f64) -> bool {
        (self.value - expected).abs() < 4.0 * self.error
    }
}

/// S_n, counted from 1.
fn s(run: &[f64; LAST], n: usize) -> f64 {
    run[n - 1]
}

#[test]
fn proposition_1() {
    for n in [2, 4, 8, 16] {
        let x = n as f64;
        let errors = Ratio::of(|run| (s(run, n + 1) - 0.5, s(run, n) - 0.5));
        assert!(errors.is(x / (x + 1.0)), "n = {n}: {} ± {}", errors.value, errors.error);
        assert!(!errors.is((x - 1.0) / (x + 1.0)), "n = {n}");

        let steps = Ratio::of(|run| (s(run, n + 1) - s(run, n), s(run, n) - s(run, n - 1)));
        assert!(steps.is((x - 1.0) / (x + 1.0)), "n = {n}: {} ± {}", steps.value, steps.error);
        let printed = (x + 1.0) * (x - 1.0) / (x * x);
        assert!(!steps.is(printed), "n = {n}: the paper's {printed} against {}", steps.value);
    }
}

#[test]
fn proposition_2() {
    type Sequence = fn(f64) -> f64;
    let g: [(Scale, Sequence); 3] = [
        (Scale::Inverse, |n| 1.0 / n),
        (Scale::InverseSquare, |n| 1.0 / (n * n)),
        (Scale::Geometric, |n| (-n).exp2()),
    ];
    for n in [1, 4, 16] {
        let x = n as f64;
        for (scale, g) in g {
            let expected = 1.0 + (g(x + 1.0) / (g(x + 1.0) - g(x))).powi(2) / x;
            assert!(expected > 1.0);
            let counts = [n as u32, n as u32 + 1];
            let transformed = |run: &[f64; LAST]| {
                let limit = AnGn(scale).limit(&counts, &run[n - 1..=n]);
                limit.expect("it has no denominator that depends on the terms") - 0.5
            };
            let ratio = Ratio::of(|run| (transformed(run), s(run, n + 1) - 0.5));
            assert!(
                ratio.is(expected),
                "{scale:?}, n = {n}: {} ± {}, {expected}",
                ratio.value,
                ratio.error
            );
            assert!(!ratio.is(1.05 * expected), "{scale:?}, n = {n}");
        }
    }
}

//! The one-dimensional integrands of section 4.1 of the paper, on [0, 1]: those that
//! the training script holds out. It writes their table, `integrands.csv`
//! (`python -m nst_train.held_out`), so that both sides have the same numbers.

use std::sync::LazyLock;

use serde::Deserialize;

/// An integrand `h N(x; μ, σ) 1[x < t]`, or `h 1[x < t]` without μ and σ.
#[derive(Clone, Copy, Debug, Deserialize)]
pub(super) struct Integrand {
    family: Family,
    mean: Option<f64>,
    deviation: Option<f64>,
    /// t, in (0, 1].
    edge: f64,
    height: f64,
    /// I.
    integral: f64,
}

/// The kinds of integrands, in the order of the paper.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Family {
    Gaussian,
    Step,
    GaussianStep,
}

/// The number of integrands of a family.
pub(super) const COUNT: usize = 9;

const TABLE: &str = include_str!("integrands.csv");

/// All rows of the table.
static INTEGRANDS: LazyLock<Vec<Integrand>> = LazyLock::new(|| {
    let rows = csv::Reader::from_reader(TABLE.as_bytes()).into_deserialize();
    rows.collect::<Result<_, _>>().expect("the table is part of the program, and tests read it")
});

impl Family {
    /// The integrand of an index below [`COUNT`].
    pub(super) fn integrand(self, index: usize) -> Integrand {
        let mut own = INTEGRANDS.iter().filter(|integrand| integrand.family == self);
        *own.nth(index).expect("the table has COUNT integrands of each family")
    }
}

impl Integrand {
    /// f(x) for x in [0, 1).
    pub(super) fn at(&self, x: f64) -> f64 {
        if x >= self.edge {
            return 0.0;
        }
        let (Some(mean), Some(deviation)) = (self.mean, self.deviation) else {
            return self.height;
        };
        let z = (x - mean) / deviation;
        self.height * (-0.5 * z * z).exp() / (deviation * std::f64::consts::TAU.sqrt())
    }

    /// ∫ f.
    pub(super) fn integral(&self) -> f64 {
        self.integral
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Simpson's rule on the support of f, where f is smooth. Its error is
    /// h⁴/180 · t · max |f''''| ≤ (1/2000)⁴/180 · 3/(√(2π) 0.15⁵) = 6e-12.
    fn quadrature(f: impl Fn(f64) -> f64, edge: f64) -> f64 {
        const INTERVALS: u32 = 2000;
        let step = edge / f64::from(INTERVALS);
        // Just inside of the support's end, where f is still its smooth self.
        let inside = edge * (1.0 - f64::EPSILON);
        let weighted = |i: u32| {
            let weight = [2.0, 4.0][i as usize % 2];
            let weight = if i == 0 || i == INTERVALS { 1.0 } else { weight };
            weight * f((f64::from(i) * step).min(inside))
        };
        (0..=INTERVALS).map(weighted).sum::<f64>() * step / 3.0
    }

    #[test]
    fn integrals_are_those_of_the_training_script() {
        assert_eq!(INTEGRANDS.len(), 3 * COUNT);
        for family in [Family::Gaussian, Family::Step, Family::GaussianStep] {
            for index in 0..COUNT {
                let f = family.integrand(index);
                let error = (quadrature(|x| f.at(x), f.edge) - f.integral()).abs();
                assert!(error < 1e-11, "{family:?} {index}: {error}");
            }
        }
        // An edge or a deviation that is a thousandth too large would be seen.
        let f = Family::GaussianStep.integrand(0);
        for wrong in [
            Integrand { edge: 1.001 * f.edge, ..f },
            Integrand { deviation: f.deviation.map(|deviation| 1.001 * deviation), ..f },
        ] {
            assert!((quadrature(|x| wrong.at(x), wrong.edge) - f.integral()).abs() > 1e-6);
        }
    }

    /// The cells `values` of the table: f at the midpoints of sixteen equal cells.
    #[test]
    fn values_are_those_of_the_training_script() {
        let mut reader = csv::Reader::from_reader(TABLE.as_bytes());
        let rows = reader.records().collect::<Result<Vec<_>, _>>().expect("a table");
        for (row, f) in rows.iter().zip(INTEGRANDS.iter()) {
            let values: Vec<f64> =
                row[row.len() - 1].split(' ').map(|y| y.parse().expect("f")).collect();
            assert_eq!(values.len(), 16);
            for (i, value) in values.into_iter().enumerate() {
                // Exponents are up to 20, after a few roundings of 1.1e-16 each.
                let ours = f.at((i as f64 + 0.5) / 16.0);
                assert!((ours - value).abs() <= 2e-14 * value, "{f:?}, {i}: {ours}, not {value}");
            }
        }
    }
}

//! The one-dimensional integrands of section 4.1 of the paper, on [0, 1].

use super::simulate::Rng;

/// An integrand h N(x; μ, σ) 1[x < t], or h 1[x < t] where σ is infinite.
#[derive(Clone, Copy)]
pub(super) struct Integrand {
    mean: f64,
    deviation: f64,
    threshold: f64,
    height: f64,
}

/// The kinds of integrands, in the order of the paper.
#[derive(Clone, Copy)]
pub(super) enum Family {
    Gaussian,
    Step,
    GaussianStep,
}

/// Positions between the ends of a parameter's range, three of each; those of the
/// training script's held-out integrands.
const POSITIONS: [f64; 3] = [0.5 / 8.0, 3.5 / 8.0, 6.5 / 8.0];

/// The number of integrands of a family.
pub(super) const COUNT: usize = POSITIONS.len() * POSITIONS.len();

impl Family {
    /// The integrand of an index below [`COUNT`].
    pub(super) fn integrand(self, index: usize) -> Integrand {
        let (u, v) = (POSITIONS[index / 3], POSITIONS[index % 3]);
        let at = |position: f64, from: f64, to: f64| from + position * (to - from);
        let (mean, deviation) = (at(u, 0.1, 0.3), at(v, 0.1, 0.3));
        match self {
            Self::Gaussian => Integrand { mean, deviation, threshold: 1.0, height: 1.0 },
            Self::Step => Integrand {
                mean: 0.0,
                deviation: f64::INFINITY,
                threshold: at(u, 0.1, 0.9),
                height: at(v, 0.5, 2.0),
            },
            Self::GaussianStep => {
                let threshold = at(Rng::new(1, index as u64).uniform(), 0.1, 0.9);
                Integrand { mean, deviation, threshold, height: 1.0 }
            }
        }
    }
}

impl Integrand {
    /// f(x) for x in [0, 1).
    pub(super) fn at(&self, x: f64) -> f64 {
        if x >= self.threshold {
            0.0
        } else if self.deviation.is_infinite() {
            self.height
        } else {
            let z = (x - self.mean) / self.deviation;
            let norm = self.deviation * std::f64::consts::TAU.sqrt();
            self.height * (-0.5 * z * z).exp() / norm
        }
    }

    /// ∫ f, by Simpson's rule on the support of f, where f is smooth: exact to 1e-12.
    pub(super) fn integral(&self) -> f64 {
        const INTERVALS: u32 = 2000;
        let step = self.threshold / f64::from(INTERVALS);
        // Just inside of the support's end, where f is still its smooth self.
        let inside = self.threshold * (1.0 - f64::EPSILON);
        let weighted = |i: u32| {
            let weight = [2.0, 4.0][i as usize % 2];
            let weight = if i == 0 || i == INTERVALS { 1.0 } else { weight };
            weight * self.at((f64::from(i) * step).min(inside))
        };
        (0..=INTERVALS).map(weighted).sum::<f64>() * step / 3.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrals() {
        // Φ((1 − μ)/σ) − Φ(−μ/σ) for μ = σ = 0.1125, from a table of erf.
        let gaussian = Family::Gaussian.integrand(0).integral();
        assert!((gaussian - 0.841_344_746_068_543).abs() < 1e-11, "{gaussian}");
        let step = Family::Step.integrand(4);
        assert!((step.integral() - 0.45 * 1.15625).abs() < 1e-12, "{}", step.integral());
        for index in 0..COUNT {
            let both = Family::GaussianStep.integrand(index).integral();
            assert!(both > 0.0 && both <= Family::Gaussian.integrand(index).integral() + 1e-12);
        }
    }
}

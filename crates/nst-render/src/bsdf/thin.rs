//! A thin pane of a medium that does not absorb. Light that enters is reflected to and fro
//! between the two sides; with R reflected by one of them, all reflections add up to
//! R + (1 − R)² R + (1 − R)² R³ + … = 2R / (1 + R), and what passes, to (1 − R) / (1 + R).

use glam::Vec3A;

use super::{dielectric::fresnel, sample::BsdfSample};

/// The pane; both sides are alike.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ThinDielectric {
    /// Index of refraction of the medium relative to what is around it, above 0.
    eta: f32,
}

impl ThinDielectric {
    pub(crate) fn new(eta: f32) -> Self {
        Self { eta }
    }

    /// Reflects with probability 2R / (1 + R), and goes straight on otherwise. Both weights
    /// are 1: radiance that leaves the medium again is as dense as it was before.
    #[inline]
    pub(super) fn sample(&self, wo: Vec3A, u: f32) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let one_side = fresnel(wo.z.abs(), self.eta).0;
        let reflectance = 2.0 * one_side / (1.0 + one_side);
        let wi = if u < reflectance { Vec3A::new(-wo.x, -wo.y, wo.z) } else { -wo };
        Some(BsdfSample { wi, weight: Vec3A::ONE, pdf: 0.0, delta: true })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::test_data::polar;

    /// What a pane reflects in all, in f64: photons that are followed from side to side, with
    /// Fresnel's equations by angles.
    fn followed(theta: f64, eta: f64) -> f64 {
        let inner = (theta.sin() / eta).asin();
        let (sum, difference) = (theta + inner, theta - inner);
        let one =
            ((difference.sin() / sum.sin()).powi(2) + (difference.tan() / sum.tan()).powi(2)) / 2.0;
        let (mut reflected, mut inside) = (one, 1.0 - one);
        // At the far side, then at the near one, where light comes out again.
        for _ in 0..10_000 {
            inside *= one;
            reflected += inside * (1.0 - one);
            inside *= one;
        }
        reflected
    }

    /// Of many equally spaced numbers, the share that is reflected; all of it is reflected as in
    /// a mirror, or passes straight. Tolerance: the spacing, and rounding of Fresnel's equations
    /// in f32.
    #[test]
    fn reflects_what_all_inner_reflections_add_up_to() {
        const COUNT: u32 = 1 << 16;
        for ior in [1.1, 1.33, 1.5, 2.4_f32] {
            let pane = ThinDielectric::new(ior);
            for (theta, side) in [(1.0, 1.0), (30.0, -1.0), (60.0, 1.0), (85.0, -1.0_f32)] {
                let wo = polar(theta, 70.0) * Vec3A::new(1.0, 1.0, side);
                let mut reflected = 0;
                for i in 0..COUNT {
                    let sample = pane.sample(wo, i as f32 / COUNT as f32).expect("a direction");
                    assert!(sample.delta && sample.weight == Vec3A::ONE);
                    if sample.wi == -wo {
                        continue;
                    }
                    assert_eq!(sample.wi, Vec3A::new(-wo.x, -wo.y, wo.z));
                    reflected += 1;
                }
                let share = f64::from(reflected) / f64::from(COUNT);
                let theta = f64::from(theta).to_radians();
                let expected = followed(theta, f64::from(ior));
                assert!((share - expected).abs() < 5e-5, "{ior}, {theta}: {share} {expected}");
                // One side alone reflects less.
                let one = f64::from(fresnel(wo.z.abs(), ior).0);
                assert!((share - one).abs() > 5e-5, "{ior}, {theta}");
            }
        }
        assert!(ThinDielectric::new(1.5).sample(Vec3A::X, 0.5).is_none());
    }
}

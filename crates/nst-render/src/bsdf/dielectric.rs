//! A smooth boundary between two media that do not absorb: mirror reflection or
//! refraction, by chance in proportion to Fresnel's equations.

use glam::Vec3A;

use super::sample::BsdfSample;

/// The boundary; z points out of the inner medium.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dielectric {
    /// Index of refraction of the inner medium relative to the outer one, above 0.
    eta: f32,
}

impl Dielectric {
    pub(crate) fn new(eta: f32) -> Self {
        Self { eta }
    }

    /// Reflects with probability F, refracts with 1 − F.
    ///
    /// What is sampled is radiance, which is denser by η² where the index is
    /// higher by η: a refraction's weight is the square of the index on the side
    /// of `wo` divided by that on the side of `wi`, which may exceed 1.
    #[inline]
    pub(super) fn sample(&self, wo: Vec3A, u: f32) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        // The index on the side of a refracted `wi`, relative to that on the side of `wo`.
        let eta = if wo.z > 0.0 { self.eta } else { 1.0 / self.eta };
        let (reflectance, cos_t) = fresnel(wo.z.abs(), eta);
        let (wi, weight) = if u < reflectance {
            (Vec3A::new(-wo.x, -wo.y, wo.z), 1.0)
        } else {
            let wi = Vec3A::new(-wo.x / eta, -wo.y / eta, cos_t.copysign(-wo.z));
            (wi.normalize(), 1.0 / (eta * eta))
        };
        Some(BsdfSample { wi, weight: Vec3A::splat(weight), pdf: 0.0, delta: true })
    }
}

/// The fraction of unpolarised light that a smooth boundary reflects, and the
/// cosine of the refracted ray (0 where all is reflected). `cos_theta` is within
/// 0 and 1; `eta` is the index beyond the boundary relative to this side.
#[inline]
pub(super) fn fresnel(cos_theta: f32, eta: f32) -> (f32, f32) {
    let cos2_t = 1.0 - (1.0 - cos_theta * cos_theta) / (eta * eta);
    if cos2_t <= 0.0 {
        return (1.0, 0.0);
    }
    let cos_t = cos2_t.sqrt();
    let perpendicular = (cos_theta - eta * cos_t) / (cos_theta + eta * cos_t);
    let parallel = (cos_t - eta * cos_theta) / (cos_t + eta * cos_theta);
    ((perpendicular * perpendicular + parallel * parallel) / 2.0, cos_t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::test_data::polar;

    const INDICES: [f32; 4] = [1.0, 1.33, 1.5, 2.4];

    /// The two outcomes of `sample`, with the probability of the first, found by bisection.
    fn outcomes(boundary: Dielectric, wo: Vec3A) -> (BsdfSample, BsdfSample, f64) {
        let at = |u| boundary.sample(wo, u).expect("wo is not in the surface");
        let (mut low, mut high) = (0.0_f32, 1.0_f32);
        while high - low > 1e-7 {
            let middle = (low + high) / 2.0;
            let reflected = at(middle).wi.z * wo.z > 0.0;
            *if reflected { &mut low } else { &mut high } = middle;
        }
        (at(0.0), at(0.999_999_9), f64::from(low))
    }

    /// Fresnel's equations in f64, by the angles: sin(i − t) / sin(i + t) and tan(i − t) / tan(i + t).
    fn fresnel_by_angles(theta: f64, eta: f64) -> f64 {
        let sin_t = theta.sin() / eta;
        if sin_t >= 1.0 {
            return 1.0;
        }
        let (sum, difference) = (theta + sin_t.asin(), theta - sin_t.asin());
        ((difference.sin() / sum.sin()).powi(2) + (difference.tan() / sum.tan()).powi(2)) / 2.0
    }

    /// Tolerance: f32 cancellation in the amplitudes.
    #[test]
    fn fresnel_equals_the_equations_by_angles() {
        for eta in [1.0 / 2.4, 1.0 / 1.5, 1.02, 1.33, 1.5, 2.4_f32] {
            for theta in (1..90).map(|degrees| f64::from(degrees).to_radians()) {
                let ours = f64::from(fresnel(theta.cos() as f32, eta).0);
                let expected = fresnel_by_angles(theta, f64::from(eta));
                assert!(
                    (ours - expected).abs() < 2e-5,
                    "η = {eta}, θ = {theta}: {ours} {expected}"
                );
                let wrong = fresnel_by_angles(theta, f64::from(eta) * 1.1);
                let near_total = expected > 0.99 || wrong > 0.99;
                assert!(near_total || (ours - wrong).abs() > 2e-5);
            }
            let at_normal = ((eta - 1.0) / (eta + 1.0)).powi(2);
            assert!((fresnel(1.0, eta).0 - at_normal).abs() < 1e-6);
            assert!((fresnel(0.0, eta).0 - 1.0).abs() < 1e-6);
        }
        assert!(fresnel(0.3, 1.0).0 < 1e-12);
    }

    /// Weight × probability, without the change of radiance by η², sums to 1;
    /// sines obey Snell's law, from both sides.
    #[test]
    fn energy_is_conserved_and_snell_obeyed() {
        for ior in INDICES {
            for (theta, phi) in [(0.5, 0.0), (30.0, 100.0), (60.0, 200.0), (85.0, 300.0)] {
                for side in [1.0, -1.0] {
                    let wo = polar(theta, phi) * Vec3A::new(1.0, 1.0, side);
                    let eta = if side > 0.0 { ior } else { 1.0 / ior };
                    let (reflected, refracted, probability) = outcomes(Dielectric::new(ior), wo);
                    if reflected.wi.z * wo.z > 0.0 {
                        assert_eq!(reflected.wi, Vec3A::new(-wo.x, -wo.y, wo.z));
                        assert_eq!(reflected.weight, Vec3A::ONE);
                    }
                    let sin_o = f64::from(wo.x).hypot(f64::from(wo.y));
                    if sin_o / f64::from(eta) >= 1.0 {
                        assert_eq!(refracted.wi, reflected.wi, "total internal reflection");
                        continue;
                    }
                    let wi = refracted.wi;
                    assert!(wi.is_normalized() && wi.z * wo.z < 0.0);
                    let sin_i = f64::from(wi.x).hypot(f64::from(wi.y));
                    assert!((sin_i * f64::from(eta) - sin_o).abs() < 1e-5);
                    // In one plane, on opposite sides of the normal.
                    assert!((wo.x * wi.y - wo.y * wi.x).abs() < 1e-6);
                    assert!(wo.x * wi.x + wo.y * wi.y <= 0.0);
                    let transmitted = f64::from(refracted.weight.x * eta * eta);
                    let total = probability + (1.0 - probability) * transmitted;
                    assert!((total - 1.0).abs() < 1e-5, "{total}");
                    let expected = fresnel_by_angles(sin_o.asin(), f64::from(eta));
                    assert!((probability - expected).abs() < 2e-5, "{probability} {expected}");
                }
            }
        }
    }

    /// Back along the same path, radiance changes by the inverse factor.
    #[test]
    fn a_reversed_path_has_the_inverse_weight() {
        for ior in INDICES {
            let boundary = Dielectric::new(ior);
            let wo = polar(50.0, 20.0);
            let there = boundary.sample(wo, 0.999).expect("refraction");
            let back = boundary.sample(there.wi, 0.999).expect("refraction");
            assert!(back.wi.abs_diff_eq(wo, 1e-5), "{} {wo}", back.wi);
            assert!((there.weight.x * back.weight.x - 1.0).abs() < 1e-6);
            assert!((there.weight.x - 1.0 / (ior * ior)).abs() < 1e-6);
            assert!(there.delta && back.delta);
        }
        assert!(Dielectric::new(1.5).sample(Vec3A::X, 0.5).is_none());
    }
}

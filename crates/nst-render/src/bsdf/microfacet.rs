//! Distributions of microfacet normals: GGX and GTR1.
//!
//! Both give the same for `h` and −`h`, so that callers may be on either side of the
//! surface.
//!
//! - Walter, Marschner, Li, Torrance: Microfacet Models for Refraction through
//!   Rough Surfaces, 2007 (GGX, Smith's masking).
//! - Heitz: Sampling the GGX Distribution of Visible Normals, 2018; with the
//!   spherical caps of Dupuy, Benyoub: Sampling Visible GGX Normals, 2023.
//! - Burley: Physically Based Shading at Disney, 2012 (GTR1).

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3A};

/// The distribution of Trowbridge and Reitz, anisotropic.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ggx {
    alpha: Vec2,
}

impl Ggx {
    /// Widths along x and y, above 0.
    pub(super) fn new(alpha: Vec2) -> Self {
        Self { alpha }
    }

    /// Density of microfacet area: ∫ D |cos θh| dω = 1 over a hemisphere.
    #[inline]
    pub(super) fn density(self, h: Vec3A) -> f32 {
        let slope = Vec2::new(h.x, h.y) / self.alpha;
        let sum = slope.length_squared() + h.z * h.z;
        1.0 / (PI * self.alpha.x * self.alpha.y * sum * sum)
    }

    /// The fraction of microfacets that are visible from `w`, over 2 |cos θ|:
    /// Smith's G1 / (2 |cos θ|), which is finite at grazing angles.
    #[inline]
    pub(super) fn visibility(self, w: Vec3A) -> f32 {
        let stretched = self.alpha * Vec2::new(w.x, w.y);
        1.0 / (w.z.abs() + (w.z * w.z + stretched.length_squared()).sqrt())
    }

    /// Draws a normal that is visible from `wo`, which is above the surface, with
    /// density G1(wo) D(h) (wo·h)⁺ / cos θo with respect to solid angle of `h`.
    #[inline]
    pub(super) fn sample_visible(self, wo: Vec3A, u2: Vec2) -> Vec3A {
        let stretch = Vec3A::from(self.alpha.extend(1.0));
        let from = (wo * stretch).normalize();
        // A uniform point of the cap that a sphere shows to light from above, after
        // a mirror reflection of `from`.
        let z = (1.0 - u2.y) * (1.0 + from.z) - from.z;
        let radius = (1.0 - z * z).max(0.0).sqrt();
        let (sin_phi, cos_phi) = (TAU * u2.x).sin_cos();
        let cap = Vec3A::new(radius * cos_phi, radius * sin_phi, z);
        ((cap + from) * stretch).normalize_or(Vec3A::Z)
    }
}

/// Generalised Trowbridge–Reitz with exponent 1, isotropic: long tails.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gtr1 {
    alpha2: f32,
    /// (1 − α²) / (−π ln α²).
    normalization: f32,
}

impl Gtr1 {
    /// A width within 0 and 1, both exclusive.
    pub(super) fn new(alpha: f32) -> Self {
        let alpha2 = alpha * alpha;
        Self { alpha2, normalization: (1.0 - alpha2) / (-PI * alpha2.ln()) }
    }

    /// Density of microfacet area: ∫ D |cos θh| dω = 1 over a hemisphere.
    #[inline]
    pub(super) fn density(self, h: Vec3A) -> f32 {
        // 1 + (α² − 1) cos² θ, without its cancellation near the normal.
        self.normalization / (h.x * h.x + h.y * h.y + self.alpha2 * h.z * h.z)
    }

    /// Draws a normal with density D(h) cos θh with respect to solid angle.
    #[inline]
    pub(super) fn sample(self, u2: Vec2) -> Vec3A {
        // cos² θ = (1 − α^(2−2u)) / (1 − α²), as a sine, exact near the normal.
        let sin2 = self.alpha2 * (-u2.y * self.alpha2.ln()).exp_m1() / (1.0 - self.alpha2);
        let sin = sin2.clamp(0.0, 1.0).sqrt();
        let (sin_phi, cos_phi) = (TAU * u2.x).sin_cos();
        Vec3A::new(sin * cos_phi, sin * sin_phi, (1.0 - sin2).max(0.0).sqrt())
    }
}

/// Smith's G1 of isotropic GGX with the given α².
#[inline]
pub(super) fn smith_g1(alpha2: f32, cos_theta: f32) -> f32 {
    let cos2 = cos_theta * cos_theta;
    2.0 * cos_theta / (cos_theta + (cos2 + alpha2 * (1.0 - cos2)).sqrt())
}

/// `w`, mirrored in the plane perpendicular to `h`.
#[inline]
pub(super) fn reflect(w: Vec3A, h: Vec3A) -> Vec3A {
    h * (2.0 * w.dot(h)) - w
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::{
        chi2::{Lens, QUADRATURE_ERROR, assert_follows, follows},
        test_data::{polar, random},
    };

    const COUNT: u32 = 20_000;

    fn visible_pdf(ggx: Ggx, wo: Vec3A, h: Vec3A) -> f32 {
        let facing = if h.z > 0.0 { wo.dot(h).max(0.0) } else { 0.0 };
        2.0 * ggx.visibility(wo) * ggx.density(h) * facing
    }

    #[test]
    fn visible_normals_follow_their_density() {
        for alpha in [Vec2::splat(0.001), Vec2::new(0.05, 0.2), Vec2::splat(0.5), Vec2::ONE] {
            for theta in [0.0_f32, 40.0, 85.0, 89.9] {
                let (ggx, wo) = (Ggx::new(alpha), polar(theta, 25.0));
                let mut stream = random(4);
                let samples: Vec<_> =
                    (0..COUNT).map(|_| Some(ggx.sample_visible(wo, stream.next_2d()))).collect();
                let lens = Lens::normal();
                let pdf = |h| visible_pdf(ggx, wo, h);
                assert_follows(&lens, pdf, &samples, &format!("α = {alpha}, θ = {theta}°"));
                let wider = Ggx::new(alpha * 1.1);
                assert!(!follows(&lens, |h| visible_pdf(wider, wo, h), &samples));
            }
        }
    }

    #[test]
    fn gtr1_normals_follow_their_density() {
        for alpha in [0.001, 0.03, 0.1] {
            let gtr = Gtr1::new(alpha);
            let mut stream = random(5);
            let samples: Vec<_> = (0..COUNT).map(|_| Some(gtr.sample(stream.next_2d()))).collect();
            let pdf = |gtr: Gtr1| move |h: Vec3A| gtr.density(h) * h.z.max(0.0);
            let lens = Lens::normal();
            assert_follows(&lens, pdf(gtr), &samples, &format!("α = {alpha}"));
            assert!(!follows(&lens, pdf(Gtr1::new(alpha * 1.5)), &samples));
        }
    }

    /// ∫ D G1(w) (w·h)⁺ dω over the hemisphere is cos θ: what is seen of the
    /// microfacets covers as much as the surface (Heitz 2014, eq. 14).
    #[test]
    fn visible_area_is_projected_area() {
        for alpha in [Vec2::splat(0.01), Vec2::new(0.1, 0.4), Vec2::ONE] {
            for theta in [0.0_f32, 60.0, 85.0] {
                let (ggx, wo) = (Ggx::new(alpha), polar(theta, 70.0));
                let area = Lens::normal().integral(|h| visible_pdf(ggx, wo, h));
                assert!((area - 1.0).abs() < QUADRATURE_ERROR, "α = {alpha}, θ = {theta}°: {area}");
            }
        }
        assert!(
            (smith_g1(0.25, 0.5) - Ggx::new(Vec2::splat(0.5)).visibility(polar(60.0, 0.0))).abs()
                < 1e-6
        );
    }
}

//! Disney's principled BRDF (Burley: Physically Based Shading at Disney, 2012),
//! reflection only, the same on both sides, in the form that it has in Mitsuba 3's
//! `principled`. With θd the angle between a direction and the half
//! vector h, w(θ) = (1 − cos θ)⁵, c the base colour, t the same scaled to luminance 1:
//!
//! - diffuse (1 − metallic) c/π (f_diffuse + f_retro), where
//!   f_diffuse = (1 − w(θi)/2)(1 − w(θo)/2), r = 2 · roughness · cos² θd,
//!   f_retro = r (w(θi) + w(θo) + w(θi) w(θo) (r − 1));
//! - sheen (1 − metallic) · sheen · lerp(1, t, sheen_tint) w(θd);
//! - specular F D G1(wo) G1(wi) / (4 cos θo cos θi): anisotropic GGX (Walter 2007)
//!   of visible normals (Heitz 2018), where F mixes Fresnel's equations (for the
//!   untinted part of the dielectric) and Schlick's approximation (for the tinted
//!   part, from t · F0, and the metal, from c);
//! - clearcoat / 4 · Schlick(0.04) · GTR1 · G1 G1 with α = 1/4 in G1: *not* divided
//!   by 4 cos θo cos θi, which makes it weak.
//!
//! Where that reflects more light than arrives, the sum is scaled: see
//! [`super::energy`]. Unlike Mitsuba's, a metal does not turn black where
//! `specular` is 0; only the dielectric's reflection vanishes.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3A};

use super::{
    dielectric::fresnel,
    energy::EnergyScale,
    lambert::cosine_hemisphere,
    microfacet::{Ggx, Gtr1, reflect, smith_g1},
    sample::{BsdfSample, Side},
};
use crate::{Disney, color::luminance_of_mitsuba};

/// The least width of GGX, as in Burley's implementation (`disney.brdf`).
const MIN_ALPHA: f32 = 0.001;
/// Reflectance of the clearcoat at normal incidence: an index of 1.5 (Burley 2012).
const CLEARCOAT_F0: f32 = 0.04;
/// α² of the clearcoat's masking, which Burley fixes.
const CLEARCOAT_MASKING: f32 = 0.25 * 0.25;
/// The specular lobe is sampled as if it reflected this share at least: at grazing angles
/// its highlights are brighter than the estimate says.
const MIN_SPECULAR: f32 = 0.02;
/// About the share of light that full sheen reflects at angles that are neither normal nor
/// grazing; sheen is sampled with the diffuse lobe.
const SHEEN_ALBEDO: f32 = 0.15;
/// Points per lobe of [`directional_albedo`].
const ALBEDO_POINTS: u32 = 512;
/// (√5 − 1) / 2: its multiples, modulo 1, are evenly spread.
const GOLDEN_RATIO: f64 = 0.618_033_988_749_894_9;

/// What does not depend on the hit.
#[derive(Clone, Debug)]
pub(crate) struct PreparedDisney {
    roughness: f32,
    /// 1 − metallic.
    diffuse: f32,
    /// (1 − metallic) · sheen.
    sheen: f32,
    sheen_tint: f32,
    ggx: Ggx,
    /// Index of refraction.
    eta: f32,
    metallic: f32,
    /// Weight of Fresnel's equations.
    untinted: f32,
    /// Weight of the tinted dielectric, times its reflectance at normal incidence.
    tinted: f32,
    /// Schlick's part of the reflectance at grazing angles.
    schlick_grazing: f32,
    /// For the choice of a lobe, what the dielectric's part of the specular lobe
    /// reflects at normal incidence, and the whole lobe at grazing angles.
    dielectric_normal: f32,
    grazing: f32,
    gtr1: Gtr1,
    /// clearcoat / 4.
    clearcoat: f32,
    /// If the material would reflect more light than arrives.
    pub(super) energy: Option<EnergyScale>,
}

/// The BRDF at one point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DisneyBsdf<'a> {
    prepared: &'a PreparedDisney,
    /// (1 − metallic) c / π.
    diffuse: Vec3A,
    sheen: Vec3A,
    /// Schlick's part of the reflectance at normal incidence.
    schlick_normal: Vec3A,
    /// Estimates of the lobes' albedos at normal incidence.
    diffuse_albedo: f32,
    specular_albedo: f32,
}

/// What a direction is drawn from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Lobe {
    Diffuse,
    Specular,
    Clearcoat,
}

impl PreparedDisney {
    /// `colors`: colours whose convex hull contains every base colour that `at` will get.
    pub(super) fn new(parameters: &Disney, colors: impl Iterator<Item = Vec3A>) -> Self {
        let mut prepared = Self::unscaled(parameters);
        // Reflection grows with c and with t, channel by channel, and both have
        // their greatest values at corners of the hull: this reflects at least as
        // much in each channel as any colour does.
        let (color, tint) = colors.fold((0.0_f32, 0.0_f32), |(color, most), c| {
            (color.max(c.max_element()), most.max(tint(c).max_element()))
        });
        let brightest = prepared.tinted_at(Vec3A::splat(color), Vec3A::splat(tint));
        prepared.energy =
            EnergyScale::new(parameters.anisotropic > 0.0, |wo| directional_albedo(&brightest, wo));
        prepared
    }

    /// Without [`super::energy`].
    pub(super) fn unscaled(parameters: &Disney) -> Self {
        let d = parameters;
        let aspect = (1.0 - 0.9 * d.anisotropic).sqrt();
        let alpha2 = d.roughness * d.roughness;
        let alpha = Vec2::new(alpha2 / aspect, alpha2 * aspect).max(Vec2::splat(MIN_ALPHA));
        let eta = 2.0 / (1.0 - (0.08 * d.specular).sqrt()) - 1.0;
        let normal = ((eta - 1.0) / (eta + 1.0)).powi(2);
        // Without a change of index, there is no boundary.
        let dielectric = if d.specular > 0.0 { 1.0 - d.metallic } else { 0.0 };
        Self {
            roughness: d.roughness,
            diffuse: 1.0 - d.metallic,
            sheen: (1.0 - d.metallic) * d.sheen,
            sheen_tint: d.sheen_tint,
            ggx: Ggx::new(alpha),
            eta,
            metallic: d.metallic,
            untinted: dielectric * (1.0 - d.specular_tint),
            tinted: dielectric * d.specular_tint * normal,
            schlick_grazing: dielectric * d.specular_tint + d.metallic,
            dielectric_normal: dielectric * normal,
            grazing: dielectric + d.metallic,
            gtr1: Gtr1::new(0.1 + d.clearcoat_gloss * (0.001 - 0.1)),
            clearcoat: 0.25 * d.clearcoat,
            energy: None,
        }
    }

    /// The BRDF for a base colour, linear RGB.
    #[inline]
    pub(super) fn at(&self, color: Vec3A) -> DisneyBsdf<'_> {
        let tinted = self.tinted > 0.0 || self.sheen * self.sheen_tint > 0.0;
        self.tinted_at(color, if tinted { tint(color) } else { Vec3A::ONE })
    }

    #[inline]
    fn tinted_at(&self, color: Vec3A, tint: Vec3A) -> DisneyBsdf<'_> {
        let brightest = color.max_element();
        DisneyBsdf {
            prepared: self,
            diffuse: color * (self.diffuse * FRAC_1_PI),
            sheen: Vec3A::ONE.lerp(tint, self.sheen_tint) * self.sheen,
            schlick_normal: color * self.metallic + tint * self.tinted,
            diffuse_albedo: brightest * self.diffuse + SHEEN_ALBEDO * self.sheen,
            specular_albedo: self.dielectric_normal + brightest * self.metallic,
        }
    }
}

/// The colour, scaled to luminance 1; white for black.
#[inline]
fn tint(color: Vec3A) -> Vec3A {
    let luminance = luminance_of_mitsuba(color);
    if luminance > 0.0 { color / luminance } else { Vec3A::ONE }
}

/// (1 − cos θ)⁵.
#[inline]
fn schlick_weight(cos_theta: f32) -> f32 {
    let x = (1.0 - cos_theta).clamp(0.0, 1.0);
    let x2 = x * x;
    x2 * x2 * x
}

impl DisneyBsdf<'_> {
    /// The probabilities of the lobes, about in proportion to what they reflect
    /// towards `wo`; all zero if nothing is reflected.
    #[inline]
    pub(super) fn probabilities(&self, wo: Vec3A) -> [(Lobe, f32); 3] {
        let p = self.prepared;
        let diffuse = self.diffuse_albedo;
        let normal = self.specular_albedo;
        let specular = normal + (p.grazing - normal) * schlick_weight(wo.z.abs());
        let specular = specular.max(MIN_SPECULAR * p.grazing);
        // Without the division by 4 cos θo cos θi, its albedo is about clearcoat · F0.
        let clearcoat = 4.0 * p.clearcoat * CLEARCOAT_F0;
        let sum = diffuse + specular + clearcoat;
        let scale = if sum > 0.0 { 1.0 / sum } else { 0.0 };
        [
            (Lobe::Diffuse, diffuse * scale),
            (Lobe::Clearcoat, clearcoat * scale),
            (Lobe::Specular, specular * scale),
        ]
    }

    /// f · |cos θi|, and the density of `sample` with respect to solid angle.
    #[inline]
    pub(super) fn eval_pdf(&self, wo: Vec3A, wi: Vec3A) -> (Vec3A, f32) {
        if wo.z * wi.z <= 0.0 {
            return (Vec3A::ZERO, 0.0);
        }
        let p = self.prepared;
        let (cos_o, cos_i) = (wo.z.abs(), wi.z.abs());
        let half = (wo + wi).normalize();
        let cos_d = half.dot(wi).clamp(0.0, 1.0);
        let weight_d = schlick_weight(cos_d);
        let [(_, p_diffuse), (_, p_clearcoat), (_, p_specular)] = self.probabilities(wo);
        let (mut value, mut pdf) = (Vec3A::ZERO, 0.0);

        if p_diffuse > 0.0 {
            let (weight_o, weight_i) = (schlick_weight(cos_o), schlick_weight(cos_i));
            let diffuse = (1.0 - 0.5 * weight_o) * (1.0 - 0.5 * weight_i);
            let r = 2.0 * p.roughness * cos_d * cos_d;
            let retro = r * (weight_o + weight_i + weight_o * weight_i * (r - 1.0));
            value += (self.diffuse * (diffuse + retro) + self.sheen * weight_d) * cos_i;
            pdf += p_diffuse * cos_i * FRAC_1_PI;
        }
        if p_specular > 0.0 {
            let untinted = if p.untinted > 0.0 { fresnel(cos_d, p.eta).0 } else { 0.0 };
            let schlick = self.schlick_normal
                + (Vec3A::splat(p.schlick_grazing) - self.schlick_normal) * weight_d;
            // D G1(wo) / (4 cos θo), the density of a mirrored visible normal.
            let visible = p.ggx.density(half) * p.ggx.visibility(wo) * 0.5;
            let g1 = 2.0 * cos_i * p.ggx.visibility(wi);
            value += (schlick + p.untinted * untinted) * (visible * g1);
            pdf += p_specular * visible;
        }
        if p_clearcoat > 0.0 {
            let density = p.gtr1.density(half);
            let reflectance = CLEARCOAT_F0 + (1.0 - CLEARCOAT_F0) * weight_d;
            let g = smith_g1(CLEARCOAT_MASKING, cos_o) * smith_g1(CLEARCOAT_MASKING, cos_i);
            value += p.clearcoat * reflectance * density * g * cos_i;
            pdf += p_clearcoat * density * half.z.abs() / (4.0 * cos_d);
        }
        if let Some(energy) = &p.energy {
            value *= energy.at(cos_o) * energy.at(cos_i);
        }
        (value, pdf)
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3A, u: f32, u2: Vec2) -> Option<BsdfSample> {
        let [(_, p_diffuse), (_, p_clearcoat), _] = self.probabilities(wo);
        let lobe = if u < p_diffuse {
            Lobe::Diffuse
        } else if u < p_diffuse + p_clearcoat {
            Lobe::Clearcoat
        } else {
            Lobe::Specular
        };
        self.sample_lobe(lobe, wo, u2)
    }

    /// Draws from one lobe; weight and density are still those of the mixture.
    #[inline]
    pub(super) fn sample_lobe(&self, lobe: Lobe, wo: Vec3A, u2: Vec2) -> Option<BsdfSample> {
        let above = wo.with_z_towards(Vec3A::Z);
        let wi = match lobe {
            Lobe::Diffuse => cosine_hemisphere(u2).into(),
            Lobe::Specular => reflect(above, self.prepared.ggx.sample_visible(above, u2)),
            Lobe::Clearcoat => reflect(above, self.prepared.gtr1.sample(u2)),
        };
        if wi.z <= 0.0 {
            return None;
        }
        let wi = wi.with_z_towards(wo);
        let (value, pdf) = self.eval_pdf(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, weight: value / pdf, pdf, delta: false })
    }
}

/// The share of light that is reflected towards `wo`, of the largest channel: for each
/// lobe, the mean over a lattice of what sampling it gives. The integrand is smooth there,
/// however narrow the lobe.
fn directional_albedo(bsdf: &DisneyBsdf, wo: Vec3A) -> f32 {
    let mut sum = 0.0_f64;
    for (lobe, probability) in bsdf.probabilities(wo) {
        if probability == 0.0 {
            continue;
        }
        for i in 0..ALBEDO_POINTS {
            let turn = (f64::from(i) * GOLDEN_RATIO).fract() as f32;
            let u2 = Vec2::new(turn, (i as f32 + 0.5) / ALBEDO_POINTS as f32);
            if let Some(sample) = bsdf.sample_lobe(lobe, wo, u2) {
                sum += f64::from(probability * sample.weight.max_element());
            }
        }
    }
    (sum / f64::from(ALBEDO_POINTS)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::{
        chi2::Lens,
        energy::QUADRATURE_ERROR,
        test_data::{parameter_grid, polar},
    };

    /// Against a quadrature over half vectors.
    #[test]
    fn the_quadrature_is_as_good_as_it_says() {
        for (i, parameters) in parameter_grid().into_iter().enumerate() {
            let prepared = PreparedDisney::unscaled(&parameters);
            let bsdf = prepared.at(Vec3A::ONE);
            let theta = [0.0, 30.0, 60.0, 75.0, 85.0, 89.0][i % 6];
            let wo = polar(theta, 20.0);
            let ours = directional_albedo(&bsdf, wo);
            let lens = Lens::half(wo);
            let expected = lens.integral(|wi| bsdf.eval_pdf(wo, wi).0.x) as f32;
            let error = (ours / expected - 1.0).abs();
            assert!(error < QUADRATURE_ERROR, "{parameters:?}, θ = {theta}°: {ours} {expected}");
            let darker = directional_albedo(&prepared.at(Vec3A::splat(0.9)), wo);
            assert!((darker / expected - 1.0).abs() > QUADRATURE_ERROR);
        }
    }

    /// A white mirror loses light between its facets, and gains none.
    #[test]
    fn materials_that_need_no_scale_have_none() {
        let metal = Disney { metallic: 1.0, roughness: 0.3, ..Disney::default() };
        let prepared = PreparedDisney::new(&metal, std::iter::once(Vec3A::ONE));
        assert!(prepared.energy.is_none());
    }
}

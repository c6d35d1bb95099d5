//! Keeps a BRDF from reflecting more light than arrives.
//!
//! The directional albedo E(θo) = ∫ f cos θi dωi of Disney's BRDF can exceed 1:
//! nothing ties its lobes together. Then f s(θo) s(θi) with s(θ) = min(1, 1/E(θ))
//! takes its place. It is as reciprocal as f is, and, as s ≤ 1, it reflects
//! s(θo) ∫ f s(θi) cos θi dωi ≤ s(θo) E(θo) ≤ 1.

use std::f32::consts::FRAC_PI_4;

use glam::{Vec2, Vec3A};

use super::disney::DisneyBsdf;

/// Nodes of the table, at equal distances in √(cos θ): most of them near grazing
/// angles, where E changes fast.
const NODES: usize = 65;
/// Points per lobe of the quadrature.
const POINTS: u32 = 512;
/// Nodes are raised by what the quadrature may be off, for narrow and rough lobes
/// alike; `the_quadrature_is_as_good_as_it_says` measures it.
const QUADRATURE_ERROR: f32 = 2e-3;
/// Below this excess, E is taken for at most 1: rounding, for a white mirror.
const ROUNDING: f32 = 1e-5;

/// max(1, E) over √(cos θ).
#[derive(Clone, Debug)]
pub(super) struct EnergyScale {
    nodes: [f32; NODES],
}

impl EnergyScale {
    /// Tabulates `albedo`, a function of wo above the surface; `None` if it is at
    /// most 1 everywhere. Of an anisotropic BRDF, which is symmetric in x and in
    /// y, the largest of three azimuths counts.
    pub(super) fn new(anisotropic: bool, albedo: impl Fn(Vec3A) -> f32) -> Option<Self> {
        let azimuths = if anisotropic { 0..3 } else { 0..1 };
        let nodes: [f32; NODES] = std::array::from_fn(|i| {
            // At 0, the limit from above.
            let cos = (i as f32 / (NODES - 1) as f32).powi(2).max(1e-6);
            let sin = (1.0 - cos * cos).sqrt();
            let towards = |azimuth: i32| {
                let (sin_phi, cos_phi) = (azimuth as f32 * FRAC_PI_4).sin_cos();
                albedo(Vec3A::new(sin * cos_phi, sin * sin_phi, cos))
            };
            azimuths.clone().map(towards).fold(0.0, f32::max)
        });
        let largest = nodes.iter().copied().fold(0.0, f32::max);
        (largest > 1.0 + ROUNDING).then(|| Self { nodes: cover(&nodes) })
    }

    /// s(θ).
    #[inline]
    pub(super) fn at(&self, cos_theta: f32) -> f32 {
        let x = cos_theta.min(1.0).sqrt() * (NODES - 1) as f32;
        let i = (x as usize).min(NODES - 2);
        let t = x - i as f32;
        1.0 / (self.nodes[i] * (1.0 - t) + self.nodes[i + 1] * t)
    }
}

/// Nodes whose linear interpolation is nowhere below that of `nodes`, nor below
/// their larger neighbour, nor below 1.
fn cover(nodes: &[f32; NODES]) -> [f32; NODES] {
    std::array::from_fn(|i| {
        let near = &nodes[i.saturating_sub(1)..(i + 2).min(NODES)];
        (near.iter().copied().fold(0.0, f32::max) * (1.0 + QUADRATURE_ERROR)).max(1.0)
    })
}

/// E towards `wo`, the largest channel: for each lobe, the mean over a lattice of
/// what sampling it gives. The integrand is smooth there, however narrow the lobe.
pub(super) fn directional_albedo(bsdf: &DisneyBsdf, wo: Vec3A) -> f32 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let mut sum = 0.0_f64;
    for (lobe, probability) in bsdf.probabilities(wo) {
        if probability == 0.0 {
            continue;
        }
        for i in 0..POINTS {
            let turn = (f64::from(i) * GOLDEN).fract() as f32;
            let u2 = Vec2::new(turn, (i as f32 + 0.5) / POINTS as f32);
            if let Some(sample) = bsdf.sample_lobe(lobe, wo, u2) {
                sum += f64::from(probability * sample.weight.max_element());
            }
        }
    }
    (sum / f64::from(POINTS)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Disney,
        bsdf::{
            PreparedDisney,
            chi2::Lens,
            tests::{parameter_grid, polar},
        },
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

    #[test]
    fn the_scale_covers_the_albedo_between_nodes() {
        let albedo = |wo: Vec3A| 0.9 + 0.6 * (-8.0 * wo.z).exp();
        let scale = EnergyScale::new(false, albedo).expect("it exceeds 1");
        for i in 0..=10_000 {
            let cos = i as f32 / 10_000.0;
            let s = scale.at(cos);
            assert!(s <= 1.0 && s * albedo(Vec3A::new(0.0, 0.0, cos)) <= 1.0, "at {cos}");
        }
        assert_eq!(scale.at(1.0), 1.0);
        assert!(scale.at(0.0) > 0.6, "it takes no more than it must");
        assert!(EnergyScale::new(false, |_| 1.0).is_none());
        assert!(EnergyScale::new(true, |wo| if wo.y > wo.z { 1.1 } else { 0.5 }).is_some());
    }

    /// A white mirror loses light between its facets, and gains none.
    #[test]
    fn materials_that_need_no_scale_have_none() {
        let metal = Disney { metallic: 1.0, roughness: 0.3, ..Disney::default() };
        let prepared = PreparedDisney::new(&metal, std::iter::once(Vec3A::ONE));
        assert!(prepared.energy.is_none());
    }
}

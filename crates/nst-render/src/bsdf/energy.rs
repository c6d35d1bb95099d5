//! Keeps a BRDF from reflecting more light than arrives.
//!
//! The directional albedo E(θo) = ∫ f cos θi dωi of Disney's BRDF can exceed 1:
//! its lobes are added whatever the others reflect. Then f s(θo) s(θi) with
//! s(θ) = min(1, 1/E(θ)) takes its place. It is reciprocal if f is, and, as s ≤ 1, it
//! reflects s(θo) ∫ f s(θi) cos θi dωi ≤ s(θo) E(θo) ≤ 1.

use std::f32::consts::FRAC_PI_4;

use glam::Vec3A;

/// Nodes of the table, at equal distances in √(cos θ): most of them near grazing
/// angles, where E changes fast.
const NODES: usize = 65;
/// What the quadrature of E may be off, relatively: nodes are raised by it.
pub(super) const QUADRATURE_ERROR: f32 = 2e-3;
/// E is taken for at most 1 if it exceeds 1 by no more than this: the rounding of the
/// sum for a white mirror.
const ROUNDING: f32 = 1e-5;

/// max(1, E) over √(cos θ).
#[derive(Clone, Debug)]
pub(super) struct EnergyScale {
    nodes: [f32; NODES],
}

impl EnergyScale {
    /// Tabulates `albedo`, E as a function of wo above the surface, which may be off by
    /// [`QUADRATURE_ERROR`]; `None` if it is at most 1 everywhere. An anisotropic BRDF,
    /// which is symmetric in x and in y, is looked at from three azimuths, of which the
    /// largest E counts.
    pub(super) fn new(anisotropic: bool, albedo: impl Fn(Vec3A) -> f32) -> Option<Self> {
        let azimuths = if anisotropic { 0..3 } else { 0..1 };
        let nodes: [f32; NODES] = std::array::from_fn(|i| {
            // Not 0, where nothing is reflected, but the limit near it.
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

#[cfg(test)]
mod tests {
    use super::*;

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
}

//! Materials and directions for tests.

use glam::Vec3A;

use crate::{Disney, SampleStream, Sampler, SamplerKind};

/// A stream of random numbers.
pub(super) fn random(seed: u64) -> SampleStream {
    Sampler::new(SamplerKind::Random, seed).stream(0, 0)
}

/// Uniform on the sphere.
pub(super) fn random_direction(stream: &mut SampleStream) -> Vec3A {
    let z = 1.0 - 2.0 * stream.next_1d();
    polar(z.acos().to_degrees(), 360.0 * stream.next_1d())
}

/// The direction at angles in degrees.
pub(super) fn polar(theta: f32, phi: f32) -> Vec3A {
    let (sin, cos) = theta.to_radians().sin_cos();
    let (sin_phi, cos_phi) = phi.to_radians().sin_cos();
    Vec3A::new(sin * cos_phi, sin * sin_phi, cos)
}

/// 90 materials.
pub(super) fn parameter_grid() -> Vec<Disney> {
    let mut grid = Vec::new();
    for roughness in [0.05, 0.15, 0.35, 0.6, 1.0] {
        for metallic in [0.0, 0.5, 1.0] {
            for anisotropic in [0.0, 0.8] {
                for (sheen, clearcoat) in [(0.0, 0.0), (1.0, 0.0), (0.5, 1.0)] {
                    grid.push(Disney {
                        roughness,
                        metallic,
                        anisotropic,
                        sheen,
                        clearcoat,
                        clearcoat_gloss: 1.0 - roughness,
                        sheen_tint: 0.5 * metallic,
                        specular_tint: if sheen == 1.0 { 0.6 } else { 0.0 },
                        ..Disney::default()
                    });
                }
            }
        }
    }
    grid
}

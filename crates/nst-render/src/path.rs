//! Unidirectional path tracing with next-event estimation (Kajiya 1986; multiple
//! importance sampling by the power heuristic, Veach 1997).

use std::f32::consts::PI;

use glam::{Vec2, Vec3A};
use obvhs::ray::Ray;

use crate::{
    SampleStream, Scene, Triangle,
    accelerator::{Accelerator, Hit, offset},
    light::Lights,
    scene::interpolate,
};

/// Russian roulette may end a path from this vertex on.
const ROULETTE_START: u32 = 5;
/// It lets no path live for ever, not even between white walls.
const MAX_SURVIVAL: f32 = 0.95;

/// A scene with everything that ray queries need.
pub(crate) struct PathTracer<'a> {
    scene: &'a Scene,
    accelerator: Accelerator,
    lights: Lights,
    /// The largest coordinate of the scene, for [`offset`].
    scale: f32,
}

/// A point of a surface, seen from `wo`.
struct Surface {
    position: Vec3A,
    /// Unit geometric normal, on the side of `wo`.
    geometric_normal: Vec3A,
    /// Unit shading normal, on the side of the geometric one.
    normal: Vec3A,
}

impl<'a> PathTracer<'a> {
    pub(crate) fn new(scene: &'a Scene) -> Self {
        let (low, high) = scene.bounds();
        Self {
            scene,
            accelerator: Accelerator::new(&scene.triangles),
            lights: Lights::new(scene),
            scale: low.abs().max(high.abs()).max_element(),
        }
    }

    /// An unbiased estimate of the radiance that arrives at `origin` from `direction`.
    pub(crate) fn radiance(
        &self,
        origin: Vec3A,
        direction: Vec3A,
        samples: &mut SampleStream,
    ) -> Vec3A {
        let mut radiance = Vec3A::ZERO;
        let mut throughput = Vec3A::ONE;
        let mut ray = Ray::new_inf(origin, direction);
        // The density, with respect to solid angle, of the direction of `ray`;
        // `None` for camera rays, which no light sampling competes with.
        let mut pdf_bsdf = None;

        for vertex in 1..=self.scene.max_depth {
            let Some(hit) = self.accelerator.intersect(&ray) else {
                let pdf_light = self.lights.pdf_escape(ray.direction);
                let weight = pdf_bsdf.map_or(1.0, |pdf| power_heuristic(pdf, pdf_light));
                return radiance
                    + throughput * self.scene.environment.radiance(ray.direction) * weight;
            };
            let triangle = &self.scene.triangles[hit.triangle as usize];
            let surface = Surface::new(triangle, &ray, &hit);
            let material = &self.scene.materials[triangle.material as usize];
            if material.emits() {
                let weight = pdf_bsdf.map_or(1.0, |pdf| {
                    let cosine = ray.direction.dot(surface.geometric_normal);
                    power_heuristic(pdf, self.lights.pdf_hit(triangle, hit.t, cosine))
                });
                radiance += throughput * self.scene.emission(triangle, hit.barycentric) * weight;
            }
            if vertex == self.scene.max_depth || material.color == Vec3A::ZERO {
                return radiance;
            }

            let color = self.scene.color(triangle, hit.barycentric);
            radiance += throughput * color / PI * self.direct(&surface, samples);

            let wi = cosine_hemisphere(surface.normal, samples.next_2d());
            let cosine = wi.dot(surface.normal);
            // Interpolated normals can send a direction below the true surface.
            if cosine <= 0.0 || wi.dot(surface.geometric_normal) <= 0.0 {
                return radiance;
            }
            throughput *= color;
            pdf_bsdf = Some(cosine / PI);
            if vertex >= ROULETTE_START {
                let survival = throughput.max_element().min(MAX_SURVIVAL);
                if samples.next_1d() >= survival {
                    return radiance;
                }
                throughput /= survival;
            }
            ray = Ray::new_inf(offset(surface.position, surface.geometric_normal, self.scale), wi);
        }
        radiance
    }

    /// Light that reaches the surface straight from a light, times the cosine
    /// there, over the density; weighted against sampling the cosine.
    fn direct(&self, surface: &Surface, samples: &mut SampleStream) -> Vec3A {
        let origin = offset(surface.position, surface.geometric_normal, self.scale);
        let (pick, u) = (samples.next_1d(), samples.next_2d());
        let Some(light) = self.lights.sample(self.scene, origin, pick, u) else {
            return Vec3A::ZERO;
        };
        let cosine = light.wi.dot(surface.normal);
        if cosine <= 0.0 || light.wi.dot(surface.geometric_normal) <= 0.0 {
            return Vec3A::ZERO;
        }
        let shadow_ray = match light.target {
            Some(target) => {
                let to_light = target - origin;
                let reach = to_light.length();
                Ray::new(origin, to_light / reach, 0.0, reach)
            }
            None => Ray::new_inf(origin, light.wi),
        };
        if self.accelerator.occluded(&shadow_ray) {
            return Vec3A::ZERO;
        }
        light.radiance * (cosine / light.pdf * power_heuristic(light.pdf, cosine / PI))
    }
}

impl Surface {
    fn new(triangle: &Triangle, ray: &Ray, hit: &Hit) -> Self {
        let facing = |normal: Vec3A, towards: Vec3A| {
            if normal.dot(towards) < 0.0 { -normal } else { normal }
        };
        let geometric_normal = facing(triangle.area_vector().normalize(), -ray.direction);
        let normal = triangle.normals.map_or(geometric_normal, |normals| {
            let normal = interpolate(normals, hit.barycentric);
            facing(normal.normalize_or(geometric_normal), geometric_normal)
        });
        // The position comes from the corners, not along the ray: its error is
        // then that of the surface's coordinates, however far the ray has come.
        Self { position: triangle.position(hit.barycentric), geometric_normal, normal }
    }
}

/// The weight of a sample with density `pdf` beside a technique with density `other`.
fn power_heuristic(pdf: f32, other: f32) -> f32 {
    // Divided through by pdf², which may overflow when squared near a light.
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}

/// A unit direction about `normal` with density cos θ / π with respect to solid angle.
fn cosine_hemisphere(normal: Vec3A, u: Vec2) -> Vec3A {
    let (sin_phi, cos_phi) = (2.0 * PI * u.x).sin_cos();
    let radius = u.y.sqrt();
    let z = (1.0 - u.y).max(0.0).sqrt();
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    tangent * (radius * cos_phi) + bitangent * (radius * sin_phi) + normal * z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Sampler, SamplerKind};

    /// χ² of the sampled directions against cos θ / π, over cells of equal
    /// probability (cos² θ and φ are uniform); the 0.9999 quantile of 63 degrees
    /// of freedom is 113.5.
    #[test]
    fn cosine_hemisphere_follows_its_density() {
        const COUNT: u32 = 64_000;
        for normal in [Vec3A::Z, Vec3A::NEG_Z, Vec3A::new(0.3, -0.8, 0.5).normalize()] {
            let (tangent, bitangent) = normal.any_orthonormal_pair();
            let mut cells = [0.0_f64; 64];
            for i in 0..COUNT {
                let w = cosine_hemisphere(
                    normal,
                    Sampler::new(SamplerKind::Random, 3).stream(0, i).next_2d(),
                );
                assert!((w.length() - 1.0).abs() < 1e-5);
                let height = w.dot(normal).powi(2);
                let turn = w.dot(bitangent).atan2(w.dot(tangent)) / (2.0 * PI) + 0.5;
                let cell = |x: f32| ((x * 8.0) as usize).min(7);
                cells[cell(height) * 8 + cell(turn)] += 1.0;
            }
            let expected = f64::from(COUNT) / 64.0;
            let chi2: f64 = cells.iter().map(|n| (n - expected).powi(2) / expected).sum();
            assert!(chi2 < 113.5, "about {normal}: χ² = {chi2}");
        }
    }
}

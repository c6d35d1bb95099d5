//! Unidirectional path tracing with next-event estimation (Kajiya 1986; multiple
//! importance sampling by the power heuristic, Veach 1997).

use glam::Vec3A;
use obvhs::ray::Ray;

use crate::{
    SampleStream, Scattering, Scene, Triangle,
    accelerator::{build, new_ray, offset},
    bsdf::{Bsdf, Frame, Prepared},
    light::{LightSample, Lights},
    scene::interpolate,
    traversal::{Hit, Tree},
};

/// Russian roulette may end a path from this vertex on.
const ROULETTE_START: u32 = 5;
/// It lets no path live for ever, not even between white walls.
const MAX_SURVIVAL: f32 = 0.95;

/// A scene with everything that paths need.
pub(crate) struct PathTracer<'a> {
    scene: &'a Scene,
    tree: Tree,
    lights: Lights,
    /// By triangle: the unit geometric normal.
    normals: Vec<Vec3A>,
    /// By material.
    scattering: Vec<Prepared>,
    /// [`Scene::scale`], for [`offset`].
    scale: f32,
    strategy: Strategy,
}

/// Which samples count where lights and BSDF could both find the same light.
/// All strategies have the same expectation; tests compare them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Strategy {
    /// Both, weighted by the power heuristic.
    Both,
    #[cfg(test)]
    LightsOnly,
    #[cfg(test)]
    BsdfOnly,
}

/// A point of a surface.
struct Surface {
    position: Vec3A,
    /// Unit geometric normal; light passes through the surface where the two
    /// directions are on different sides of it.
    normal: Vec3A,
    /// About the shading normal, on the side of the geometric one.
    frame: Frame,
}

impl<'a> PathTracer<'a> {
    pub(crate) fn new(scene: &'a Scene) -> Self {
        Self {
            scene,
            tree: build(&scene.triangles),
            lights: Lights::new(scene),
            normals: scene.triangles.iter().map(|t| t.area_vector().normalize()).collect(),
            scattering: scene.materials.iter().map(Prepared::new).collect(),
            scale: scene.scale(),
            strategy: Strategy::Both,
        }
    }

    /// An unbiased estimate of the radiance that arrives at `origin` from `direction`.
    pub(crate) fn radiance(
        &self,
        origin: Vec3A,
        direction: Vec3A,
        samples: &mut SampleStream,
    ) -> Vec3A {
        let scene = self.scene;
        let mut radiance = Vec3A::ZERO;
        let mut throughput = Vec3A::ONE;
        let mut ray = new_ray(origin, direction, f32::INFINITY);
        // The density, with respect to solid angle, of the direction of `ray`;
        // `None` where light sampling could not have found it: from the camera,
        // and after a delta distribution.
        let mut pdf_bsdf = None;

        for vertex in 1..=scene.max_depth {
            let Some(hit) = self.tree.nearest(&ray) else {
                let pdf_light = self.lights.pdf_escape(ray.direction);
                let weight = self.weight_bsdf(pdf_bsdf, pdf_light);
                return radiance + throughput * scene.environment.radiance(ray.direction) * weight;
            };
            let triangle = &scene.triangles[hit.triangle as usize];
            let material = &scene.materials[triangle.material as usize];
            if material.emits() {
                let cosine = ray.direction.dot(self.normals[hit.triangle as usize]);
                let pdf_light = self.lights.pdf_hit(triangle, hit.t, cosine);
                let weight = self.weight_bsdf(pdf_bsdf, pdf_light);
                radiance += throughput * scene.emission(triangle, hit.barycentric) * weight;
            }
            if vertex == scene.max_depth {
                return radiance;
            }

            let surface = self.surface(triangle, &ray, &hit);
            let color = scene.color(triangle, hit.barycentric);
            let bsdf = self.scattering[triangle.material as usize].at(color);
            let wo = surface.frame.to_local(-ray.direction);
            if !bsdf.is_delta() {
                radiance += throughput * self.direct(&surface, &bsdf, wo, -ray.direction, samples);
            }

            let (lobe, u) = (samples.next_1d(), samples.next_2d());
            let Some(sample) = bsdf.sample(wo, lobe, u) else { return radiance };
            let wi = surface.frame.to_world(sample.wi);
            // Interpolated normals can send a direction to the wrong side.
            let side = wi.dot(surface.normal);
            let passes = -ray.direction.dot(surface.normal) * side < 0.0;
            if passes != (wo.z * sample.wi.z < 0.0) {
                return radiance;
            }
            throughput *= sample.weight;
            pdf_bsdf = (!sample.delta).then_some(sample.pdf);
            if scene.russian_roulette && vertex >= ROULETTE_START {
                let survival = throughput.max_element().min(MAX_SURVIVAL);
                if samples.next_1d() >= survival {
                    return radiance;
                }
                throughput /= survival;
            } else if throughput == Vec3A::ZERO {
                return radiance;
            }
            ray = new_ray(self.origin(&surface, side), wi, f32::INFINITY);
        }
        radiance
    }

    /// Light that reaches the surface straight from a light and is scattered
    /// towards `wo`, weighted against sampling the BSDF.
    fn direct(
        &self,
        surface: &Surface,
        bsdf: &Bsdf<'_>,
        wo: Vec3A,
        wo_world: Vec3A,
        samples: &mut SampleStream,
    ) -> Vec3A {
        let (pick, u) = (samples.next_1d(), samples.next_2d());
        let origin = self.origin(surface, wo_world.dot(surface.normal));
        let Some(light) = self.lights.sample(self.scene, origin, pick, u) else {
            return Vec3A::ZERO;
        };
        // Nothing but a delta distribution lets light through.
        if light.wi.dot(surface.normal) * wo_world.dot(surface.normal) <= 0.0 {
            return Vec3A::ZERO;
        }
        let (scattered, pdf_bsdf) = bsdf.eval_pdf(wo, surface.frame.to_local(light.wi));
        if scattered == Vec3A::ZERO || self.is_hidden(origin, &light) {
            return Vec3A::ZERO;
        }
        light.radiance * scattered * (self.weight_light(light.pdf, pdf_bsdf) / light.pdf)
    }

    fn is_hidden(&self, origin: Vec3A, light: &LightSample) -> bool {
        // To the light and no farther: in units of the way there, up to 1.
        let (direction, tmax) = match light.target {
            Some(target) => (target - origin, 1.0),
            None => (light.wi, f32::INFINITY),
        };
        self.tree.any(&new_ray(origin, direction, tmax))
    }

    /// Where a ray leaves the surface to the side of the normal that `side` tells.
    fn origin(&self, surface: &Surface, side: f32) -> Vec3A {
        offset(surface.position, surface.normal * side.signum(), self.scale)
    }

    fn surface(&self, triangle: &Triangle, ray: &Ray, hit: &Hit) -> Surface {
        let normal = self.normals[hit.triangle as usize];
        let mut shading = normal;
        if let Some(normals) = triangle.normals {
            let smooth = interpolate(normals, hit.barycentric).normalize_or(normal);
            let smooth = if smooth.dot(normal) < 0.0 { -smooth } else { smooth };
            // At a silhouette, a smooth normal may face away from who looks at
            // the surface; the geometric one never does.
            if smooth.dot(ray.direction) * normal.dot(ray.direction) > 0.0 {
                shading = smooth;
            }
        }
        let frame = match self.scene.materials[triangle.material as usize].scattering {
            Scattering::Disney(disney) if disney.anisotropic > 0.0 => {
                Frame::with_tangent(shading, triangle.tangent())
            }
            _ => Frame::new(shading),
        };
        // The position comes from the corners, not along the ray: its error is
        // then that of the surface's coordinates, however far the ray has come.
        Surface { position: triangle.position(hit.barycentric), normal, frame }
    }

    /// The weight of a light that a BSDF sample found.
    fn weight_bsdf(&self, pdf_bsdf: Option<f32>, pdf_light: f32) -> f32 {
        match (self.strategy, pdf_bsdf) {
            (_, None) => 1.0,
            (Strategy::Both, Some(pdf)) => power_heuristic(pdf, pdf_light),
            #[cfg(test)]
            (Strategy::LightsOnly, Some(_)) => {
                if pdf_light > 0.0 {
                    0.0
                } else {
                    1.0
                }
            }
            #[cfg(test)]
            (Strategy::BsdfOnly, Some(_)) => 1.0,
        }
    }

    /// The weight of a light sample.
    fn weight_light(&self, pdf_light: f32, pdf_bsdf: f32) -> f32 {
        match self.strategy {
            Strategy::Both => power_heuristic(pdf_light, pdf_bsdf),
            #[cfg(test)]
            Strategy::LightsOnly => 1.0,
            #[cfg(test)]
            Strategy::BsdfOnly => 0.0,
        }
    }
}

/// The weight of a sample with density `pdf` beside a technique with density `other`.
fn power_heuristic(pdf: f32, other: f32) -> f32 {
    // Divided through by pdf², which may overflow when squared near a light.
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}

#[cfg(test)]
mod tests {
    use std::{path::Path, sync::Arc};

    use glam::Vec2;

    use super::*;
    use crate::{Environment, Sampler, SamplerKind, Texture, camera::Projection};

    fn scene(name: &str) -> Scene {
        let path = format!("{}/../../scenes/{name}/{name}.obj", env!("CARGO_MANIFEST_DIR"));
        Scene::load(Path::new(&path)).expect("the scene is part of the repository")
    }

    /// The mean radiance over a film of 4 × 4 pixels, and its variance.
    fn mean(scene: &Scene, strategy: Strategy, seed: u64) -> (f64, f64) {
        const COUNT: u32 = 20_000;
        let tracer = PathTracer { strategy, ..PathTracer::new(scene) };
        let projection = Projection::new(&scene.camera, [4, 4]);
        let sampler = Sampler::new(SamplerKind::Random, seed);
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in 0..COUNT {
            let mut samples = sampler.stream(i % 16, i / 16);
            let film = Vec2::new((i % 4) as f32, (i / 4 % 4) as f32) + samples.next_2d();
            let direction = projection.direction(film);
            let radiance = tracer.radiance(projection.origin, direction, &mut samples);
            let value = f64::from(radiance.element_sum());
            sum += value;
            squares += value * value;
        }
        let n = f64::from(COUNT);
        (sum / n, (squares / n - (sum / n).powi(2)) / n)
    }

    /// |z| of the difference between two estimates of a mean.
    fn z((a, va): (f64, f64), (b, vb): (f64, f64)) -> f64 {
        (a - b).abs() / (va + vb).sqrt()
    }

    fn assert_strategies_agree(name: &str, scene: &Scene) {
        let both = mean(scene, Strategy::Both, 1);
        for (seed, strategy) in [(2, Strategy::LightsOnly), (3, Strategy::BsdfOnly)] {
            let other = mean(scene, strategy, seed);
            assert!(z(both, other) < 4.0, "{name}: {both:?}, {strategy:?}: {other:?}");
        }
        // More precise than the difference that one missing bounce makes.
        let fewer = Scene { max_depth: scene.max_depth - 1, ..scene.clone() };
        assert!(z(both, mean(&fewer, Strategy::Both, 4)) > 4.0, "{name}");
    }

    #[test]
    fn lights_and_bsdf_alone_agree_with_both() {
        for name in ["plane-lambert", "plane-ggx", "teapot-glossy"] {
            assert_strategies_agree(name, &scene(name));
        }
        let direct = Scene { max_depth: 2, ..scene("cornell") };
        assert_strategies_agree("cornell", &direct);
    }

    #[test]
    fn they_agree_under_an_image_of_the_sky() {
        let texel = |i: usize| if i == 90 { [30.0, 20.0, 10.0] } else { [0.2, 0.3, 0.4] };
        let sky = Texture::new([16, 8], (0..128).map(texel).collect()).expect("128 texels");
        let mut scene = scene("teapot-glossy");
        scene.environment = Environment { radiance: Vec3A::ONE, image: Some(Arc::new(sky)) };
        assert_strategies_agree("sky and lamp", &scene);
        for material in &mut scene.materials {
            material.emission = Vec3A::ZERO;
        }
        assert_strategies_agree("sky alone", &scene);
    }

    #[test]
    fn russian_roulette_keeps_the_mean() {
        let with = scene("cornell");
        let without = Scene { russian_roulette: false, ..with.clone() };
        assert!(with.max_depth > ROULETTE_START);
        let z = z(mean(&with, Strategy::Both, 5), mean(&without, Strategy::Both, 6));
        assert!(z < 4.0, "{z}");
    }
}

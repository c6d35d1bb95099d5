//! Light sampling: emitting triangles, chosen in proportion to their power, and the
//! environment if it is an image.

mod choice;

use std::f64::consts::PI;

use glam::{Vec2, Vec3, Vec3A};

use crate::{
    Material, Scene, Triangle,
    accelerator::{Rays, offset},
    color::luminance,
    environment::importance::EnvironmentSampler,
    packet::{PACKET, Vec3s},
};
use choice::Choice;

/// Directions from a packet of points towards lights.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct LightSamples {
    /// From the points to the lights. They end a little before the light's surface, so
    /// that the light does not hide itself.
    pub(crate) rays: Rays,
    /// The rays' directions, with length 1.
    pub(crate) wi: Vec3s,
    pub(crate) radiance: Vec3s,
    /// Probability density with respect to solid angle; 0 if there is no light,
    /// or if the chosen one is seen edge-on.
    pub(crate) pdf: [f32; PACKET],
}

impl LightSamples {
    pub(crate) const NONE: Self =
        Self { rays: Rays::NONE, wi: Vec3s::ZERO, radiance: Vec3s::ZERO, pdf: [0.0; PACKET] };
}

/// An emitting triangle: what samples of it need, side by side in memory.
struct Emitter {
    /// Index into [`Scene::triangles`].
    triangle: u32,
    corner: Vec3,
    edges: [Vec3; 2],
    /// Unit geometric normal.
    normal: Vec3,
    /// The density of its points among all samples, with respect to area.
    pdf_area: f32,
    /// Emitted radiance, not yet multiplied by the texture.
    radiance: Vec3,
    textured: bool,
    /// Whether parts of it are not there.
    cut_out: bool,
}

impl Emitter {
    /// `probability`: that of choosing this triangle.
    fn new(scene: &Scene, index: u32, probability: f64) -> Self {
        let triangle = &scene.triangles[index as usize];
        let material = &scene.materials[triangle.material as usize];
        let [a, b, c] = triangle.positions;
        Self {
            triangle: index,
            corner: a.into(),
            edges: [(b - a).into(), (c - a).into()],
            normal: triangle.area_vector().normalize().into(),
            pdf_area: (probability / area(triangle)) as f32,
            radiance: material.emission.into(),
            textured: material.emission_texture.is_some(),
            cut_out: material.is_cut_out(),
        }
    }
}

/// A packet of points of emitters.
#[repr(C, align(64))]
struct ChosenEmitters {
    point: Vec3s,
    normal: Vec3s,
    pdf_area: [f32; PACKET],
}

impl ChosenEmitters {
    const ZERO: Self = Self { point: Vec3s::ZERO, normal: Vec3s::ZERO, pdf_area: [0.0; PACKET] };
}

/// The lights of a scene.
pub(crate) struct Lights {
    emitters: Vec<Emitter>,
    environment: Option<EnvironmentSampler>,
    choice: Choice,
    /// The probability of choosing the environment.
    environment_share: f32,
    /// [`Scene::scale`], for [`offset`].
    scale: f32,
}

/// The least and the greatest share of the environment in the samples, where there are
/// other lights too: powers say nothing about what a point can see, so that neither may be
/// left with almost no samples.
const ENVIRONMENT_SHARE: std::ops::RangeInclusive<f32> = 0.1..=0.9;

impl Lights {
    pub(crate) fn new(scene: &Scene) -> Self {
        let powers = powers(scene);
        let total = powers.iter().map(|&(_, power)| power).sum();
        let environment = EnvironmentSampler::new(&scene.environment);
        let share =
            environment.as_ref().map_or(0.0, |sampler| environment_share(scene, sampler, total));
        let choice = Choice::new(share, powers.iter().map(|&(_, power)| power));
        let emitters = powers
            .iter()
            .zip(choice.probabilities())
            .map(|(&(triangle, _), probability)| Emitter::new(scene, triangle, probability))
            .collect();
        let environment_share = choice.environment() as f32;
        Self { emitters, environment, choice, environment_share, scale: scene.scale() }
    }

    /// The emitting triangles, as indices into [`Scene::triangles`], each with the density,
    /// with respect to area, with which [`Self::sample`] finds its points.
    pub(crate) fn densities(&self) -> impl Iterator<Item = (u32, f32)> {
        self.emitters.iter().map(|emitter| (emitter.triangle, emitter.pdf_area))
    }

    /// Chooses a light for each point with `pick`, random integers of
    /// [`crate::sampler::FINE_BITS`] bits, and a point of it with `u`.
    #[inline(always)]
    pub(crate) fn sample(
        &self,
        scene: &Scene,
        from: &Vec3s,
        pick: &[u64; PACKET],
        u: &[[f32; PACKET]; 2],
        samples: &mut LightSamples,
    ) {
        samples.rays.origin = *from;
        samples.pdf = [0.0; PACKET];
        if !self.emitters.is_empty() {
            self.sample_emitters(scene, pick, u, samples);
        }
        if let Some(environment) = &self.environment {
            for i in (0..PACKET).filter(|&i| self.choice.is_environment(pick[i])) {
                let wi = environment.sample(Vec2::new(u[0][i], u[1][i]));
                samples.wi.set(i, wi.into());
                samples.rays.direction.set(i, wi.into());
                samples.rays.tmax[i] = f32::INFINITY;
                samples.radiance.set(i, scene.environment.radiance(wi).into());
                samples.pdf[i] = environment.pdf(wi) * self.environment_share;
            }
        }
    }

    #[inline(always)]
    fn sample_emitters(
        &self,
        scene: &Scene,
        pick: &[u64; PACKET],
        u: &[[f32; PACKET]; 2],
        samples: &mut LightSamples,
    ) {
        // What has to be looked up one by one, before the loop without branches below.
        let mut chosen = ChosenEmitters::ZERO;
        for i in 0..PACKET {
            let emitter = &self.emitters[self.choice.emitter(pick[i])];
            // Uniform on the triangle: the square's upper half is folded onto the lower.
            let u = Vec2::new(u[0][i], u[1][i]);
            let barycentric = if u.x + u.y > 1.0 { 1.0 - u } else { u };
            let [e1, e2] = emitter.edges;
            chosen.point.set(i, emitter.corner + e1 * barycentric.x + e2 * barycentric.y);
            chosen.normal.set(i, emitter.normal);
            chosen.pdf_area[i] = emitter.pdf_area;
            let radiance = if emitter.textured {
                scene.emission(&scene.triangles[emitter.triangle as usize], barycentric).into()
            } else {
                emitter.radiance
            };
            samples.radiance.set(i, radiance);
            if emitter.cut_out {
                let opacity =
                    scene.opacity(&scene.triangles[emitter.triangle as usize], barycentric);
                samples.radiance.set(i, radiance * opacity);
            }
        }
        for i in 0..PACKET {
            let (from, point) = (samples.rays.origin.get(i), chosen.point.get(i));
            let normal = chosen.normal.get(i);
            let to_light = point - from;
            let distance2 = to_light.length_squared();
            let wi = to_light * (1.0 / distance2.sqrt());
            let cosine = wi.dot(normal);
            let pdf = chosen.pdf_area[i] * distance2 / cosine.abs();
            let target = offset(point, normal * 1.0_f32.copysign(-cosine), self.scale);
            samples.wi.set(i, wi);
            samples.rays.direction.set(i, target - from);
            samples.rays.tmax[i] = 1.0;
            // A NaN, at distance 0, becomes 0 as well.
            samples.pdf[i] = if (pdf > 0.0) & (pdf < f32::INFINITY) { pdf } else { 0.0 };
        }
    }

    /// The density, with respect to solid angle, with which [`Self::sample`] finds a
    /// direction to the environment.
    pub(crate) fn pdf_escape(&self, direction: Vec3A) -> f32 {
        self.environment.as_ref().map_or(0.0, |e| e.pdf(direction) * self.environment_share)
    }
}

/// The density, with respect to solid angle, of a point that has the density `pdf_area`
/// with respect to area, seen at a distance under the cosine of an angle.
#[inline(always)]
pub(crate) fn pdf_solid_angle(pdf_area: f32, distance: f32, cosine: f32) -> f32 {
    pdf_area * distance * distance / cosine.abs()
}

/// The emitting triangles, as indices into [`Scene::triangles`], each with its power up to
/// a factor that all have in common: its area times its mean luminance.
fn powers(scene: &Scene) -> Vec<(u32, f64)> {
    let luminances: Vec<f64> = scene.materials.iter().map(mean_luminance).collect();
    (0..)
        .zip(&scene.triangles)
        .filter_map(|(index, triangle)| {
            let luminance = luminances[triangle.material as usize];
            (luminance > 0.0).then_some((index, area(triangle) * luminance))
        })
        .collect()
}

/// The luminance that a material emits, the mean over its textures.
fn mean_luminance(material: &Material) -> f64 {
    if !material.emits() {
        return 0.0;
    }
    let texels = material.emission_texture.as_ref().map_or(&[[1.0; 3]][..], |t| t.image.texels());
    let emission = |&texel: &[f32; 3]| f64::from(luminance(material.emission * Vec3A::from(texel)));
    let luminance = texels.iter().map(emission).sum::<f64>() / texels.len() as f64;
    luminance * mean_opacity(material)
}

fn mean_opacity(material: &Material) -> f64 {
    let texels = material.opacity_texture.as_ref().map_or(&[[1.0; 3]][..], |t| t.image.texels());
    let sum: f64 = texels.iter().map(|texel| f64::from(texel[0])).sum();
    f64::from(material.opacity) * sum / texels.len() as f64
}

fn area(triangle: &Triangle) -> f64 {
    f64::from(triangle.area_vector().length()) / 2.0
}

/// The probability of choosing the environment, beside emitters whose powers sum up to
/// `total`.
fn environment_share(scene: &Scene, environment: &EnvironmentSampler, total: f64) -> f32 {
    if total == 0.0 {
        return 1.0;
    }
    let (low, high) = scene.bounds();
    // Power into the bounding sphere, π r² · 4π L̄, beside 2π A L of two-sided lights.
    let area = PI * f64::from((high - low).length_squared()) / 4.0;
    let power = area * 4.0 * PI * environment.mean_luminance();
    let share = (power / (power + 2.0 * PI * total)) as f32;
    share.clamp(*ENVIRONMENT_SHARE.start(), *ENVIRONMENT_SHARE.end())
}

#[cfg(test)]
mod tests {
    use std::{path::Path, sync::Arc};

    use super::*;
    use crate::{Environment, Sampler, SamplerKind, Texture, sampler::Streams};

    /// The lamp of the Cornell box, many times and up to a million times smaller in area;
    /// every other one shines a thousand times brighter.
    fn many_lamps(environment: Environment) -> Scene {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/cornell/cornell.obj");
        let mut scene = Scene::load(Path::new(path)).expect("the scene is part of the repository");
        let lamp = scene
            .triangles
            .iter()
            .copied()
            .find(|triangle| scene.materials[triangle.material as usize].emits())
            .expect("a lamp");
        let dim = &scene.materials[lamp.material as usize];
        let bright = Material { emission: dim.emission * 1000.0, ..dim.clone() };
        scene.materials.push(bright);
        let bright = scene.materials.len() as u32 - 1;
        let smaller = |i: u32| {
            let scale = 10.0_f32.powf(-0.003 * (i * 709 % 1000) as f32);
            let positions = lamp.positions.map(|corner| corner * scale);
            let material = if i.is_multiple_of(2) { lamp.material } else { bright };
            Triangle { positions, material, ..lamp }
        };
        scene.triangles = (0..50_000).map(smaller).collect();
        Scene { environment, ..scene }
    }

    /// The densities of emitters' points integrate to the probability of all emitters, and
    /// what a sample says of its density is what its triangle's density says. Tolerances:
    /// rounding in f32.
    #[test]
    fn samples_have_the_densities_of_their_triangles() {
        let sky = Texture::new([2, 1], vec![[1.0; 3], [2.0; 3]]).expect("two texels");
        let sky =
            Environment { radiance: Vec3A::ONE, image: Some(Arc::new(sky)), ..Default::default() };
        for (environment, has_sky) in [(Environment::default(), false), (sky, true)] {
            let scene = many_lamps(environment);
            let lights = Lights::new(&scene);
            let densities: Vec<_> = lights.densities().collect();
            assert_eq!(densities.len(), scene.triangles.len());
            let sum: f64 = densities
                .iter()
                .map(|&(i, pdf)| f64::from(pdf) * area(&scene.triangles[i as usize]))
                .sum();
            let expected = 1.0 - f64::from(lights.environment_share);
            assert!((sum - expected).abs() < 1e-6, "{sum}, not {expected}");
            assert_eq!(expected < 1.0, has_sky);

            let mut streams = Streams::ZERO;
            let sampler = Sampler::new(SamplerKind::Random, 1);
            let from = Vec3s::ZERO;
            for packet in 0..100 {
                for i in 0..PACKET {
                    streams.set(i, &sampler.stream(packet, i as u32));
                }
                let pick = streams.draw_fine(SamplerKind::Random, 0);
                let u = streams.draw_2d(SamplerKind::Random, 1);
                let mut samples = LightSamples::NONE;
                lights.sample(&scene, &from, &pick, &u, &mut samples);
                for i in (0..PACKET).filter(|&i| !lights.choice.is_environment(pick[i])) {
                    let chosen = lights.choice.emitter(pick[i]);
                    let normal = scene.triangles[chosen].area_vector().normalize();
                    let cosine = samples.wi.get(i).dot(normal.into());
                    // Up to the offset from the surface.
                    let distance = samples.rays.direction.get(i).length();
                    let agrees = |(_, pdf_area): (u32, f32)| {
                        let expected = pdf_solid_angle(pdf_area, distance, cosine);
                        (samples.pdf[i] / expected - 1.0).abs() < 1e-2
                    };
                    assert_eq!(densities[chosen].0 as usize, chosen);
                    assert!(agrees(densities[chosen]), "{chosen}: {}", samples.pdf[i]);
                    assert!(!agrees(densities[chosen ^ 1]), "{chosen}: a lamp of the other kind");
                }
            }
        }
    }
}

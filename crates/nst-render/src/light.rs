//! What next-event estimation aims at: emitting triangles, chosen in proportion
//! to their power, and the environment where it is an image.

use std::f32::consts::PI;

use glam::{Vec2, Vec3, Vec3A};

use crate::{
    Scene, Triangle,
    accelerator::{Rays, offset},
    environment::EnvironmentSampler,
    lanes::{LANES, Vec3s},
};

/// Directions from sixteen points towards lights.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct LightSamples {
    /// From the points to the lights and no farther: to a point that is off its
    /// light's surface, so that the light does not hide it.
    pub(crate) rays: Rays,
    /// The rays' directions, with length 1.
    pub(crate) wi: Vec3s,
    pub(crate) radiance: Vec3s,
    /// Probability density with respect to solid angle; 0 if there is no light,
    /// or if the chosen one is seen edge-on.
    pub(crate) pdf: [f32; LANES],
}

impl LightSamples {
    pub(crate) const NONE: Self =
        Self { rays: Rays::NONE, wi: Vec3s::ZERO, radiance: Vec3s::ZERO, pdf: [0.0; LANES] };
}

/// An emitting triangle, with what a sample of it needs side by side.
struct Emitter {
    /// Index into [`Scene::triangles`].
    triangle: u32,
    /// The probability of this or an earlier emitter; 1 for the last.
    cumulative: f32,
    corner: Vec3,
    edges: [Vec3; 2],
    /// Unit geometric normal.
    normal: Vec3,
    pdf_area: f32,
    /// Without its texture.
    radiance: Vec3,
    textured: bool,
}

/// Points of emitters.
#[repr(C, align(64))]
struct ChosenEmitters {
    point: Vec3s,
    normal: Vec3s,
    pdf_area: [f32; LANES],
}

impl ChosenEmitters {
    const ZERO: Self = Self { point: Vec3s::ZERO, normal: Vec3s::ZERO, pdf_area: [0.0; LANES] };
}

/// The lights of a scene.
pub(crate) struct Lights {
    emitters: Vec<Emitter>,
    /// By material: the density with respect to area of a point of a triangle,
    /// whose probability is proportional to its area times its mean luminance.
    pdf_area: Vec<f32>,
    environment: Option<EnvironmentSampler>,
    /// The probability of choosing the environment.
    environment_share: f32,
    /// [`Scene::scale`], for [`offset`].
    scale: f32,
}

/// The environment's share of the samples where there are other lights too.
const ENVIRONMENT_SHARE: std::ops::RangeInclusive<f32> = 0.1..=0.9;

/// Luminance of linear sRGB (ITU-R BT.709).
pub(crate) fn luminance(rgb: Vec3A) -> f32 {
    rgb.dot(Vec3A::new(0.2126, 0.7152, 0.0722))
}

impl Lights {
    pub(crate) fn new(scene: &Scene) -> Self {
        let mean_luminance: Vec<f64> = scene
            .materials
            .iter()
            .map(|material| {
                let texels =
                    material.emission_texture.as_ref().map_or(&[[1.0; 3]][..], |t| t.texels());
                let emission = |&texel: &[f32; 3]| {
                    f64::from(luminance(material.emission * Vec3A::from(texel)))
                };
                texels.iter().map(emission).sum::<f64>() / texels.len() as f64
            })
            .collect();
        let emitters: Vec<(u32, f64)> = (0..)
            .zip(&scene.triangles)
            .filter_map(|(index, triangle)| {
                let luminance = mean_luminance[triangle.material as usize];
                let area = f64::from(triangle.area_vector().length()) / 2.0;
                (luminance > 0.0).then_some((index, area * luminance))
            })
            .collect();
        let total: f64 = emitters.iter().map(|&(_, power)| power).sum();

        let environment = scene.environment.image.as_deref().map(EnvironmentSampler::new);
        let (low, high) = scene.bounds();
        let environment_share = environment.as_ref().map_or(0.0, |environment| {
            // Power into the bounding sphere, π r² · 4π L̄, beside 2π A L of two-sided lights.
            let radiance = luminance(scene.environment.radiance) * environment.mean_luminance();
            let power = PI * (high - low).length_squared() / 4.0 * 4.0 * PI * radiance;
            let others = 2.0 * PI * total as f32;
            if others == 0.0 {
                return 1.0;
            }
            (power / (power + others)).clamp(*ENVIRONMENT_SHARE.start(), *ENVIRONMENT_SHARE.end())
        });
        let of_triangles = f64::from(1.0 - environment_share);
        let density = |luminance: &f64| {
            if total > 0.0 { (of_triangles * luminance / total) as f32 } else { 0.0 }
        };
        let pdf_area: Vec<f32> = mean_luminance.iter().map(density).collect();
        let mut cumulative = 0.0;
        let emitters = emitters
            .into_iter()
            .map(|(index, power)| {
                cumulative += power;
                let triangle = &scene.triangles[index as usize];
                let material = &scene.materials[triangle.material as usize];
                let [a, b, c] = triangle.positions;
                Emitter {
                    triangle: index,
                    cumulative: (cumulative / total) as f32,
                    corner: a.into(),
                    edges: [(b - a).into(), (c - a).into()],
                    normal: triangle.area_vector().normalize().into(),
                    pdf_area: pdf_area[triangle.material as usize],
                    radiance: material.emission.into(),
                    textured: material.emission_texture.is_some(),
                }
            })
            .collect();
        Self { emitters, pdf_area, environment, environment_share, scale: scene.scale() }
    }

    /// Chooses a light for each point with `pick`, and a point of it with `u`.
    #[inline(always)]
    pub(crate) fn sample(
        &self,
        scene: &Scene,
        from: &Vec3s,
        pick: &[f32; LANES],
        u: &[[f32; LANES]; 2],
        samples: &mut LightSamples,
    ) {
        samples.rays.origin = *from;
        samples.pdf = [0.0; LANES];
        if !self.emitters.is_empty() {
            self.sample_emitters(scene, pick, u, samples);
        }
        if let Some(environment) = &self.environment {
            for i in (0..LANES).filter(|&i| pick[i] < self.environment_share) {
                samples.pdf[i] = 0.0;
                if let Some((wi, pdf)) = environment.sample(Vec2::new(u[0][i], u[1][i])) {
                    samples.wi.set(i, wi.into());
                    samples.rays.direction.set(i, wi.into());
                    samples.rays.tmax[i] = f32::INFINITY;
                    samples.radiance.set(i, scene.environment.radiance(wi).into());
                    samples.pdf[i] = pdf * self.environment_share;
                }
            }
        }
    }

    #[inline(always)]
    fn sample_emitters(
        &self,
        scene: &Scene,
        pick: &[f32; LANES],
        u: &[[f32; LANES]; 2],
        samples: &mut LightSamples,
    ) {
        // What is looked up lane by lane, for the loop without branches below.
        let mut chosen = ChosenEmitters::ZERO;
        let scale = 1.0 / (1.0 - self.environment_share);
        for i in 0..LANES {
            let pick = (pick[i] - self.environment_share) * scale;
            let last = self.emitters.len() - 1;
            let emitter =
                &self.emitters[self.emitters.partition_point(|e| e.cumulative <= pick).min(last)];
            // Uniform on the triangle: fold the square's upper half onto the lower.
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
        }
        for i in 0..LANES {
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
            // Not so for a NaN, at distance 0.
            samples.pdf[i] = if (pdf > 0.0) & (pdf < f32::INFINITY) { pdf } else { 0.0 };
        }
    }

    /// The density, with respect to solid angle, with which [`Self::sample`] finds
    /// a point of this triangle, seen at a distance under the cosine of an angle.
    pub(crate) fn pdf_hit(&self, triangle: &Triangle, distance: f32, cosine: f32) -> f32 {
        self.pdf_area[triangle.material as usize] * distance * distance / cosine.abs()
    }

    /// The density, with respect to solid angle, of a direction to the environment.
    pub(crate) fn pdf_escape(&self, direction: Vec3A) -> f32 {
        self.environment.as_ref().map_or(0.0, |e| e.pdf(direction) * self.environment_share)
    }
}

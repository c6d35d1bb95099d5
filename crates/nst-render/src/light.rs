//! What next-event estimation aims at: emitting triangles, chosen in proportion
//! to their power, and the environment where it is an image.

use std::f32::consts::PI;

use glam::{Vec2, Vec3A};

use crate::{Scene, Triangle, accelerator::offset, environment::EnvironmentSampler};

/// A direction towards a light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightSample {
    /// Unit direction to the light.
    pub(crate) wi: Vec3A,
    /// The point of the light, moved off its surface so that the light does not
    /// hide it; `None` for the environment.
    pub(crate) target: Option<Vec3A>,
    pub(crate) radiance: Vec3A,
    /// Probability density with respect to solid angle.
    pub(crate) pdf: f32,
}

/// An emitting triangle, with what a sample of it needs side by side.
struct Emitter {
    /// Index into [`Scene::triangles`].
    triangle: u32,
    /// The probability of this or an earlier emitter; 1 for the last.
    cumulative: f32,
    corner: Vec3A,
    edges: [Vec3A; 2],
    /// Unit geometric normal.
    normal: Vec3A,
    pdf_area: f32,
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
                let [a, b, c] = triangle.positions;
                Emitter {
                    triangle: index,
                    cumulative: (cumulative / total) as f32,
                    corner: a,
                    edges: [b - a, c - a],
                    normal: triangle.area_vector().normalize(),
                    pdf_area: pdf_area[triangle.material as usize],
                }
            })
            .collect();
        Self { emitters, pdf_area, environment, environment_share, scale: scene.scale() }
    }

    /// A direction from the point `from` to a light; `None` if there is no light,
    /// or if the chosen one is seen edge-on.
    pub(crate) fn sample(
        &self,
        scene: &Scene,
        from: Vec3A,
        pick: f32,
        u: Vec2,
    ) -> Option<LightSample> {
        if pick < self.environment_share {
            let (wi, pdf) = self.environment.as_ref()?.sample(u)?;
            let radiance = scene.environment.radiance(wi);
            return Some(LightSample {
                wi,
                target: None,
                radiance,
                pdf: pdf * self.environment_share,
            });
        }
        let pick = (pick - self.environment_share) / (1.0 - self.environment_share);
        let last = self.emitters.len().checked_sub(1)?;
        let chosen = self.emitters.partition_point(|e| e.cumulative <= pick).min(last);
        let emitter = &self.emitters[chosen];
        // Uniform on the triangle: fold the square's upper half onto the lower.
        let barycentric = if u.x + u.y > 1.0 { 1.0 - u } else { u };
        let point =
            emitter.corner + emitter.edges[0] * barycentric.x + emitter.edges[1] * barycentric.y;
        let to_light = point - from;
        let distance2 = to_light.length_squared();
        let wi = to_light / distance2.sqrt();
        let cosine = wi.dot(emitter.normal);
        let pdf = emitter.pdf_area * distance2 / cosine.abs();
        // Not so for a NaN, at distance 0.
        (pdf > 0.0 && pdf.is_finite()).then(|| LightSample {
            wi,
            target: Some(offset(point, emitter.normal * -cosine.signum(), self.scale)),
            radiance: scene.emission(&scene.triangles[emitter.triangle as usize], barycentric),
            pdf,
        })
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

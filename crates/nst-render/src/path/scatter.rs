//! One step of a packet of paths: the light that their points scatter towards them,
//! and where they go on.

use glam::{Vec2, Vec3, Vec3A};

use super::{
    tracer::PathTracer,
    wave::{Paths, Points},
};
use crate::{
    SamplerKind, Scattering,
    accelerator::{NONE, max, offset},
    bsdf::{Frame, lambert},
    light::LightSamples,
    packet::{PACKET, Vec3s},
};

/// The random numbers of one vertex of a packet of paths.
pub(super) struct Draws {
    light: [u64; PACKET],
    on_light: [[f32; PACKET]; 2],
    lobe: [f32; PACKET],
    direction: [[f32; PACKET]; 2],
    /// Only where there is Russian roulette.
    survival: Option<[f32; PACKET]>,
}

impl Draws {
    /// How many dimensions of the sampler one vertex takes.
    pub(super) fn dimensions(roulette: bool) -> u32 {
        6 + u32::from(roulette)
    }

    #[inline(always)]
    pub(super) fn new(points: &Points, kind: SamplerKind, first: u32, roulette: bool) -> Self {
        let streams = &points.streams;
        Self {
            light: streams.draw_fine(kind, first),
            on_light: streams.draw_2d(kind, first + 1),
            lobe: streams.draw_1d(kind, first + 3),
            direction: streams.draw_2d(kind, first + 4),
            survival: roulette.then(|| streams.draw_1d(kind, first + 6)),
        }
    }

    #[inline(always)]
    fn direction(&self, i: usize) -> Vec2 {
        Vec2::new(self.direction[0][i], self.direction[1][i])
    }
}

/// Light that goes along `lights.rays` to a vertex, and from there to the camera.
pub(super) struct Direct {
    pub(super) lights: LightSamples,
    pub(super) contribution: Vec3s,
}

impl PathTracer<'_> {
    /// Samples the lights for each point; paths without a light have a ray with
    /// negative `tmax`.
    #[inline(always)]
    pub(super) fn lights(&self, points: &Points, draws: &Draws) -> Direct {
        let mut origins = Vec3s::ZERO;
        for i in 0..PACKET {
            let normal = points.normal.get(i);
            origins.set(i, self.origin(points, i, points.wo.get(i).dot(normal)));
        }
        let mut lights = LightSamples::NONE;
        self.lights.sample(self.scene, &origins, &draws.light, &draws.on_light, &mut lights);
        for i in 0..PACKET {
            let (normal, wo) = (points.normal.get(i), points.wo.get(i));
            // Only delta distributions let light pass, and light samples never meet theirs.
            let same_side = lights.wi.get(i).dot(normal) * wo.dot(normal) > 0.0;
            let lit = same_side & (lights.pdf[i] > 0.0) & (points.path[i] != NONE);
            lights.rays.tmax[i] = if lit { lights.rays.tmax[i] } else { -1.0 };
        }
        Direct { lights, contribution: Vec3s::ZERO }
    }

    /// Scatters at Lambert's surfaces, all points of the packet together.
    #[inline(always)]
    pub(super) fn reflect(
        &self,
        points: &Points,
        draws: &Draws,
        direct: &mut Direct,
        next: &mut Paths,
    ) {
        let lights = &mut direct.lights;
        for i in 0..PACKET {
            let shading = points.shading.get(i);
            let cos_o = points.wo.get(i).dot(shading);
            let pdf_light = lights.pdf[i];
            let pdf = lambert::density(cos_o, lights.wi.get(i).dot(shading));
            let weight = pdf * self.weight_light(pdf_light, pdf) / pdf_light;
            let reflected = points.throughput.get(i) * points.color.get(i);
            direct.contribution.set(i, reflected * lights.radiance.get(i) * weight);
            lights.rays.tmax[i] = if pdf > 0.0 { lights.rays.tmax[i] } else { -1.0 };
        }
        for i in 0..PACKET {
            let (normal, shading) = (points.normal.get(i), points.shading.get(i));
            let wo = points.wo.get(i);
            let cos_o = wo.dot(shading);
            let local = lambert::sample(cos_o, draws.direction(i));
            let (tangent, bitangent) = shading.any_orthonormal_pair();
            let wi = tangent * local.x + bitangent * local.y + shading * local.z;
            let pdf = lambert::density(cos_o, local.z);
            // Interpolated normals can send a direction to the wrong side.
            let side = wi.dot(normal);
            let alive = (side * wo.dot(normal) >= 0.0) & (pdf > 0.0) & (points.path[i] != NONE);
            next.rays.origin.set(i, self.origin(points, i, side));
            next.rays.direction.set(i, wi);
            next.rays.tmax[i] = if alive { f32::INFINITY } else { -1.0 };
            next.pdf[i] = pdf;
            next.throughput.set(i, points.throughput.get(i) * points.color.get(i));
        }
    }

    /// Scatters at any surfaces, one point after the other.
    #[inline(always)]
    pub(super) fn scatter(
        &self,
        points: &Points,
        draws: &Draws,
        direct: &mut Direct,
        next: &mut Paths,
    ) {
        let lights = &mut direct.lights;
        for i in (0..PACKET).filter(|&i| points.path[i] != NONE) {
            let triangle = &self.scene.triangles[points.triangle[i] as usize];
            let material = triangle.material as usize;
            let (normal, shading) = (Vec3A::from(points.normal.get(i)), points.shading.get(i));
            let frame = match self.scene.materials[material].scattering {
                Scattering::Disney(disney) if disney.anisotropic > 0.0 => {
                    Frame::with_tangent(shading.into(), triangle.tangent())
                }
                _ => Frame::new(shading.into()),
            };
            let bsdf = self.scattering[material].at(points.color.get(i).into());
            let wo_world = Vec3A::from(points.wo.get(i));
            let wo = frame.to_local(wo_world);
            let throughput = Vec3A::from(points.throughput.get(i));

            if bsdf.is_delta() {
                lights.rays.tmax[i] = -1.0;
            } else if lights.rays.tmax[i] >= 0.0 {
                let wi = frame.to_local(lights.wi.get(i).into());
                let (scattered, pdf) = bsdf.eval_pdf(wo, wi);
                if scattered == Vec3A::ZERO {
                    lights.rays.tmax[i] = -1.0;
                }
                let weight = self.weight_light(lights.pdf[i], pdf) / lights.pdf[i];
                let radiance = Vec3A::from(lights.radiance.get(i));
                direct.contribution.set(i, (throughput * scattered * radiance * weight).into());
            }

            let Some(sample) = bsdf.sample(wo, draws.lobe[i], draws.direction(i)) else { continue };
            let wi = frame.to_world(sample.wi);
            // Interpolated normals can send a direction to the wrong side.
            let side = wi.dot(normal);
            let passes = wo_world.dot(normal) * side < 0.0;
            if passes != (wo.z * sample.wi.z < 0.0) {
                continue;
            }
            next.rays.origin.set(i, self.origin(points, i, side));
            next.rays.direction.set(i, wi.into());
            next.rays.tmax[i] = f32::INFINITY;
            next.pdf[i] = if sample.delta { f32::INFINITY } else { sample.pdf };
            next.throughput.set(i, (throughput * sample.weight).into());
        }
    }

    /// The origin of a ray that leaves point `i`: a little off the surface, on the side
    /// that the normal points to if `side` is positive, else on the other.
    #[inline(always)]
    fn origin(&self, points: &Points, i: usize, side: f32) -> Vec3 {
        let normal = points.normal.get(i) * 1.0_f32.copysign(side);
        offset(points.position.get(i), normal, self.scale)
    }
}

/// The highest probability to survive Russian roulette: below 1, so that paths end even
/// between white walls.
const MAX_SURVIVAL: f32 = 0.95;
/// The lowest probability to survive Russian roulette, 2⁻⁸. Random numbers are multiples of
/// 2⁻²⁴, which rounds a probability up to such a multiple: a path that should survive with
/// 10⁻¹² survives with 2⁻²⁴, 60,000 times as often as its weight allows for, a bias. From
/// 2⁻⁸ on, the relative excess is at most 2⁻¹⁶, which no pixel can show: even 2³² samples,
/// the most that a pixel can have, leave noise of this size. A higher floor would be as
/// good, but it would change the paths between both.
const MIN_SURVIVAL: f32 = 1.0 / 256.0;

/// The probability that a path goes on, in proportion to what it carries.
#[inline(always)]
fn survival(throughput: f32) -> f32 {
    if throughput < MAX_SURVIVAL { max(throughput, MIN_SURVIVAL) } else { MAX_SURVIVAL }
}

/// Ends paths that carry nothing, and some of the others by Russian roulette.
#[inline(always)]
pub(super) fn survive(draws: &Draws, next: &mut Paths) {
    let draw = draws.survival.unwrap_or([0.0; PACKET]);
    for i in 0..PACKET {
        let throughput = next.throughput.get(i);
        let largest = max(throughput.x, max(throughput.y, throughput.z));
        let survival = if draws.survival.is_some() { survival(largest) } else { 1.0 };
        let alive = (largest > 0.0) & (draw[i] < survival);
        next.rays.tmax[i] = if alive { next.rays.tmax[i] } else { -1.0 };
        next.throughput.set(i, throughput * (1.0 / survival));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a path carries after Russian roulette, divided by what it carried before: the
    /// mean over all numbers that a sampler can draw.
    fn mean_after_roulette(throughput: f32) -> f64 {
        const NUMBERS: usize = 1 << 24;
        let mut draws = Draws {
            light: [0; PACKET],
            on_light: [[0.0; PACKET]; 2],
            lobe: [0.0; PACKET],
            direction: [[0.0; PACKET]; 2],
            survival: None,
        };
        let mut sum = 0.0;
        for first in (0..NUMBERS).step_by(PACKET) {
            draws.survival =
                Some(std::array::from_fn(|i| (first + i) as f32 * (1.0 / NUMBERS as f32)));
            let mut paths = Paths::default();
            for i in 0..PACKET {
                paths.rays.tmax[i] = f32::INFINITY;
                paths.throughput.set(i, throughput * Vec3::new(0.25, 1.0, 0.5));
            }
            survive(&draws, &mut paths);
            for i in (0..PACKET).filter(|&i| paths.rays.tmax[i] >= 0.0) {
                let carried = paths.throughput.get(i);
                assert!(carried.y <= f32::max(1.0, throughput / MAX_SURVIVAL) * 1.000_001);
                sum += f64::from(carried.y);
            }
        }
        sum / NUMBERS as f64 / f64::from(throughput)
    }

    /// Tolerance: the excess that the floor allows, and f32's rounding.
    #[test]
    fn roulette_keeps_what_dark_paths_carry() {
        for throughput in [1e-30, 1e-12, 1e-6, 0.003, 0.004, 0.017, 0.3, 0.949, 0.96, 3.0] {
            let mean = mean_after_roulette(throughput);
            assert!((mean - 1.0).abs() < 1.1 / 65_536.0, "{throughput}: {mean}");
        }
    }

    /// Above the floor, and below the ceiling, survivors carry the same as without a floor.
    #[test]
    fn the_floor_acts_on_dark_paths_alone() {
        for throughput in [MIN_SURVIVAL, 0.005, 0.2, 0.94] {
            assert_eq!(survival(throughput), throughput);
        }
        assert_eq!([survival(0.003), survival(0.0)], [MIN_SURVIVAL; 2]);
        assert_eq!([survival(0.96), survival(7.0)], [MAX_SURVIVAL; 2]);
    }
}

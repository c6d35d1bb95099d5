//! What the camera sees beside radiance: features, which filters read as guides.
//!
//! Albedo and normal are those of the first surface that scatters light in many directions:
//! mirrors and glass show others, and paths are followed through them, with what they carry
//! (as Open Image Denoise and Cycles do). Where a path ends on its way, they are those of the
//! last surface that it came to.

use glam::{Vec3, Vec3A};

use super::{arrive::Surface, tracer::PathTracer, wave::Paths};
use crate::accelerator::{Hits, NONE};

/// The features of one sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct FeatureSample {
    /// Linear RGB in [0, 1]; of lamps, and where nothing is, the radiance, at most 1.
    pub(crate) albedo: Vec3,
    /// The unit shading normal in world space, on the side that the path came from; zero where
    /// nothing is.
    pub(crate) normal: Vec3,
    /// The distance from the camera to the first surface; 0 where nothing is.
    pub(crate) depth: f32,
    /// The part of the sample's radiance that the camera sees directly, or in glass: what a
    /// path brings that has not scattered but at mirrors and glass, if no light sample could
    /// have found it.
    pub(crate) emission: Vec3,
    /// Whether albedo and normal are found.
    pub(crate) is_settled: bool,
}

impl PathTracer<'_> {
    /// Takes the features where path `i` of a packet has arrived. `emitted` is what that adds to
    /// the sample's radiance; `surface` is what it has hit, if it has hit one.
    #[inline(always)]
    pub(super) fn see(
        &self,
        sample: &mut FeatureSample,
        paths: &Paths,
        hits: &Hits,
        i: usize,
        emitted: Vec3A,
        surface: Option<&Surface>,
    ) {
        if sample.is_settled {
            return;
        }
        let is_direct = paths.pdf[i] == f32::INFINITY;
        if is_direct {
            sample.emission += Vec3::from(emitted);
        }
        let throughput = paths.throughput.get(i);
        // What reaches the camera from there if no light sample shares the work.
        let shines =
            if is_direct { emitted.into() } else { throughput * self.shines(paths, hits, i) };
        let Some(surface) = surface else {
            sample.albedo = within_0_and_1(shines);
            sample.normal = Vec3::ZERO;
            sample.is_settled = true;
            return;
        };
        let facet = &self.facets[hits.triangle[i] as usize];
        let material = &self.scene.materials[facet.material as usize];
        let albedo = Vec3::from(material.albedo(surface.color));
        sample.albedo = within_0_and_1(throughput * albedo + shines);
        let side = paths.rays.direction.get(i).dot(facet.normal);
        sample.normal = surface.shading * -1.0_f32.copysign(side);
        sample.is_settled = !facet.shows_others;
    }

    /// The radiance that a path meets.
    #[cold]
    #[inline(never)]
    fn shines(&self, paths: &Paths, hits: &Hits, i: usize) -> Vec3 {
        let radiance = match hits.triangle[i] {
            NONE => self.scene.environment.radiance(paths.rays.direction.get(i).into()),
            triangle => {
                let barycentric = glam::Vec2::new(hits.u[i], hits.v[i]);
                self.scene.emission(&self.scene.triangles[triangle as usize], barycentric)
            }
        };
        radiance.into()
    }
}

/// Each coordinate, or 0 if it is not a number.
#[inline(always)]
fn within_0_and_1(color: Vec3) -> Vec3 {
    Vec3::from_array(color.to_array().map(|x| if x > 0.0 { x.min(1.0) } else { 0.0 }))
}

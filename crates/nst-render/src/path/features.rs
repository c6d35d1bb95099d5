//! What the camera sees beside radiance: features, which filters read as guides.
//!
//! Albedo and normal are those of the first surface that scatters light in many directions:
//! mirrors and glass show others, and paths are followed through them, with what they carry
//! (as Open Image Denoise and Cycles do). Where a path ends on its way, they are those of the
//! last surface that it came to.

use glam::{Vec3, Vec3A};

use super::{
    tracer::PathTracer,
    wave::{Paths, Points},
};
use crate::{
    accelerator::{Hits, NONE},
    packet::{PACKET, Vec3s},
};

/// The features of sixteen samples.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct FeaturePacket {
    /// Linear RGB in [0, 1]; of lamps, and where nothing is, the radiance, at most 1.
    pub(crate) albedo: Vec3s,
    /// The unit shading normal in world space, on the side that the path came from; zero where
    /// nothing is.
    pub(crate) normal: Vec3s,
    /// The part of the sample's radiance that the camera sees directly, or in glass: what a
    /// path brings that has not scattered but at mirrors and glass, if no light sample could
    /// have found it. Not written, and zero, unless the packet `emits`.
    pub(crate) emission: Vec3s,
    /// The distance from the camera to the first surface; 0 where nothing is.
    pub(crate) depth: [f32; PACKET],
    /// Whether albedo and normal are found.
    is_settled: [bool; PACKET],
    /// Whether a sample sees light directly: few do.
    pub(crate) emits: bool,
}

impl FeaturePacket {
    pub(crate) const NONE: Self = Self {
        albedo: Vec3s::ZERO,
        normal: Vec3s::ZERO,
        emission: Vec3s::ZERO,
        depth: [0.0; PACKET],
        is_settled: [false; PACKET],
        emits: false,
    };

    /// Begins with the first vertex. `is_settled`: whether no later one tells more.
    #[inline(always)]
    pub(super) fn begin(&mut self, hits: &Hits, is_settled: bool) {
        for i in 0..PACKET {
            self.depth[i] = if hits.triangle[i] == NONE { 0.0 } else { hits.t[i] };
        }
        self.is_settled = [is_settled; PACKET];
        self.emits = false;
    }

    /// Takes the light that a path from the camera meets first: a lamp's, or that of where
    /// nothing is.
    #[cold]
    #[inline(never)]
    pub(super) fn see_light(&mut self, i: usize, radiance: Vec3, has_hit: bool) {
        if radiance != Vec3::ZERO {
            self.shine(i, radiance);
        }
        if !has_hit {
            self.albedo.set(i, within_0_and_1(radiance));
            self.normal.set(i, Vec3::ZERO);
            self.is_settled[i] = true;
        }
    }

    /// Adds to what is seen directly.
    fn shine(&mut self, i: usize, radiance: Vec3) {
        if !self.emits {
            self.emission = Vec3s::ZERO;
            self.emits = true;
        }
        self.emission.set(i, self.emission.get(i) + radiance);
    }

    /// Makes a sample one that sees no light directly.
    pub(crate) fn darken(&mut self, i: usize) {
        self.emission.set(i, Vec3::ZERO);
    }
}

impl PathTracer<'_> {
    /// Takes the features of points that paths from the camera have come to first.
    #[inline(always)]
    pub(super) fn see_points(
        &self,
        points: &Points,
        are_lambert: bool,
        features: &mut [FeaturePacket],
    ) {
        let (mut albedo, mut normal) = (points.color, Vec3s::ZERO);
        for i in 0..PACKET {
            normal.set(i, points.shading.get(i) * facing(-points.wo.get(i), points.normal.get(i)));
        }
        if !are_lambert {
            for i in (0..PACKET).filter(|&i| points.path[i] != NONE) {
                let facet = &self.facets[points.triangle[i] as usize];
                let color = Vec3A::from(points.color.get(i));
                albedo.set(i, self.scene.materials[facet.material as usize].albedo(color).into());
            }
        }
        let first = points.path[0];
        let are_neighbours = (0..PACKET).all(|i| points.path[i] == first.wrapping_add(i as u32));
        let seen = features.get_mut(first as usize / PACKET);
        if let Some(seen) = seen.filter(|seen| {
            are_neighbours && first.is_multiple_of(PACKET as u32) && !seen.emits && are_lambert
        }) {
            for i in 0..PACKET {
                seen.albedo.set(i, within_0_and_1(albedo.get(i)));
            }
            seen.normal = normal;
            seen.is_settled = [true; PACKET];
            return;
        }
        for i in (0..PACKET).filter(|&i| points.path[i] != NONE) {
            let number = points.path[i] as usize;
            let (seen, place) = (&mut features[number / PACKET], number % PACKET);
            let shines = if seen.emits { seen.emission.get(place) } else { Vec3::ZERO };
            seen.albedo.set(place, within_0_and_1(albedo.get(i) + shines));
            seen.normal.set(place, normal.get(i));
            seen.is_settled[place] =
                are_lambert || !self.facets[points.triangle[i] as usize].shows_others;
        }
    }

    /// Begins a packet with what paths from the camera have come to, which have met this
    /// radiance, `[path]`. Where they go on, points of surfaces are left to [`Self::see_points`],
    /// which takes many at once; the little that is left comes after the loop over paths, which is
    /// the faster for it.
    #[inline(never)]
    pub(super) fn see_first(
        &self,
        seen: &mut FeaturePacket,
        paths: &Paths,
        hits: &Hits,
        radiance: &[Vec3A],
        is_last: bool,
    ) {
        seen.begin(hits, !is_last);
        for i in (0..PACKET).filter(|&i| paths.rays.tmax[i] >= 0.0) {
            if is_last {
                self.see_path(seen, paths, hits, i, true);
            } else if hits.triangle[i] == NONE || self.facets[hits.triangle[i] as usize].emits {
                let radiance = radiance[paths.path[i] as usize];
                seen.see_light(i, radiance.into(), hits.triangle[i] != NONE);
            }
        }
    }

    /// Takes the features of paths that have come to a later vertex.
    #[inline(never)]
    pub(super) fn see(&self, features: &mut [FeaturePacket], paths: &Paths, hits: &Hits) {
        for i in (0..PACKET).filter(|&i| paths.rays.tmax[i] >= 0.0) {
            self.see_path(&mut features[paths.path[i] as usize / PACKET], paths, hits, i, false);
        }
    }

    /// Takes the features where path `i` of a packet has arrived, if they are not settled.
    #[inline(always)]
    fn see_path(
        &self,
        seen: &mut FeaturePacket,
        paths: &Paths,
        hits: &Hits,
        i: usize,
        from_camera: bool,
    ) {
        let place = paths.path[i] as usize % PACKET;
        if seen.is_settled[place] {
            return;
        }
        let emitted = self.emitted(paths, hits, i, from_camera);
        let surface = (hits.triangle[i] != NONE).then(|| self.surface(paths, hits, i));
        let is_direct = paths.pdf[i] == f32::INFINITY;
        if is_direct && emitted != Vec3A::ZERO {
            seen.shine(place, emitted.into());
        }
        let throughput = paths.throughput.get(i);
        // What reaches the camera from there if no light sample shares the work.
        let shines =
            if is_direct { emitted.into() } else { throughput * self.shines(paths, hits, i) };
        let Some(surface) = surface else {
            seen.albedo.set(place, within_0_and_1(shines));
            seen.normal.set(place, Vec3::ZERO);
            seen.is_settled[place] = true;
            return;
        };
        let facet = &self.facets[hits.triangle[i] as usize];
        let albedo = if facet.lambert {
            surface.color
        } else {
            self.scene.materials[facet.material as usize].albedo(surface.color)
        };
        seen.albedo.set(place, within_0_and_1(throughput * Vec3::from(albedo) + shines));
        let facing = facing(paths.rays.direction.get(i), facet.normal);
        seen.normal.set(place, surface.shading * facing);
        seen.is_settled[place] = !facet.shows_others;
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

/// What turns a normal to the side that a direction comes from: 1 or −1.
#[inline(always)]
fn facing(direction: Vec3, normal: Vec3) -> f32 {
    -1.0_f32.copysign(direction.dot(normal))
}

/// Each coordinate, or 0 if it is not a number.
#[inline(always)]
fn within_0_and_1(color: Vec3) -> Vec3 {
    Vec3::from_array(
        color.to_array().map(|x| if x > 0.0 { if x < 1.0 { x } else { 1.0 } } else { 0.0 }),
    )
}

/// One sample of a packet.
#[cfg(test)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct FeatureSample {
    pub(crate) albedo: Vec3,
    pub(crate) normal: Vec3,
    pub(crate) depth: f32,
    pub(crate) emission: Vec3,
    pub(crate) is_settled: bool,
}

#[cfg(test)]
impl FeaturePacket {
    /// At most sixteen samples.
    pub(crate) fn of(samples: &[FeatureSample]) -> Self {
        let mut packet = Self::NONE;
        for (i, sample) in samples.iter().enumerate() {
            packet.albedo.set(i, sample.albedo);
            packet.normal.set(i, sample.normal);
            packet.depth[i] = sample.depth;
            packet.is_settled[i] = sample.is_settled;
            if sample.emission != Vec3::ZERO {
                packet.shine(i, sample.emission);
            }
        }
        packet
    }

    pub(crate) fn get(&self, i: usize) -> FeatureSample {
        FeatureSample {
            albedo: self.albedo.get(i),
            normal: self.normal.get(i),
            depth: self.depth[i],
            emission: if self.emits { self.emission.get(i) } else { Vec3::ZERO },
            is_settled: self.is_settled[i],
        }
    }
}

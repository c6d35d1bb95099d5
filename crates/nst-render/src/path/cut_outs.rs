//! Surfaces with holes. A point of opacity a is there with probability a, for each ray by
//! itself; where it is not, the ray goes on behind it. So the light along a ray is, on average,
//! a times that of the surface and 1 − a times that of what is behind, and all else, such as
//! densities and weights of light samples, stays as it is. Where a is 0 or 1, nothing is random.

use glam::Vec2;

use super::tracer::PathTracer;
use crate::{
    accelerator::{Hits, NONE, Rays, Stacks, offset},
    instructions::{Kernel, Vectors},
    packet::PACKET,
    sampler::Streams,
    scene::interpolate,
};

/// No ray meets more sheets before it meets something: a guard against rounding that sends a
/// ray to and fro between two of them. What it meets then counts as there.
const MOST_SHEETS: usize = 1 << 16;

impl PathTracer<'_> {
    /// The nearest hits of points that are there. `dimension` tells rays of one path apart.
    ///
    /// A call of its own: scenes without cut-outs should not pay for its size.
    #[cold]
    #[inline(never)]
    pub(super) fn see_through(
        &self,
        rays: &Rays,
        streams: &Streams,
        dimension: u32,
        stacks: &mut Stacks,
    ) -> Hits {
        self.instructions.run(SeeThrough { tracer: self, rays, streams, dimension, stacks })
    }
}

struct SeeThrough<'a> {
    tracer: &'a PathTracer<'a>,
    rays: &'a Rays,
    streams: &'a Streams,
    dimension: u32,
    stacks: &'a mut Stacks,
}

impl Kernel for SeeThrough<'_> {
    type Output = Hits;

    #[inline(always)]
    fn run<V: Vectors>(self, vectors: V) -> Hits {
        let mut hits = Hits::MISSED;
        // What is left of the rays, and how far they have come.
        let mut rest = *self.rays;
        let mut passed = [0.0; PACKET];
        for sheet in 0.. {
            let mut found = Hits::MISSED;
            self.tracer.accelerator.nearest(vectors, &rest, self.stacks, &mut found);
            let mut all_end = true;
            for i in (0..PACKET).filter(|&i| self.rays.tmax[i] >= 0.0) {
                if rest.tmax[i] < 0.0 {
                    continue;
                }
                if sheet < MOST_SHEETS && found.triangle[i] != NONE && !self.is_there(&found, i) {
                    passed[i] = self.go_on(&found, i, &mut rest);
                    all_end &= rest.tmax[i] < 0.0;
                    continue;
                }
                rest.tmax[i] = -1.0;
                hits.t[i] = passed[i] + found.t[i];
                (hits.u[i], hits.v[i]) = (found.u[i], found.v[i]);
                hits.triangle[i] = found.triangle[i];
            }
            if all_end {
                break;
            }
        }
        hits
    }
}

impl SeeThrough<'_> {
    fn is_there(&self, hits: &Hits, i: usize) -> bool {
        let index = hits.triangle[i];
        if !self.tracer.facets[index as usize].cut_out {
            return true;
        }
        let triangle = &self.tracer.scene.triangles[index as usize];
        let opacity = self.tracer.scene.opacity(triangle, Vec2::new(hits.u[i], hits.v[i]));
        opacity >= 1.0
            || opacity > 0.0 && self.streams.draw_aside(i, self.dimension, index) < opacity
    }

    /// Lets ray `i` begin anew behind its hit; or end, if it ends there. Returns how far it has
    /// come in all.
    fn go_on(&self, hits: &Hits, i: usize, rest: &mut Rays) -> f32 {
        let facet = &self.tracer.facets[hits.triangle[i] as usize];
        let direction = rest.direction.get(i);
        let normal = facet.normal * 1.0_f32.copysign(direction.dot(facet.normal));
        let point = interpolate(facet.corners, Vec2::new(hits.u[i], hits.v[i]));
        let origin = offset(point, normal, self.tracer.scale);
        rest.origin.set(i, origin);
        let come = (origin - self.rays.origin.get(i)).dot(direction) / direction.length_squared();
        let left = self.rays.tmax[i] - come;
        rest.tmax[i] = if left > 0.0 { left } else { -1.0 };
        come
    }
}

//! What paths have come to: lights, and surfaces where they are to scatter.

use glam::{Vec2, Vec3, Vec3A};

use super::{
    tracer::PathTracer,
    wave::{Paths, Points, Queue},
};
use crate::{
    accelerator::{Hits, NONE},
    light::pdf_solid_angle,
    scene::interpolate,
};

/// What a path needs of the surface that it has hit.
pub(super) struct Surface {
    /// Unit shading normal, on the same side of the surface as the geometric one.
    pub(super) shading: Vec3,
    /// Reflectance or base colour.
    pub(super) color: Vec3A,
}

impl PathTracer<'_> {
    /// What path `i` of the packet adds to its pixel where it has arrived: the radiance of
    /// a light or of the environment, times weight and throughput; or zero. `from_camera`:
    /// whether this is the first vertex.
    #[inline(always)]
    pub(super) fn emitted(&self, paths: &Paths, hits: &Hits, i: usize, from_camera: bool) -> Vec3A {
        let direction = Vec3A::from(paths.rays.direction.get(i));
        let (radiance, pdf_light) = if hits.triangle[i] == NONE {
            if let Some(background) = self.scene.environment.background.filter(|_| from_camera) {
                return background;
            }
            (self.scene.environment.radiance(direction), self.lights.pdf_escape(direction))
        } else {
            let index = hits.triangle[i] as usize;
            let facet = &self.facets[index];
            if !facet.emits {
                return Vec3A::ZERO;
            }
            let cosine = direction.dot(facet.normal.into());
            let barycentric = Vec2::new(hits.u[i], hits.v[i]);
            (
                self.scene.emission(&self.scene.triangles[index], barycentric),
                pdf_solid_angle(facet.pdf_area, hits.t[i], cosine),
            )
        };
        let weight = self.weight_bsdf(paths.pdf[i], pdf_light);
        Vec3A::from(paths.throughput.get(i)) * radiance * weight
    }

    /// The surface that path `from` of the packet has hit.
    #[inline(always)]
    pub(super) fn surface(&self, paths: &Paths, hits: &Hits, from: usize) -> Surface {
        let index = hits.triangle[from];
        let facet = &self.facets[index as usize];
        let barycentric = Vec2::new(hits.u[from], hits.v[from]);
        let direction = paths.rays.direction.get(from);
        let shading = if facet.smooth {
            self.smooth_normal(index, barycentric, direction)
        } else {
            facet.normal
        };
        let shading = if facet.relief {
            self.relief_normal(index, barycentric, direction, shading)
        } else {
            shading
        };
        let color = if facet.textured {
            self.scene.color(index, barycentric)
        } else {
            self.scene.materials[facet.material as usize].color
        };
        Surface { shading, color }
    }

    /// Puts path `from` of the packet, which has hit a surface, into the queue for its kind
    /// of material.
    #[inline(always)]
    pub(super) fn arrive(
        &self,
        paths: &Paths,
        hits: &Hits,
        from: usize,
        surface: &Surface,
        queues: &mut [Queue<Points>; 2],
    ) {
        let index = hits.triangle[from];
        let facet = &self.facets[index as usize];
        let barycentric = Vec2::new(hits.u[from], hits.v[from]);
        let (points, i) = queues[usize::from(!facet.lambert)].push();
        // The position is interpolated from the corners, not found along the ray: so its
        // error does not grow with the distance that the ray has come.
        points.position.set(i, interpolate(facet.corners, barycentric));
        points.normal.set(i, facet.normal);
        points.shading.set(i, surface.shading);
        points.wo.set(i, -paths.rays.direction.get(from));
        points.color.set(i, surface.color.into());
        points.throughput.set(i, paths.throughput.get(from));
        points.streams.copy(i, &paths.streams, from);
        points.path[i] = paths.path[from];
        points.triangle[i] = index;
    }

    /// The interpolated normal, on the side of the geometric one.
    fn smooth_normal(&self, triangle: u32, barycentric: Vec2, direction: Vec3) -> Vec3 {
        let normal = self.facets[triangle as usize].normal;
        let Some(normals) = self.scene.triangles[triangle as usize].normals else { return normal };
        let smooth = Vec3::from(interpolate(normals, barycentric)).normalize_or(normal);
        let smooth = if smooth.dot(normal) < 0.0 { -smooth } else { smooth };
        // At a silhouette, a smooth normal may face away from where the path came from,
        // and the geometric one not.
        if smooth.dot(direction) * normal.dot(direction) > 0.0 { smooth } else { normal }
    }
}

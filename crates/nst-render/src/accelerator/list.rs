//! A few triangles, all of them tested against sixteen rays at once: faster than
//! a tree while there are no more than [`MAX_LENGTH`].

use glam::{Vec3, Vec3A};

use super::{Hits, NONE, Rays};
use crate::lanes::LANES;

/// Where a tree begins to be faster.
pub(super) const MAX_LENGTH: usize = 64;

/// Triangles in the order of the scene.
pub(crate) struct List(Vec<Corner>);

/// A corner of a triangle, the edges from there, and their product.
struct Corner {
    position: Vec3,
    edges: [Vec3; 2],
    normal: Vec3,
}

impl List {
    pub(super) fn new(corners: &[[Vec3A; 3]]) -> Self {
        let corner = |&[a, b, c]: &[Vec3A; 3]| {
            let (e1, e2) = (b - a, c - a);
            Corner {
                position: a.into(),
                edges: [e1.into(), e2.into()],
                normal: e1.cross(e2).into(),
            }
        };
        Self(corners.iter().map(corner).collect())
    }

    #[inline(always)]
    pub(super) fn nearest(&self, rays: &Rays, hits: &mut Hits) {
        let mut nearest = Hits { t: rays.tmax, ..Hits::MISSED };
        for (triangle, corner) in (0..).zip(&self.0) {
            for i in 0..LANES {
                let (t, u, v) = corner.intersect(rays.origin.get(i), rays.direction.get(i));
                let closer = is_inside(u, v) & (t >= 0.0) & (t < nearest.t[i]);
                nearest.t[i] = if closer { t } else { nearest.t[i] };
                nearest.u[i] = if closer { u } else { nearest.u[i] };
                nearest.v[i] = if closer { v } else { nearest.v[i] };
                nearest.triangle[i] = if closer { triangle } else { nearest.triangle[i] };
            }
        }
        *hits = nearest;
    }

    #[inline(always)]
    pub(super) fn hides(&self, rays: &Rays) -> [bool; LANES] {
        let mut hidden = [NONE; LANES];
        for corner in &self.0 {
            for i in 0..LANES {
                let (t, u, v) = corner.intersect(rays.origin.get(i), rays.direction.get(i));
                let hit = is_inside(u, v) & (t >= 0.0) & (t < rays.tmax[i]);
                hidden[i] = if hit { 0 } else { hidden[i] };
            }
        }
        hidden.map(|triangle| triangle != NONE)
    }
}

impl Corner {
    /// Distance and barycentric weights where a ray meets the plane (Möller and
    /// Trumbore 1997, with the normal at hand); NaN for a ray within the plane.
    #[inline(always)]
    fn intersect(&self, origin: Vec3, direction: Vec3) -> (f32, f32, f32) {
        let c = self.position - origin;
        let inverse = 1.0 / self.normal.dot(direction);
        let r = c.cross(direction);
        let t = self.normal.dot(c) * inverse;
        (t, r.dot(self.edges[1]) * inverse, -r.dot(self.edges[0]) * inverse)
    }
}

/// All false for a NaN.
#[inline(always)]
fn is_inside(u: f32, v: f32) -> bool {
    (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
}

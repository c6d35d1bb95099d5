//! A few triangles, all of them tested against a packet of rays: faster than a tree
//! up to [`MAX_LENGTH`]. Two triangles that make a plane quadrilateral are tested as
//! one face, which takes little longer than one triangle.

use glam::{Vec3, Vec3A};

use super::rays::{Hits, NONE, Rays};
use crate::{
    instructions::{Floats, Vec3x, Vectors},
    packet::PACKET,
};

/// The longest list that is faster than a tree, by measurement.
pub(super) const MAX_LENGTH: usize = 64;

/// How far the fourth corner of a face may be off the plane of the others, relative
/// to the face's extent: a few roundings of the corners' coordinates in f32.
const PLANE_TOLERANCE: f64 = 4.0 * f32::EPSILON as f64;

/// All triangles, in the order of the scene.
pub(crate) struct List(Vec<Face>);

/// A triangle with corners a, b, c, or two of them with corners a, b, c and a, c, d.
struct Face {
    a: Vec3,
    /// b − a, c − a, d − a.
    edges: [Vec3; 3],
    /// (b − a) × (c − a)
    normal: Vec3,
    /// The area of the first triangle divided by that of the second; NaN if there is none.
    ratio: f32,
    /// The first triangle's index; the second's is the next one.
    triangle: u32,
}

/// Where rays meet a face's plane.
#[derive(Clone, Copy)]
struct Meeting<F> {
    /// Distances in units of the rays' directions.
    t: F,
    /// Barycentric weights in the triangle on that side of the diagonal.
    u: F,
    v: F,
    /// The bits of the triangle's index.
    triangle: F,
}

impl List {
    pub(super) fn new(corners: &[[Vec3A; 3]]) -> Self {
        let mut faces = Vec::new();
        let mut rest = corners;
        while let [first, others @ ..] = rest {
            let face = Face::new((corners.len() - rest.len()) as u32, first, others.first());
            rest = if face.ratio.is_nan() { others } else { &others[1..] };
            faces.push(face);
        }
        Self(faces)
    }

    #[inline(always)]
    pub(super) fn nearest<V: Vectors>(&self, vectors: V, rays: &Rays, hits: &mut Hits) {
        let proof = vectors.wide();
        for first in (0..PACKET).step_by(V::Wide::WIDTH) {
            let origin = rays.origin.load::<V::Wide>(proof, first);
            let direction = rays.direction.load::<V::Wide>(proof, first);
            let mut nearest = Meeting {
                t: Floats::load(proof, &rays.tmax[first..]),
                u: Floats::splat(proof, 0.0),
                v: Floats::splat(proof, 0.0),
                triangle: Floats::splat(proof, f32::from_bits(NONE)),
            };
            for face in &self.0 {
                let met = face.meet(proof, origin, direction);
                nearest = Meeting::select(met.is_within(proof, nearest.t), met, nearest);
            }
            nearest.t.store(&mut hits.t[first..]);
            nearest.u.store(&mut hits.u[first..]);
            nearest.v.store(&mut hits.v[first..]);
            nearest.triangle.store(bytemuck::cast_slice_mut(&mut hits.triangle[first..]));
        }
    }

    #[inline(always)]
    pub(super) fn hides<V: Vectors>(&self, vectors: V, rays: &Rays) -> [bool; PACKET] {
        let proof = vectors.wide();
        let mut hidden = [false; PACKET];
        for first in (0..PACKET).step_by(V::Wide::WIDTH) {
            let origin = rays.origin.load::<V::Wide>(proof, first);
            let direction = rays.direction.load::<V::Wide>(proof, first);
            let tmax = Floats::load(proof, &rays.tmax[first..]);
            let mut hit = 0;
            for face in &self.0 {
                hit |= V::Wide::bits(face.meet(proof, origin, direction).is_within(proof, tmax));
            }
            for i in 0..V::Wide::WIDTH {
                hidden[first + i] = hit >> i & 1 != 0;
            }
        }
        hidden
    }
}

impl Face {
    /// A face of the first triangle, and of the second if both make a plane quadrilateral.
    fn new(triangle: u32, first: &[Vec3A; 3], second: Option<&[Vec3A; 3]>) -> Self {
        let &[a, b, c] = first;
        let (d, ratio) = second
            .filter(|second| second[0] == a && second[1] == c)
            .and_then(|second| Some((second[2], ratio(a, b, c, second[2])?)))
            .unwrap_or((c, f32::NAN));
        let edges = [b - a, c - a, d - a].map(Vec3::from);
        Self { a: a.into(), edges, normal: edges[0].cross(edges[1]), ratio, triangle }
    }

    /// Möller and Trumbore (1997), with a normal that is computed in advance; NaN for a
    /// ray within the plane.
    #[inline(always)]
    fn meet<F: Floats>(
        &self,
        proof: F::Proof,
        origin: Vec3x<F>,
        direction: Vec3x<F>,
    ) -> Meeting<F> {
        let to_a = Vec3x::splat(proof, self.a) - origin;
        let normal = Vec3x::splat(proof, self.normal);
        let inverse = F::splat(proof, 1.0) / normal.dot(direction);
        let r = to_a.cross(direction);
        // Not `map`: see `Vec3x::splat`.
        let [b, c, d] = self.edges;
        let b = r.dot(Vec3x::splat(proof, b)) * inverse;
        let c = r.dot(Vec3x::splat(proof, c)) * inverse;
        let d = r.dot(Vec3x::splat(proof, d)) * inverse;
        // The diagonal from a to c divides the plane.
        let first = F::splat(proof, 0.0).at_most(c);
        let ratio = F::splat(proof, self.ratio);
        let index = |triangle| F::splat(proof, f32::from_bits(triangle));
        Meeting {
            t: normal.dot(to_a) * inverse,
            u: F::select(first, c, d * ratio),
            v: F::select(first, -b, -c * ratio),
            triangle: F::select(first, index(self.triangle), index(self.triangle + 1)),
        }
    }
}

impl<F: Floats> Meeting<F> {
    /// Where the meeting is in the triangle and on the ray; not where it is NaN.
    #[inline(always)]
    fn is_within(&self, proof: F::Proof, tmax: F) -> F::Mask {
        let &Self { t, u, v, .. } = self;
        let (zero, one) = (F::splat(proof, 0.0), F::splat(proof, 1.0));
        zero.at_most(u) & zero.at_most(v) & (u + v).at_most(one) & zero.at_most(t) & t.less(tmax)
    }

    #[inline(always)]
    fn select(mask: F::Mask, yes: Self, no: Self) -> Self {
        Self {
            t: F::select(mask, yes.t, no.t),
            u: F::select(mask, yes.u, no.u),
            v: F::select(mask, yes.v, no.v),
            triangle: F::select(mask, yes.triangle, no.triangle),
        }
    }
}

/// The area of the triangle a, b, c divided by that of a, c, d, if both are in one plane
/// and on different sides of a, c.
fn ratio(a: Vec3A, b: Vec3A, c: Vec3A, d: Vec3A) -> Option<f32> {
    let [b, c, d] = [b, c, d].map(|corner| (corner - a).as_dvec3());
    let (first, second) = (b.cross(c), c.cross(d));
    let extent = b.length().max(c.length()).max(d.length());
    let height = first.dot(d) / first.length();
    let is_plane = height.abs() <= PLANE_TOLERANCE * extent && first.dot(second) > 0.0;
    is_plane.then(|| (first.length() / second.length()) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plane_quadrilaterals_are_one_face() {
        let faces = |d: [f32; 3], diagonal: [usize; 2]| {
            let corners =
                [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 2.0, 0.0], d].map(Vec3A::from_array);
            let second = [corners[0], corners[diagonal[0]], corners[diagonal[1]]];
            List::new(&[[corners[0], corners[1], corners[2]], second]).0.len()
        };
        assert_eq!(faces([0.0, 2.0, 0.0], [2, 3]), 1);
        assert_eq!(faces([0.0, 2.0, 1e-3], [2, 3]), 2, "bent");
        assert_eq!(faces([0.0, 2.0, 0.0], [3, 2]), 2, "wound the other way");
        assert_eq!(faces([3.0, 1.0, 0.0], [2, 3]), 2, "folded over");
        assert_eq!(faces([6.0, 4.0, 0.0], [2, 3]), 2, "without area");
    }
}

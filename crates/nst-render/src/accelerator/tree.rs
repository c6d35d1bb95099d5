//! Traversal of an eight-wide compressed BVH (Ylitie, Karras, Laine 2017).

use glam::{Vec2, Vec3A};
use obvhs::cwbvh::{CwBvh, node::CwBvhNode};
use smallvec::SmallVec;

use super::{Hits, Rays};
use crate::lanes::LANES;

/// A ray from 0 to `tmax`, in units of its direction.
#[derive(Clone, Copy)]
struct Ray {
    origin: Vec3A,
    direction: Vec3A,
    inverse: Vec3A,
    tmax: f32,
}

impl Ray {
    #[inline(always)]
    fn new(rays: &Rays, lane: usize) -> Self {
        let direction = Vec3A::from(rays.direction.get(lane));
        // Where a component is 0, a large inverse of its sign does, and makes no NaN.
        let least = Vec3A::splat(1e-18);
        let divisor =
            Vec3A::select(direction.abs().cmplt(least), least.copysign(direction), direction);
        Self {
            origin: rays.origin.get(lane).into(),
            direction,
            inverse: divisor.recip(),
            tmax: rays.tmax[lane],
        }
    }
}

/// An intersection.
#[derive(Clone, Copy)]
struct Hit {
    t: f32,
    triangle: u32,
    barycentric: Vec2,
}

/// The nodes of a tree, and the triangles of their leaves.
pub(crate) struct Tree {
    nodes: Vec<CwBvhNode>,
    /// The triangles of one node take up to three blocks of their own.
    blocks: Vec<Block>,
}

impl Tree {
    /// Takes obvhs' tree and the corners of the triangles it was built from.
    pub(super) fn new(bvh: CwBvh, corners: &[[Vec3A; 3]]) -> Self {
        let mut nodes = bvh.nodes;
        let mut blocks = Vec::new();
        for node in &mut nodes {
            let leaves = (0..8).filter(|&child| node.is_leaf(child) && !node.is_child_empty(child));
            let end = |child| {
                let (first, count) = node.child_primitives(child);
                first + count
            };
            let first = node.primitive_base_idx;
            let count = leaves.map(end).max().unwrap_or(first) - first;
            let indices = &bvh.primitive_indices[first as usize..(first + count) as usize];
            // From here on, the index of the node's first block.
            node.primitive_base_idx = blocks.len() as u32;
            blocks.extend(indices.chunks(WIDTH).map(|chunk| Block::new(chunk, corners)));
        }
        Self { nodes, blocks }
    }

    #[inline(always)]
    pub(super) fn nearest(&self, rays: &Rays, hits: &mut Hits) {
        *hits = Hits::MISSED;
        for i in (0..LANES).filter(|&i| rays.tmax[i] >= 0.0) {
            if let Some(hit) = self.traverse::<false>(Ray::new(rays, i)) {
                hits.t[i] = hit.t;
                hits.triangle[i] = hit.triangle;
                hits.u[i] = hit.barycentric.x;
                hits.v[i] = hit.barycentric.y;
            }
        }
    }

    #[inline(always)]
    pub(super) fn hides(&self, rays: &Rays) -> [bool; LANES] {
        let mut hidden = [false; LANES];
        for i in (0..LANES).filter(|&i| rays.tmax[i] >= 0.0) {
            hidden[i] = self.traverse::<true>(Ray::new(rays, i)).is_some();
        }
        hidden
    }

    /// The nearest hit, or with `ANY` the first that turns up.
    #[inline(always)]
    fn traverse<const ANY: bool>(&self, mut ray: Ray) -> Option<Hit> {
        let slabs = Slabs::new(&ray);
        let mut found = None;
        let mut stack: SmallVec<[Group; 24]> = SmallVec::new();
        let mut group = Group { base: 0, bits: 1 << 31 };
        loop {
            let child = 31 - group.bits.leading_zeros();
            let inner = group.bits;
            group.bits &= !(1 << child);
            if group.bits & HITS != 0 {
                stack.push(group);
            }
            let slot = (child - 24) ^ (slabs.octant & 0xff);
            let before = (inner & !(u32::MAX << slot) & 0xff).count_ones();
            let node = &self.nodes[(group.base + before) as usize];
            let hits = slabs.hits(node, ray.tmax);

            let mut triangles = hits & !HITS;
            let mut block = node.primitive_base_idx as usize;
            while triangles != 0 {
                if let Some(hit) = self.blocks[block].intersect(&ray, triangles & 0xff) {
                    if ANY {
                        return Some(hit);
                    }
                    ray.tmax = hit.t;
                    found = Some(hit);
                }
                triangles >>= WIDTH;
                block += 1;
            }

            group = Group { base: node.child_base_idx, bits: hits & HITS | u32::from(node.imask) };
            if group.bits & HITS == 0 {
                match stack.pop() {
                    Some(next) => group = next,
                    None => return found,
                }
            }
        }
    }
}

/// How many boxes, and how many triangles, are tested at once.
const WIDTH: usize = 8;

/// Eight triangles, coordinate by coordinate. Slots that are left over hold a
/// point, which no ray hits.
#[derive(Clone, Debug)]
struct Block {
    corner: [[f32; WIDTH]; 3],
    /// To the second and to the third corner.
    edges: [[[f32; WIDTH]; 3]; 2],
    /// The product of the edges.
    normal: [[f32; WIDTH]; 3],
    triangles: [u32; WIDTH],
}

impl Block {
    fn new(indices: &[u32], corners: &[[Vec3A; 3]]) -> Self {
        let mut block = Self {
            corner: [[0.0; WIDTH]; 3],
            edges: [[[0.0; WIDTH]; 3]; 2],
            normal: [[0.0; WIDTH]; 3],
            triangles: [u32::MAX; WIDTH],
        };
        for (slot, &index) in indices.iter().enumerate() {
            let [a, b, c] = corners[index as usize];
            let (e1, e2) = (b - a, c - a);
            let normal = e1.cross(e2);
            for axis in 0..3 {
                block.corner[axis][slot] = a[axis];
                block.edges[0][axis][slot] = e1[axis];
                block.edges[1][axis][slot] = e2[axis];
                block.normal[axis][slot] = normal[axis];
            }
            block.triangles[slot] = index;
        }
        block
    }

    /// The nearest hit within the ray's interval among the slots of `wanted`
    /// (Möller and Trumbore 1997, with the normal at hand).
    #[inline(always)]
    fn intersect(&self, ray: &Ray, wanted: u32) -> Option<Hit> {
        let [ox, oy, oz] = ray.origin.to_array();
        let [dx, dy, dz] = ray.direction.to_array();
        let ([ax, ay, az], [nx, ny, nz]) = (&self.corner, &self.normal);
        let [[e1x, e1y, e1z], [e2x, e2y, e2z]] = &self.edges;
        let (mut t, mut u, mut v) = ([0.0_f32; WIDTH], [0.0_f32; WIDTH], [0.0_f32; WIDTH]);
        let mut hits = 0;
        for i in 0..WIDTH {
            let (cx, cy, cz) = (ax[i] - ox, ay[i] - oy, az[i] - oz);
            let inverse = 1.0 / (nx[i] * dx + ny[i] * dy + nz[i] * dz);
            let (rx, ry, rz) = (cy * dz - cz * dy, cz * dx - cx * dz, cx * dy - cy * dx);
            t[i] = (nx[i] * cx + ny[i] * cy + nz[i] * cz) * inverse;
            u[i] = (rx * e2x[i] + ry * e2y[i] + rz * e2z[i]) * inverse;
            v[i] = -(rx * e1x[i] + ry * e1y[i] + rz * e1z[i]) * inverse;
        }
        for i in 0..WIDTH {
            // All false for a NaN, of a ray in the plane of the triangle.
            let inside = (u[i] >= 0.0) & (v[i] >= 0.0) & (u[i] + v[i] <= 1.0);
            let within = (t[i] >= 0.0) & (t[i] < ray.tmax);
            hits |= u32::from(inside & within) << i;
        }
        hits &= wanted;
        let mut nearest: Option<Hit> = None;
        while hits != 0 {
            let i = hits.trailing_zeros() as usize;
            hits &= hits - 1;
            if nearest.is_none_or(|hit| t[i] < hit.t) {
                let barycentric = Vec2::new(u[i], v[i]);
                nearest = Some(Hit { t: t[i], triangle: self.triangles[i], barycentric });
            }
        }
        nearest
    }
}

/// Children of one node that are still to be visited: in the upper byte those
/// that were hit, in the order of the ray's octant; in the lower byte which
/// children are inner nodes, to find their index.
#[derive(Clone, Copy)]
struct Group {
    base: u32,
    bits: u32,
}

const HITS: u32 = 0xff00_0000;

/// What the test of a node needs of a ray.
struct Slabs {
    origin: Vec3A,
    inverse: Vec3A,
    negative: [bool; 3],
    /// The child order of the ray's octant, in each byte.
    octant: u32,
}

/// Makes up for the rounding of the far distances (Ize 2013).
const SLACK: f32 = 1.0 + 8.0 * f32::EPSILON;

impl Slabs {
    #[inline(always)]
    fn new(ray: &Ray) -> Self {
        let negative = ray.direction.to_array().map(|x| x < 0.0);
        let bit = |axis: usize, bit: u32| if negative[axis] { 0 } else { bit * 0x0101_0101 };
        Self {
            origin: ray.origin,
            inverse: ray.inverse,
            negative,
            octant: bit(0, 4) | bit(1, 2) | bit(2, 1),
        }
    }

    /// The children hit, as `Group` orders them, and in the lower 24 bits the
    /// triangles of the leaves that were hit.
    #[inline(always)]
    fn hits(&self, node: &CwBvhNode, tmax: f32) -> u32 {
        let scale = node.compute_extent() * self.inverse;
        let origin = (Vec3A::from(node.p) - self.origin) * self.inverse;
        let mut near = [0.0; WIDTH];
        let mut far = [tmax; WIDTH];
        let planes = [
            (&node.child_min_x, &node.child_max_x),
            (&node.child_min_y, &node.child_max_y),
            (&node.child_min_z, &node.child_max_z),
        ];
        for (axis, (low, high)) in planes.into_iter().enumerate() {
            let (first, second) = if self.negative[axis] { (high, low) } else { (low, high) };
            let (scale, origin) = (scale[axis], origin[axis]);
            for i in 0..WIDTH {
                let enter = f32::from(first[i]) * scale + origin;
                let leave = f32::from(second[i]) * scale + origin;
                near[i] = if enter > near[i] { enter } else { near[i] };
                far[i] = if leave < far[i] { leave } else { far[i] };
            }
        }
        let (bits, shifts) = node.get_child_and_index_bits(self.octant);
        let (bits, shifts) = (bits.to_le_bytes(), shifts.to_le_bytes());
        let mut hits = [0_u32; WIDTH];
        for i in 0..WIDTH {
            let hit = u32::from(near[i] <= far[i] * SLACK).wrapping_neg();
            hits[i] = hit & (u32::from(bits[i]) << u32::from(shifts[i] & 31));
        }
        hits.into_iter().fold(0, |all, hit| all | hit)
    }
}

//! Traversal of an eight-wide compressed BVH (Ylitie, Karras, Laine 2017) by a packet
//! of rays in turns: while one waits for its node from memory, or for the outcome of
//! its tests, the others work.

use glam::{Vec3, Vec3A};
use obvhs::cwbvh::{CwBvh, node::CwBvhNode};

use super::rays::{Hits, NONE, Rays};
use crate::{
    instructions::{Boxes, Floats, Vec3x, Vectors},
    packet::PACKET,
};

/// How many boxes, and how many triangles, are tested at once: a node's children.
const WIDTH: usize = 8;
/// The most blocks that a node's triangles fill: eight leaves of up to three triangles.
const MAX_BLOCKS: usize = 3;

/// The nodes of a tree, and the triangles of their leaves.
pub(crate) struct Tree {
    nodes: Vec<Node>,
    /// The blocks of one node follow each other.
    blocks: Vec<Block>,
}

/// Eight boxes, on a grid of 256³ steps. obvhs sorts them into slots so that a ray is
/// likely to meet the box of slot `s` as number `s ^ octant`.
#[repr(align(64))]
struct Node {
    origin: Vec3,
    /// Of a step of the grid.
    size: Vec3,
    /// Lower and upper bounds along x, y and z.
    planes: [[[u8; WIDTH]; 2]; 3],
    /// Index of the first inner child; the others follow in the order of slots.
    first_child: u32,
    first_block: u32,
    /// The slots of inner children.
    inner: u8,
    /// The slots of leaves that have triangles in each block.
    leaves: [u8; MAX_BLOCKS],
}

/// Eight triangles, coordinate by coordinate: a corner and the edges from there.
/// Slots that are left over contain a point, which no ray hits.
#[repr(align(64))]
struct Block {
    corner: [[f32; WIDTH]; 3],
    edges: [[[f32; WIDTH]; 3]; 2],
    triangles: [u32; WIDTH],
}

impl Tree {
    /// A tree like `bvh`, which was built from the triangles with these corners.
    pub(super) fn new(bvh: &CwBvh, corners: &[[Vec3A; 3]]) -> Self {
        let mut blocks = Vec::new();
        let nodes = bvh.nodes.iter().map(|node| {
            let first_block = blocks.len() as u32;
            let mut leaves = [0; MAX_BLOCKS];
            let mut used = 0;
            for child in (0..WIDTH).filter(|&c| node.is_leaf(c) && !node.is_child_empty(c)) {
                let (first, count) = node.child_primitives(child);
                for &triangle in &bvh.primitive_indices[first as usize..(first + count) as usize] {
                    if used % WIDTH == 0 {
                        blocks.push(Block::EMPTY);
                    }
                    let block = blocks.last_mut().expect("one was just pushed");
                    block.set(used % WIDTH, triangle, corners[triangle as usize]);
                    leaves[used / WIDTH] |= 1 << child;
                    used += 1;
                }
            }
            Node::new(node, first_block, leaves)
        });
        Self { nodes: nodes.collect(), blocks }
    }

    #[inline(always)]
    pub(super) fn nearest<V: Vectors>(
        &self,
        vectors: V,
        rays: &Rays,
        stacks: &mut Stacks,
        hits: &mut Hits,
    ) {
        *hits = Hits { t: rays.tmax, ..Hits::MISSED };
        self.traverse::<V, false>(vectors, rays, stacks, hits);
    }

    #[inline(always)]
    pub(super) fn hides<V: Vectors>(
        &self,
        vectors: V,
        rays: &Rays,
        stacks: &mut Stacks,
    ) -> [bool; PACKET] {
        let mut hits = Hits { t: rays.tmax, ..Hits::MISSED };
        self.traverse::<V, true>(vectors, rays, stacks, &mut hits);
        hits.triangle.map(|triangle| triangle != NONE)
    }

    /// Finds the nearest hit of each ray, or with `ANY` the first that is found.
    #[inline(always)]
    fn traverse<V: Vectors, const ANY: bool>(
        &self,
        vectors: V,
        rays: &Rays,
        stacks: &mut Stacks,
        hits: &mut Hits,
    ) {
        let mut slabs = [Slabs::NONE; PACKET];
        let mut visits = [Visit::ROOT; PACKET];
        let mut boxes = [0_u32; PACKET];
        let mut active = [0_usize; PACKET];
        let mut count = 0;
        for i in 0..PACKET {
            slabs[i] = Slabs::new(rays, i);
            stacks.0[i].clear();
            active[count] = i;
            count += usize::from(rays.tmax[i] >= 0.0);
        }
        while count > 0 {
            // Nothing here depends on another ray's outcome: the processor works on
            // several rays at once.
            for &i in &active[..count] {
                boxes[i] = slabs[i].hits(vectors, &self.nodes[visits[i].node as usize], hits.t[i]);
            }
            let mut left = 0;
            for k in 0..count {
                let i = active[k];
                let node = &self.nodes[visits[i].node as usize];
                let mut found = false;
                for (block, &leaves) in node.leaves.iter().enumerate() {
                    if boxes[i] & u32::from(leaves) != 0 {
                        let block = &self.blocks[node.first_block as usize + block];
                        found |= block.intersect::<V, ANY>(vectors, &slabs[i], hits, i);
                    }
                }
                if (ANY && found)
                    || !visits[i].advance(node, boxes[i], slabs[i].octant, &mut stacks.0[i])
                {
                    continue;
                }
                vectors.prefetch(&self.nodes[visits[i].node as usize]);
                active[left] = i;
                left += 1;
            }
            count = left;
        }
    }
}

impl Node {
    fn new(node: &CwBvhNode, first_block: u32, leaves: [u8; MAX_BLOCKS]) -> Self {
        Self {
            origin: node.p,
            size: node.compute_extent().into(),
            planes: [
                [node.child_min_x, node.child_max_x],
                [node.child_min_y, node.child_max_y],
                [node.child_min_z, node.child_max_z],
            ],
            first_child: node.child_base_idx,
            first_block,
            inner: node.imask,
            leaves,
        }
    }
}

impl Block {
    const EMPTY: Self =
        Self { corner: [[0.0; WIDTH]; 3], edges: [[[0.0; WIDTH]; 3]; 2], triangles: [NONE; WIDTH] };

    fn set(&mut self, slot: usize, triangle: u32, [a, b, c]: [Vec3A; 3]) {
        for axis in 0..3 {
            self.corner[axis][slot] = a[axis];
            self.edges[0][axis][slot] = b[axis] - a[axis];
            self.edges[1][axis][slot] = c[axis] - a[axis];
        }
        self.triangles[slot] = triangle;
    }

    /// Whether there is a hit nearer than hit `i`, which it then replaces (Möller and
    /// Trumbore 1997): by the nearest one, or with `ANY` by any.
    #[inline(always)]
    fn intersect<V: Vectors, const ANY: bool>(
        &self,
        vectors: V,
        ray: &Slabs,
        hits: &mut Hits,
        i: usize,
    ) -> bool {
        let proof = vectors.eight();
        let (zero, one) = (V::Eight::splat(proof, 0.0), V::Eight::splat(proof, 1.0));
        let direction = Vec3x::splat(proof, ray.direction);
        let (e1, e2) = (load(proof, &self.edges[0]), load(proof, &self.edges[1]));
        let s = Vec3x::splat(proof, ray.origin) - load(proof, &self.corner);
        let p = direction.cross(e2);
        let q = s.cross(e1);
        let inverse = one / e1.dot(p);
        let t = e2.dot(q) * inverse;
        let u = s.dot(p) * inverse;
        let v = direction.dot(q) * inverse;
        // Not where they are NaN, of a ray in the plane of the triangle.
        let inside = zero.at_most(u) & zero.at_most(v) & (u + v).at_most(one);
        let within = zero.at_most(t) & t.less(V::Eight::splat(proof, hits.t[i]));
        let mut mask = V::Eight::bits(inside & within);
        if mask == 0 {
            return false;
        }
        let [mut ts, mut us, mut vs] = [[0.0; WIDTH]; 3];
        t.store(&mut ts);
        u.store(&mut us);
        v.store(&mut vs);
        while mask != 0 {
            let slot = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            if ts[slot] < hits.t[i] {
                hits.t[i] = ts[slot];
                hits.u[i] = us[slot];
                hits.v[i] = vs[slot];
                hits.triangle[i] = self.triangles[slot];
            }
            if ANY {
                break;
            }
        }
        true
    }
}

/// Inner children of one node that are still to be visited.
#[derive(Clone, Copy)]
struct Group {
    first_child: u32,
    /// The slots of all inner children.
    inner: u32,
    /// The slots of the children still to be visited, in the order of [`ORDER`].
    children: u32,
}

/// Where a ray is, and what it still has to visit below the nodes on its stack.
#[derive(Clone, Copy)]
struct Visit {
    node: u32,
    group: Group,
}

/// By ray: what is still to be visited of nodes farther up. The memory of one query
/// serves the next one.
#[derive(Default)]
pub(crate) struct Stacks([Vec<Group>; PACKET]);

impl Visit {
    const ROOT: Self = Self { node: 0, group: Group { first_child: 0, inner: 0, children: 0 } };

    /// Goes on to the next node; false if there is none. `boxes`: the slots of `node` whose
    /// boxes the ray meets.
    #[inline(always)]
    fn advance(&mut self, node: &Node, boxes: u32, octant: usize, stack: &mut Vec<Group>) -> bool {
        let inner = u32::from(node.inner);
        let children = u32::from(ORDER[octant][(boxes & inner) as usize]);
        if children != 0 {
            if self.group.children != 0 {
                stack.push(self.group);
            }
            self.group = Group { first_child: node.first_child, inner, children };
        } else if self.group.children == 0 {
            let Some(group) = stack.pop() else { return false };
            self.group = group;
        }
        let first = self.group.children.trailing_zeros();
        self.group.children &= self.group.children - 1;
        let slot = first ^ octant as u32;
        let before = self.group.inner & ((1 << slot) - 1);
        self.node = self.group.first_child + before.count_ones();
        true
    }
}

/// By octant and by set of slots, as bits: the same set, with the bit of the slot that a
/// ray is likely to meet first as the lowest.
static ORDER: [[u8; 256]; 8] = {
    let mut order = [[0; 256]; 8];
    let mut octant = 0;
    while octant < 8 {
        let mut set = 0;
        while set < 256 {
            let mut slot = 0;
            while slot < 8 {
                if set >> slot & 1 != 0 {
                    order[octant][set] |= 1 << (slot ^ octant);
                }
                slot += 1;
            }
            set += 1;
        }
        octant += 1;
    }
    order
};

/// A ray, and what tests of nodes need of it.
#[derive(Clone, Copy)]
struct Slabs {
    origin: Vec3,
    direction: Vec3,
    inverse: Vec3,
    /// By axis: 1 if the ray leaves a box at its upper plane, 0 if at its lower one.
    far: [usize; 3],
    /// Bit 2 is set if x decreases along the ray, bit 1 if y does, bit 0 if z does.
    octant: usize,
}

/// A component of a direction that is smaller is replaced by this, with its sign. Its
/// inverse is then finite, and so 0 times the inverse is no NaN; a unit direction changes
/// by far less than f32 resolves.
const LEAST: f32 = 1e-18;

/// The far distances are raised by this, for their rounding (Ize 2013: Robust BVH Ray
/// Traversal).
const SLACK: f32 = 1.0 + 8.0 * f32::EPSILON;

impl Slabs {
    const NONE: Self = Self {
        origin: Vec3::ZERO,
        direction: Vec3::ZERO,
        inverse: Vec3::ZERO,
        far: [0; 3],
        octant: 0,
    };

    #[inline(always)]
    fn new(rays: &Rays, i: usize) -> Self {
        let direction = rays.direction.get(i);
        let divisor = |x: f32| if x.abs() < LEAST { LEAST.copysign(x) } else { x };
        // By the sign bit, like the inverse: −0 counts as backward.
        let forward = |x: f32| usize::from(x.is_sign_positive());
        let far = [forward(direction.x), forward(direction.y), forward(direction.z)];
        Self {
            origin: rays.origin.get(i),
            direction,
            inverse: Vec3::new(divisor(direction.x), divisor(direction.y), divisor(direction.z))
                .recip(),
            far,
            octant: (far[0] << 2 | far[1] << 1 | far[2]) ^ 7,
        }
    }

    /// The slots whose boxes the ray meets before `tmax`.
    #[inline(always)]
    fn hits<V: Vectors>(&self, vectors: V, node: &Node, tmax: f32) -> u32 {
        let step = node.size * self.inverse;
        let origin = (node.origin - self.origin) * self.inverse;
        let planes = |axis: usize| {
            let planes = &node.planes[axis];
            (&planes[1 - self.far[axis]], &planes[self.far[axis]])
        };
        vectors.overlaps(&Boxes {
            bounds: [planes(0), planes(1), planes(2)],
            step: step.to_array(),
            origin: origin.to_array(),
            end: tmax,
            slack: SLACK,
        })
    }
}

/// Eight vectors, coordinate by coordinate.
#[inline(always)]
fn load<F: Floats>(proof: F::Proof, [x, y, z]: &[[f32; WIDTH]; 3]) -> Vec3x<F> {
    Vec3x::new(F::load(proof, x), F::load(proof, y), F::load(proof, z))
}

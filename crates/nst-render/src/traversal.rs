//! Traversal of an eight-wide compressed BVH (Ylitie, Karras, Laine 2017),
//! compiled twice: for any processor, and for those with AVX2.
//!
//! The two give the same bits: both round after every multiplication.

use glam::Vec3A;
use obvhs::{cwbvh::node::CwBvhNode, ray::Ray, rt_triangle::RtTriangle};
use smallvec::SmallVec;

/// Which instructions the processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Instructions {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Instructions {
    pub(crate) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt")
        {
            return Self::Avx2;
        }
        Self::Portable
    }
}

/// The nodes of a tree, and the triangles in the order of its leaves.
pub(crate) struct Tree {
    pub(crate) nodes: Vec<CwBvhNode>,
    pub(crate) triangles: Vec<RtTriangle>,
    pub(crate) instructions: Instructions,
}

impl Tree {
    /// The distance and the index of the nearest triangle in the ray's interval.
    pub(crate) fn nearest(&self, ray: &Ray) -> Option<(f32, u32)> {
        match self.instructions {
            Instructions::Portable => traverse::<false>(self, ray),
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: `Instructions::detect` found the features.
            Instructions::Avx2 => unsafe { nearest_avx2(self, ray) },
        }
    }

    /// Whether there is any triangle in the ray's interval.
    pub(crate) fn any(&self, ray: &Ray) -> bool {
        match self.instructions {
            Instructions::Portable => traverse::<true>(self, ray).is_some(),
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: `Instructions::detect` found the features.
            Instructions::Avx2 => unsafe { any_avx2(self, ray) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn nearest_avx2(tree: &Tree, ray: &Ray) -> Option<(f32, u32)> {
    traverse::<false>(tree, ray)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn any_avx2(tree: &Tree, ray: &Ray) -> bool {
    traverse::<true>(tree, ray).is_some()
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

/// The nearest hit, or with `ANY` the first that turns up.
#[inline(always)]
fn traverse<const ANY: bool>(tree: &Tree, ray: &Ray) -> Option<(f32, u32)> {
    let slabs = Slabs::new(ray);
    let mut ray = *ray;
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
        let node = &tree.nodes[(group.base + before) as usize];
        let hits = slabs.hits(node, ray.tmax);

        let mut triangles = hits & !HITS;
        while triangles != 0 {
            let index = node.primitive_base_idx + triangles.trailing_zeros();
            triangles &= triangles - 1;
            let t = tree.triangles[index as usize].intersect(&ray);
            if t < ray.tmax {
                ray.tmax = t;
                found = Some((t, index));
                if ANY {
                    return found;
                }
            }
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

/// What the test of a node needs of a ray.
struct Slabs {
    origin: Vec3A,
    inverse: Vec3A,
    negative: [bool; 3],
    tmin: f32,
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
            inverse: ray.inv_direction,
            negative,
            tmin: ray.tmin,
            octant: bit(0, 4) | bit(1, 2) | bit(2, 1),
        }
    }

    /// The children hit, as `Group` orders them, and in the lower 24 bits the
    /// triangles of the leaves that were hit.
    #[inline(always)]
    fn hits(&self, node: &CwBvhNode, tmax: f32) -> u32 {
        let scale = node.compute_extent() * self.inverse;
        let origin = (Vec3A::from(node.p) - self.origin) * self.inverse;
        let mut near = [self.tmin; 8];
        let mut far = [tmax; 8];
        let planes = [
            (&node.child_min_x, &node.child_max_x),
            (&node.child_min_y, &node.child_max_y),
            (&node.child_min_z, &node.child_max_z),
        ];
        for (axis, (low, high)) in planes.into_iter().enumerate() {
            let (first, second) = if self.negative[axis] { (high, low) } else { (low, high) };
            let (scale, origin) = (scale[axis], origin[axis]);
            for i in 0..8 {
                let enter = f32::from(first[i]) * scale + origin;
                let leave = f32::from(second[i]) * scale + origin;
                near[i] = if enter > near[i] { enter } else { near[i] };
                far[i] = if leave < far[i] { leave } else { far[i] };
            }
        }
        let (bits, shifts) = node.get_child_and_index_bits(self.octant);
        let (bits, shifts) = (bits.to_le_bytes(), shifts.to_le_bytes());
        let mut hits = [0_u32; 8];
        for i in 0..8 {
            let hit = u32::from(near[i] <= far[i] * SLACK).wrapping_neg();
            hits[i] = hit & (u32::from(bits[i]) << u32::from(shifts[i] & 31));
        }
        hits.into_iter().fold(0, |all, hit| all | hit)
    }
}

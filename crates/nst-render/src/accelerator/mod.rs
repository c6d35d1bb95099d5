//! What rays hit first, and whether they hit anything, among the triangles of a scene:
//! by a tree, or by a list if there are few.

mod list;
mod rays;
mod tree;

use std::time::Duration;

use glam::{Vec3, Vec3A};
use obvhs::{BvhBuildParams, cwbvh::builder::build_cwbvh_from_tris};

use crate::{Triangle, instructions::Vectors, packet::PACKET};
use {list::List, tree::Tree};

pub(crate) use {
    rays::{Hits, NONE, Rays},
    tree::Stacks,
};

/// Finds what rays hit.
pub(crate) enum Accelerator {
    List(List),
    Tree(Tree),
}

/// With at most this number of triangles, the tree is built as well as obvhs can: it
/// then takes a fifth of a second at most.
const THOROUGH_BUILD: usize = 1 << 15;

impl Accelerator {
    pub(crate) fn new(triangles: &[Triangle]) -> Self {
        let corners: Vec<_> = triangles.iter().map(|triangle| triangle.positions).collect();
        if corners.len() <= list::MAX_LENGTH {
            Self::List(List::new(&corners))
        } else {
            Self::Tree(build_tree(&corners))
        }
    }

    /// The nearest hits in the rays' intervals.
    #[inline(always)]
    pub(crate) fn nearest<V: Vectors>(
        &self,
        vectors: V,
        rays: &Rays,
        stacks: &mut Stacks,
        hits: &mut Hits,
    ) {
        match self {
            Self::List(list) => list.nearest(vectors, rays, hits),
            Self::Tree(tree) => tree.nearest(vectors, rays, stacks, hits),
        }
    }

    /// Whether there is any triangle in the rays' intervals.
    #[inline(always)]
    pub(crate) fn hides<V: Vectors>(
        &self,
        vectors: V,
        rays: &Rays,
        stacks: &mut Stacks,
    ) -> [bool; PACKET] {
        match self {
            Self::List(list) => list.hides(vectors, rays),
            Self::Tree(tree) => tree.hides(vectors, rays, stacks),
        }
    }
}

fn build_tree(corners: &[[Vec3A; 3]]) -> Tree {
    let bounded: Vec<_> =
        corners.iter().map(|&[v0, v1, v2]| obvhs::triangle::Triangle { v0, v1, v2 }).collect();
    // Tracing paths costs far more than a thorough build, unless there are many triangles.
    let params = if corners.len() <= THOROUGH_BUILD {
        BvhBuildParams::very_slow_build()
    } else {
        BvhBuildParams::medium_build()
    };
    let mut build_time = Duration::ZERO;
    Tree::new(&build_cwbvh_from_tris(&bounded, params, &mut build_time), corners)
}

/// Moves a point off its surface along the unit `normal`, so far that rounding in f32
/// cannot put a new ray's origin on the other side: by 8 · 2⁻²³ times the largest
/// coordinate of the point, or `scale`, that of the scene, if it is larger.
#[inline(always)]
pub(crate) fn offset(point: Vec3, normal: Vec3, scale: f32) -> Vec3 {
    let largest = max(max(point.x.abs(), point.y.abs()), max(point.z.abs(), scale));
    point + normal * (8.0 * f32::EPSILON * largest)
}

/// The larger number. Unlike `f32::max`, it is one instruction; if `a` is NaN, it is `b`,
/// and if `b` is NaN, it is `b` as well.
#[inline(always)]
pub(crate) fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use proptest::{
        prelude::*,
        test_runner::{RngSeed, TestCaseError},
    };

    use super::*;
    use crate::instructions::{Instructions, Kernel};

    /// The oracle: every triangle, Möller and Trumbore (1997) in f64.
    fn nearest(triangles: &[Triangle], origin: Vec3A, direction: Vec3A) -> Option<f64> {
        let o = origin.as_dvec3();
        let d = direction.as_dvec3();
        triangles
            .iter()
            .filter_map(|triangle| {
                let [a, b, c] = triangle.positions.map(|p| p.as_dvec3());
                let (e1, e2) = (b - a, c - a);
                let p = d.cross(e2);
                let det = e1.dot(p);
                let s = o - a;
                let u = s.dot(p) / det;
                let q = s.cross(e1);
                let v = d.dot(q) / det;
                let t = e2.dot(q) / det;
                (det != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
            })
            .min_by(f64::total_cmp)
    }

    #[derive(Clone, Copy)]
    struct Query<'a> {
        accelerator: &'a Accelerator,
        rays: &'a Rays,
    }

    impl Kernel for Query<'_> {
        type Output = (Hits, [bool; PACKET]);

        #[inline(always)]
        fn run<V: Vectors>(self, vectors: V) -> Self::Output {
            let mut hits = Hits::MISSED;
            let mut stacks = Stacks::default();
            self.accelerator.nearest(vectors, self.rays, &mut stacks, &mut hits);
            (hits, self.accelerator.hides(vectors, self.rays, &mut stacks))
        }
    }

    /// One triangle, or two that share the diagonal of a plane quadrilateral, convex or not.
    fn polygon() -> impl Strategy<Value = Vec<[Vec3A; 3]>> {
        let triangle = prop::array::uniform3(vector());
        (triangle, any::<bool>(), -1.0_f32..1.5, 0.1_f32..1.0).prop_map(
            |([a, b, c], is_alone, along, across)| {
                let d = a + (c - a) * along - (b - a) * across;
                if is_alone { vec![[a, b, c]] } else { vec![[a, b, c], [a, c, d]] }
            },
        )
    }

    fn vector() -> impl Strategy<Value = Vec3A> {
        prop::array::uniform3(-1.0_f32..1.0).prop_map(Vec3A::from)
    }

    /// A component of a direction: ordinary, zero with either sign, or too small to matter,
    /// among them numbers whose inverse is infinite.
    fn component() -> impl Strategy<Value = f32> {
        let small = prop::sample::select(vec![0.0_f32, 1e-45, 1e-40, 1e-30, 1e-19, 1e-18, 1e-12]);
        let signed = (small, any::<bool>()).prop_map(|(x, minus)| if minus { -x } else { x });
        prop_oneof![signed, -1.0_f32..1.0]
    }

    /// Compares list and tree, with all instructions, with the oracle.
    ///
    /// A ray may slip past an edge by rounding, so hits are compared where the oracle
    /// agrees with itself for rays shifted by 1e-4.
    fn compare_with_brute_force(
        polygons: &[Vec<[Vec3A; 3]>],
        origin: Vec3A,
        direction: Vec3A,
    ) -> Result<(), TestCaseError> {
        let corners = polygons.concat();
        let triangles: Vec<_> = corners
            .iter()
            .map(|&positions| Triangle { positions, normals: None, uvs: None, material: 0 })
            .collect();
        let expected = nearest(&triangles, origin, direction);
        for shift in [Vec3A::X, Vec3A::Y, Vec3A::Z, Vec3A::NEG_X, Vec3A::NEG_Y, Vec3A::NEG_Z] {
            let shifted = nearest(&triangles, origin + 1e-4 * shift, direction);
            prop_assume!(match (expected, shifted) {
                (Some(a), Some(b)) => (a - b).abs() < 1e-2,
                (a, b) => a.is_none() && b.is_none(),
            });
        }
        let mut rays = Rays::NONE;
        let i = triangles.len() % PACKET;
        rays.origin.set(i, origin.into());
        rays.direction.set(i, direction.into());
        rays.tmax[i] = f32::INFINITY;
        for accelerator in
            [Accelerator::List(List::new(&corners)), Accelerator::Tree(build_tree(&corners))]
        {
            let query = Query { accelerator: &accelerator, rays: &rays };
            let (hits, hidden) = Instructions::Portable.run(query);
            for instructions in Instructions::available() {
                prop_assert_eq!(instructions.run(query), (hits, hidden), "{:?}", instructions);
            }
            prop_assert_eq!(hits.triangle[i] != NONE, expected.is_some());
            prop_assert_eq!(hidden[i], expected.is_some());
            if let Some(expected) = expected {
                let t = hits.t[i];
                prop_assert!((f64::from(t) - expected).abs() < 1e-3, "{} {}", t, expected);
                let [a, b, c] = corners[hits.triangle[i] as usize];
                let (u, v) = (hits.u[i], hits.v[i]);
                let point = a * (1.0 - u - v) + b * u + c * v;
                prop_assert!(point.distance(origin + direction * t) < 1e-3);
            }
        }
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 1024,
            rng_seed: RngSeed::Fixed(1),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        #[test]
        fn nearest_hit_equals_brute_force(
            polygons in prop::collection::vec(polygon(), 1..30),
            origin in vector(),
            towards in vector(),
        ) {
            prop_assume!(origin.distance(towards) > 1e-2);
            compare_with_brute_force(&polygons, origin, (towards - origin).normalize())?;
        }

        /// Rays along an axis or a coordinate plane, or almost, through a point of a polygon.
        #[test]
        fn rays_along_axes_find_what_brute_force_finds(
            polygons in prop::collection::vec(polygon(), 1..30),
            direction in prop::array::uniform3(component()).prop_map(Vec3A::from),
            weights in prop::array::uniform2(0.01_f32..0.49),
            distance in 0.1_f32..2.0,
        ) {
            prop_assume!(direction.length() > 1e-2);
            let direction = direction.normalize();
            let [a, b, c] = polygons[0][0];
            let target = a + (b - a) * weights[0] + (c - a) * weights[1];
            compare_with_brute_force(&polygons, target - direction * distance, direction)?;
        }
    }
}

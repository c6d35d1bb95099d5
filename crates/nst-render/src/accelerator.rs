//! Ray queries against the triangles of a scene, through an obvhs CWBVH.

use std::time::Duration;

use glam::Vec3A;
use obvhs::{BvhBuildParams, cwbvh::builder::build_cwbvh_from_tris, ray::Ray};

use crate::{Triangle, traversal::Tree};

/// Up to so many triangles, the tree is built as well as obvhs can, in a fifth of a second at most.
const THOROUGH_BUILD: usize = 1 << 15;

/// The tree for the triangles of a scene.
pub(crate) fn build(triangles: &[Triangle]) -> Tree {
    let corners: Vec<_> = triangles.iter().map(|triangle| triangle.positions).collect();
    let bounded: Vec<_> =
        corners.iter().map(|&[v0, v1, v2]| obvhs::triangle::Triangle { v0, v1, v2 }).collect();
    // Paths cost far more than a thorough build, unless there are many triangles.
    let params = if triangles.len() <= THOROUGH_BUILD {
        BvhBuildParams::very_slow_build()
    } else {
        BvhBuildParams::medium_build()
    };
    let mut build_time = Duration::ZERO;
    Tree::new(build_cwbvh_from_tris(&bounded, params, &mut build_time), &corners)
}

/// A ray from 0 to `tmax`, in units of its direction.
#[inline]
pub(crate) fn new_ray(origin: Vec3A, direction: Vec3A, tmax: f32) -> Ray {
    // Where a component is 0, a large inverse of its sign does, and makes no NaN.
    let least = Vec3A::splat(1e-18);
    let divisor = Vec3A::select(direction.abs().cmplt(least), least.copysign(direction), direction);
    Ray { origin, direction, inv_direction: divisor.recip(), tmin: 0.0, tmax }
}

/// Moves a point off its surface, far enough that f32 rounding cannot put a new
/// ray's origin on the other side: eight units in the last place of the largest
/// coordinate (of the point, or of the scene where the point is near the origin).
pub(crate) fn offset(point: Vec3A, normal: Vec3A, scale: f32) -> Vec3A {
    point + normal * (8.0 * f32::EPSILON * point.abs().max_element().max(scale))
}

#[cfg(test)]
mod tests {
    use proptest::{prelude::*, test_runner::RngSeed};

    use glam::Vec2;

    use super::*;
    use crate::traversal::Instructions;

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

    fn vector() -> impl Strategy<Value = Vec3A> {
        prop::array::uniform3(-1.0_f32..1.0).prop_map(Vec3A::from)
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            rng_seed: RngSeed::Fixed(1),
            ..ProptestConfig::default()
        })]

        /// A ray may slip past an edge by rounding, so hits are compared where
        /// the oracle agrees with itself for rays shifted by 1e-4.
        #[test]
        fn nearest_hit_equals_brute_force(
            corners in prop::collection::vec(prop::array::uniform3(vector()), 1..40),
            origin in vector(),
            towards in vector(),
        ) {
            let triangles: Vec<_> = corners
                .into_iter()
                .map(|positions| Triangle { positions, normals: None, uvs: None, material: 0 })
                .collect();
            prop_assume!(origin.distance(towards) > 1e-2);
            let direction = (towards - origin).normalize();
            let expected = nearest(&triangles, origin, direction);
            for shift in [Vec3A::X, Vec3A::Y, Vec3A::Z, Vec3A::NEG_X, Vec3A::NEG_Y, Vec3A::NEG_Z] {
                let shifted = nearest(&triangles, origin + 1e-4 * shift, direction);
                prop_assume!(match (expected, shifted) {
                    (Some(a), Some(b)) => (a - b).abs() < 1e-2,
                    (a, b) => a.is_none() && b.is_none(),
                });
            }
            let mut tree = build(&triangles);
            let ray = Ray::new_inf(origin, direction);
            let hit = tree.nearest(&ray);
            tree.instructions = Instructions::Portable;
            prop_assert_eq!(tree.nearest(&ray), hit);
            prop_assert_eq!(hit.is_some(), expected.is_some());
            prop_assert_eq!(tree.any(&ray), expected.is_some());
            if let (Some(hit), Some(expected)) = (hit, expected) {
                prop_assert!((f64::from(hit.t) - expected).abs() < 1e-3, "{} {expected}", hit.t);
                let [a, b, c] = triangles[hit.triangle as usize].positions;
                let Vec2 { x: u, y: v } = hit.barycentric;
                let point = a * (1.0 - u - v) + b * u + c * v;
                prop_assert!(point.distance(origin + direction * hit.t) < 1e-3);
            }
        }
    }
}

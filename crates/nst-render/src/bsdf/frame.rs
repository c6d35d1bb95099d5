//! Orthonormal frames at points of surfaces.

use glam::Vec3A;

/// An orthonormal basis of world space, with z along a normal.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    tangent: Vec3A,
    bitangent: Vec3A,
    normal: Vec3A,
}

impl Frame {
    /// A frame about a unit normal; x and y are any directions perpendicular to it.
    #[inline]
    pub(crate) fn new(normal: Vec3A) -> Self {
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        Self { tangent, bitangent, normal }
    }

    /// A right-handed frame about a unit normal, with x along the part of
    /// `tangent` that is perpendicular to it; with any x if that part is only rounding.
    #[inline]
    pub(crate) fn with_tangent(normal: Vec3A, tangent: Vec3A) -> Self {
        let across = tangent - normal * normal.dot(tangent);
        // Of a tangent along the normal, rounding leaves about 1e-7 of its length.
        if across.length_squared() > 1e-10 * tangent.length_squared() {
            // Perpendicular to the normal even where `across` is mostly rounding.
            let bitangent = normal.cross(across).normalize();
            Self { tangent: bitangent.cross(normal), bitangent, normal }
        } else {
            Self::new(normal)
        }
    }

    #[inline]
    pub(crate) fn to_local(self, world: Vec3A) -> Vec3A {
        Vec3A::new(world.dot(self.tangent), world.dot(self.bitangent), world.dot(self.normal))
    }

    #[inline]
    pub(crate) fn to_world(self, local: Vec3A) -> Vec3A {
        self.tangent * local.x + self.bitangent * local.y + self.normal * local.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::test_data::{random, random_direction};

    /// Tolerances: a few roundings of numbers below 1.
    #[test]
    fn frames_are_orthonormal_right_handed_and_invertible() {
        let mut stream = random(1);
        for i in 0..1000 {
            let normal = random_direction(&mut stream);
            // Every other tangent is almost along the normal.
            let tangent = random_direction(&mut stream) * if i % 2 == 0 { 1.0 } else { 1e-4 };
            let tangent = tangent + normal * 0.9;
            for frame in [Frame::new(normal), Frame::with_tangent(normal, tangent)] {
                let x = frame.to_world(Vec3A::X);
                assert!(x.is_normalized() && x.dot(normal).abs() < 1e-6, "{normal} {tangent}");
                assert!(x.cross(frame.to_world(Vec3A::Y)).abs_diff_eq(normal, 1e-6));
                let world = random_direction(&mut stream);
                assert!(frame.to_world(frame.to_local(world)).abs_diff_eq(world, 1e-6));
            }
        }
    }

    #[test]
    fn the_tangent_is_kept_and_may_be_useless() {
        let frame = Frame::with_tangent(Vec3A::Z, Vec3A::new(0.0, 5.0, 3.0));
        assert_eq!(frame.to_local(Vec3A::Y), Vec3A::X);
        for tangent in [Vec3A::ZERO, Vec3A::Z * 7.0, Vec3A::NAN] {
            assert!(Frame::with_tangent(Vec3A::Z, tangent).to_world(Vec3A::X).is_normalized());
        }
    }
}

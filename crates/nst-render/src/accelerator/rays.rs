//! Packets of rays, and what they hit.

use crate::packet::{PACKET, Vec3s};

/// A packet of rays. Each goes from distance 0 to `tmax`, in units of the length of its
/// direction; a negative `tmax` stands for no ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rays {
    pub(crate) origin: Vec3s,
    pub(crate) direction: Vec3s,
    pub(crate) tmax: [f32; PACKET],
}

impl Rays {
    pub(crate) const NONE: Self =
        Self { origin: Vec3s::ZERO, direction: Vec3s::ZERO, tmax: [-1.0; PACKET] };
}

/// What the rays of a packet hit first.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Hits {
    /// Distance along the ray, in units of its direction.
    pub(crate) t: [f32; PACKET],
    /// The barycentric weights of the second and third corner.
    pub(crate) u: [f32; PACKET],
    pub(crate) v: [f32; PACKET],
    /// Index into the scene's triangles, or [`NONE`].
    pub(crate) triangle: [u32; PACKET],
}

/// The triangle of a ray that hits none.
pub(crate) const NONE: u32 = u32::MAX;

impl Hits {
    pub(crate) const MISSED: Self =
        Self { t: [0.0; PACKET], u: [0.0; PACKET], v: [0.0; PACKET], triangle: [NONE; PACKET] };
}

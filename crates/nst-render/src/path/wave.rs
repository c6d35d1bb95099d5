//! What paths carry from vertex to vertex, in packets.

use crate::{
    accelerator::{NONE, Rays},
    packet::{PACKET, Vec3s},
    sampler::Streams,
};

/// A packet of paths on their way to the next vertex; those with a negative `tmax`
/// have ended.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Paths {
    pub(super) rays: Rays,
    pub(super) throughput: Vec3s,
    /// The density, with respect to solid angle, of the ray's direction; infinite
    /// where light sampling could not have found it: from the camera, and after
    /// a delta distribution.
    pub(super) pdf: [f32; PACKET],
    pub(super) streams: Streams,
    /// The number of the path in its batch.
    pub(super) path: [u32; PACKET],
}

/// A packet of points of surfaces that paths have come to.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Points {
    pub(super) position: Vec3s,
    /// Unit geometric normal; light passes through the surface where the two
    /// directions are on different sides of it.
    pub(super) normal: Vec3s,
    /// Unit shading normal, on the same side of the surface as the geometric one.
    pub(super) shading: Vec3s,
    /// Where the path came from.
    pub(super) wo: Vec3s,
    /// Reflectance or base colour.
    pub(super) color: Vec3s,
    pub(super) throughput: Vec3s,
    pub(super) streams: Streams,
    /// The number of the path in its batch; [`NONE`] for members that are not used.
    pub(super) path: [u32; PACKET],
    pub(super) triangle: [u32; PACKET],
}

impl Default for Paths {
    #[inline(always)]
    fn default() -> Self {
        Self {
            rays: Rays::NONE,
            throughput: Vec3s::ZERO,
            pdf: [0.0; PACKET],
            streams: Streams::ZERO,
            path: [NONE; PACKET],
        }
    }
}

impl Default for Points {
    #[inline(always)]
    fn default() -> Self {
        Self {
            position: Vec3s::ZERO,
            normal: Vec3s::ZERO,
            shading: Vec3s::ZERO,
            wo: Vec3s::ZERO,
            color: Vec3s::ZERO,
            throughput: Vec3s::ZERO,
            streams: Streams::ZERO,
            path: [NONE; PACKET],
            triangle: [NONE; PACKET],
        }
    }
}

/// Packets, filled member by member.
#[derive(Default)]
pub(super) struct Queue<T> {
    packets: Vec<T>,
    /// Members in use.
    len: usize,
}

impl<T: Default> Queue<T> {
    /// The next unused member: its packet, and its place there.
    #[inline(always)]
    pub(super) fn push(&mut self) -> (&mut T, usize) {
        let (packet, i) = (self.len / PACKET, self.len % PACKET);
        if i == 0 {
            self.packets.push(T::default());
        }
        self.len += 1;
        (&mut self.packets[packet], i)
    }

    /// A packet for the caller alone.
    #[inline(always)]
    pub(super) fn push_packet(&mut self) -> &mut T {
        self.packets.push(T::default());
        self.len = self.packets.len() * PACKET;
        let last = self.packets.len() - 1;
        &mut self.packets[last]
    }

    pub(super) fn packets(&self) -> &[T] {
        &self.packets
    }

    pub(super) fn clear(&mut self) {
        self.packets.clear();
        self.len = 0;
    }
}

//! What paths carry from vertex to vertex, in chunks of sixteen.

use crate::{
    accelerator::{NONE, Rays},
    lanes::{LANES, Vec3s},
    sampler::Streams,
};

/// Sixteen paths on their way to the next vertex; those with a negative `tmax`
/// have ended.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Paths {
    pub(super) rays: Rays,
    pub(super) throughput: Vec3s,
    /// The density, with respect to solid angle, of the ray's direction; infinite
    /// where light sampling could not have found it: from the camera, and after
    /// a delta distribution.
    pub(super) pdf: [f32; LANES],
    pub(super) streams: Streams,
    /// Which path it is.
    pub(super) path: [u32; LANES],
}

/// Sixteen points of surfaces that paths have come to.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Points {
    pub(super) position: Vec3s,
    /// Unit geometric normal; light passes through the surface where the two
    /// directions are on different sides of it.
    pub(super) normal: Vec3s,
    /// Unit shading normal, on the side of the geometric one.
    pub(super) shading: Vec3s,
    /// Where the path came from.
    pub(super) wo: Vec3s,
    /// Reflectance or base colour.
    pub(super) color: Vec3s,
    pub(super) throughput: Vec3s,
    pub(super) streams: Streams,
    /// Which path it is; [`NONE`] in lanes that are not used.
    pub(super) path: [u32; LANES],
    pub(super) triangle: [u32; LANES],
}

impl Default for Paths {
    #[inline(always)]
    fn default() -> Self {
        Self {
            rays: Rays::NONE,
            throughput: Vec3s::ZERO,
            pdf: [0.0; LANES],
            streams: Streams::ZERO,
            path: [NONE; LANES],
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
            path: [NONE; LANES],
            triangle: [NONE; LANES],
        }
    }
}

/// Chunks, filled lane by lane.
#[derive(Default)]
pub(super) struct Queue<T> {
    chunks: Vec<T>,
    /// Lanes in use.
    len: usize,
}

impl<T: Default> Queue<T> {
    /// The next unused lane.
    #[inline(always)]
    pub(super) fn push(&mut self) -> (&mut T, usize) {
        let (chunk, lane) = (self.len / LANES, self.len % LANES);
        if lane == 0 {
            self.chunks.push(T::default());
        }
        self.len += 1;
        (&mut self.chunks[chunk], lane)
    }

    /// A chunk of its own.
    #[inline(always)]
    pub(super) fn push_chunk(&mut self) -> &mut T {
        self.chunks.push(T::default());
        self.len = self.chunks.len() * LANES;
        let last = self.chunks.len() - 1;
        &mut self.chunks[last]
    }

    pub(super) fn chunks(&self) -> &[T] {
        &self.chunks
    }

    pub(super) fn clear(&mut self) {
        self.chunks.clear();
        self.len = 0;
    }
}

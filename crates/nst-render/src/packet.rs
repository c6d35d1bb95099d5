//! Packets: sixteen rays, paths or points side by side. Each of their numbers is an
//! array of sixteen. Loops over a packet have bodies without branches, which compilers
//! turn into vector instructions.

use glam::Vec3;

use crate::instructions::{Floats, Vec3x};

/// The members of a packet: as many floats as fit into a register of AVX-512, two of
/// AVX2, or four of SSE2.
pub(crate) const PACKET: usize = 16;

/// The vectors of a packet, coordinate by coordinate.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Vec3s {
    x: [f32; PACKET],
    y: [f32; PACKET],
    z: [f32; PACKET],
}

impl Vec3s {
    pub(crate) const ZERO: Self = Self { x: [0.0; PACKET], y: [0.0; PACKET], z: [0.0; PACKET] };

    #[inline(always)]
    pub(crate) fn get(&self, i: usize) -> Vec3 {
        Vec3::new(self.x[i], self.y[i], self.z[i])
    }

    #[inline(always)]
    pub(crate) fn set(&mut self, i: usize, value: Vec3) {
        self.x[i] = value.x;
        self.y[i] = value.y;
        self.z[i] = value.z;
    }

    /// A coordinate of all of them: x, y or z.
    #[inline(always)]
    pub(crate) fn coordinate(&self, number: usize) -> &[f32; PACKET] {
        [&self.x, &self.y, &self.z][number]
    }

    /// The vectors from `first` on, as many as `F` has places for.
    #[inline(always)]
    pub(crate) fn load<F: Floats>(&self, proof: F::Proof, first: usize) -> Vec3x<F> {
        let [x, y, z] = [&self.x[first..], &self.y[first..], &self.z[first..]];
        Vec3x::new(F::load(proof, x), F::load(proof, y), F::load(proof, z))
    }
}

//! Sixteen numbers side by side. Loops over lanes have bodies without branches,
//! which compilers turn into vector instructions.

use glam::Vec3;

use crate::instructions::{Floats, Vec3x};

/// As many as AVX-512 holds in a register; AVX2 takes two, SSE2 four.
pub(crate) const LANES: usize = 16;

/// Sixteen vectors, coordinate by coordinate.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Vec3s {
    x: [f32; LANES],
    y: [f32; LANES],
    z: [f32; LANES],
}

impl Vec3s {
    pub(crate) const ZERO: Self = Self { x: [0.0; LANES], y: [0.0; LANES], z: [0.0; LANES] };

    #[inline(always)]
    pub(crate) fn get(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    #[inline(always)]
    pub(crate) fn set(&mut self, lane: usize, value: Vec3) {
        self.x[lane] = value.x;
        self.y[lane] = value.y;
        self.z[lane] = value.z;
    }

    /// As many lanes as `F` has, from `first` on.
    #[inline(always)]
    pub(crate) fn load<F: Floats>(&self, first: usize) -> Vec3x<F> {
        let [x, y, z] = [&self.x, &self.y, &self.z].map(|values| F::load(&values[first..]));
        Vec3x::new(x, y, z)
    }
}

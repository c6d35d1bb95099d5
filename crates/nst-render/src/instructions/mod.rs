//! Code that is compiled several times, for what processors can do.
//!
//! All versions give the same bits: each operation rounds by itself, as nothing
//! fuses multiplications with additions.
//!
//! No safe function executes an instruction that the processor may lack: `x86::Avx2`
//! and `x86::Avx512` are made by detection alone, and floats in registers are made with
//! one of them, or out of other floats.

mod floats;
mod vectors;
#[cfg(target_arch = "x86_64")]
mod x86;

use vectors::Portable;
#[cfg(target_arch = "x86_64")]
use x86::{Avx2, Avx512};

pub(crate) use {
    floats::{Floats, Vec3x},
    vectors::{Boxes, Kernel, Vectors},
};

/// Instructions that the processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Instructions {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
    #[cfg(target_arch = "x86_64")]
    Avx512(Avx512),
}

/// The widest vector instructions that this machine has and the renderer uses: `AVX-512`,
/// `AVX2`, or `portable` code.
#[must_use]
pub fn instruction_set() -> &'static str {
    match Instructions::detect() {
        Instructions::Portable => "portable",
        #[cfg(target_arch = "x86_64")]
        Instructions::Avx2(_) => "AVX2",
        #[cfg(target_arch = "x86_64")]
        Instructions::Avx512(_) => "AVX-512",
    }
}

impl Instructions {
    /// The best that this processor has.
    pub(crate) fn detect() -> Self {
        *Self::available().last().unwrap_or(&Self::Portable)
    }

    /// All that this processor has, the best last.
    pub(crate) fn available() -> Vec<Self> {
        #[allow(unused_mut, reason = "there is one version only for other processors")]
        let mut available = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            available.extend(Avx2::detect().map(Self::Avx2));
            available.extend(Avx512::detect().map(Self::Avx512));
        }
        available
    }

    /// Runs the version of the kernel for these instructions.
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            Self::Portable => kernel.run(Portable),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(avx2) => avx2.run(kernel),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(avx512) => avx512.run(kernel),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every operation of [`Floats`].
    struct Operations;

    impl Kernel for Operations {
        type Output = [[u32; 16]; 2];

        #[inline(always)]
        fn run<V: Vectors>(self, vectors: V) -> Self::Output {
            [results::<V::Wide>(vectors.wide()), results::<V::Eight>(vectors.eight())]
        }
    }

    /// The bits of what a few operations give for sixteen pairs of numbers.
    #[inline(always)]
    fn results<F: Floats>(proof: F::Proof) -> [u32; 16] {
        const SPECIAL: [f32; 16] = [
            0.0,
            -0.0,
            1.0,
            -1.5,
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            1e-40,
            -3e38,
            f32::MIN_POSITIVE,
            0.1,
            7.0,
            1.0 / 3.0,
            -0.7,
            2.5e-3,
            1e10,
        ];
        let mut others = SPECIAL;
        others.rotate_left(5);
        let mut all = [0; 16];
        for first in (0..16).step_by(F::WIDTH) {
            let a = F::load(proof, &SPECIAL[first..]);
            let b = F::load(proof, &others[first..]);
            let one = F::splat(proof, 1.0);
            let either = F::select(a.less(b) & b.at_most(one), a * b - one, -(a / b) + b);
            let mut values = [0.0; 16];
            either.store(&mut values[..F::WIDTH]);
            let mask = F::bits(a.at_most(b));
            for i in 0..F::WIDTH {
                // Which NaN it is, is not defined.
                let bits = if values[i].is_nan() { u32::MAX } else { values[i].to_bits() };
                all[first + i] = bits ^ (mask >> i & 1);
            }
        }
        all
    }

    #[test]
    fn operations_give_the_same_bits_in_all_registers() {
        let [expected, eight] = Instructions::Portable.run(Operations);
        assert_eq!(expected, eight);
        assert!(expected.iter().any(|&bits| bits != expected[0]));
        for instructions in Instructions::available() {
            assert_eq!(instructions.run(Operations), [expected; 2], "{instructions:?}");
        }
    }
}

//! [`Floats`] in the registers of x86.

use std::{
    arch::x86_64::*,
    ops::{Add, BitAnd, Div, Mul, Neg, Sub},
};

use super::{
    super::floats::Floats,
    tokens::{Avx2, Avx512},
};

/// A type of floats: its width and register, the same of its mask, what proves that the
/// processor has the instructions, and the names of the functions that work on registers.
macro_rules! floats {
    (
        $name:ident: $width:literal in $register:ty, $mask:ident in $mask_register:ty, of $proof:ty,
        $splat:ident, $load:ident, $store:ident, $xor:ident,
        $less:ident, $at_most:ident, $select:ident, $bits:ident, $and:ident,
        $($operator:ident $function:ident $instruction:ident),*
    ) => {
        /// Made of a proof or of others of its type: where there is a value, the
        /// processor has the instructions for it.
        #[derive(Clone, Copy)]
        pub(crate) struct $name($register);

        /// Made of floats: the same holds.
        #[derive(Clone, Copy)]
        pub(crate) struct $mask($mask_register);

        #[allow(unsafe_code)]
        impl Floats for $name {
            const WIDTH: usize = $width;

            type Proof = $proof;

            type Mask = $mask;

            #[inline(always)]
            fn splat(_: $proof, value: f32) -> Self {
                // SAFETY: the proof says that the processor has the instruction.
                Self(unsafe { $splat(value) })
            }

            #[inline(always)]
            fn load(_: $proof, values: &[f32]) -> Self {
                let values = &values[..$width];
                // SAFETY: the same; as many floats are read as there are.
                Self(unsafe { $load(values.as_ptr()) })
            }

            #[inline(always)]
            fn store(self, values: &mut [f32]) {
                let values = &mut values[..$width];
                // SAFETY: `self` says that the processor has the instruction; as many
                // floats are written as there are.
                unsafe { $store(values.as_mut_ptr(), self.0) }
            }

            #[inline(always)]
            fn less(self, other: Self) -> $mask {
                // SAFETY: the processor has the instruction, as there is a value: see the type.
                $mask(unsafe { $less(self.0, other.0) })
            }

            #[inline(always)]
            fn at_most(self, other: Self) -> $mask {
                // SAFETY: the processor has the instruction, as there is a value: see the type.
                $mask(unsafe { $at_most(self.0, other.0) })
            }

            #[inline(always)]
            fn select(mask: $mask, yes: Self, no: Self) -> Self {
                // SAFETY: the processor has the instruction, as there is a value: see the type.
                Self(unsafe { $select(mask.0, yes.0, no.0) })
            }

            #[inline(always)]
            fn bits(mask: $mask) -> u32 {
                // SAFETY: the processor has the instruction, as there is a value: see the type.
                unsafe { $bits(mask.0) }
            }
        }

        #[allow(unsafe_code)]
        impl BitAnd for $mask {
            type Output = Self;

            #[inline(always)]
            fn bitand(self, other: Self) -> Self {
                // SAFETY: the processor has the instruction, as there is a value: see the type.
                Self(unsafe { $and(self.0, other.0) })
            }
        }

        #[allow(unsafe_code)]
        impl Neg for $name {
            type Output = Self;

            #[inline(always)]
            fn neg(self) -> Self {
                // SAFETY: the processor has the instruction, as there is a value: see the type.
                Self(unsafe { $xor(self.0, $splat(-0.0)) })
            }
        }

        $(
            #[allow(unsafe_code)]
            impl $operator for $name {
                type Output = Self;

                #[inline(always)]
                fn $function(self, other: Self) -> Self {
                    // SAFETY: the processor has the instruction, as there is a value: see the type.
                    Self(unsafe { $instruction(self.0, other.0) })
                }
            }
        )*
    };
}

floats! {
    Floats8: 8 in __m256, Mask8 in __m256, of Avx2,
    _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_xor_ps,
    less_8, at_most_8, select_8, bits_8, _mm256_and_ps,
    Add add _mm256_add_ps, Sub sub _mm256_sub_ps, Mul mul _mm256_mul_ps, Div div _mm256_div_ps
}

floats! {
    Floats16: 16 in __m512, Mask16 in __mmask16, of Avx512,
    _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_xor_ps,
    less_16, at_most_16, select_16, bits_16, and_16,
    Add add _mm512_add_ps, Sub sub _mm512_sub_ps, Mul mul _mm512_mul_ps, Div div _mm512_div_ps
}

#[target_feature(enable = "avx2")]
#[inline]
fn less_8(a: __m256, b: __m256) -> __m256 {
    _mm256_cmp_ps::<_CMP_LT_OQ>(a, b)
}

#[target_feature(enable = "avx2")]
#[inline]
fn at_most_8(a: __m256, b: __m256) -> __m256 {
    _mm256_cmp_ps::<_CMP_LE_OQ>(a, b)
}

#[target_feature(enable = "avx2")]
#[inline]
fn select_8(mask: __m256, yes: __m256, no: __m256) -> __m256 {
    _mm256_blendv_ps(no, yes, mask)
}

#[target_feature(enable = "avx2")]
#[inline]
fn bits_8(mask: __m256) -> u32 {
    _mm256_movemask_ps(mask) as u32
}

#[target_feature(enable = "avx512f")]
#[inline]
fn less_16(a: __m512, b: __m512) -> __mmask16 {
    _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b)
}

#[target_feature(enable = "avx512f")]
#[inline]
fn at_most_16(a: __m512, b: __m512) -> __mmask16 {
    _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b)
}

#[target_feature(enable = "avx512f")]
#[inline]
fn select_16(mask: __mmask16, yes: __m512, no: __m512) -> __m512 {
    _mm512_mask_blend_ps(mask, no, yes)
}

#[target_feature(enable = "avx512f")]
#[inline]
fn bits_16(mask: __mmask16) -> u32 {
    u32::from(mask)
}

#[target_feature(enable = "avx512f")]
#[inline]
fn and_16(a: __mmask16, b: __mmask16) -> __mmask16 {
    a & b
}

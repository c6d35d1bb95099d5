//! Vectors of lanes, and which of them a processor has.

use std::fmt;

/// Which vector instructions evaluate a network or a filter. Results differ between them by
/// rounding alone: with AVX2 and AVX-512, multiplications and additions are fused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Instructions {
    /// What the compiler makes of loops over four lanes: SSE2 on x86-64, NEON on aarch64.
    Portable,
    /// Vectors of eight lanes.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// Vectors of sixteen lanes.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Instructions {
    /// What this processor has, the best last.
    #[must_use]
    pub fn available() -> Vec<Self> {
        #[allow(unused_mut, reason = "there is one version only for other processors")]
        let mut available = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            available.push(Self::Avx2);
            if is_x86_feature_detected!("avx512f") {
                available.push(Self::Avx512);
            }
        }
        available
    }

    /// The best that this processor has.
    #[must_use]
    pub fn detect() -> Self {
        *Self::available().last().unwrap_or(&Self::Portable)
    }
}

/// `portable`, `avx2` or `avx512`.
impl fmt::Display for Instructions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => "avx512",
        })
    }
}

/// A register of lanes. All methods are inlined into a function that is compiled
/// for the instructions.
///
/// # Safety
/// The processor has the type's instructions: a promise that every method asks of its caller.
#[allow(unsafe_code)]
pub(crate) trait Vector: Copy {
    /// Lanes per register.
    const LANES: usize;

    unsafe fn splat(value: f32) -> Self;

    /// # Safety
    /// Also, `LANES` numbers can be read there, and the address is a multiple of their size.
    unsafe fn load(from: *const f32) -> Self;

    /// As [`Self::load`], from any address of a number.
    ///
    /// # Safety
    /// Also, `LANES` numbers can be read there.
    unsafe fn load_anywhere(from: *const f32) -> Self;

    /// # Safety
    /// Also, `LANES` numbers can be written there, and the address is a multiple of their size.
    unsafe fn store(self, to: *mut f32);

    /// self · factor + term, fused where the processor can.
    unsafe fn mul_add(self, factor: Self, term: Self) -> Self;

    unsafe fn add(self, other: Self) -> Self;

    unsafe fn mul(self, other: Self) -> Self;

    /// The greater of the two; `other` where one is a NaN.
    unsafe fn max(self, other: Self) -> Self;

    /// The lesser of the two; `other` where one is a NaN.
    unsafe fn min(self, other: Self) -> Self;
}

/// For any processor.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
pub(crate) struct Four([f32; 4]);

impl Four {
    #[inline(always)]
    fn map(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

#[allow(unsafe_code)]
impl Vector for Four {
    const LANES: usize = 4;

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        Self([value; 4])
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller's promise.
        unsafe { from.cast::<Self>().read() }
    }

    #[inline(always)]
    unsafe fn load_anywhere(from: *const f32) -> Self {
        // SAFETY: the caller's promise.
        Self(unsafe { from.cast::<[f32; 4]>().read() })
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the caller's promise.
        unsafe { to.cast::<Self>().write(self) }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, term: Self) -> Self {
        // Without the instruction, `f32::mul_add` is a slow function.
        if cfg!(any(target_arch = "aarch64", target_feature = "fma")) {
            Self(std::array::from_fn(|i| self.0[i].mul_add(factor.0[i], term.0[i])))
        } else {
            Self(std::array::from_fn(|i| self.0[i] * factor.0[i] + term.0[i]))
        }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        self.map(other, |a, b| a + b)
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        self.map(other, |a, b| a * b)
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        self.map(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    unsafe fn min(self, other: Self) -> Self {
        self.map(other, |a, b| if a < b { a } else { b })
    }
}

/// The vectors of x86-64: a register, its lanes, and the intrinsics by name.
macro_rules! x86_vector {
    ($name:ident, $register:ident, $lanes:literal, $splat:ident, $load:ident, $load_anywhere:ident,
     $store:ident,
     $mul_add:ident, $add:ident, $mul:ident, $max:ident, $min:ident) => {
        #[cfg(target_arch = "x86_64")]
        #[derive(Clone, Copy)]
        pub(crate) struct $name(std::arch::x86_64::$register);

        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code)]
        impl Vector for $name {
            const LANES: usize = $lanes;

            #[inline(always)]
            unsafe fn splat(value: f32) -> Self {
                // SAFETY: the caller's promise.
                Self(unsafe { std::arch::x86_64::$splat(value) })
            }

            #[inline(always)]
            unsafe fn load(from: *const f32) -> Self {
                // SAFETY: the caller's promise.
                Self(unsafe { std::arch::x86_64::$load(from) })
            }

            #[inline(always)]
            unsafe fn load_anywhere(from: *const f32) -> Self {
                // SAFETY: the caller's promise.
                Self(unsafe { std::arch::x86_64::$load_anywhere(from) })
            }

            #[inline(always)]
            unsafe fn store(self, to: *mut f32) {
                // SAFETY: the caller's promise.
                unsafe { std::arch::x86_64::$store(to, self.0) }
            }

            #[inline(always)]
            unsafe fn mul_add(self, factor: Self, term: Self) -> Self {
                // SAFETY: the caller's promise.
                Self(unsafe { std::arch::x86_64::$mul_add(self.0, factor.0, term.0) })
            }

            #[inline(always)]
            unsafe fn add(self, other: Self) -> Self {
                // SAFETY: the caller's promise.
                Self(unsafe { std::arch::x86_64::$add(self.0, other.0) })
            }

            #[inline(always)]
            unsafe fn mul(self, other: Self) -> Self {
                // SAFETY: the caller's promise.
                Self(unsafe { std::arch::x86_64::$mul(self.0, other.0) })
            }

            #[inline(always)]
            unsafe fn max(self, other: Self) -> Self {
                // SAFETY: the caller's promise.
                Self(unsafe { std::arch::x86_64::$max(self.0, other.0) })
            }

            #[inline(always)]
            unsafe fn min(self, other: Self) -> Self {
                // SAFETY: the caller's promise.
                Self(unsafe { std::arch::x86_64::$min(self.0, other.0) })
            }
        }
    };
}

x86_vector!(
    Eight,
    __m256,
    8,
    _mm256_set1_ps,
    _mm256_load_ps,
    _mm256_loadu_ps,
    _mm256_store_ps,
    _mm256_fmadd_ps,
    _mm256_add_ps,
    _mm256_mul_ps,
    _mm256_max_ps,
    _mm256_min_ps
);

x86_vector!(
    Sixteen,
    __m512,
    16,
    _mm512_set1_ps,
    _mm512_load_ps,
    _mm512_loadu_ps,
    _mm512_store_ps,
    _mm512_fmadd_ps,
    _mm512_add_ps,
    _mm512_mul_ps,
    _mm512_max_ps,
    _mm512_min_ps
);

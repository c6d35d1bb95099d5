//! Kernels with AVX2 and with AVX-512.

use std::arch::x86_64::*;

use super::{
    super::vectors::{Boxes, Kernel, Vectors},
    floats::{Floats8, Floats16},
    tokens::{Avx2, Avx512},
};

/// Bytes that a processor loads into its cache at once.
const CACHE_LINE: usize = 64;

impl Vectors for Avx2 {
    type Wide = Floats8;
    type Eight = Floats8;

    #[inline(always)]
    fn wide(self) -> Self {
        self
    }

    #[inline(always)]
    fn eight(self) -> Self {
        self
    }

    #[inline(always)]
    fn overlaps(self, boxes: &Boxes<'_>) -> u32 {
        #[allow(unsafe_code)]
        // SAFETY: `self` proves that the processor has AVX2.
        unsafe {
            overlaps(boxes)
        }
    }

    #[inline(always)]
    fn prefetch<T>(self, place: &T) {
        let start: *const i8 = std::ptr::from_ref(place).cast();
        for i in (0..size_of::<T>()).step_by(CACHE_LINE) {
            #[allow(unsafe_code)]
            // SAFETY: any address may be prefetched; SSE is part of x86-64.
            unsafe {
                _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(i));
            }
        }
    }
}

impl Vectors for Avx512 {
    type Wide = Floats16;
    type Eight = Floats8;

    #[inline(always)]
    fn wide(self) -> Self {
        self
    }

    #[inline(always)]
    fn eight(self) -> Avx2 {
        self.avx2()
    }

    #[inline(always)]
    fn overlaps(self, boxes: &Boxes<'_>) -> u32 {
        self.avx2().overlaps(boxes)
    }

    #[inline(always)]
    fn prefetch<T>(self, place: &T) {
        self.avx2().prefetch(place);
    }
}

impl Avx2 {
    /// Runs the version of a kernel that uses these instructions.
    pub(in super::super) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[allow(unsafe_code)]
        // SAFETY: `self` proves that the processor has what `detect` looks for.
        unsafe {
            run_avx2(self, kernel)
        }
    }
}

impl Avx512 {
    /// Runs the version of a kernel that uses these instructions.
    pub(in super::super) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[allow(unsafe_code)]
        // SAFETY: `self` proves that the processor has what `detect` looks for.
        unsafe {
            run_avx512(self, kernel)
        }
    }
}

#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn run_avx2<K: Kernel>(avx2: Avx2, kernel: K) -> K::Output {
    kernel.run(avx2)
}

#[target_feature(
    enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt"
)]
fn run_avx512<K: Kernel>(avx512: Avx512, kernel: K) -> K::Output {
    kernel.run(avx512)
}

/// [`Vectors::overlaps`].
#[target_feature(enable = "avx2")]
#[inline]
fn overlaps(boxes: &Boxes<'_>) -> u32 {
    let &Boxes { bounds, step, origin, end, slack } = boxes;
    let mut near = _mm256_setzero_ps();
    let mut far = _mm256_set1_ps(end);
    for axis in 0..3 {
        let (step, origin) = (_mm256_set1_ps(step[axis]), _mm256_set1_ps(origin[axis]));
        let plane = |bytes: &[u8; 8]| {
            let bytes = _mm_cvtsi64_si128(i64::from_le_bytes(*bytes));
            let floats = _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(bytes));
            _mm256_add_ps(_mm256_mul_ps(floats, step), origin)
        };
        near = _mm256_max_ps(plane(bounds[axis].0), near);
        far = _mm256_min_ps(plane(bounds[axis].1), far);
    }
    let far = _mm256_mul_ps(far, _mm256_set1_ps(slack));
    _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far)) as u32
}

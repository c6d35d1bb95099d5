//! Code that is compiled several times, for what processors can do.
//!
//! All versions give the same bits: each operation rounds by itself, as nothing
//! fuses multiplications with additions.

mod floats;
#[cfg(target_arch = "x86_64")]
mod x86;

#[cfg(target_arch = "x86_64")]
use std::marker::PhantomData;

pub(crate) use floats::{Floats, Vec3x};

/// Which instructions the processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Instructions {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

/// Work to be compiled for each of [`Instructions`]. `run` and what it calls in
/// inner loops must be `#[inline(always)]`.
pub(crate) trait Kernel {
    type Output;

    fn run<V: Vectors>(self) -> Self::Output;
}

/// What compilers do not find by themselves.
pub(crate) trait Vectors {
    /// As many as a register holds.
    type Lanes: Floats;
    /// Eight of them.
    type Eight: Floats;

    /// Which of eight boxes a ray meets, as bits.
    fn overlaps(boxes: &Boxes<'_>) -> u32;

    /// Asks for what the reference points to, which is needed soon.
    fn prefetch<T>(place: &T);
}

/// Eight boxes, as a ray sees them.
pub(crate) struct Boxes<'a> {
    /// By axis: it enters at `bytes · step + origin` with the first bytes, and
    /// leaves with the second ones.
    pub(crate) bounds: [(&'a [u8; 8], &'a [u8; 8]); 3],
    pub(crate) step: [f32; 3],
    pub(crate) origin: [f32; 3],
    /// Where the ray ends; it begins at 0.
    pub(crate) end: f32,
    /// A factor that makes the leaving later.
    pub(crate) slack: f32,
}

/// For any processor.
struct Portable;

impl Vectors for Portable {
    type Lanes = floats::Array<4>;
    type Eight = floats::Array<8>;

    #[inline(always)]
    fn overlaps(boxes: &Boxes<'_>) -> u32 {
        let &Boxes { bounds, step, origin, end, slack } = boxes;
        let mut near = [0.0_f32; 8];
        let mut far = [end; 8];
        for axis in 0..3 {
            let (first, second) = bounds[axis];
            for i in 0..8 {
                let enter = f32::from(first[i]) * step[axis] + origin[axis];
                let leave = f32::from(second[i]) * step[axis] + origin[axis];
                near[i] = if enter > near[i] { enter } else { near[i] };
                far[i] = if leave < far[i] { leave } else { far[i] };
            }
        }
        (0..8).fold(0, |bits, i| bits | u32::from(near[i] <= far[i] * slack) << i)
    }

    #[inline(always)]
    fn prefetch<T>(_place: &T) {}
}

/// For processors with AVX2, and what they have registers for.
#[cfg(target_arch = "x86_64")]
struct Avx2<F>(PhantomData<F>);

#[cfg(target_arch = "x86_64")]
impl<F: Floats> Vectors for Avx2<F> {
    type Lanes = F;
    type Eight = x86::Floats8;

    #[inline(always)]
    fn overlaps(boxes: &Boxes<'_>) -> u32 {
        #[allow(unsafe_code)]
        // SAFETY: `Instructions::run` chooses this type where there is AVX2.
        unsafe {
            overlaps_avx2(boxes)
        }
    }

    #[inline(always)]
    fn prefetch<T>(place: &T) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let line: *const i8 = std::ptr::from_ref(place).cast();
        for i in (0..size_of::<T>()).step_by(64) {
            #[allow(unsafe_code)]
            // SAFETY: any address may be prefetched; SSE is part of x86-64.
            unsafe {
                _mm_prefetch::<_MM_HINT_T0>(line.wrapping_add(i));
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline]
fn overlaps_avx2(boxes: &Boxes<'_>) -> u32 {
    use std::arch::x86_64::*;
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

impl Instructions {
    pub(crate) fn detect() -> Self {
        *Self::available().last().unwrap_or(&Self::Portable)
    }

    /// What this processor has, the best last.
    pub(crate) fn available() -> Vec<Self> {
        #[allow(unused_mut, reason = "there is one version only for other processors")]
        let mut available = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt")
        {
            available.push(Self::Avx2);
            if is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512cd")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
            {
                available.push(Self::Avx512);
            }
        }
        available
    }

    /// Runs the version for these instructions, which the processor must have.
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            Self::Portable => kernel.run::<Portable>(),
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: `detect` and `available` found the features.
            Self::Avx2 => unsafe { run_avx2(kernel) },
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: the same.
            Self::Avx512 => unsafe { run_avx512(kernel) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Avx2<x86::Floats8>>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(
    enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt"
)]
fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Avx2<x86::Floats16>>()
}

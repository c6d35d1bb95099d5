//! What kernels may do with vector instructions, and how any processor does it.

use super::floats::{Array, Floats};

/// Work that is compiled for each kind of instructions. `run` and what it calls in
/// inner loops must be `#[inline(always)]`: what is not inlined has no vector instructions.
pub(crate) trait Kernel {
    type Output;

    fn run<V: Vectors>(self, vectors: V) -> Self::Output;
}

/// The vector instructions that a kernel is compiled for. A value of these types is the
/// proof that the processor has the instructions, and takes no memory.
pub(crate) trait Vectors: Copy {
    /// As many floats as a register contains.
    type Wide: Floats;
    /// Eight floats.
    type Eight: Floats;

    /// What makes [`Self::Wide`].
    fn wide(self) -> <Self::Wide as Floats>::Proof;

    /// What makes [`Self::Eight`].
    fn eight(self) -> <Self::Eight as Floats>::Proof;

    /// Which of eight boxes a ray meets: bit i is set if it meets box i.
    fn overlaps(self, boxes: &Boxes<'_>) -> u32;

    /// Starts to load what the reference points to, which is needed soon, into the cache.
    fn prefetch<T>(self, place: &T);
}

/// Eight boxes, as a ray sees them.
pub(crate) struct Boxes<'a> {
    /// By axis, the bytes of the planes where the ray enters and where it leaves: it
    /// crosses a plane at the distance `byte · step + origin`, in units of its direction.
    pub(crate) bounds: [(&'a [u8; 8], &'a [u8; 8]); 3],
    pub(crate) step: [f32; 3],
    pub(crate) origin: [f32; 3],
    /// The distance where the ray ends; it begins at 0.
    pub(crate) end: f32,
    /// The distances where it leaves are multiplied by this, against rounding.
    pub(crate) slack: f32,
}

/// The instructions that every processor has.
#[derive(Clone, Copy)]
pub(super) struct Portable;

impl Vectors for Portable {
    type Wide = Array<4>;
    type Eight = Array<8>;

    #[inline(always)]
    fn wide(self) {}

    #[inline(always)]
    fn eight(self) {}

    #[inline(always)]
    fn overlaps(self, boxes: &Boxes<'_>) -> u32 {
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
    fn prefetch<T>(self, _place: &T) {}
}

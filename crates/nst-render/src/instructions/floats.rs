//! Several floats in a register.
//!
//! Compilers turn plain loops over packets into vector instructions, but not always
//! into good ones: where it matters most, these types say which ones are meant.

use std::ops::{Add, BitAnd, Div, Mul, Neg, Sub};

/// Floats side by side; each operation is on each float by itself, and rounds as for one.
pub(crate) trait Floats:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// How many there are.
    const WIDTH: usize;

    /// What shows that the processor has the instructions for these floats.
    type Proof: Copy;

    /// For each float, yes or no.
    type Mask: Copy + BitAnd<Output = Self::Mask>;

    /// The same value for all.
    fn splat(proof: Self::Proof, value: f32) -> Self;
    /// The first `WIDTH` of a slice; panics if there are fewer.
    fn load(proof: Self::Proof, values: &[f32]) -> Self;
    /// Replaces the first `WIDTH` of a slice; panics if there are fewer.
    fn store(self, values: &mut [f32]);
    /// Where `self` is less than `other`; not where either is NaN.
    fn less(self, other: Self) -> Self::Mask;
    /// Where `self` is less than `other` or equal; not where either is NaN.
    fn at_most(self, other: Self) -> Self::Mask;
    /// `yes` where the mask says yes, else `no`; all bits are kept, also those of a NaN.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Bit i is set where float i has a yes.
    fn bits(mask: Self::Mask) -> u32;
}

/// Vectors in space, coordinate by coordinate.
#[derive(Clone, Copy)]
pub(crate) struct Vec3x<F>([F; 3]);

impl<F: Floats> Vec3x<F> {
    #[inline(always)]
    pub(crate) fn new(x: F, y: F, z: F) -> Self {
        Self([x, y, z])
    }

    #[inline(always)]
    pub(crate) fn splat(proof: F::Proof, vector: glam::Vec3) -> Self {
        // Not `map`: its closure is not always inlined, and then has no vector instructions.
        let [x, y, z] = vector.to_array();
        Self([F::splat(proof, x), F::splat(proof, y), F::splat(proof, z)])
    }

    #[inline(always)]
    pub(crate) fn dot(self, other: Self) -> F {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        a * x + b * y + c * z
    }

    #[inline(always)]
    pub(crate) fn cross(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([b * z - y * c, c * x - z * a, a * y - x * b])
    }
}

impl<F: Floats> Sub for Vec3x<F> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([a - x, b - y, c - z])
    }
}

/// Floats for any processor.
#[derive(Clone, Copy)]
pub(crate) struct Array<const N: usize>([f32; N]);

#[derive(Clone, Copy)]
pub(crate) struct ArrayMask<const N: usize>([bool; N]);

impl<const N: usize> Array<N> {
    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

impl<const N: usize> Floats for Array<N> {
    const WIDTH: usize = N;

    type Proof = ();

    type Mask = ArrayMask<N>;

    #[inline(always)]
    fn splat((): (), value: f32) -> Self {
        Self([value; N])
    }

    #[inline(always)]
    fn load((): (), values: &[f32]) -> Self {
        Self(std::array::from_fn(|i| values[i]))
    }

    #[inline(always)]
    fn store(self, values: &mut [f32]) {
        values[..N].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn less(self, other: Self) -> Self::Mask {
        ArrayMask(std::array::from_fn(|i| self.0[i] < other.0[i]))
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> Self::Mask {
        ArrayMask(std::array::from_fn(|i| self.0[i] <= other.0[i]))
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|i| if mask.0[i] { yes.0[i] } else { no.0[i] }))
    }

    #[inline(always)]
    fn bits(mask: Self::Mask) -> u32 {
        (0..N).fold(0, |bits, i| bits | u32::from(mask.0[i]) << i)
    }
}

impl<const N: usize> BitAnd for ArrayMask<N> {
    type Output = Self;

    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] & other.0[i]))
    }
}

impl<const N: usize> Neg for Array<N> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

macro_rules! array_operators {
    ($($operator:ident $function:ident $symbol:tt,)*) => {$(
        impl<const N: usize> $operator for Array<N> {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                self.with(other, |a, b| a $symbol b)
            }
        }
    )*};
}

array_operators! { Add add +, Sub sub -, Mul mul *, Div div /, }

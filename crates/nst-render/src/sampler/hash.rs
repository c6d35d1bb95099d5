//! Random bits as pure functions of keys, and numbers made of them.

use glam::Vec2;
pub(super) use nst_core::random::{GAMMA, mix};

/// Bits of a random f32: as many as its fraction has with the leading one, so that all
/// numbers are multiples of 2⁻²⁴.
const UNIT_BITS: u32 = 24;

/// 64 random bits for one dimension: SplitMix64, seeded with `key`, with direct access to
/// its sequence.
#[inline(always)]
pub(super) fn bits(key: u64, dimension: u32) -> u64 {
    mix(key.wrapping_add(GAMMA.wrapping_mul(u64::from(dimension) + 1)))
}

/// Maps 24 bits to [0, 1), exactly.
#[inline(always)]
pub(super) fn unit(bits: u32) -> f32 {
    bits as f32 * (1.0 / (1_u32 << UNIT_BITS) as f32)
}

/// A number of the highest 24 of 64 bits.
#[inline(always)]
pub(super) fn first(bits: u64) -> f32 {
    unit((bits >> 40) as u32)
}

/// [`first`], and a number of the next 24 bits.
#[inline(always)]
pub(super) fn pair(bits: u64) -> Vec2 {
    Vec2::new(first(bits), unit((bits >> 16) as u32 & 0xff_ffff))
}

//! Random bits as pure functions of keys, and numbers made of them.

use glam::Vec2;

/// Bits of a random f32: as many as its fraction has with the leading one, so that all
/// numbers are multiples of 2⁻²⁴.
const UNIT_BITS: u32 = 24;

/// 2⁶⁴ divided by the golden ratio, made odd: SplitMix64's step.
pub(super) const GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// SplitMix64's output function (Steele, Lea, Flood 2014), a bijection.
#[inline(always)]
pub(super) fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

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

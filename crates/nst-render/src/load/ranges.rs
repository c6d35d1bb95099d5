//! The ranges of numbers in scene files; `docs/scenes.md` lists them.

use std::ops::RangeInclusive;

use glam::Vec3A;

/// Reflectances and parameters of materials.
pub(super) const UNIT: RangeInclusive<f32> = 0.0..=1.0;
/// The indices of refraction that a dielectric may have: all of nature's (1 to 4),
/// those of a body seen from within a denser one, and some for experiments.
pub(super) const IOR: RangeInclusive<f32> = 0.1..=10.0;
/// What f32 can multiply with areas and textures; the sun is some 1e9 W/(m² sr).
pub(super) const RADIANCE: RangeInclusive<f32> = 0.0..=1e15;
/// All finite numbers from zero on.
pub(super) const NOT_NEGATIVE: RangeInclusive<f32> = 0.0..=f32::MAX;
/// All finite numbers.
pub(super) const FINITE: RangeInclusive<f32> = f32::MIN..=f32::MAX;

/// Whether all three numbers are in the range; NaN is in none.
pub(super) fn is_within(v: Vec3A, range: &RangeInclusive<f32>) -> bool {
    v.to_array().iter().all(|x| range.contains(x))
}

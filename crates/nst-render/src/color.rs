//! How bright colours are.

use glam::Vec3A;

/// Relative luminance of linear RGB with the primaries and the white of sRGB
/// (ITU-R BT.709, item 3.2, whose coefficients have four digits).
pub(crate) fn luminance(rgb: Vec3A) -> f32 {
    rgb.dot(Vec3A::new(0.2126, 0.7152, 0.0722))
}

/// [`luminance`] with six digits, as Mitsuba 3 computes it: with it, Disney's BRDF has
/// the numbers of Mitsuba's `principled`.
#[inline]
pub(crate) fn luminance_of_mitsuba(rgb: Vec3A) -> f32 {
    rgb.dot(Vec3A::new(0.212_671, 0.715_160, 0.072_169))
}

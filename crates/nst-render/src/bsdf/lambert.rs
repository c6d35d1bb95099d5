//! Lambert's law: the same radiance is reflected in all directions.

use std::f32::consts::{FRAC_1_PI, FRAC_PI_2};

use glam::{Vec2, Vec3};

/// The density of [`sample`] with respect to solid angle; the BRDF times |cos θi|
/// is the reflectance times this. Zero for directions on different sides.
#[inline(always)]
pub(crate) fn density(cos_o: f32, cos_i: f32) -> f32 {
    if cos_o * cos_i > 0.0 { cos_i.abs() * FRAC_1_PI } else { 0.0 }
}

/// A direction on the side of `cos_o`, with density |cos θi| / π.
#[inline(always)]
pub(crate) fn sample(cos_o: f32, u2: Vec2) -> Vec3 {
    let wi = cosine_hemisphere(u2);
    Vec3::new(wi.x, wi.y, wi.z.copysign(cos_o))
}

/// A direction above the surface, with density cos θ / π with respect to solid angle.
#[inline(always)]
pub(super) fn cosine_hemisphere(u2: Vec2) -> Vec3 {
    let (sin_phi, cos_phi) = sin_cos_turns(u2.x);
    let radius = u2.y.sqrt();
    Vec3::new(radius * cos_phi, radius * sin_phi, (1.0 - u2.y).sqrt())
}

/// Sine and cosine of 2πx for x in [0, 1], with an error below 3e-7: without a branch, so
/// that loops over packets become vector instructions.
#[inline(always)]
fn sin_cos_turns(x: f32) -> (f32, f32) {
    let quarters = (4.0 * x + 0.5) as i32;
    let angle = (4.0 * x - quarters as f32) * FRAC_PI_2;
    // Taylor's series: the next terms are below 4e-8 at the ends, ±π/4.
    let a2 = angle * angle;
    let sin = angle
        * (1.0
            + a2 * (-1.0 / 6.0
                + a2 * (1.0 / 120.0 + a2 * (-1.0 / 5040.0 + a2 * (1.0 / 362_880.0)))));
    let cos = 1.0 + a2 * (-0.5 + a2 * (1.0 / 24.0 + a2 * (-1.0 / 720.0 + a2 * (1.0 / 40_320.0))));
    let (sin, cos) = if quarters & 1 == 0 { (sin, cos) } else { (cos, -sin) };
    if quarters & 2 == 0 { (sin, cos) } else { (-sin, -cos) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_and_cosines_all_around() {
        for i in 0..=100_000 {
            let x = i as f32 / 100_000.0;
            let angle = f64::from(x) * std::f64::consts::TAU;
            let (sin, cos) = sin_cos_turns(x);
            let error = (f64::from(sin) - angle.sin()).hypot(f64::from(cos) - angle.cos());
            assert!(error < 3e-7, "{x}: {sin} {cos}, off by {error}");
        }
    }
}

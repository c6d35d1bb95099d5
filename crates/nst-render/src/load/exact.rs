//! Arithmetic that gives the same bits on every machine, for the numbers that the
//! scene's fingerprint covers.
//!
//! IEEE 754 fixes the results of +, −, ×, ÷ and √. It does not fix those of powers,
//! logarithms and sines, which differ between libraries, and glam adds the products
//! of a scalar product in an order that depends on the processor.

use glam::Vec3A;

/// The square of the length; the products are added from x to z.
pub(super) fn length_squared(v: Vec3A) -> f32 {
    let [x, y, z] = v.to_array();
    x * x + y * y + z * z
}

/// The unit vector, or zero for the zero vector. Vectors of any length have one,
/// also where f32 cannot square it.
pub(super) fn unit_or_zero(v: Vec3A) -> Vec3A {
    let reciprocal = 1.0 / length_squared(v).sqrt();
    if reciprocal.is_finite() && reciprocal > 0.0 {
        return v * reciprocal;
    }
    // glam computes with three f64 one by one, in the order of `length_squared`.
    v.as_dvec3().normalize_or_zero().as_vec3a()
}

/// ⁴√x. The square roots are of f64, so that the result is f32's nearest but for
/// very few x.
pub(super) fn fourth_root(x: f32) -> f32 {
    f64::from(x).sqrt().sqrt() as f32
}

/// The linear intensity of a value of sRGB within 0 and 1 (IEC 61966-2-1).
pub(super) fn srgb_to_linear(x: f32) -> f32 {
    let x = f64::from(x);
    if x <= 0.04045 {
        return (x / 12.92) as f32;
    }
    // t^2.4 = t² · ⁵√t².
    let t = (x + 0.055) / 1.055;
    (t * t * fifth_root(t * t)) as f32
}

/// ⁵√x of a positive, normal number, to some units in the last place of f64.
fn fifth_root(x: f64) -> f64 {
    // A fifth of the exponent, and a fraction that is off by less than 7 %.
    let mut root = f64::from_bits(x.to_bits() / 5 + (1023_u64 << 52) / 5 * 4);
    // Newton's steps: a relative error of e becomes 2 e².
    for _ in 0..5 {
        let square = root * root;
        root = (4.0 * root + x / (square * square)) / 5.0;
    }
    root
}

/// ⌊log₂ x⌋ of a positive, finite number.
pub(super) fn exponent(x: f32) -> i32 {
    // Every positive f32 is a normal f64, whose bits 52 to 62 are the exponent plus 1023.
    (f64::from(x).to_bits() >> 52) as i32 - 1023
}

/// 2ⁿ, for n of -1022 to 1023.
pub(super) fn power_of_two(n: i32) -> f64 {
    f64::from_bits(((1023 + n) as u64) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Random bits, which are f32 of all magnitudes, but for infinities and NaN.
    fn numbers(count: u32) -> impl Iterator<Item = f32> {
        let bits = (0..count).map(|i| i.wrapping_mul(2_654_435_761).rotate_left(7) ^ i);
        bits.map(f32::from_bits).filter(|x| x.is_finite())
    }

    #[test]
    fn exponents_and_powers_of_two() {
        for x in numbers(100_000).map(f32::abs).filter(|&x| x > 0.0) {
            let power = power_of_two(exponent(x));
            let x = f64::from(x);
            assert!(power <= x && x < 2.0 * power, "{x}: {power}");
        }
        let edges =
            [(1.0, 0), (1.999_999_9, 0), (2.0, 1), (0.5, -1), (1e-45, -149), (f32::MAX, 127)];
        for (x, expected) in edges {
            assert_eq!(exponent(x), expected, "{x}");
        }
        assert_eq!([-149, 0, 127].map(power_of_two), [2.0_f64.powi(-149), 1.0, 2.0_f64.powi(127)]);
    }

    /// Two roundings of f64 and one of f32 are off by half a unit in the last place
    /// of f32 at most, but for a share of 2⁻²⁸ of that unit.
    #[test]
    fn fourth_roots() {
        for x in numbers(100_000).map(f32::abs) {
            let root = f64::from(fourth_root(x));
            let error = (root.powi(4) - f64::from(x)).abs();
            // d(r⁴) = 4 r³ dr, with dr of half a unit: 2⁻²⁴ r.
            assert!(error <= 4.001 * 2.0_f64.powi(-24) * f64::from(x), "{x}: {root}");
        }
        assert_eq!([0.0, 1.0, 16.0, 0.0625].map(fourth_root), [0.0, 1.0, 2.0, 0.5]);
    }

    /// Half a unit in the last place of f32 below 1, and a little for the library's power.
    #[test]
    fn srgb() {
        for i in 0..=100_000_u32 {
            let x = i as f32 / 100_000.0;
            let exact = if x <= 0.04045 {
                f64::from(x) / 12.92
            } else {
                ((f64::from(x) + 0.055) / 1.055).powf(2.4)
            };
            let linear = f64::from(srgb_to_linear(x));
            assert!((linear - exact).abs() <= 1.001 * 2.0_f64.powi(-25), "{x}: {linear}, {exact}");
        }
        assert_eq!([0.0, 1.0].map(srgb_to_linear), [0.0, 1.0]);
        assert_eq!(fifth_root(32.0), 2.0);
    }

    #[test]
    fn unit_vectors_of_any_length() {
        let all: Vec<_> = numbers(30_000).collect();
        for v in all.chunks_exact(3).map(Vec3A::from_slice) {
            let unit = unit_or_zero(v).as_dvec3();
            let exact = v.as_dvec3().normalize();
            // Three roundings of f32, each of 2⁻²⁴ at most.
            assert!(unit.distance(exact) < 3.0 * 2.0_f64.powi(-24), "{v}: {unit}");
        }
        assert_eq!(unit_or_zero(Vec3A::ZERO), Vec3A::ZERO);
        assert_eq!(unit_or_zero(Vec3A::X * 1e30), Vec3A::X);
        assert_eq!(unit_or_zero(Vec3A::X * 1e-45), Vec3A::X);
    }

    /// The order of the additions decides the last bit.
    #[test]
    fn products_are_added_from_x_to_z() {
        // Two squares of 5.5e-8, each less than half a unit in the last place of 1.
        let v = Vec3A::new(1.0, 2.35e-4, 2.35e-4);
        assert_eq!(length_squared(v), 1.0);
        assert!(length_squared(Vec3A::new(v.y, v.z, v.x)) > 1.0);
    }
}

//! A logarithm that compilers turn into vector instructions.

/// ln x of a positive, normal x, within 2e-7 of the true value or of its size; other x give some
/// number or a NaN.
///
/// x = 2^k · m with m from √½ to √2, and ln m = f − f²/2 + f³ P(f) with f = m − 1, where P is
/// that of `logf` in S. Moshier's Cephes library.
#[inline(always)]
pub(super) fn ln(x: f32) -> f32 {
    const HALF_ROOT: u32 = 0x3f35_04f3; // √½
    let bits = x.to_bits();
    let k = (bits.wrapping_sub(HALF_ROOT) as i32) >> 23;
    let f = f32::from_bits(bits.wrapping_sub((k << 23) as u32)) - 1.0;
    let square = f * f;
    let mut p = 7.037_683_6e-2;
    p = p * f - 1.151_461e-1;
    p = p * f + 1.167_699_9e-1;
    p = p * f - 1.242_014_1e-1;
    p = p * f + 1.424_932_3e-1;
    p = p * f - 1.666_805_8e-1;
    p = p * f + 2.000_071_5e-1;
    p = p * f - 2.499_999_4e-1;
    p = p * f + 3.333_333e-1;
    f - 0.5 * square + square * f * p + k as f32 * std::f32::consts::LN_2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_the_logarithm() {
        let mut x = f32::MIN_POSITIVE;
        let mut worst = 0.0_f64;
        while x < 1e38 {
            let exact = f64::from(x).ln();
            worst = worst.max((f64::from(ln(x)) - exact).abs() / exact.abs().max(1.0));
            x *= 1.000_37;
        }
        assert!(worst < 2e-7, "{worst}");
        assert_eq!(ln(1.0), 0.0);
        // The comparison tells a neighbour from it.
        assert!((f64::from(ln(2.000_001)) - 2.0_f64.ln()).abs() > 4e-7);
    }
}

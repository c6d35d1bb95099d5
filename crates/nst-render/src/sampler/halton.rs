//! The Halton sequence (Halton 1964) with Owen's nested uniform scrambling
//! (Owen 1995): each digit is permuted by a permutation that depends on the
//! digits before it.

use super::hash::{mix, unit};

/// The base of each dimension.
#[rustfmt::skip]
pub(super) const PRIMES: [u32; 64] = [
    2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53,
    59, 61, 67, 71, 73, 79, 83, 89, 97, 101, 103, 107, 109, 113, 127, 131,
    137, 139, 149, 151, 157, 163, 167, 173, 179, 181, 191, 193, 197, 199, 211, 223,
    227, 229, 233, 239, 241, 251, 257, 263, 269, 271, 277, 281, 283, 293, 307, 311,
];

/// Digits are produced until a further one would be below 2⁻²⁴, the step of [`unit`].
const RESOLUTION: f64 = 1.0 / 16_777_216.0;

/// The digits of `index` in a prime `base`, mirrored at the radix point (the last digit
/// becomes the first one behind it) and scrambled. Over all keys the result is uniform on [0, 1); for one key, any `base`^k
/// consecutive indices fall into different intervals of length `base`^−k.
pub(super) fn scrambled_radical_inverse(index: u32, base: u32, key: u64) -> f32 {
    let mut rest = index;
    let mut prefix = key;
    let mut weight = 1.0_f64;
    let mut value = 0.0_f64;
    while weight > RESOLUTION {
        let digit = rest % base;
        rest /= base;
        // A random affine map modulo a prime is a permutation; its shift alone
        // makes the digit uniform.
        let bits = mix(prefix);
        let below = |half: u64, count: u32| ((half * u64::from(count)) >> 32) as u32;
        let scale = 1 + below(bits >> 32, base - 1);
        let shift = below(bits & 0xffff_ffff, base);
        let scrambled = (digit * scale + shift) % base;
        weight /= f64::from(base);
        value += weight * f64::from(scrambled);
        prefix = mix(prefix ^ u64::from(digit + 1));
    }
    // The sum of all digits may round up to 1.
    unit((value / RESOLUTION).min(16_777_215.0) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bases_are_the_first_primes() {
        let primes = (2_u32..).filter(|n| (2..*n).all(|d| n % d != 0));
        assert!(primes.take(PRIMES.len()).eq(PRIMES));
    }

    #[test]
    fn consecutive_points_are_stratified() {
        for &base in &PRIMES[..12] {
            let count = base * base;
            let mut hit = vec![false; count as usize];
            for index in 3 * count..4 * count {
                let x = scrambled_radical_inverse(index, base, 99);
                hit[(x * count as f32) as usize] = true;
            }
            // Rounding to f32 moves points by far less than the intervals' length,
            // but a point may sit on a boundary.
            let missed = hit.iter().filter(|hit| !**hit).count();
            assert!(missed <= 1, "base {base}: {missed} of {count} intervals are empty");
        }
    }

    /// The mean of (x − 1/2) y over 64 points has far less variance than with
    /// independent ones, whose variance is 1/12 · 1/3 / 64.
    #[test]
    fn scrambling_keeps_the_low_discrepancy() {
        let mut squares = 0.0;
        for key in 0..200_u64 {
            let mean = (0..64)
                .map(|i| {
                    let x = scrambled_radical_inverse(i, 2, mix(2 * key));
                    let y = scrambled_radical_inverse(i, 3, mix(2 * key + 1));
                    f64::from((x - 0.5) * y)
                })
                .sum::<f64>()
                / 64.0;
            squares += mean * mean;
        }
        let ratio = squares / 200.0 / (1.0 / 36.0 / 64.0);
        assert!(ratio < 0.1, "variance relative to independent points: {ratio}");
    }
}

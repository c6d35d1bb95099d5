//! Random numbers that are the same everywhere: for simulations and tests.

/// SplitMix64 (Steele, Lea, Flood: *Fast Splittable Pseudorandom Number Generators*, OOPSLA
/// 2014). Renderers need better ones: see the samplers of `nst-render`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SplitMix64(pub u64);

/// The step of the state, an odd number near 2⁶⁴ divided by the golden ratio: the authors'
/// choice.
pub const GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

impl SplitMix64 {
    /// The generator of a stream: every pair of seed and stream gives numbers of its own.
    #[must_use]
    pub fn of_stream(seed: u64, stream: u64) -> Self {
        Self(mix(mix(seed.wrapping_add(GAMMA)) ^ stream))
    }

    /// The next 64 bits.
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(GAMMA);
        mix(self.0)
    }

    /// A number in [0, 1), a multiple of 2⁻⁵³.
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A number below `end`, or 0 if that is 0. The bias of the remainder is below
    /// `end` / 2⁶⁴.
    pub fn below(&mut self, end: usize) -> usize {
        (self.next_u64() % end.max(1) as u64) as usize
    }
}

/// The generator's output function, with the authors' constants: a bijection in which every
/// bit of the result depends on every bit of `z`.
#[must_use]
#[inline(always)]
pub fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first outputs of the authors' C code (prng.di.unimi.it/splitmix64.c) for
    /// the state 1234567.
    #[test]
    fn known_outputs() {
        let mut random = SplitMix64(1_234_567);
        let known = [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
            4_593_380_528_125_082_431,
        ];
        assert_eq!([(); 4].map(|()| random.next_u64()), known);
        assert!((0..100).all(|_| (0.0..1.0).contains(&random.uniform())));
        assert!((0..100).all(|_| random.below(3) < 3) && random.below(0) == 0);
    }
}

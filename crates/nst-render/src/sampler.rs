//! Random numbers as pure functions of (seed, pixel, sample index, dimension).

use glam::Vec2;

/// Independent uniform random numbers: SplitMix64 (Steele, Lea, Flood 2014),
/// started at a hash of seed, pixel and sample index.
#[derive(Clone, Copy, Debug)]
pub struct RandomSampler {
    seed: u64,
}

impl RandomSampler {
    /// A sampler; different seeds give independent renderings.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { seed: mix(seed.wrapping_add(GAMMA)) }
    }

    /// The numbers of one sample of one pixel, from dimension 0 on.
    #[must_use]
    pub fn stream(&self, pixel: u32, index: u32) -> SampleStream {
        SampleStream { state: mix(self.seed ^ (u64::from(pixel) << 32 | u64::from(index))) }
    }
}

/// The dimensions of one sample, drawn in turn.
#[derive(Clone, Copy, Debug)]
pub struct SampleStream {
    state: u64,
}

impl SampleStream {
    /// The next dimension, uniform on [0, 1).
    pub fn next_1d(&mut self) -> f32 {
        unit((self.next() >> 40) as u32)
    }

    /// The next two dimensions, uniform on [0, 1)².
    pub fn next_2d(&mut self) -> Vec2 {
        let bits = self.next();
        Vec2::new(unit((bits >> 40) as u32), unit((bits >> 16) as u32 & 0xff_ffff))
    }

    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GAMMA);
        mix(self.state)
    }
}

/// 2⁶⁴ divided by the golden ratio, made odd.
const GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Maps 24 bits to [0, 1), exactly.
fn unit(bits: u32) -> f32 {
    bits as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_do_not_depend_on_the_order_of_queries() {
        let sampler = RandomSampler::new(7);
        let values = |pixel, index| {
            let mut stream = sampler.stream(pixel, index);
            [stream.next_1d(), stream.next_2d().x, stream.next_1d()]
        };
        let forward: Vec<_> = (0..100).map(|i| values(i / 10, i % 10)).collect();
        let backward: Vec<_> = (0..100).rev().map(|i| values(i / 10, i % 10)).collect();
        assert!(forward.iter().eq(backward.iter().rev()));
        assert_ne!(values(3, 4), values(4, 3));
        assert_ne!(forward[0][0], RandomSampler::new(8).stream(0, 0).next_1d());
    }

    /// χ² over 16² cells of neighbouring dimensions, pixels and samples; the
    /// 0.9999 quantile of 255 degrees of freedom is 347.7.
    #[test]
    fn neighbours_are_uniform_and_independent() {
        const COUNT: u32 = 65_536;
        let sampler = RandomSampler::new(1);
        let first = |pixel, index| sampler.stream(pixel, index).next_1d();
        let pairs: [&dyn Fn(u32) -> (f32, f32); 4] = [
            &|i| (first(i, 0), first(i + 1, 0)),
            &|i| (first(0, i), first(0, i + 1)),
            &|i| sampler.stream(i, 3).next_2d().into(),
            &|i| {
                let mut stream = sampler.stream(5, i);
                (stream.next_1d(), stream.next_2d().y)
            },
        ];
        for (case, pair) in pairs.iter().enumerate() {
            let mut cells = [0.0_f64; 256];
            for i in 0..COUNT {
                let (x, y) = pair(i);
                cells[(x * 16.0) as usize * 16 + (y * 16.0) as usize] += 1.0;
            }
            let expected = f64::from(COUNT) / 256.0;
            let chi2: f64 = cells.iter().map(|n| (n - expected).powi(2) / expected).sum();
            assert!(chi2 < 347.7, "case {case}: χ² = {chi2}");
        }
    }
}

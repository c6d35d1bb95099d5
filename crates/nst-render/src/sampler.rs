//! Random numbers as pure functions of (seed, pixel, sample index, dimension).

mod halton;
mod hash;

use std::{fmt, str::FromStr};

use glam::Vec2;
use nst_core::FOLDS;

use crate::packet::PACKET;
use hash::{GAMMA, bits, first, mix, pair};

/// Which numbers a rendering draws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SamplerKind {
    /// Independent and uniform.
    #[default]
    Random,
    /// The Halton sequence, Owen-scrambled for each pixel by itself. The folds of a lane
    /// depend on each other.
    Halton,
    /// For each of the [`FOLDS`] folds of a pixel a Halton sequence of its own, scrambled by
    /// itself, so that the folds are independent.
    HaltonFolds,
}

impl SamplerKind {
    const ALL: [Self; 3] = [Self::Random, Self::Halton, Self::HaltonFolds];
}

/// The name in sequence files and on the command line.
impl fmt::Display for SamplerKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Random => "random",
            Self::Halton => "halton",
            Self::HaltonFolds => "halton-folds",
        })
    }
}

impl FromStr for SamplerKind {
    type Err = String;

    /// Undoes `to_string`.
    fn from_str(name: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.to_string() == name)
            .ok_or_else(|| format!("'{name}' is not 'random', 'halton' or 'halton-folds'"))
    }
}

/// A sampler with its seed. Different seeds give independent renderings, and
/// the pixels of one rendering are independent of each other.
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    kind: SamplerKind,
    seed: u64,
}

impl Sampler {
    /// A sampler of a kind.
    #[must_use]
    pub fn new(kind: SamplerKind, seed: u64) -> Self {
        Self { kind, seed: mix(seed.wrapping_add(GAMMA)) }
    }

    pub(crate) fn kind(&self) -> SamplerKind {
        self.kind
    }

    /// The numbers of one sample of one pixel, from dimension 0 on.
    #[must_use]
    pub fn stream(&self, pixel: u32, index: u32) -> SampleStream {
        // The samples of a pixel, or of a fold of it, are points of one Halton sequence;
        // random ones are independent.
        const FOLD_COUNT: u32 = FOLDS as u32;
        let (member, index) = match self.kind {
            SamplerKind::Random => (index, index),
            SamplerKind::Halton => (0, index),
            SamplerKind::HaltonFolds => (index % FOLD_COUNT, index / FOLD_COUNT),
        };
        let key = mix(self.seed ^ (u64::from(pixel) << 32 | u64::from(member)));
        SampleStream { kind: self.kind, key, index, dimension: 0 }
    }
}

/// The dimensions of one sample, drawn in turn.
#[derive(Clone, Copy, Debug)]
pub struct SampleStream {
    kind: SamplerKind,
    key: u64,
    index: u32,
    dimension: u32,
}

impl SampleStream {
    /// The next dimension, uniform on [0, 1).
    #[inline]
    pub fn next_1d(&mut self) -> f32 {
        let dimension = self.dimension;
        self.dimension += 1;
        match self.kind {
            SamplerKind::Random => first(bits(self.key, dimension)),
            SamplerKind::Halton | SamplerKind::HaltonFolds => {
                halton(self.key, self.index, dimension)
            }
        }
    }

    /// The next two dimensions, uniform on [0, 1)².
    #[inline]
    pub fn next_2d(&mut self) -> Vec2 {
        let dimension = self.dimension;
        self.dimension += 2;
        match self.kind {
            SamplerKind::Random => pair(bits(self.key, dimension)),
            SamplerKind::Halton | SamplerKind::HaltonFolds => Vec2::new(
                halton(self.key, self.index, dimension),
                halton(self.key, self.index, dimension + 1),
            ),
        }
    }
}

/// Bits of the numbers of [`Streams::draw_fine`].
pub(crate) const FINE_BITS: u32 = 48;

/// The streams of a packet of samples, drawn from together.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Streams {
    key: [u64; PACKET],
    index: [u32; PACKET],
}

impl Streams {
    pub(crate) const ZERO: Self = Self { key: [0; PACKET], index: [0; PACKET] };

    #[inline(always)]
    pub(crate) fn set(&mut self, i: usize, stream: &SampleStream) {
        self.key[i] = stream.key;
        self.index[i] = stream.index;
    }

    #[inline(always)]
    pub(crate) fn copy(&mut self, i: usize, other: &Self, from: usize) {
        self.key[i] = other.key[from];
        self.index[i] = other.index[from];
    }

    /// A dimension of each sample.
    #[inline(always)]
    pub(crate) fn draw_1d(&self, kind: SamplerKind, dimension: u32) -> [f32; PACKET] {
        let mut values = [0.0; PACKET];
        match kind {
            SamplerKind::Random => {
                for i in 0..PACKET {
                    values[i] = first(bits(self.key[i], dimension));
                }
            }
            SamplerKind::Halton | SamplerKind::HaltonFolds => {
                for i in 0..PACKET {
                    values[i] = halton(self.key[i], self.index[i], dimension);
                }
            }
        }
        values
    }

    /// A number of sample `i`, uniform on [0, 1), that belongs to no dimension: for each
    /// `dimension` and `event`, one that is independent of all others.
    #[inline]
    pub(crate) fn draw_aside(&self, i: usize, dimension: u32, event: u32) -> f32 {
        // The complement, as in `fine_halton`: another key than that of any dimension.
        let key = mix(!self.key[i] ^ u64::from(self.index[i]));
        first(mix(key ^ (u64::from(dimension) << 32 | u64::from(event))))
    }

    /// A dimension of each sample with twice as many digits, as a number of [`FINE_BITS`]
    /// bits: the first 24 are those of [`Self::draw_1d`].
    #[inline(always)]
    pub(crate) fn draw_fine(&self, kind: SamplerKind, dimension: u32) -> [u64; PACKET] {
        let mut values = [0; PACKET];
        match kind {
            SamplerKind::Random => {
                for i in 0..PACKET {
                    values[i] = bits(self.key[i], dimension) >> (64 - FINE_BITS);
                }
            }
            SamplerKind::Halton | SamplerKind::HaltonFolds => {
                for i in 0..PACKET {
                    values[i] = fine_halton(self.key[i], self.index[i], dimension);
                }
            }
        }
        values
    }

    /// A dimension of each sample and the next one.
    #[inline(always)]
    pub(crate) fn draw_2d(&self, kind: SamplerKind, dimension: u32) -> [[f32; PACKET]; 2] {
        match kind {
            SamplerKind::Random => {
                let [mut x, mut y] = [[0.0; PACKET]; 2];
                for i in 0..PACKET {
                    let u = pair(bits(self.key[i], dimension));
                    x[i] = u.x;
                    y[i] = u.y;
                }
                [x, y]
            }
            SamplerKind::Halton | SamplerKind::HaltonFolds => {
                [self.draw_1d(kind, dimension), self.draw_1d(kind, dimension + 1)]
            }
        }
    }
}

/// A dimension of sample `index` of Halton's sequence, scrambled by `key`.
#[cold]
fn halton(key: u64, index: u32, dimension: u32) -> f32 {
    let key = bits(key, dimension);
    match halton::PRIMES.get(dimension as usize) {
        Some(&base) => halton::scrambled_radical_inverse(index, base, key),
        // In larger bases, far fewer samples than base² are no more even than random ones.
        None => first(mix(key ^ u64::from(index))),
    }
}

/// [`halton`] with [`FINE_BITS`] bits. The further digits are random: below 2⁻²⁴, the
/// scrambled digits of any number of samples are no better.
#[cold]
fn fine_halton(key: u64, index: u32, dimension: u32) -> u64 {
    let first = (halton(key, index, dimension) * 16_777_216.0) as u64;
    // The complement: scrambling hashes the same key with small numbers.
    let more = mix(!bits(key, dimension) ^ u64::from(index)) >> 40;
    first << 24 | more
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_do_not_depend_on_the_order_of_queries() {
        for kind in SamplerKind::ALL {
            let sampler = Sampler::new(kind, 7);
            let values = |pixel, index| {
                let mut stream = sampler.stream(pixel, index);
                [stream.next_1d(), stream.next_2d().x, stream.next_1d()]
            };
            let forward: Vec<_> = (0..100).map(|i| values(i / 10, i % 10)).collect();
            let backward: Vec<_> = (0..100).rev().map(|i| values(i / 10, i % 10)).collect();
            assert!(forward.iter().eq(backward.iter().rev()));
            assert_ne!(values(3, 4), values(4, 3));
            assert_ne!(forward[0][0], Sampler::new(kind, 8).stream(0, 0).next_1d());
        }
    }

    /// χ² over 16² cells of neighbouring dimensions, pixels and samples; the
    /// 0.9999 quantile of 255 degrees of freedom is 347.7.
    fn chi2(pair: impl Fn(u32) -> (f32, f32)) -> f64 {
        const COUNT: u32 = 65_536;
        let mut cells = [0.0_f64; 256];
        for i in 0..COUNT {
            let (x, y) = pair(i);
            assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
            cells[(x * 16.0) as usize * 16 + (y * 16.0) as usize] += 1.0;
        }
        let expected = f64::from(COUNT) / 256.0;
        cells.iter().map(|n| (n - expected).powi(2) / expected).sum()
    }

    #[test]
    fn neighbours_are_uniform_and_independent() {
        for kind in SamplerKind::ALL {
            let sampler = Sampler::new(kind, 1);
            let dimension = |pixel, index, dimension| {
                let mut stream = sampler.stream(pixel, index);
                (0..=dimension).map(|_| stream.next_1d()).last().unwrap_or_default()
            };
            let pixels = chi2(|i| (dimension(i, 0, 0), dimension(i + 1, 0, 0)));
            let plane = chi2(|i| sampler.stream(i, 3).next_2d().into());
            let deep = chi2(|i| (dimension(i, 5, 3), dimension(i, 5, 70)));
            assert!(
                pixels < 347.7 && plane < 347.7 && deep < 347.7,
                "{kind:?}: {pixels} {plane} {deep}"
            );
        }
        let random = Sampler::new(SamplerKind::Random, 1);
        let first = |index| random.stream(0, index).next_1d();
        assert!(chi2(|i| (first(i), first(i + 1))) < 347.7);
        // The test must see numbers that are not independent.
        assert!(chi2(|i| (first(i), first(i))) > 347.7);
    }

    /// Every fold is a Halton sequence: its first eight numbers in base 2 are one in each eighth.
    /// One fold says nothing about another, which χ² sees where folds share a sequence.
    #[test]
    fn folds_are_sequences_of_their_own() {
        let first = |kind, pixel, index| Sampler::new(kind, 5).stream(pixel, index).next_1d();
        let folds = SamplerKind::HaltonFolds;
        for fold in 0..FOLDS as u32 {
            let mut eighths: Vec<_> =
                (0..8).map(|i| (first(folds, 3, fold + i * 4) * 8.0) as u32).collect();
            eighths.sort_unstable();
            assert_eq!(eighths, [0, 1, 2, 3, 4, 5, 6, 7], "fold {fold}");
        }
        let neighbours = |kind| chi2(|pixel| (first(kind, pixel, 4), first(kind, pixel, 5)));
        assert!(neighbours(folds) < 347.7 && neighbours(SamplerKind::Halton) > 347.7);
    }

    /// Both halves of numbers with many digits: the first is the number with fewer, and
    /// the second is uniform and independent of it, of its neighbours, and of the next
    /// dimension.
    #[test]
    fn fine_numbers_are_finer_than_others_and_uniform() {
        for kind in SamplerKind::ALL {
            let sampler = Sampler::new(kind, 3);
            let fine = |pixel, index, dimension| {
                let mut streams = Streams::ZERO;
                streams.set(5, &sampler.stream(pixel, index));
                let number = streams.draw_fine(kind, dimension)[5];
                assert_eq!(first(number << 16), streams.draw_1d(kind, dimension)[5]);
                first(number << 40)
            };
            let number = |index, dimension| {
                let mut streams = Streams::ZERO;
                streams.set(0, &sampler.stream(9, index));
                streams.draw_1d(kind, dimension)[0]
            };
            let tests = [
                chi2(|i| (fine(9, i, 2), number(i, 2))),
                chi2(|i| (fine(9, i, 2), number(i, 3))),
                chi2(|i| (fine(9, i, 2), fine(9, i + 1, 2))),
                chi2(|i| (fine(i, 0, 2), fine(i + 1, 0, 2))),
                chi2(|i| (fine(9, i, 2), fine(9, i, 8))),
                chi2(|i| (fine(9, i, 100), fine(9, i, 101))),
            ];
            assert!(tests.iter().all(|&value| value < 347.7), "{kind:?}: {tests:?}");
        }
    }
}

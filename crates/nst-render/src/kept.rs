//! Which terms of each pixel's sequence are kept, and where while samples come in.

use crate::Keep;

/// The places of terms during a rendering of at most N samples: a *slot* holds
/// one term of all lanes. First come those of S_1, S_2, S_4, … if they are
/// asked for, then a ring of the last terms.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slots {
    powers: usize,
    ring: u32,
}

impl Slots {
    pub(crate) fn new(keep: Keep, samples: u32) -> Self {
        let ring = match keep {
            Keep::All => samples,
            Keep::Window(length) | Keep::Pow2(length) => length.clamp(1, samples),
        };
        let powers = if matches!(keep, Keep::Pow2(_)) { samples.ilog2() + 1 } else { 0 };
        Self { powers: powers as usize, ring }
    }

    pub(crate) fn count(&self) -> usize {
        self.powers + self.ring as usize
    }

    /// The slots of S_n, of which there may be two, in a pass that ends with S_`end`;
    /// none if the ring would lose the term before then.
    pub(crate) fn of(&self, n: u32, end: u32) -> impl Iterator<Item = usize> + use<> {
        let power = (self.powers > 0 && n.is_power_of_two()).then(|| n.ilog2() as usize);
        let lasts = end - n < self.ring;
        let ring = lasts.then(|| self.powers + ((n - 1) % self.ring) as usize);
        power.into_iter().chain(ring)
    }

    /// Puts the slots in the order of [`Slots::sample_counts`] after n samples, and
    /// drops the others. A slot is `plane` numbers long.
    pub(crate) fn sort(&self, terms: &mut Vec<f32>, plane: usize, n: u32) {
        let ring = &mut terms[self.powers * plane..];
        if n >= self.ring {
            ring.rotate_left((n % self.ring) as usize * plane);
        }
        let last = self.powers + self.ring.min(n) as usize;
        terms.truncate(last * plane);
        // Powers of two that the window holds as well.
        terms.drain(self.early(n) * plane..self.powers * plane);
        terms.shrink_to_fit();
    }

    /// The number of samples behind each term that is kept after n, increasing.
    pub(crate) fn sample_counts(&self, n: u32) -> Vec<u32> {
        let early = (0..self.early(n)).map(|power| 1 << power);
        early.chain(self.window(n)..=n).collect()
    }

    /// The first term of the ring after n samples.
    fn window(&self, n: u32) -> u32 {
        n.saturating_sub(self.ring - 1).max(1)
    }

    /// How many powers of two lie before the ring.
    fn early(&self, n: u32) -> usize {
        (0..self.powers).take_while(|&power| 1_u64 << power < u64::from(self.window(n))).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every kept term, whenever a rendering stops, however its passes are split.
    #[test]
    fn slots_hold_what_they_say() {
        for keep in [Keep::All, Keep::Window(0), Keep::Window(8), Keep::Pow2(1), Keep::Pow2(8)] {
            for (samples, pass) in [(1, 1), (5, 2), (64, 16), (70, 7), (70, 1)] {
                let slots = Slots::new(keep, samples);
                let mut terms = vec![-1.0; slots.count()];
                let mut n = 0;
                while n < samples {
                    let end = samples.min(n + pass);
                    for term in n + 1..=end {
                        slots.of(term, end).for_each(|slot| terms[slot] = term as f32);
                    }
                    n = end;
                    let mut sorted = terms.clone();
                    slots.sort(&mut sorted, 1, n);
                    let counts = slots.sample_counts(n);
                    assert_eq!(sorted, counts.iter().map(|&n| n as f32).collect::<Vec<_>>());
                }
            }
        }
    }

    #[test]
    fn kept_terms() {
        let kept = |n, keep| Slots::new(keep, n).sample_counts(n);
        assert_eq!(kept(64, Keep::Window(8)), Vec::from_iter(57..=64));
        assert_eq!(kept(64, Keep::All), Vec::from_iter(1..=64));
        assert_eq!(kept(5, Keep::Window(8)), [1, 2, 3, 4, 5]);
        assert_eq!(kept(5, Keep::Window(0)), [5]);
        assert_eq!(kept(64, Keep::Pow2(2)), [1, 2, 4, 8, 16, 32, 63, 64]);
        assert_eq!(kept(40, Keep::Pow2(8)), [1, 2, 4, 8, 16, 32, 33, 34, 35, 36, 37, 38, 39, 40]);
        assert_eq!(kept(3, Keep::Pow2(8)), [1, 2, 3]);
        assert_eq!(kept(u32::MAX, Keep::Window(2)), [u32::MAX - 1, u32::MAX]);
    }
}

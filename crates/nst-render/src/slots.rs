//! The places in memory of the terms that are kept, while samples are added.

use nst_core::Keep;

/// The places of terms during a rendering of at most N samples: a *slot* is for one term of
/// all lanes. First come those of S_1, S_2, S_4, … if they are kept, then a ring of the
/// last terms.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slots {
    keep: Keep,
    powers: usize,
    ring: u32,
}

impl Slots {
    pub(crate) fn new(keep: Keep, samples: u32) -> Self {
        let powers = keep.powers(samples) as usize;
        Self { keep, powers, ring: keep.window_length(samples) }
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

    /// The slots of the terms that are kept after n samples, in the order of
    /// [`Slots::sample_counts`].
    pub(crate) fn sorted(&self, n: u32) -> Vec<usize> {
        let slot = |count| self.of(count, n).next().expect("a slot for each term that is kept");
        self.sample_counts(n).into_iter().map(slot).collect()
    }

    /// The number of samples behind each term that is kept after n, increasing.
    pub(crate) fn sample_counts(&self, n: u32) -> Vec<u32> {
        self.keep.sample_counts(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every kept term, whenever a rendering stops, however its passes are split.
    #[test]
    fn slots_contain_what_they_say() {
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
                    let sorted: Vec<f32> =
                        slots.sorted(n).iter().map(|&slot| terms[slot]).collect();
                    let counts = slots.sample_counts(n);
                    assert_eq!(sorted, counts.iter().map(|&n| n as f32).collect::<Vec<_>>());
                }
            }
        }
    }
}

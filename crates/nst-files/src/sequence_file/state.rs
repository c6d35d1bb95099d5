//! The f64 sums of a rendering as pairs of UINT channels, without loss.
//!
//! A sum is a layer of its own: `state.fold0` … `state.fold3` for Σy, `state.root0` … for Σ√y,
//! and `state.square0` … for Σy². `lo` contains the lower 32 bits of the number. The fold's mean
//! in the same file predicts its upper 32 bits almost exactly, so `hi` contains only their
//! difference (mod 2³²) from the prediction: mostly zeros, which compress well.

use exr::prelude::SampleType;

use nst_core::{FOLDS, LaneSums, SequenceBatch, Side, fold_count};

use crate::{ColorModel, layers::channel_name, rows::Channel};

/// The number of sums of a lane.
pub(super) const SUMS: usize = Side::EVERY_OF_FOLDS.len();

/// The UINT channels: for each sum `hi` and `lo`, each with the channels of `model`.
pub(super) fn channels(model: ColorModel) -> Vec<Channel> {
    let sums = Side::EVERY_OF_FOLDS.iter().map(|side| format!("state.{side}"));
    sums.flat_map(|sum| [format!("{sum}.hi"), format!("{sum}.lo")])
        .flat_map(|layer| {
            model
                .channels()
                .iter()
                .map(move |channel| (channel_name(&layer, channel), SampleType::U32))
        })
        .collect()
}

/// What a file of n samples says about one lane.
#[derive(Clone, Copy)]
pub(super) struct Known {
    pub(super) n: u32,
    /// The means of the folds, `[sum]`; zeros if there are none.
    pub(super) means: [f32; SUMS],
    /// The variance of S_n; zero if there is none.
    pub(super) variance: f32,
}

impl Known {
    /// What the means predict for the sums. A prediction must have the same bits on every
    /// machine: those of a NaN may differ, so 0 takes its place.
    fn predicted(&self) -> [f64; SUMS] {
        std::array::from_fn(|sum| {
            let predicted = f64::from(self.means[sum]) * fold_count(sum % FOLDS, self.n);
            if predicted.is_nan() { 0.0 } else { predicted }
        })
    }

    /// The `hi` and `lo` of the sums.
    pub(super) fn split(&self, sums: &LaneSums) -> [[u32; 2]; SUMS] {
        let (sums, predicted) = (flat(sums), self.predicted());
        std::array::from_fn(|sum| split(sums[sum], predicted[sum]))
    }

    /// The inverse of [`Known::split`].
    pub(super) fn join(&self, words: [[u32; 2]; SUMS]) -> LaneSums {
        let predicted = self.predicted();
        let of_kind = |kind: usize| {
            std::array::from_fn(|fold| {
                let sum = kind * FOLDS + fold;
                join(words[sum], predicted[sum])
            })
        };
        LaneSums { folds: of_kind(0), roots: of_kind(1), squares: of_kind(2) }
    }
}

/// The sums of a lane in the order of [`Side::EVERY_OF_FOLDS`].
fn flat(sums: &LaneSums) -> [f64; SUMS] {
    std::array::from_fn(|sum| sums.of_folds()[sum / FOLDS][sum % FOLDS])
}

/// How far a sum may be, relatively, from the 32-bit float that the file has of it: 2⁻²⁴ by
/// rounding, and 2⁻²⁰ where a program has copied the file that stores integers as 32-bit
/// floats, and a word of a state is off by one.
pub(super) const LOST_BITS: f64 = 1.0 / (1 << 17) as f64;

/// Whether a number agrees with what the file says of it, but for rounding relative to `scale`.
pub(super) fn close(a: f64, b: f32, scale: f64) -> bool {
    let b = f64::from(b);
    let difference = (a - b).abs();
    difference <= LOST_BITS * scale.max(b.abs()) + f64::from(f32::MIN_POSITIVE)
        || a as f32 == b as f32
        || !(a.is_finite() || b.is_finite())
}

/// Whether the sums of a lane agree with what the file says of it beside them: the last
/// term, the fold means and the variance.
pub(super) fn agree(sums: &LaneSums, last: f32, known: &Known) -> bool {
    let n = f64::from(known.n);
    let folds_agree = flat(sums).iter().zip(known.means).enumerate().all(|(i, (sum, mean))| {
        let count = fold_count(i % FOLDS, known.n);
        known.n < FOLDS as u32 || close(sum / count, mean, (sum / count).abs())
    });
    let mean = sums.total() / n;
    let scale = sums.folds.iter().map(|sum| sum.abs()).sum::<f64>() / n;
    let spread = sums.squares.iter().sum::<f64>() / (n * (n - 1.0)).max(1.0);
    let variance = f64::from(sums.variance(known.n));
    folds_agree
        && close(mean, last, scale)
        && (known.n < 2 || close(variance, known.variance, spread.abs()))
}

/// What a batch says about each lane beside its terms.
pub(super) struct KnownLanes<'a> {
    n: u32,
    means: [Option<&'a [f32]>; SUMS],
    variance: Option<&'a [f32]>,
}

impl<'a> KnownLanes<'a> {
    pub(super) fn new(batch: &'a SequenceBatch) -> Self {
        Self {
            n: batch.sample_counts().last().copied().unwrap_or_default(),
            means: std::array::from_fn(|sum| batch.side(&Side::EVERY_OF_FOLDS[sum])),
            variance: batch.side(&Side::Variance),
        }
    }

    pub(super) fn lane(&self, lane: usize) -> Known {
        let value = |side: Option<&[f32]>| side.map_or(0.0, |values| values[lane]);
        Known { n: self.n, means: self.means.map(value), variance: value(self.variance) }
    }
}

fn upper(number: f64) -> u32 {
    (number.to_bits() >> 32) as u32
}

pub(super) fn split(number: f64, prediction: f64) -> [u32; 2] {
    [upper(number).wrapping_sub(upper(prediction)), number.to_bits() as u32]
}

pub(super) fn join([hi, lo]: [u32; 2], prediction: f64) -> f64 {
    let upper = hi.wrapping_add(upper(prediction));
    f64::from_bits(u64::from(upper) << 32 | u64::from(lo))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The means that a file has of sums of n samples.
    fn means(sums: &LaneSums, n: u32) -> [f32; SUMS] {
        let sums = flat(sums);
        std::array::from_fn(|sum| (sums[sum] / fold_count(sum % FOLDS, n)) as f32)
    }

    fn unflat(sums: [f64; SUMS]) -> LaneSums {
        let of_kind = |kind: usize| std::array::from_fn(|fold| sums[kind * FOLDS + fold]);
        LaneSums { folds: of_kind(0), roots: of_kind(1), squares: of_kind(2) }
    }

    #[test]
    fn sums_that_contradict_the_file_are_seen() {
        let mut sums = LaneSums::default();
        (0..16).for_each(|i| sums.add(i, f64::from(i % 5) + 0.1));
        let known = Known { n: 16, means: means(&sums, 16), variance: sums.variance(16) };
        let last = (sums.total() / 16.0) as f32;
        assert!(agree(&sums, last, &known));
        // As after a copy by a program that stores integers as 32-bit floats.
        let lossy = |x: f64| f64::from_bits((x.to_bits() & !0 << 9) + (1 << 32));
        assert!(agree(&unflat(flat(&sums).map(lossy)), last, &known));
        for i in 0..SUMS {
            for factor in [1.001, f64::NAN] {
                let mut wrong = flat(&sums);
                wrong[i] *= factor;
                assert!(!agree(&unflat(wrong), last, &known), "sum {i}");
            }
        }
        assert!(!agree(&sums, 1.001 * last, &known));
        assert!(!agree(&sums, last, &Known { n: 17, ..known }));
        assert!(!agree(&sums, last, &Known { means: [f32::NAN; SUMS], ..known }));
        assert!(!agree(&sums, last, &Known { variance: 1.001 * known.variance, ..known }));
    }

    proptest! {
        /// Whatever the bits are, and whatever the file says beside them.
        #[test]
        fn no_bit_is_lost(
            n in 1..u32::MAX,
            bits in prop::array::uniform12(any::<u64>()),
            known in prop::array::uniform12(any::<u32>()),
        ) {
            let known = Known { n, means: known.map(f32::from_bits), variance: 0.0 };
            let again = known.join(known.split(&unflat(bits.map(f64::from_bits))));
            prop_assert_eq!(flat(&again).map(f64::to_bits), bits);
        }

        /// The prediction is off by a carry at most.
        #[test]
        fn upper_words_are_predicted(samples in prop::collection::vec(0.0..100.0_f32, 8..40)) {
            let mut sums = LaneSums::default();
            (0..).zip(&samples).for_each(|(i, &y)| sums.add(i, f64::from(y)));
            let n = samples.len() as u32;
            let known = Known { n, means: means(&sums, n), variance: sums.variance(n) };
            for [hi, _] in known.split(&sums) {
                prop_assert!(hi.wrapping_add(1) <= 2, "{hi}");
            }
        }
    }
}

//! The f64 sums of a rendering as pairs of UINT channels, without loss.
//!
//! A sum is a layer of its own: `state.fold0` … `state.fold3` and `state.squares`. `lo`
//! contains the lower 32 bits of the number. The fold mean or the variance in the same file
//! predicts its upper 32 bits almost exactly, so `hi` contains only their difference (mod
//! 2³²) from the prediction: mostly zeros, which compress well.

use exr::prelude::SampleType;

use nst_core::{FOLDS, LaneSums, SequenceBatch, Side, fold_count};

use crate::{ColorModel, layers::channel_name, rows::Channel};

/// The number of sums of a lane: one for each fold, and one of the squares.
pub(super) const SUMS: usize = FOLDS + 1;

/// The UINT channels: for each sum `hi` and `lo`, each with the channels of `model`.
pub(super) fn channels(model: ColorModel) -> Vec<Channel> {
    let folds = Side::ALL_FOLDS.iter().map(|fold| format!("state.{fold}"));
    folds
        .chain(["state.squares".to_owned()])
        .flat_map(|sum| [format!("{sum}.hi"), format!("{sum}.lo")])
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
    /// The fold means; zeros if there are none.
    pub(super) means: [f32; FOLDS],
    /// The variance of S_n; zero if there is none.
    pub(super) variance: f32,
}

impl Known {
    fn fold(&self, fold: usize) -> f64 {
        predictable(f64::from(self.means[fold]) * fold_count(fold, self.n))
    }

    /// Σy² = Var[S_n] n (n − 1) + (Σy)²/n.
    fn squares(&self, sum: f64) -> f64 {
        let n = f64::from(self.n);
        predictable(f64::from(self.variance) * n * (n - 1.0) + sum * sum / n)
    }

    /// The `hi` and `lo` of the folds, then of the squares.
    pub(super) fn split(&self, sums: &LaneSums) -> [[u32; 2]; SUMS] {
        std::array::from_fn(|sum| match sums.folds.get(sum) {
            Some(&fold) => split(fold, self.fold(sum)),
            None => split(sums.squares, self.squares(sums.total())),
        })
    }

    /// The inverse of [`Known::split`].
    pub(super) fn join(&self, words: [[u32; 2]; SUMS]) -> LaneSums {
        let folds = std::array::from_fn(|fold| join(words[fold], self.fold(fold)));
        let mut sums = LaneSums { folds, squares: 0.0 };
        sums.squares = join(words[FOLDS], self.squares(sums.total()));
        sums
    }
}

/// How far a sum may be, relatively, from the 32-bit float that the file has of it: 2⁻²⁴ by
/// rounding, and 2⁻²⁰ where a program has copied the file that stores integers as 32-bit
/// floats, and a word of a state is off by one.
const LOST_BITS: f64 = 1.0 / (1 << 17) as f64;

/// Whether the sums of a lane agree with what the file says of it beside them: the last
/// term, the fold means and the variance.
pub(super) fn agree(sums: &LaneSums, last: f32, known: &Known) -> bool {
    let close = |a: f64, b: f32, scale: f64| {
        let b = f64::from(b);
        let difference = (a - b).abs();
        difference <= LOST_BITS * scale.max(b.abs()) + f64::from(f32::MIN_POSITIVE)
            || a as f32 == b as f32
            || !(a.is_finite() || b.is_finite())
    };
    let n = f64::from(known.n);
    let folds_agree = sums.folds.iter().zip(known.means).enumerate().all(|(fold, (sum, mean))| {
        let count = fold_count(fold, known.n);
        known.n < FOLDS as u32 || close(sum / count, mean, (sum / count).abs())
    });
    let mean = sums.total() / n;
    let scale = sums.folds.iter().map(|sum| sum.abs()).sum::<f64>() / n;
    let spread = sums.squares / (n * (n - 1.0)).max(1.0);
    let variance = f64::from(sums.variance(known.n));
    folds_agree
        && close(mean, last, scale)
        && (known.n < 2 || close(variance, known.variance, spread.abs()))
}

/// What a batch says about each lane beside its terms.
pub(super) struct KnownLanes<'a> {
    n: u32,
    folds: [Option<&'a [f32]>; FOLDS],
    variance: Option<&'a [f32]>,
}

impl<'a> KnownLanes<'a> {
    pub(super) fn new(batch: &'a SequenceBatch) -> Self {
        Self {
            n: batch.sample_counts().last().copied().unwrap_or_default(),
            folds: Side::ALL_FOLDS.each_ref().map(|fold| batch.side(fold)),
            variance: batch.side(&Side::Variance),
        }
    }

    pub(super) fn lane(&self, lane: usize) -> Known {
        let value = |side: Option<&[f32]>| side.map_or(0.0, |values| values[lane]);
        Known { n: self.n, means: self.folds.map(value), variance: value(self.variance) }
    }
}

/// A prediction must have the same bits on every machine. Those of a NaN may differ, so 0
/// takes its place.
fn predictable(prediction: f64) -> f64 {
    if prediction.is_nan() { 0.0 } else { prediction }
}

fn upper(number: f64) -> u32 {
    (number.to_bits() >> 32) as u32
}

fn split(number: f64, prediction: f64) -> [u32; 2] {
    [upper(number).wrapping_sub(upper(prediction)), number.to_bits() as u32]
}

fn join([hi, lo]: [u32; 2], prediction: f64) -> f64 {
    let upper = hi.wrapping_add(upper(prediction));
    f64::from_bits(u64::from(upper) << 32 | u64::from(lo))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn sums_that_contradict_the_file_are_seen() {
        let mut sums = LaneSums::default();
        (0..16).for_each(|i| sums.add(i, f64::from(i % 5) + 0.1));
        let means = std::array::from_fn(|f| (sums.folds[f] / fold_count(f, 16)) as f32);
        let known = Known { n: 16, means, variance: sums.variance(16) };
        let last = (sums.total() / 16.0) as f32;
        assert!(agree(&sums, last, &known));
        // As after a copy by a program that stores integers as 32-bit floats.
        let lossy = |x: f64| f64::from_bits((x.to_bits() & !0 << 9) + (1 << 32));
        let copied = LaneSums { folds: sums.folds.map(lossy), squares: lossy(sums.squares) };
        assert!(agree(&copied, last, &known));
        let scaled = |i: usize, factor: f64| {
            let mut wrong = sums;
            match wrong.folds.get_mut(i) {
                Some(fold) => *fold *= factor,
                None => wrong.squares *= factor,
            }
            wrong
        };
        for i in 0..SUMS {
            assert!(!agree(&scaled(i, 1.001), last, &known), "sum {i}");
            assert!(!agree(&scaled(i, f64::NAN), last, &known), "sum {i}");
        }
        assert!(!agree(&sums, 1.001 * last, &known));
        assert!(!agree(&sums, last, &Known { n: 17, ..known }));
        assert!(!agree(&sums, last, &Known { means: [f32::NAN; FOLDS], ..known }));
    }

    proptest! {
        /// Whatever the bits are, and whatever the file says beside them.
        #[test]
        fn no_bit_is_lost(
            n in 1..u32::MAX,
            bits in prop::array::uniform5(any::<u64>()),
            known in prop::array::uniform5(any::<u32>()),
        ) {
            let [a, b, c, d, squares] = bits.map(f64::from_bits);
            let [e, f, g, h, variance] = known.map(f32::from_bits);
            let known = Known { n, means: [e, f, g, h], variance };
            let again = known.join(known.split(&LaneSums { folds: [a, b, c, d], squares }));
            let [a, b, c, d] = again.folds;
            prop_assert_eq!([a, b, c, d, again.squares].map(f64::to_bits), bits);
        }

        /// The prediction is off by a carry at most.
        #[test]
        fn upper_words_are_predicted(samples in prop::collection::vec(0.0..100.0_f32, 8..40)) {
            let mut sums = LaneSums::default();
            (0..).zip(&samples).for_each(|(i, &y)| sums.add(i, f64::from(y)));
            let n = samples.len() as u32;
            let means = std::array::from_fn(|f| (sums.folds[f] / fold_count(f, n)) as f32);
            let known = Known { n, means, variance: sums.variance(n) };
            for [hi, _] in known.split(&sums) {
                prop_assert!(hi.wrapping_add(1) <= 2, "{hi}");
            }
        }
    }
}

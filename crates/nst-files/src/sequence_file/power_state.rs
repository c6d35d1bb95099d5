//! The f64 sums of further powers of samples, stored as those of lanes are ([`super::state`]):
//! `state.power4fold0` and so on, each with the channels of the picture.

use std::ops::Range;

use exr::prelude::SampleType;
use nst_core::{FOLDS, FurtherPowers, Power, PowerSums, SequenceBatch, Side, fold_count};
use rayon::prelude::*;

use super::state::{LOST_BITS, close, join, split};
use crate::{ColorModel, Error, layers::channel_name, rows::Channel};

/// The layers of the state of a side channel, `[word]`.
fn layers(side: &Side) -> [String; 2] {
    ["hi", "lo"].map(|word| format!("state.{side}.{word}"))
}

/// Whether a file with such layers has sums of a power.
pub(super) fn is_of(power: Power, has_layer: impl Fn(&str) -> bool) -> bool {
    Side::power_means(power).iter().flat_map(layers).any(|layer| has_layer(&layer))
}

/// The UINT channels, `[power][fold][word][channel]`.
pub(super) fn channels(powers: FurtherPowers, model: ColorModel) -> Vec<Channel> {
    let layers = powers.sides().flat_map(|side| layers(&side));
    let channel = |layer: String| {
        let names = model.channels().iter().map(move |channel| channel_name(&layer, channel));
        names.map(|name| (name, SampleType::U32))
    };
    layers.flat_map(channel).collect()
}

/// What a batch says of the sums of a fold.
struct Known<'a> {
    power: Power,
    fold: usize,
    /// The power means, `[lane]`, if the batch has them.
    means: Option<&'a [f32]>,
    /// How many samples the fold has.
    count: f64,
}

impl<'a> Known<'a> {
    /// Of all powers and folds, `[power][fold]`.
    fn all(batch: &'a SequenceBatch, powers: FurtherPowers) -> Vec<Self> {
        let n = batch.sample_counts().last().copied().unwrap_or_default();
        let folds = |power| (0..).zip(Side::power_means(power)).map(move |it| (power, it));
        let of_fold = |(power, (fold, side)): (Power, (usize, Side))| {
            let means = batch.side(&side);
            Self { power, fold, means, count: fold_count(fold, n) }
        };
        powers.iter().flat_map(folds).map(of_fold).collect()
    }

    /// What the mean of a lane predicts for its sum; 0 where it does not. Roots and squares alone
    /// give it, which have the same bits on every machine.
    fn predicted(&self, lane: usize) -> f64 {
        let mean = self.means.map_or(0.0, |means| f64::from(means[lane]));
        let predicted = self.power.of(mean) * self.count;
        if predicted.is_nan() { 0.0 } else { predicted }
    }

    /// Whether a sum agrees with the mean of its lane. Both ways of looking at it are needed: a
    /// mean for the power 1/16 may be too small for an f32; and if a sum is off by 2⁻²⁰, as after
    /// a copy by another program, that mean is off by 16 times that.
    fn agrees(&self, sum: f64, lane: usize) -> bool {
        let Some(means) = self.means else { return true };
        let (of_sum, predicted) = (self.power.mean_of(sum / self.count), self.predicted(lane));
        let near = (sum - predicted).abs() <= LOST_BITS * predicted;
        // As all summands are.
        let is_positive = sum >= 0.0 || sum.is_nan();
        is_positive && (near || close(of_sum, means[lane], of_sum))
    }
}

/// The words of some pixels of a batch, in the order of [`channels`].
pub(super) fn words(
    batch: &SequenceBatch,
    sums: &PowerSums,
    pixels: usize,
    part: &Range<usize>,
) -> Vec<Vec<u32>> {
    let of_fold = |(known, sums): (Known<'_>, &[[f64; FOLDS]])| {
        let lanes = (0..batch.lanes()).step_by(pixels);
        let lanes = lanes.flat_map(|first| first + part.start..first + part.end);
        let words: Vec<[u32; 2]> =
            lanes.map(|lane| split(sums[lane][known.fold], known.predicted(lane))).collect();
        let of_word = |word: usize| {
            let channels = words.chunks(part.len());
            channels.map(move |words| words.iter().map(|it| it[word]).collect::<Vec<u32>>())
        };
        (0..2).flat_map(of_word).collect::<Vec<_>>()
    };
    let known = Known::all(batch, sums.powers());
    let sums = sums.sums().chunks_exact(batch.lanes());
    let sums = sums.flat_map(|sums| [sums; FOLDS]);
    let folds: Vec<_> = known.into_iter().zip(sums).collect();
    folds.into_par_iter().flat_map_iter(of_fold).collect()
}

/// The sums of the lanes of a batch, from planes of words in the order of [`channels`].
pub(super) fn joined(
    batch: &SequenceBatch,
    powers: FurtherPowers,
    words: &[u32],
) -> Result<PowerSums, Error> {
    let (lanes, known) = (batch.lanes(), Known::all(batch, powers));
    let of_lane = |i: usize| {
        let (power, lane) = (i / lanes, i % lanes);
        std::array::from_fn(|fold| {
            let sum = power * FOLDS + fold;
            let word = |word: usize| words[(2 * sum + word) * lanes + lane];
            join([word(0), word(1)], known[sum].predicted(lane))
        })
    };
    let sums = (0..powers.count() * lanes).into_par_iter().map(of_lane).collect();
    Ok(PowerSums::from_sums(powers, sums)?)
}

/// The first lane whose sums contradict the means in the batch.
pub(super) fn contradiction(batch: &SequenceBatch, sums: &PowerSums) -> Option<usize> {
    let lanes = batch.lanes();
    let known = Known::all(batch, sums.powers());
    let agrees = |lane: usize| {
        known.iter().enumerate().all(|(i, known)| {
            let sum = sums.sums()[i / FOLDS * lanes + lane][known.fold];
            known.agrees(sum, lane)
        })
    };
    (0..lanes).into_par_iter().find_first(|&lane| !agrees(lane))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Sums of all further powers of n samples of a lane, and the means that a file has of them.
    fn sums(samples: &[f64]) -> (SequenceBatch, PowerSums) {
        let powers: Vec<Power> = Power::all().collect();
        let mut sums = PowerSums::new(&powers, 1);
        (0..).zip(samples).for_each(|(index, &y)| sums.add(0, index, y));
        let n = samples.len() as u32;
        let mut batch = SequenceBatch::from_last(&[1.0], n).expect("a lane");
        batch.set_power_sums(&sums, n).expect("sums of the lane");
        (batch, sums)
    }

    fn with(sums: &PowerSums, i: usize, change: impl Fn(f64) -> f64) -> PowerSums {
        let mut changed = sums.sums().to_vec();
        let sum = &mut changed[i / FOLDS][i % FOLDS];
        *sum = change(*sum);
        PowerSums::from_sums(sums.powers(), changed).expect("as many")
    }

    #[test]
    fn sums_that_contradict_the_file_are_seen() {
        let usual: Vec<f64> = (0..16).map(|i| f64::from(i % 5) + 0.1).collect();
        // The power 16 of such samples is beyond f32; of so few that are not black, the mean for
        // the power 1/16 is below it.
        let bright = [1e6; 8];
        let mut dark = vec![0.0; 2000];
        dark[..4].fill(1e-3);
        for (samples, are_known) in [(&usual[..], true), (&bright, true), (&dark, false)] {
            let (batch, sums) = sums(samples);
            assert_eq!(contradiction(&batch, &sums), None);
            for i in 0..sums.sums().len() * FOLDS {
                // As after a copy by a program that stores integers as 32-bit floats.
                let lossy = |x: f64| f64::from_bits((x.to_bits() & !0 << 9) + (1 << 32));
                assert_eq!(contradiction(&batch, &with(&sums, i, lossy)), None, "sum {i}");
                let negative = with(&sums, i, |sum| -sum);
                assert_eq!(contradiction(&batch, &negative), Some(0), "sum {i}");
                for factor in [1.001, f64::NAN] {
                    let wrong = with(&sums, i, |sum| factor * sum);
                    let found = contradiction(&batch, &wrong);
                    // Nothing is known of the sum where the mean is 0 in f32.
                    assert!(found == Some(0) || !are_known && factor > 0.0, "sum {i}");
                }
            }
        }
        let (few, sums) = sums(&[1.0, 2.0, 3.0]);
        assert_eq!(contradiction(&few, &with(&sums, 1, |sum| 2.0 * sum)), None, "it has no means");
    }

    proptest! {
        /// Whatever the bits are, and whatever the file says beside them.
        #[test]
        fn no_bit_is_lost(
            n in 1..u32::MAX,
            bits in prop::collection::vec(any::<u64>(), 2 * FOLDS * 6),
            known in prop::collection::vec(prop::option::of(any::<u32>()), FOLDS),
        ) {
            let powers = FurtherPowers::of(&[Power::of_value(0.25), Power::of_value(16.0)].map(|it| it.expect("a power of two")));
            let mut batch = SequenceBatch::from_last(&[1.0; 6], n).expect("six lanes");
            for (known, side) in known.iter().zip(powers.sides()) {
                if let Some(bits) = known {
                    batch.set_side(side, vec![f32::from_bits(*bits); 6]).expect("six lanes");
                }
            }
            let sums: Vec<[f64; FOLDS]> =
                bits.as_chunks().0.iter().map(|bits| bits.map(f64::from_bits)).collect();
            let sums = PowerSums::from_sums(powers, sums).expect("of six lanes");
            // Three channels of two pixels, one after the other.
            let parts = [0..1, 1..2].map(|part| words(&batch, &sums, 2, &part));
            let planes = parts[0].iter().zip(&parts[1]);
            let planes: Vec<u32> = planes.flat_map(|(a, b)| [a[0], b[0]]).collect();
            let again = joined(&batch, powers, &planes).expect("of six lanes");
            let bits_of = |sums: &PowerSums| -> Vec<u64> {
                sums.sums().iter().flatten().map(|sum| sum.to_bits()).collect()
            };
            prop_assert_eq!(bits_of(&again), bits);
        }

        /// A mean is rounded by 2⁻²⁴, so that its power 16 is wrong by 2⁻²⁰ at most, a unit or two
        /// of an upper word.
        #[test]
        fn upper_words_are_predicted(samples in prop::collection::vec(0.0..100.0_f64, 8..40)) {
            let (batch, sums) = sums(&samples);
            for words in words(&batch, &sums, 1, &(0..1)).chunks(2) {
                prop_assert!(words[0][0].wrapping_add(3) <= 6, "{}", words[0][0]);
            }
        }
    }
}

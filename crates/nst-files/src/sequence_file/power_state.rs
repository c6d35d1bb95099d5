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

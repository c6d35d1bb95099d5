//! The f64 sums of the features of a rendering, stored as those of its lanes are
//! ([`super::state`]): `state.depth`, and those of each fold, `state.albedo0` …, `state.normal0` …,
//! `state.emission0` …, each with the channels of its feature.

use std::ops::Range;

use exr::prelude::SampleType;
use nst_core::{FeatureSums, SequenceBatch, Side};
use rayon::prelude::*;

use super::state::{close, join, split};
use crate::{ColorModel, layers::channel_name, rows::Channel};

/// A sum of each pixel: the side channel whose mean it is of, and which channel of it.
type Sum = (&'static Side, usize);

/// The names of the channels that a side channel has; renderings are RGB.
fn names(side: &Side) -> &'static [&'static str] {
    ColorModel::Rgb.side_channels(side)
}

/// All sums, in the order of their channels.
fn sums() -> impl Iterator<Item = Sum> {
    let channels = |side| (0..names(side).len()).map(move |channel| (side, channel));
    Side::STORED_FEATURES.iter().flat_map(channels)
}

/// The UINT channels, `[sum][word]`.
pub(super) fn channels() -> Vec<Channel> {
    let words = |(side, channel): Sum| {
        ["hi", "lo"].map(|word| {
            let layer = format!("state.{side}.{word}");
            (channel_name(&layer, names(side)[channel]), SampleType::U32)
        })
    };
    sums().flat_map(words).collect()
}

/// What the means of a batch predict for a sum of a pixel; 0 where they do not.
fn predicted(batch: &SequenceBatch, (side, channel): Sum, pixel: usize) -> f64 {
    let pixels = batch.grid().map_or(0, |grid| grid.pixels());
    let mean = batch.side(side).map_or(0.0, |means| f64::from(means[channel * pixels + pixel]));
    let predicted = mean * FeatureSums::count(side, samples(batch));
    if predicted.is_nan() { 0.0 } else { predicted }
}

fn samples(batch: &SequenceBatch) -> u32 {
    batch.sample_counts().last().copied().unwrap_or_default()
}

/// The words of some pixels of a batch, in the order of [`channels`].
pub(super) fn words(
    batch: &SequenceBatch,
    pixels: &[FeatureSums],
    part: Range<usize>,
) -> Vec<Vec<u32>> {
    let sums: Vec<Sum> = sums().collect();
    let of_sum = |&sum: &Sum| {
        let of_pixel = |pixel: usize| {
            let value = pixels[pixel].sum(sum.0, sum.1).unwrap_or_default();
            split(value, predicted(batch, sum, pixel))
        };
        let words: Vec<[u32; 2]> = part.clone().map(of_pixel).collect();
        [0, 1].map(|word| words.iter().map(|words| words[word]).collect::<Vec<u32>>())
    };
    sums.par_iter().flat_map_iter(of_sum).collect()
}

/// The sums of the pixels of a batch, from planes of words in the order of [`channels`].
pub(super) fn joined(batch: &SequenceBatch, words: &[u32]) -> Vec<FeatureSums> {
    let pixels = batch.grid().map_or(0, |grid| grid.pixels());
    let of_pixel = |pixel: usize| {
        let mut of_pixel = FeatureSums::default();
        for (i, sum) in sums().enumerate() {
            let word = |word: usize| words[(2 * i + word) * pixels + pixel];
            if let Some(place) = of_pixel.sum_mut(sum.0, sum.1) {
                *place = join([word(0), word(1)], predicted(batch, sum, pixel));
            }
        }
        of_pixel
    };
    (0..pixels).into_par_iter().map(of_pixel).collect()
}

/// The first pixel whose sums contradict the means in the batch.
pub(super) fn contradiction(batch: &SequenceBatch, pixels: &[FeatureSums]) -> Option<usize> {
    let n = samples(batch);
    let agrees = |pixel: usize| {
        Side::of_features(n).all(|side| {
            let means = batch.side(side).unwrap_or_default();
            let count = FeatureSums::count(side, n);
            (0..names(side).len()).all(|channel| {
                let sum = pixels[pixel].sum(side, channel).unwrap_or_default();
                let mean = means.get(channel * pixels.len() + pixel).copied().unwrap_or_default();
                close(sum / count, mean, (sum / count).abs())
            })
        })
    };
    (0..pixels.len()).into_par_iter().find_first(|&pixel| !agrees(pixel))
}

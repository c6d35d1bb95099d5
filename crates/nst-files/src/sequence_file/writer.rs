//! Writes sequence files row by row.

use std::ops::Range;

use nst_core::{LaneSums, SampleSums, SequenceBatch, Side};
use rayon::prelude::*;

use super::{
    feature_state,
    info::{ResumeInfo, SequenceInfo, VERSION},
    power_state,
    state::{self, KnownLanes},
};
use crate::{
    Error,
    limits::BLOCK_ROWS,
    output_file::OutputFile,
    rows::{Attribute, Attributes, RowWriter},
};

/// Writes a sequence, some rows at a time, from the top.
pub struct SequenceWriter<'a> {
    rows: RowWriter<'a>,
    info: SequenceInfo,
}

impl<'a> SequenceWriter<'a> {
    /// Writes the header.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn create(output: &'a mut OutputFile, info: &SequenceInfo) -> Result<Self, Error> {
        let mut channels = info.channels();
        channels.extend(info.state_channels());
        let rows = RowWriter::create(output, info.size, &channels, attributes(info))?;
        Ok(Self { rows, info: info.clone() })
    }

    /// Appends rows, with their sums if [`SequenceInfo::resume`] is given: then those of the
    /// features, too, if there are any, and of its powers. All calls but the last need a multiple
    /// of 16 rows.
    ///
    /// # Errors
    /// [`Error::Mismatch`] if the rows are not what the header promises, [`Error::Io`]
    /// if they cannot be written.
    pub fn push(&mut self, batch: &SequenceBatch, sums: Option<&SampleSums>) -> Result<(), Error> {
        let channels = self.info.model.channels().len();
        let pixels = batch.lanes() / channels;
        let fits = batch.sample_counts() == self.info.sample_counts
            && batch.sides().map(|(side, _)| side).eq(&self.info.sides)
            && batch.lanes() == pixels * channels
            && pixels.is_multiple_of(self.info.size[0] as usize)
            && sums.is_some() == self.info.resume.is_some()
            && sums.is_none_or(|sums| self.fit(sums, batch));
        if !fits {
            return Err(Error::Mismatch("rows differ from what the sequence's header says".into()));
        }
        let terms = (0..batch.sample_counts().len()).map(|k| batch.term(k));
        let sides = batch.sides().map(|(_, values)| values);
        let layers: Vec<_> = [batch.last()].into_iter().chain(terms).chain(sides).collect();
        // The words of the state are made for a few rows at a time, to save memory.
        let step = (BLOCK_ROWS * self.info.size[0]) as usize * 2 * rayon::current_num_threads();
        for first in (0..pixels).step_by(step) {
            let part = first..pixels.min(first + step);
            let state = sums.map(|sums| self.state(batch, sums, pixels, part.clone()));
            let mut planes: Vec<&[u8]> = layers
                .iter()
                .flat_map(|lanes| lanes.chunks_exact(pixels))
                .map(|image| bytemuck::cast_slice(&image[part.clone()]))
                .collect();
            planes
                .extend(state.iter().flatten().map(|words| bytemuck::cast_slice::<u32, _>(words)));
            self.rows.push(&planes)?;
        }
        Ok(())
    }

    /// Whether sums are those of the lanes and pixels of a batch.
    fn fit(&self, sums: &SampleSums, batch: &SequenceBatch) -> bool {
        let lanes = batch.lanes();
        let pixels = lanes / self.info.model.channels().len();
        let features = sums.features.as_ref();
        sums.lanes.len() == lanes
            && sums.powers.are_of(self.info.further_powers(), lanes)
            && features.is_some() == self.info.has_features()
            && features.is_none_or(|features| features.len() == pixels && batch.grid().is_some())
    }

    /// The channels of the state for some pixels, in the order of
    /// [`SequenceInfo::state_channels`].
    fn state(
        &self,
        batch: &SequenceBatch,
        sums: &SampleSums,
        pixels: usize,
        part: Range<usize>,
    ) -> Vec<Vec<u32>> {
        let mut planes = self.of_lanes(batch, &sums.lanes, pixels, part.clone());
        if let Some(features) = &sums.features {
            planes.extend(feature_state::words(batch, features, part.clone()));
        }
        planes.extend(power_state::words(batch, &sums.powers, pixels, &part));
        planes
    }

    /// Those of the sums of the lanes, in the order of [`state::channels`].
    fn of_lanes(
        &self,
        batch: &SequenceBatch,
        sums: &[LaneSums],
        pixels: usize,
        part: Range<usize>,
    ) -> Vec<Vec<u32>> {
        let channels = self.info.model.channels().len();
        let known = KnownLanes::new(batch);
        let split: Vec<Vec<_>> = (0..channels)
            .into_par_iter()
            .map(|channel| {
                let lanes = part.clone().map(|pixel| channel * pixels + pixel);
                lanes.map(|lane| known.lane(lane).split(&sums[lane])).collect()
            })
            .collect();
        let mut planes = Vec::with_capacity(2 * state::SUMS * channels);
        for sum in 0..state::SUMS {
            for word in 0..2 {
                planes.extend(split.iter().map(|lanes| -> Vec<u32> {
                    lanes.iter().map(|words| words[sum][word]).collect()
                }));
            }
        }
        planes
    }

    /// Completes the file; all its rows must have been pushed. The caller commits the
    /// output.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn finish(self) -> Result<(), Error> {
        self.rows.finish()
    }
}

fn attributes(info: &SequenceInfo) -> Attributes {
    let join = |numbers: &mut dyn Iterator<Item = String>| numbers.collect::<Vec<_>>().join(",");
    let text = |text: &str| Attribute::Text(text.to_owned());
    let folds = info.sides.iter().filter(|side| matches!(side, Side::Fold(_))).count();
    let mut attributes = vec![
        ("nst.version", text(VERSION)),
        ("nst.terms", Attribute::Text(join(&mut info.sample_counts.iter().map(u32::to_string)))),
        ("nst.folds", Attribute::Text(folds.to_string())),
        ("nst.scene", text(&info.scene)),
        ("nst.sampler", text(&info.sampler)),
        ("nst.seed", Attribute::Text(join(&mut info.seeds.iter().map(u64::to_string)))),
        ("renderTimeSeconds", Attribute::F32(info.render_seconds)),
    ];
    // More than it can say are in `nst.terms` alone.
    let samples = i32::try_from(info.samples()).ok();
    attributes.extend(samples.map(|samples| ("samplesPerPixel", Attribute::I32(samples))));
    if let Some(ResumeInfo { keep, pixel_filter, max_depth, russian_roulette, .. }) = &info.resume {
        attributes.push(("nst.keep", text(&keep.to_string())));
        attributes.push(("nst.pixel", text(pixel_filter)));
        attributes.push(("nst.maxDepth", text(&max_depth.to_string())));
        let switch = if *russian_roulette { "on" } else { "off" };
        attributes.push(("nst.russianRoulette", text(switch)));
    }
    // What is not known is left out: some programs drop empty texts when they copy a file.
    attributes.retain(|(_, value)| *value != Attribute::Text(String::new()));
    attributes.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

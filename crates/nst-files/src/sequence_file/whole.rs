//! Sequences that fit the memory.

use std::{ops::Range, path::Path};

use ndarray::Array2;
use nst_core::{
    FOLDS, FeatureSums, FurtherPowers, Grid, LaneSums, PowerSums, SampleSums, SequenceBatch, Side,
};
use rayon::prelude::*;

use super::{
    feature_state,
    info::SequenceInfo,
    power_state,
    reader::SequenceReader,
    state::{KnownLanes, agree},
    writer::SequenceWriter,
};
use crate::{Error, output_file::OutputFile};

/// A whole sequence in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceFile {
    /// What the file says about itself.
    pub info: SequenceInfo,
    /// Planar lanes.
    pub batch: SequenceBatch,
    /// What the rendering can be continued from, if [`SequenceInfo::resume`] says how.
    pub sums: Option<SampleSums>,
}

impl SequenceFile {
    /// Writes the file. The caller commits `output`.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written, [`Error::Mismatch`] if its parts
    /// do not fit together.
    pub fn write(&self, output: &mut OutputFile) -> Result<(), Error> {
        let mut writer = SequenceWriter::create(output, &self.info)?;
        writer.push(&self.batch, self.sums.as_ref())?;
        writer.finish()
    }

    /// Reads a whole file.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Malformed`] names the file and what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::read_with(path, true)
    }

    /// Reads what a rendering is continued from: all but folds, variance and features, which
    /// follow from the sums.
    ///
    /// # Errors
    /// As [`SequenceFile::read`].
    pub fn read_to_resume(path: &Path) -> Result<Self, Error> {
        Self::read_with(path, false)
    }

    fn read_with(path: &Path, with_sides: bool) -> Result<Self, Error> {
        let mut reader = SequenceReader::open(path)?.with_sums();
        let info = reader.info().clone();
        let grid = info.grid()?;
        let mut terms = Vec::new();
        reserve(path, &mut terms, info.sample_counts.len(), grid.lanes())?;
        let follows =
            |side: &Side| side.is_of_fold() || side.is_feature() || *side == Side::Variance;
        let wanted = |side: &Side| with_sides || !follows(side);
        let mut sides: Vec<(Side, Vec<f32>)> =
            info.sides.iter().filter(|side| wanted(side)).map(|s| (s.clone(), vec![])).collect();
        for (side, values) in &mut sides {
            let channels = info.model.side_channels(side).len();
            reserve(path, values, channels, grid.pixels())?;
        }
        let mut sums = Sums::new(path, &info, &grid)?;
        let mut rows = 0..0;
        while let Some((strip, strip_sums)) = reader.next_with_sums()? {
            let strip_rows = strip.grid().map_or(0, Grid::rows);
            rows = rows.end..rows.end + strip_rows;
            let place = rows.start * grid.width()..rows.end * grid.width();
            for (k, term) in terms.chunks_exact_mut(grid.lanes()).enumerate() {
                put(term, &grid, &place, strip.term(k));
            }
            for (side, values) in &mut sides {
                put(values, &grid, &place, strip.side(side).unwrap_or_default());
            }
            if let Some(strip_sums) = &strip_sums {
                check_sums(path, &strip, strip_sums)?;
                sums.put(&grid, &place, strip_sums);
            }
        }
        let terms = Array2::from_shape_vec((info.sample_counts.len(), grid.lanes()), terms)
            .map_err(|error| Error::malformed(path, error.to_string()))?;
        let mut batch = SequenceBatch::new(terms, info.sample_counts.clone())?;
        batch.set_grid(grid)?;
        for (side, values) in sides {
            batch.set_side(side, values)?;
        }
        let sums = info.resume.is_some().then(|| sums.complete(info.further_powers()));
        Ok(Self { sums: sums.transpose()?, info, batch })
    }
}

/// The [`SampleSums`] of a whole picture, strip by strip.
struct Sums {
    lanes: Vec<LaneSums>,
    features: Option<Vec<FeatureSums>>,
    /// `[power][lane]`
    powers: Vec<[f64; FOLDS]>,
}

impl Sums {
    /// Of no strips yet; empty if the file has none.
    fn new(path: &Path, info: &SequenceInfo, grid: &Grid) -> Result<Self, Error> {
        let mut sums = Self { lanes: Vec::new(), features: None, powers: Vec::new() };
        if info.resume.is_some() {
            reserve(path, &mut sums.lanes, 1, grid.lanes())?;
            reserve(path, &mut sums.powers, info.further_powers().count(), grid.lanes())?;
            if info.has_features() {
                reserve(path, sums.features.insert(Vec::new()), 1, grid.pixels())?;
            }
        }
        Ok(sums)
    }

    fn put(&mut self, grid: &Grid, place: &Range<usize>, strip: &SampleSums) {
        put(&mut self.lanes, grid, place, &strip.lanes);
        put(&mut self.powers, grid, place, strip.powers.sums());
        if let (Some(features), Some(of_strip)) = (&mut self.features, &strip.features) {
            put(features, grid, place, of_strip);
        }
    }

    fn complete(self, powers: FurtherPowers) -> Result<SampleSums, Error> {
        let Self { lanes, features, powers: sums } = self;
        Ok(SampleSums { lanes, features, powers: PowerSums::from_sums(powers, sums)? })
    }
}

/// Fails if sums contradict what the file says beside them: one of the two is damaged.
fn check_sums(path: &Path, strip: &SequenceBatch, sums: &SampleSums) -> Result<(), Error> {
    let known = KnownLanes::new(strip);
    let contradictory = (0..strip.lanes())
        .into_par_iter()
        .find_first(|&lane| !agree(&sums.lanes[lane], strip.last()[lane], &known.lane(lane)));
    let features = sums.features.as_deref();
    let contradictory = contradictory
        .or_else(|| feature_state::contradiction(strip, features?))
        .or_else(|| power_state::contradiction(strip, &sums.powers));
    contradictory.map_or(Ok(()), |lane| Err(contradictory_pixel(path, strip, lane)))
}

/// Says where sums contradict means, of a lane or a pixel of the strip.
fn contradictory_pixel(path: &Path, strip: &SequenceBatch, lane: usize) -> Error {
    let (x, y) = strip.grid().map_or((lane, 0), |grid| {
        let pixel = lane % grid.pixels();
        (pixel % grid.width(), pixel / grid.width() + grid.first_row() as usize)
    });
    Error::malformed(
        path,
        format!(
            "the pixel at column {x}, row {y}: its sums ('state.…') contradict its means or its \
             variance; the file is damaged"
        ),
    )
}

/// Makes a vector of zeros, or says how much memory it would take.
fn reserve<T: Clone + Default>(
    path: &Path,
    values: &mut Vec<T>,
    planes: usize,
    plane: usize,
) -> Result<(), Error> {
    let count = planes.saturating_mul(plane);
    values.try_reserve_exact(count).map_err(|_| {
        let bytes = count.saturating_mul(size_of::<T>());
        let message = format!("it does not fit the memory: {} MiB are needed", bytes >> 20);
        Error::malformed(path, message)
    })?;
    values.resize(count, T::default());
    Ok(())
}

/// Puts the pixels of a strip, plane by plane, where they belong in the whole picture.
fn put<T: Copy>(whole: &mut [T], grid: &Grid, place: &Range<usize>, part: &[T]) {
    let planes = whole.chunks_exact_mut(grid.pixels()).zip(part.chunks_exact(place.len()));
    for (image, values) in planes {
        image[place.clone()].copy_from_slice(values);
    }
}

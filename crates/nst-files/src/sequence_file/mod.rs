//! Sequences as EXR files; `docs/sequence-exr.md` defines the format for others.
//!
//! R, G, B contain S_N; the layer `S0008` the term of 8 samples, and so on; `fold0` …,
//! `Variance` and `Skipped` are the side channels; `state.…` is what a rendering is
//! continued from.

mod reader;
mod state;
mod writer;

use std::path::Path;

use ndarray::Array2;
use nst_core::{Grid, Keep, LaneSums, SequenceBatch, Side};

use crate::{ColorModel, Error, layers::layer_channels, output::OutputFile, rows::Channel};

pub use reader::SequenceReader;
pub use writer::SequenceWriter;

/// The version of the format that this module writes, and the only one it reads.
const VERSION: &str = "1";

/// What the header of a sequence file says.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceInfo {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// The channels of each layer; lanes are planar, in their order.
    pub model: ColorModel,
    /// The number of samples behind each stored term, increasing.
    pub sample_counts: Vec<u32>,
    /// The side channels, sorted.
    pub sides: Vec<Side>,
    /// The scene's fingerprint; empty if unknown.
    pub scene: String,
    /// The sampler's name; empty if unknown.
    pub sampler: String,
    /// The seeds of the samples: one, several of a merged sequence, or none if unknown.
    pub seeds: Vec<u64>,
    /// How long the rendering took, in seconds; 0 if unknown.
    pub render_seconds: f32,
    /// How the rendering can be continued; the file then contains its sums, too.
    pub resume: Option<ResumeInfo>,
}

/// What continuing a rendering needs to know beside its scene, sampler and seed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResumeInfo {
    /// The terms to keep.
    pub keep: Keep,
    /// The renderer's name for how it chooses positions within a pixel.
    pub pixel_filter: String,
    /// The most vertices of a path after the camera.
    pub max_depth: u32,
    /// Whether Russian roulette may end paths early.
    pub russian_roulette: bool,
}

impl SequenceInfo {
    /// The number of samples behind the last term.
    #[must_use]
    pub fn samples(&self) -> u32 {
        self.sample_counts.last().copied().unwrap_or_default()
    }

    /// The place of each lane in the picture.
    ///
    /// # Errors
    /// [`Error::Core`] if there are none, or too many.
    pub fn grid(&self) -> Result<Grid, Error> {
        let [width, height] = self.size;
        Ok(Grid::new(width, height, self.model.channels().len() as u32, 0)?)
    }

    /// The f32 channels: the picture, the terms, the side channels.
    fn channels(&self) -> Vec<Channel> {
        let lanes = self.model.channels();
        let terms = self.sample_counts.iter().map(|&count| term_name(count));
        let layers = [String::new()].into_iter().chain(terms).map(|layer| (layer, lanes));
        let sides =
            self.sides.iter().map(|side| (side.to_string(), self.model.side_channels(side)));
        layers
            .chain(sides)
            .flat_map(|(layer, channels)| layer_channels(&layer, channels).collect::<Vec<_>>())
            .collect()
    }

    /// The channels of the state, none if the rendering cannot be continued.
    fn state_channels(&self) -> Vec<Channel> {
        if self.resume.is_some() { state::channels(self.model) } else { Vec::new() }
    }
}

fn term_name(sample_count: u32) -> String {
    format!("S{sample_count:04}")
}

/// A whole sequence in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceFile {
    /// What the file says about itself.
    pub info: SequenceInfo,
    /// Planar lanes.
    pub batch: SequenceBatch,
    /// What the rendering can be continued from, if [`SequenceInfo::resume`] says how.
    pub sums: Option<Vec<LaneSums>>,
}

impl SequenceFile {
    /// Writes the file. The caller commits `output`.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written, [`Error::Mismatch`] if its parts
    /// do not fit together.
    pub fn write(&self, output: &mut OutputFile) -> Result<(), Error> {
        let mut writer = SequenceWriter::create(output, &self.info)?;
        writer.push(&self.batch, self.sums.as_deref())?;
        writer.finish()
    }

    /// Reads a whole file.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Malformed`] names the file and what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::read_with(path, true)
    }

    /// Reads what a rendering is continued from: all but folds and variance, which follow
    /// from the sums.
    ///
    /// # Errors
    /// As [`SequenceFile::read`].
    pub fn read_to_resume(path: &Path) -> Result<Self, Error> {
        Self::read_with(path, false)
    }

    fn read_with(path: &Path, with_sides: bool) -> Result<Self, Error> {
        let mut reader = SequenceReader::open(path)?;
        let info = reader.info().clone();
        let grid = info.grid()?;
        let mut terms = Vec::new();
        reserve(path, &mut terms, info.sample_counts.len(), grid.lanes())?;
        // Folds and variance follow from the sums.
        let wanted = |side: &Side| with_sides || !matches!(side, Side::Fold(_) | Side::Variance);
        let mut sides: Vec<(Side, Vec<f32>)> =
            info.sides.iter().filter(|side| wanted(side)).map(|s| (s.clone(), vec![])).collect();
        for (side, values) in &mut sides {
            let channels = info.model.side_channels(side).len();
            reserve(path, values, channels, grid.pixels())?;
        }
        let mut sums = info.resume.as_ref().map(|_| Vec::new());
        if let Some(sums) = &mut sums {
            reserve(path, sums, 1, grid.lanes())?;
        }
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
            if let (Some(sums), Some(strip_sums)) = (&mut sums, &strip_sums) {
                put(sums, &grid, &place, strip_sums);
            }
        }
        let terms = Array2::from_shape_vec((info.sample_counts.len(), grid.lanes()), terms)
            .map_err(|error| Error::malformed(path, error.to_string()))?;
        let mut batch = SequenceBatch::new(terms, info.sample_counts.clone())?;
        batch.set_grid(grid)?;
        for (side, values) in sides {
            batch.set_side(side, values)?;
        }
        Ok(Self { info, batch, sums })
    }
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
fn put<T: Copy>(whole: &mut [T], grid: &Grid, place: &std::ops::Range<usize>, part: &[T]) {
    let planes = whole.chunks_exact_mut(grid.pixels()).zip(part.chunks_exact(place.len()));
    for (image, values) in planes {
        image[place.clone()].copy_from_slice(values);
    }
}

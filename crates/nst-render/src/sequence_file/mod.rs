//! Sequences as EXR files; `docs/sequence-exr.md` defines the format for others.
//!
//! R, G, B hold S_N; the layer `S0008` the term of 8 samples, and so on; `fold0` …
//! and `Variance` the side channels; `state.…` what a rendering is continued from.

mod reader;
mod state;
mod writer;

use std::path::Path;

use ndarray::Array2;
use nst_core::SequenceBatch;

use crate::{
    Error, Keep, LaneSums, PixelFilter, exr_rows::Channel, film::ColorModel, output::OutputFile,
};

pub use reader::SequenceReader;
pub use writer::SequenceWriter;

/// The version of the format that this module writes, and the only one it reads.
const VERSION: &str = "1";

/// What a sequence file says about its lanes, and where they come from.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceInfo {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// The channels of each layer; lanes are planar, in their order.
    pub model: ColorModel,
    /// The number of samples behind each stored term, increasing.
    pub sample_counts: Vec<u32>,
    /// The names of the side channels, sorted.
    pub sides: Vec<String>,
    /// The scene's fingerprint, or nothing.
    pub scene: String,
    /// The sampler's name, or nothing.
    pub sampler: String,
    /// The seeds of the samples: one, several of a merged sequence, or none if unknown.
    pub seeds: Vec<u64>,
    /// How long the rendering took.
    pub render_seconds: f32,
    /// How the rendering can be continued; the file then holds its sums as well.
    pub resume: Option<ResumeInfo>,
}

/// What continuing a rendering needs to know beside its scene, sampler and seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResumeInfo {
    /// The terms to keep.
    pub keep: Keep,
    /// How positions within a pixel are chosen.
    pub pixel_filter: PixelFilter,
    /// The longest paths.
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

    /// The layers of f32 channels: the picture, the terms, the side channels.
    fn layers(&self) -> Vec<String> {
        let terms = self.sample_counts.iter().map(|&count| term_name(count));
        [String::new()].into_iter().chain(terms).chain(self.sides.iter().cloned()).collect()
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
    /// [`Error::Io`] if it cannot be written, [`Error::Settings`] if its parts
    /// do not fit together.
    pub fn write(&self, output: &mut OutputFile) -> Result<(), Error> {
        let mut writer = SequenceWriter::create(output, &self.info)?;
        writer.push(&self.batch, self.sums.as_deref())?;
        writer.finish()
    }

    /// Reads a whole file.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Image`] names the file and what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::read_with(path, true)
    }

    /// Reads what a rendering is continued from: all but the side channels, which
    /// the sums give again.
    ///
    /// # Errors
    /// As [`SequenceFile::read`].
    pub fn read_to_resume(path: &Path) -> Result<Self, Error> {
        Self::read_with(path, false)
    }

    fn read_with(path: &Path, with_sides: bool) -> Result<Self, Error> {
        let mut reader = SequenceReader::open(path)?;
        let info = reader.info().clone();
        let pixels = info.size[0] as usize * info.size[1] as usize;
        let lanes = info.model.channels().len() * pixels;
        let mut terms = vec![0.0; info.sample_counts.len() * lanes];
        let count = if with_sides { info.sides.len() } else { 0 };
        let mut sides = vec![vec![0.0; lanes]; count];
        let mut sums = info.resume.map(|_| vec![LaneSums::default(); lanes]);
        let mut first = 0;
        while !reader.is_done() {
            let (strip, strip_sums) = reader.read_with_sums(reader.strip_rows())?;
            let part = strip.lanes() / info.model.channels().len();
            for (k, term) in terms.chunks_exact_mut(lanes).enumerate() {
                place(term, pixels, first, strip.term(k), part);
            }
            for (side, (_, values)) in sides.iter_mut().zip(strip.sides()) {
                place(side, pixels, first, values, part);
            }
            if let (Some(sums), Some(strip_sums)) = (&mut sums, &strip_sums) {
                place(sums, pixels, first, strip_sums, part);
            }
            first += part;
        }
        let terms = Array2::from_shape_vec((info.sample_counts.len(), lanes), terms)
            .map_err(|error| Error::image(path, error.to_string()))?;
        let mut batch = SequenceBatch::new(terms, info.sample_counts.clone())?;
        for (name, values) in info.sides.iter().zip(sides) {
            batch.set_side(name, values)?;
        }
        Ok(Self { info, batch, sums })
    }
}

/// Puts some pixels of each channel where they belong in the whole picture.
fn place<T: Copy>(whole: &mut [T], pixels: usize, first: usize, part: &[T], part_pixels: usize) {
    for (image, values) in whole.chunks_exact_mut(pixels).zip(part.chunks_exact(part_pixels)) {
        image[first..first + part_pixels].copy_from_slice(values);
    }
}

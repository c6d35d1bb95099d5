//! Reads sequence files row by row.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use exr::prelude::SampleType;
use ndarray::Array2;
use nst_core::SequenceBatch;
use rayon::prelude::*;

use super::{
    ResumeInfo, SequenceInfo, VERSION, term_name,
    writer::{KnownLanes, parse_keep},
};
use crate::{
    Error, LaneSums, PixelFilter,
    exr_rows::{Attribute, BLOCK_ROWS, RowReader, Rows},
    film::{ColorModel, channel_name},
};

/// How much of a file is decompressed at a time, in bytes.
const STRIP_BYTES: usize = 128 << 20;

/// Reads a sequence whose rows come in order, so that it need not fit the memory.
pub struct SequenceReader {
    rows: RowReader,
    info: SequenceInfo,
    /// Which of the file's channels hold the terms and the side channels,
    /// `[term or side][channel]`.
    layers: Vec<usize>,
    /// Which hold the state, `[sum][word][channel]`.
    state: Vec<usize>,
}

impl SequenceReader {
    /// Reads and checks the header.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Image`] names the file and what is wrong with it.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let rows = RowReader::open(path)?;
        let header = Header { path, rows: &rows };
        let version = header.text("nst.version")?;
        if version != VERSION {
            return Err(Error::image(
                path,
                format!("format version {version}; this program reads version {VERSION}"),
            ));
        }
        let sample_counts: Vec<u32> = header.numbers("nst.terms")?;
        if sample_counts[0] == 0 || sample_counts.windows(2).any(|pair| pair[0] >= pair[1]) {
            let message =
                "attribute 'nst.terms': sample counts must start at 1 or above and increase";
            return Err(Error::image(path, message));
        }
        // Samples of another program may have none of these.
        let seeds = match header.optional("nst.seed")?.as_deref() {
            None | Some("") => Vec::new(),
            Some(_) => header.numbers("nst.seed")?,
        };
        let scene = header.optional("nst.scene")?.unwrap_or_default();
        let sampler = header.optional("nst.sampler")?.unwrap_or_default();
        let render_seconds = match rows.attribute("renderTimeSeconds") {
            Some(Attribute::F32(seconds)) if seconds.is_finite() && seconds > 0.0 => seconds,
            _ => 0.0,
        };
        let resume = header.resume()?;

        let channels = Channels::of(path, &rows);
        let model = channels.model();
        let mut layers = channels.terms(model, &sample_counts)?;
        let sides = channels.sides(model, &sample_counts);
        layers.extend(sides.values().flatten());
        let sides = sides.into_keys().collect();
        let info = SequenceInfo {
            size: rows.size(),
            model,
            sample_counts,
            sides,
            scene,
            sampler,
            seeds,
            render_seconds,
            resume,
        };
        let state = info.state_channels();
        let state = state.iter().map(|(name, kind)| channels.find(name, *kind));
        let state = state.collect::<Result<_, _>>()?;
        let folds = info.sides.iter().filter(|name| name.starts_with("fold")).count();
        if header.text("nst.folds")? != folds.to_string() {
            return Err(Error::image(
                path,
                format!("attribute 'nst.folds' differs from its {folds} folds"),
            ));
        }
        let lanes =
            model.channels().len() as u64 * u64::from(info.size[0]) * u64::from(info.size[1]);
        if lanes > 1 << 31 {
            return Err(Error::image(path, "it has more than 2^31 lanes"));
        }
        Ok(Self { rows, info, layers, state })
    }

    /// What the file says about itself.
    #[must_use]
    pub fn info(&self) -> &SequenceInfo {
        &self.info
    }

    /// Whether all rows have been read.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.rows.next_row() == self.info.size[1]
    }

    /// A number of rows for [`SequenceReader::read_rows`] that keeps all threads
    /// busy and takes up some 100 MB.
    #[must_use]
    pub fn strip_rows(&self) -> u32 {
        let blocks = STRIP_BYTES / (self.rows.row_bytes() * BLOCK_ROWS as usize);
        // Pictures have less than 2^31 rows.
        BLOCK_ROWS * (blocks.clamp(1, 1 << 20) as u32)
    }

    /// Reads the next rows: a multiple of 16, or what is left. They make a batch of
    /// their own, of planar lanes.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Image`] if they cannot be read, [`Error::Settings`]
    /// if there are none or if `rows` is not a multiple of 16.
    pub fn read_rows(&mut self, rows: u32) -> Result<SequenceBatch, Error> {
        let rows = self.next(rows)?;
        self.batch(&rows)
    }

    /// As [`SequenceReader::read_rows`], with the sums if the file holds them.
    pub(super) fn read_with_sums(
        &mut self,
        rows: u32,
    ) -> Result<(SequenceBatch, Option<Vec<LaneSums>>), Error> {
        let rows = self.next(rows)?;
        let batch = self.batch(&rows)?;
        let sums = (!self.state.is_empty()).then(|| self.sums(&rows, &batch));
        Ok((batch, sums))
    }

    fn next(&mut self, rows: u32) -> Result<Rows, Error> {
        let left = self.info.size[1] - self.rows.next_row();
        if left == 0 || rows == 0 || (rows < left && !rows.is_multiple_of(BLOCK_ROWS)) {
            return Err(Error::Settings(format!(
                "{rows} rows to be read, of {left} that are left"
            )));
        }
        self.rows.read(rows)
    }

    fn batch(&self, rows: &Rows) -> Result<SequenceBatch, Error> {
        let (terms, channels) = (self.info.sample_counts.len(), self.info.model.channels().len());
        let pixels = rows.pixels();
        let lanes = channels * pixels;
        let copy = |source: &[usize]| {
            let mut values = vec![0.0_f32; source.len() * pixels];
            values
                .par_chunks_exact_mut(pixels)
                .zip(source)
                .for_each(|(image, &channel)| rows.copy(channel, bytemuck::cast_slice_mut(image)));
            values
        };
        let (term_channels, side_channels) = self.layers.split_at(terms * channels);
        let values = Array2::from_shape_vec((terms, lanes), copy(term_channels))
            .map_err(|error| Error::Settings(error.to_string()))?;
        let mut batch = SequenceBatch::new(values, self.info.sample_counts.clone())?;
        for (name, source) in self.info.sides.iter().zip(side_channels.chunks_exact(channels)) {
            batch.set_side(name, copy(source))?;
        }
        Ok(batch)
    }

    fn sums(&self, rows: &Rows, batch: &SequenceBatch) -> Vec<LaneSums> {
        let pixels = rows.pixels();
        // `[sum][word][lane]`
        let mut words = vec![0_u32; self.state.len() * pixels];
        words
            .par_chunks_exact_mut(pixels)
            .zip(&self.state)
            .for_each(|(image, &channel)| rows.copy(channel, bytemuck::cast_slice_mut(image)));
        let lanes = batch.lanes();
        let known = KnownLanes::new(batch);
        let joined = (0..lanes).into_par_iter().map(|lane| {
            let word = |sum: usize, word: usize| words[(2 * sum + word) * lanes + lane];
            known.lane(lane).join(std::array::from_fn(|sum| [word(sum, 0), word(sum, 1)]))
        });
        joined.collect()
    }
}

/// The channels of a file: index and type, by name.
struct Channels<'a> {
    path: &'a Path,
    by_name: BTreeMap<String, (usize, SampleType)>,
}

impl<'a> Channels<'a> {
    fn of(path: &'a Path, rows: &RowReader) -> Self {
        let channels = rows.channels().enumerate();
        Self { path, by_name: channels.map(|(i, (name, kind))| (name, (i, kind))).collect() }
    }

    fn model(&self) -> ColorModel {
        let has = |name| self.by_name.contains_key(name);
        if has("R") || !has("Y") { ColorModel::Rgb } else { ColorModel::Mono }
    }

    fn find(&self, name: &str, kind: SampleType) -> Result<usize, Error> {
        match self.by_name.get(name) {
            Some(&(index, found)) if found == kind => Ok(index),
            Some(_) => {
                Err(Error::image(self.path, format!("channel '{name}' is not of type {kind:?}")))
            }
            None => Err(Error::image(self.path, format!("channel '{name}' is missing"))),
        }
    }

    fn layer(&self, model: ColorModel, layer: &str) -> Result<Vec<usize>, Error> {
        let names = model.channels().iter().map(|channel| channel_name(layer, channel));
        names.map(|name| self.find(&name, SampleType::F32)).collect()
    }

    /// The channels of the terms, `[term][channel]`.
    fn terms(&self, model: ColorModel, sample_counts: &[u32]) -> Result<Vec<usize>, Error> {
        // The picture repeats the last term; it is not read, but must be there.
        self.layer(model, "")?;
        let mut terms = Vec::new();
        for &count in sample_counts {
            terms.extend(self.layer(model, &term_name(count))?);
        }
        Ok(terms)
    }

    /// What is left beside the picture, the terms and the state: side channels.
    fn sides(&self, model: ColorModel, sample_counts: &[u32]) -> BTreeMap<String, Vec<usize>> {
        let terms: BTreeSet<String> = sample_counts.iter().copied().map(term_name).collect();
        let first = model.channels()[0];
        let layers = self.by_name.keys().filter_map(|name| {
            let (layer, channel) = name.rsplit_once('.')?;
            let other = channel == first && !layer.is_empty() && !terms.contains(layer);
            other.then_some(layer)
        });
        let found = |layer: &str| Some((layer.to_owned(), self.layer(model, layer).ok()?));
        layers.filter_map(found).collect()
    }
}

/// The attributes of a file.
struct Header<'a> {
    path: &'a Path,
    rows: &'a RowReader,
}

impl Header<'_> {
    fn optional(&self, name: &str) -> Result<Option<String>, Error> {
        match self.rows.attribute(name) {
            Some(Attribute::Text(text)) => Ok(Some(text)),
            Some(_) => Err(Error::image(self.path, format!("attribute '{name}' is not text"))),
            None => Ok(None),
        }
    }

    fn text(&self, name: &str) -> Result<String, Error> {
        self.optional(name)?.ok_or_else(|| {
            Error::image(
                self.path,
                format!(
                    "it holds no sequence (attribute '{name}' is missing); 'nst render --sequence FILE' writes one"
                ),
            )
        })
    }

    /// One or more numbers.
    fn numbers<T: std::str::FromStr>(&self, name: &str) -> Result<Vec<T>, Error> {
        let text = self.text(name)?;
        text.split(',').map(|number| number.parse().ok()).collect::<Option<_>>().ok_or_else(|| {
            let short: String = text.chars().take(40).collect();
            Error::image(
                self.path,
                format!("attribute '{name}' is '{short}', not a list of whole numbers"),
            )
        })
    }

    fn resume(&self) -> Result<Option<ResumeInfo>, Error> {
        let Some(keep) = self.optional("nst.keep")? else { return Ok(None) };
        let unknown = |name: &str| {
            Error::image(self.path, format!("attribute '{name}' has an unknown value"))
        };
        let pixel = self.text("nst.pixel")?;
        let filters = [PixelFilter::Box, PixelFilter::Center];
        Ok(Some(ResumeInfo {
            keep: parse_keep(&keep).ok_or_else(|| unknown("nst.keep"))?,
            pixel_filter: filters
                .into_iter()
                .find(|filter| filter.name() == pixel)
                .ok_or_else(|| unknown("nst.pixel"))?,
            max_depth: self.numbers("nst.maxDepth")?[0],
            russian_roulette: match self.text("nst.russianRoulette")?.as_str() {
                "on" => true,
                "off" => false,
                _ => return Err(unknown("nst.russianRoulette")),
            },
        }))
    }
}

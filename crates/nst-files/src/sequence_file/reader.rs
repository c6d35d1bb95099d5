//! Reads sequence files row by row.

use std::{borrow::Cow, ops::Range, path::Path};

use ndarray::Array2;
use nst_core::{FOLDS, FurtherPowers, Grid, LaneSums, SampleSums, SequenceBatch, Side, Strips};
use rayon::prelude::*;

use super::{
    channels::Channels,
    feature_state,
    info::{ResumeInfo, SequenceInfo, VERSION},
    planes::{KeptRows, Planes},
    power_state,
    state::{self, KnownLanes},
};
use crate::{
    ColorModel, Error,
    limits::{BLOCK_ROWS, strip_rows},
    rows::{Attribute, RowReader, slices_of_rows},
};

/// A strip, and its sums if the file contains them.
type StripWithSums = (SequenceBatch, Option<SampleSums>);

/// Reads a sequence strip by strip, so that it need not fit into memory.
pub struct SequenceReader {
    rows: RowReader,
    info: SequenceInfo,
    /// Which of the file's channels are those of the terms, `[term][channel]`.
    terms: Vec<usize>,
    /// Which are those of the side channels, `[side][channel]`.
    sides: Vec<Vec<usize>>,
    /// Which are those of the state: `[sum][word][channel]`, and then those of the states of
    /// features and of further powers.
    state: Vec<usize>,
    /// Rows of a strip, a multiple of 16.
    step: u32,
    /// The first row of the next strip.
    next: u32,
    /// Rows above and below a strip that are read with it.
    halo: u32,
    /// Rows of the next strip and its halo that are already there.
    kept: KeptRows,
}

impl SequenceReader {
    /// Reads and checks the header.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Malformed`] names the file and what is wrong with it.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let rows = RowReader::open(path)?;
        let header = Header { path, rows: &rows };
        let version = header.text("nst.version")?;
        if version != VERSION {
            return Err(Error::malformed(
                path,
                format!("format version {version}; this program reads version {VERSION}"),
            ));
        }
        let sample_counts: Vec<u32> = header.numbers("nst.terms")?;
        if sample_counts[0] == 0 || sample_counts.windows(2).any(|pair| pair[0] >= pair[1]) {
            let message =
                "attribute 'nst.terms': sample counts must start at 1 or above and increase";
            return Err(Error::malformed(path, message));
        }
        // Files that were made from pictures of other programs may lack these.
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
        let channels = Channels::of(path, &rows);
        let model = channels.model();
        // Early files lack some of the sums with which a rendering is continued.
        let has_sums = channels.has_layer("state.square0.hi", model);
        let resume = header.resume(channels.powers(model))?.filter(|_| has_sums);
        let terms = channels.terms(model, &sample_counts)?;
        let (names, sides): (Vec<_>, Vec<Vec<usize>>) =
            channels.sides(model, &sample_counts)?.into_iter().unzip();
        let info = SequenceInfo {
            size: rows.size(),
            model,
            sample_counts,
            sides: names,
            scene,
            sampler,
            seeds,
            render_seconds,
            resume,
        };
        let state = info.state_channels();
        let state = state.iter().map(|(name, kind)| channels.find(name, *kind));
        let state = state.collect::<Result<_, _>>()?;
        header.check_folds(&info)?;
        check_resumable(&info).map_err(|why| Error::malformed(path, why))?;
        info.grid().map_err(|error| Error::malformed(path, error.to_string()))?;
        // Most of a file with a state is that, which is not read with strips.
        let read = terms.len() + sides.iter().map(Vec::len).sum::<usize>();
        let step = strip_rows(read * rows.size()[0] as usize * size_of::<f32>());
        let kept = KeptRows::default();
        Ok(Self { rows, info, terms, sides, state, step, next: 0, halo: 0, kept })
    }

    /// What the file says about itself.
    #[must_use]
    pub fn info(&self) -> &SequenceInfo {
        &self.info
    }

    /// Reads strips of this many rows, rounded up to a multiple of 16, instead of strips of
    /// about 128 MiB.
    #[must_use]
    pub fn with_strip_rows(self, rows: u32) -> Self {
        Self { step: rows.clamp(1, 1 << 30).next_multiple_of(BLOCK_ROWS), ..self }
    }

    /// Reads strips of at least this many rows, rounded up likewise.
    #[must_use]
    pub fn with_least_strip_rows(self, rows: u32) -> Self {
        let rows = rows.max(self.step);
        self.with_strip_rows(rows)
    }

    /// Reads strips that are not larger with their sums.
    pub(super) fn with_sums(self) -> Self {
        let step = strip_rows(self.rows.row_bytes());
        Self { step, ..self }
    }

    /// Continues with the strip that begins at a row.
    pub(crate) fn skip_to(&mut self, row: u32) {
        (self.next, self.kept) = (row.min(self.info.size[1]), KeptRows::default());
    }

    /// The next strip; `None` after the last.
    pub(super) fn next_with_sums(&mut self) -> Result<Option<StripWithSums>, Error> {
        let Some((outer, grid)) = self.next_range()? else { return Ok(None) };
        let mut planes = self.planes(grid);
        let mut words = vec![0; self.state.len() * grid.pixels()];
        let mut images = planes.images(outer.start);
        images.extend(words.chunks_exact_mut(grid.pixels()));
        let channels = [&self.channels()[..], &self.state].concat();
        self.rows.read(outer, &channels, slices_of_rows(images, grid.width()))?;
        let batch = self.batch(planes)?;
        if self.state.is_empty() {
            return Ok(Some((batch, None)));
        }
        let (channels, powers) = (self.info.model.channels().len(), self.info.further_powers());
        let of_lanes = 2 * state::SUMS * channels * grid.pixels();
        let of_powers = 2 * FOLDS * powers.count() * channels * grid.pixels();
        let (lanes, others) = words.split_at(of_lanes);
        let (features, of_powers) = others.split_at(others.len() - of_powers);
        let lanes = sums(lanes, &batch);
        let features = (!features.is_empty()).then(|| feature_state::joined(&batch, features));
        let powers = power_state::joined(&batch, powers, of_powers)?;
        Ok(Some((batch, Some(SampleSums { lanes, features, powers }))))
    }

    /// The rows of the next strip and of its halo.
    fn next_range(&mut self) -> Result<Option<(Range<u32>, Grid)>, Error> {
        let [width, height] = self.info.size;
        if self.next == height {
            return Ok(None);
        }
        let inner = self.next..height.min(self.next.saturating_add(self.step));
        let outer =
            inner.start.saturating_sub(self.halo)..height.min(inner.end.saturating_add(self.halo));
        let channels = self.info.model.channels().len() as u32;
        let grid = Grid::new(width, outer.len() as u32, channels, outer.start)?
            .with_halo(inner.start - outer.start, outer.end - inner.end)?;
        self.next = inner.end;
        Ok(Some((outer, grid)))
    }

    /// What is read of a strip, to be filled.
    fn planes(&self, grid: Grid) -> Planes {
        let layers = [&self.terms].into_iter().chain(&self.sides);
        Planes::new(layers.map(Vec::len), grid)
    }

    /// The channels of these in the file.
    fn channels(&self) -> Vec<usize> {
        [&self.terms].into_iter().chain(&self.sides).flatten().copied().collect()
    }

    /// Reads a strip, of rows of the picture, but for those that the last one has left. Of the last
    /// block, it keeps what is only in the next strip.
    fn fill(&mut self, planes: &mut Planes, outer: &Range<u32>) -> Result<(), Error> {
        let (width, height) = (planes.grid.width(), self.info.size[1]);
        let mut kept = std::mem::take(&mut self.kept);
        let mut start = outer.start;
        if kept.rows.start == start {
            kept.put(planes);
            start = kept.rows.end;
        }
        let end = height.min(outer.end.next_multiple_of(self.rows.block_rows()));
        let next = if self.next == height { end } else { self.next.saturating_sub(self.halo) };
        let channels = self.channels();
        let mut kept = KeptRows::new(next..end, channels.len(), width);
        let out = slices_of_rows(planes.images(start), width);
        let out = out.chain(slices_of_rows(kept.images(outer.end, width), width));
        self.rows.read(start..end, &channels, out)?;
        kept.take(planes);
        self.kept = kept;
        Ok(())
    }

    fn batch(&self, planes: Planes) -> Result<SequenceBatch, Error> {
        let Planes { layers, grid } = planes;
        let mut layers = layers.into_iter();
        let shape = (self.info.sample_counts.len(), grid.lanes());
        let terms = Array2::from_shape_vec(shape, layers.next().unwrap_or_default())
            .map_err(|error| Error::Mismatch(error.to_string()))?;
        let mut batch = SequenceBatch::new(terms, self.info.sample_counts.clone())?;
        batch.set_grid(grid)?;
        for (side, values) in self.info.sides.iter().zip(layers) {
            batch.set_side(side.clone(), values)?;
        }
        Ok(batch)
    }
}

/// The sums of the lanes, from words `[sum][word][lane]`.
fn sums(words: &[u32], batch: &SequenceBatch) -> Vec<LaneSums> {
    let lanes = batch.lanes();
    let known = KnownLanes::new(batch);
    let joined = (0..lanes).into_par_iter().map(|lane| {
        let word = |sum: usize, word: usize| words[(2 * sum + word) * lanes + lane];
        known.lane(lane).join(std::array::from_fn(|sum| [word(sum, 0), word(sum, 1)]))
    });
    joined.collect()
}

impl Strips for SequenceReader {
    fn rewind(&mut self, halo: u32) -> Result<(), nst_core::Error> {
        (self.next, self.halo, self.kept) = (0, halo, KeptRows::default());
        Ok(())
    }

    fn next_strip(&mut self) -> Result<Option<Cow<'_, SequenceBatch>>, nst_core::Error> {
        let Some((outer, grid)) = self.next_range()? else { return Ok(None) };
        let mut planes = self.planes(grid);
        self.fill(&mut planes, &outer)?;
        Ok(Some(Cow::Owned(self.batch(planes)?)))
    }
}

/// Fails if a file with a state lacks what the state is read with, or contradicts itself.
fn check_resumable(info: &SequenceInfo) -> Result<(), String> {
    let Some(resume) = &info.resume else { return Ok(()) };
    let n = info.samples();
    let folds = Side::EVERY_OF_FOLDS.iter().filter(|_| n as usize >= FOLDS);
    let features = info.has_features().then(|| Side::of_features(n)).into_iter().flatten();
    let powers = resume.powers.sides().filter(|_| n as usize >= FOLDS);
    if info.has_features() && info.model != ColorModel::Rgb {
        return Err("it has features ('albedo' …) and a state, but not the channels R, G and B; \
                    without attribute 'nst.keep' it is a sequence that cannot be continued"
            .into());
    }
    let mut needed = folds.chain(features).cloned().chain(powers);
    if let Some(side) = needed.find(|side| !info.sides.contains(side)) {
        return Err(format!(
            "layer '{side}' is missing, without which its state cannot be read; without \
             attribute 'nst.keep' it is a sequence that cannot be continued"
        ));
    }
    if resume.keep.sample_counts(n) != info.sample_counts {
        let keep = resume.keep;
        return Err(format!(
            "attributes 'nst.keep' ({keep}) and 'nst.terms' contradict each other"
        ));
    }
    Ok(())
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
            Some(_) => Err(Error::malformed(self.path, format!("attribute '{name}' is not text"))),
            None => Ok(None),
        }
    }

    fn text(&self, name: &str) -> Result<String, Error> {
        self.optional(name)?.ok_or_else(|| {
            Error::malformed(
                self.path,
                format!(
                    "it contains no sequence (attribute '{name}' is missing); 'nst render --sequence FILE' writes one"
                ),
            )
        })
    }

    /// One or more numbers.
    fn numbers<T: std::str::FromStr>(&self, name: &str) -> Result<Vec<T>, Error> {
        let text = self.text(name)?;
        text.split(',').map(|number| number.parse().ok()).collect::<Option<_>>().ok_or_else(|| {
            let short: String = text.chars().take(40).collect();
            Error::malformed(
                self.path,
                format!("attribute '{name}' is '{short}', not a list of whole numbers"),
            )
        })
    }

    /// Fails unless the file has all folds or none, and `nst.folds` says which; and roots and
    /// squares of all folds, or of none.
    fn check_folds(&self, info: &SequenceInfo) -> Result<(), Error> {
        let count = |all: &[Side]| all.iter().filter(|side| info.sides.contains(side)).count();
        let [folds, roots, squares] = Side::OF_FOLDS.map(|sides| count(sides));
        if ![0, folds].contains(&roots) || squares != roots {
            let message = format!(
                "it has {folds} layers 'fold…', {roots} 'root…' and {squares} 'square…'; it needs \
                 {FOLDS} of each, or none"
            );
            return Err(Error::malformed(self.path, message));
        }
        if self.text("nst.folds")? != folds.to_string() || ![0, FOLDS].contains(&folds) {
            let message = format!(
                "attribute 'nst.folds' must be the number of its folds ({folds}), 0 or {FOLDS}"
            );
            return Err(Error::malformed(self.path, message));
        }
        Ok(())
    }

    fn resume(&self, powers: FurtherPowers) -> Result<Option<ResumeInfo>, Error> {
        let Some(keep) = self.optional("nst.keep")? else { return Ok(None) };
        let keep = keep
            .parse()
            .map_err(|why| Error::malformed(self.path, format!("attribute 'nst.keep': {why}")))?;
        Ok(Some(ResumeInfo {
            keep,
            pixel_filter: self.text("nst.pixel")?,
            max_depth: self.numbers("nst.maxDepth")?[0],
            russian_roulette: match self.text("nst.russianRoulette")?.as_str() {
                "on" => true,
                "off" => false,
                other => {
                    let message =
                        format!("attribute 'nst.russianRoulette' is '{other}', not 'on' or 'off'");
                    return Err(Error::malformed(self.path, message));
                }
            },
            powers,
        }))
    }
}

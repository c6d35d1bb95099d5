//! Strips that stay in memory for those who read a sequence more than once.

use std::borrow::Cow;

use nst_core::{Grid, SequenceBatch, Strips};

use super::SequenceReader;

/// The most bytes that are kept: a picture of 1920 × 1080 pixels with statistics and features takes
/// three quarters of it.
const MOST_BYTES: usize = 1 << 30;

/// A sequence of which the first strips, as many as memory is meant for, are read once and kept as
/// long as the same halo is asked for.
pub struct KeptStrips {
    reader: SequenceReader,
    /// The first strips of the picture.
    strips: Vec<SequenceBatch>,
    /// Whether no more are kept.
    full: bool,
    most_bytes: usize,
    /// The number of the next strip.
    next: usize,
    halo: u32,
}

impl KeptStrips {
    /// Of a sequence of which nothing was read.
    #[must_use]
    pub fn new(reader: SequenceReader) -> Self {
        let (strips, most_bytes) = (Vec::new(), MOST_BYTES);
        Self { reader, strips, full: false, most_bytes, next: 0, halo: 0 }
    }

    /// Keeps a strip that was read, if there is room, and little of it is a halo: else, most rows
    /// would be kept more than once.
    fn keep(&mut self, strip: SequenceBatch) -> Cow<'_, SequenceBatch> {
        let bytes: usize = self.strips.iter().chain([&strip]).map(bytes).sum();
        let mostly_halo = |grid: &Grid| 4 * grid.inner_rows().len() < 3 * grid.rows();
        self.full |= bytes > self.most_bytes || strip.grid().is_some_and(mostly_halo);
        if self.full {
            return Cow::Owned(strip);
        }
        self.strips.push(strip);
        Cow::Borrowed(&self.strips[self.strips.len() - 1])
    }
}

/// How many bytes a strip takes.
fn bytes(strip: &SequenceBatch) -> usize {
    let sides: usize = strip.sides().map(|(_, values)| values.len()).sum();
    (strip.terms().len() + sides) * size_of::<f32>()
}

impl Strips for KeptStrips {
    fn rewind(&mut self, halo: u32) -> Result<(), nst_core::Error> {
        if halo != self.halo {
            (self.strips, self.full, self.halo) = (Vec::new(), false, halo);
        }
        self.next = 0;
        self.reader.rewind(halo)?;
        let grid = self.strips.last().and_then(SequenceBatch::grid);
        self.reader.skip_to(grid.map_or(0, |grid| grid.picture_rows().end as u32));
        Ok(())
    }

    fn next_strip(&mut self) -> Result<Option<Cow<'_, SequenceBatch>>, nst_core::Error> {
        self.next += 1;
        if self.next <= self.strips.len() {
            return Ok(Some(Cow::Borrowed(&self.strips[self.next - 1])));
        }
        let strip = self.reader.next_strip()?.map(Cow::into_owned);
        Ok(strip.map(|strip| self.keep(strip)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        ColorModel, Error,
        output::OutputFile,
        sequence_file::{SequenceFile, SequenceInfo},
    };

    /// All strips of a pass with a halo.
    fn pass(strips: &mut dyn Strips, halo: u32) -> Result<Vec<SequenceBatch>, nst_core::Error> {
        strips.rewind(halo)?;
        let mut all = Vec::new();
        while let Some(strip) = strips.next_strip()? {
            all.push(strip.into_owned());
        }
        Ok(all)
    }

    /// Five strips, of which all, some or none are kept, are those that a reader gives, however
    /// often they are read.
    #[test]
    fn kept_strips_are_those_of_the_reader() -> Result<(), Box<dyn std::error::Error>> {
        let (size, values) = ([7, 70], (0..7 * 70).map(|i| i as f32).collect::<Vec<_>>());
        let mut batch = SequenceBatch::from_last(&values, 3)?;
        batch.set_grid(Grid::new(7, 70, 1, 0)?)?;
        let info = SequenceInfo {
            size,
            model: ColorModel::Mono,
            sample_counts: vec![3],
            sides: Vec::new(),
            scene: String::new(),
            sampler: String::new(),
            seeds: Vec::new(),
            render_seconds: 0.0,
            resume: None,
        };
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("sequence.exr");
        let mut output = OutputFile::create(&path)?;
        SequenceFile { info, batch, sums: None }.write(&mut output)?;
        output.commit()?;
        let open = || Ok::<_, Error>(SequenceReader::open(&path)?.with_strip_rows(16));

        let of_rows = |rows: usize| rows * 7 * size_of::<f32>();
        for (most_bytes, counts) in [(MOST_BYTES, [5, 5, 0]), (of_rows(41), [2, 2, 0]), (0, [0; 3])]
        {
            let mut kept = KeptStrips { most_bytes, ..KeptStrips::new(open()?) };
            for (halo, count) in [0, 2, 6].into_iter().zip(counts) {
                let expected = pass(&mut open()?, halo)?;
                assert_eq!(expected.len(), 5);
                for _ in 0..3 {
                    assert_eq!(pass(&mut kept, halo)?, expected, "{most_bytes} {halo}");
                    assert_eq!(kept.strips.len(), count);
                }
            }
        }
        Ok(())
    }
}

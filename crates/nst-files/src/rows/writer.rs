//! Writes files row by row.

use std::{
    fs::File,
    io::{BufWriter, Read, Seek, SeekFrom, Write},
    ops::Range,
    path::PathBuf,
};

use exr::{
    block::{BlockIndex, UncompressedBlock, chunk::Chunk},
    meta::{
        BlockDescription, MetaData,
        attribute::{AttributeValue, ChannelDescription, Compression, LineOrder, Text},
        header::{Header, LayerAttributes},
        magic_number,
    },
    prelude::Vec2,
};
use rayon::prelude::*;

use super::parts::{Attribute, Attributes, Channel, SAMPLE};
use crate::{
    Error,
    limits::BLOCK_ROWS,
    output_file::{OutputFile, SOFTWARE},
};

/// Writes a file row by row.
pub(crate) struct RowWriter<'a> {
    path: PathBuf,
    file: BufWriter<&'a mut File>,
    header: [Header; 1],
    /// For each of the file's channels, which are sorted, its place in the caller's list.
    order: Vec<usize>,
    /// Where the table of blocks begins, and what it will contain.
    table: u64,
    offsets: Vec<u64>,
}

impl<'a> RowWriter<'a> {
    /// Writes the header of a ZIP-compressed file.
    pub(crate) fn create(
        output: &'a mut OutputFile,
        size: [u32; 2],
        channels: &[Channel],
        attributes: Attributes,
    ) -> Result<Self, Error> {
        let path = output.path().to_owned();
        let mut order: Vec<usize> = (0..channels.len()).collect();
        order.sort_by_key(|&i| &channels[i].0);
        let header = [header(size, order.iter().map(|&i| &channels[i]), attributes)];
        let mut file = BufWriter::new(output.file());
        let blocks = header[0].chunk_count as u64;
        let table = MetaData::validate(&header, true)
            .and_then(|requirements| {
                magic_number::write(&mut file)?;
                requirements.write(&mut file)?;
                Header::write_all(&header, &mut file, false)?;
                let table = file.stream_position()?;
                // Zeros for now: readers of an unfinished file take its blocks for missing.
                std::io::copy(&mut std::io::repeat(0).take(8 * blocks), &mut file)?;
                Ok(table)
            })
            .map_err(|error| Error::exr("write", &path, error))?;
        Ok(Self { path, file, header, order, table, offsets: Vec::new() })
    }

    /// Appends rows: `planes` are the channels in the order given to
    /// [`RowWriter::create`], each the native bytes of the same number of rows.
    ///
    /// All calls but the last need a multiple of [`BLOCK_ROWS`] rows.
    pub(crate) fn push(&mut self, planes: &[&[u8]]) -> Result<(), Error> {
        self.check(planes)?;
        let block_bytes = self.row_bytes() * BLOCK_ROWS as usize;
        let count = planes[0].len().div_ceil(block_bytes);
        // A few blocks for each thread, so that few wait to be written.
        let group = 2 * rayon::current_num_threads();
        for first in (0..count).step_by(group) {
            let blocks = (first..count.min(first + group))
                .into_par_iter()
                .map(|block| {
                    let end = planes[0].len().min((block + 1) * block_bytes);
                    let number = self.offsets.len() + block - first;
                    self.compress(planes, block * block_bytes..end, number)
                })
                .collect::<Result<Vec<_>, _>>();
            let written = blocks.and_then(|blocks| {
                blocks.iter().try_for_each(|block| {
                    self.offsets.push(self.file.stream_position()?);
                    block.write(&mut self.file, 1)
                })
            });
            written.map_err(|error| Error::exr("write", &self.path, error))?;
        }
        Ok(())
    }

    /// Bytes of a row of one channel.
    fn row_bytes(&self) -> usize {
        SAMPLE * self.header[0].layer_size.width()
    }

    /// Fails if rows are missing, too many, or cut within a block.
    fn check(&self, planes: &[&[u8]]) -> Result<(), Error> {
        let height = self.header[0].layer_size.height();
        let rows = planes.first().map_or(0, |plane| plane.len()) / self.row_bytes();
        let end = self.offsets.len() * BLOCK_ROWS as usize + rows;
        let alike = planes.iter().all(|plane| plane.len() == rows * self.row_bytes());
        let whole_blocks = end == height || rows.is_multiple_of(BLOCK_ROWS as usize);
        if planes.len() == self.order.len() && alike && end <= height && whole_blocks {
            return Ok(());
        }
        Err(Error::Mismatch(format!(
            "'{}': {rows} rows of {} channels that end with row {end} of {height}; all {} \
             channels are needed, and all but the last rows in multiples of {BLOCK_ROWS}",
            self.path.display(),
            planes.len(),
            self.order.len()
        )))
    }

    /// Compresses a block: its number in the file, and its range of bytes in each plane.
    fn compress(
        &self,
        planes: &[&[u8]],
        place: Range<usize>,
        number: usize,
    ) -> exr::error::Result<Chunk> {
        let row = self.row_bytes();
        let mut data = Vec::with_capacity(place.len() * planes.len());
        for start in place.clone().step_by(row) {
            for &channel in &self.order {
                data.extend_from_slice(&planes[channel][start..start + row]);
            }
        }
        let index = BlockIndex {
            layer: 0,
            pixel_position: Vec2(0, number * BLOCK_ROWS as usize),
            pixel_size: Vec2(row / SAMPLE, place.len() / row),
            level: Vec2(0, 0),
        };
        UncompressedBlock { index, data }.compress_to_chunk(&self.header)
    }

    /// Completes the file; all its rows must have been pushed. The caller commits the
    /// output.
    pub(crate) fn finish(mut self) -> Result<(), Error> {
        if self.offsets.len() != self.header[0].chunk_count {
            let message = format!(
                "'{}': {} of {} blocks of rows were given",
                self.path.display(),
                self.offsets.len(),
                self.header[0].chunk_count
            );
            return Err(Error::Mismatch(message));
        }
        let table: Vec<u8> = self.offsets.iter().flat_map(|offset| offset.to_le_bytes()).collect();
        let written = self.file.seek(SeekFrom::Start(self.table));
        let written = written.and_then(|_| self.file.write_all(&table));
        written
            .and_then(|()| self.file.flush())
            .map_err(|error| Error::io("write", &self.path, error))
    }
}

/// The header of a file with these channels, which are sorted.
fn header<'a>(
    size: [u32; 2],
    channels: impl Iterator<Item = &'a Channel>,
    attributes: Attributes,
) -> Header {
    let descriptions = channels
        .map(|(name, kind)| ChannelDescription {
            name: latin1(name),
            sample_type: *kind,
            quantize_linearly: false,
            sampling: Vec2(1, 1),
        })
        .collect();
    let mut layer =
        LayerAttributes { software_name: Some(Text::from(SOFTWARE)), ..Default::default() };
    for (name, value) in attributes {
        let value = match value {
            Attribute::Text(text) => {
                AttributeValue::Text(Text::from_slice_unchecked(text.as_bytes()))
            }
            Attribute::I32(number) => AttributeValue::I32(number),
            Attribute::F32(number) => AttributeValue::F32(number),
        };
        layer.other.insert(latin1(&name), value);
    }
    let size = Vec2(size[0] as usize, size[1] as usize);
    Header::new(Text::default(), size, descriptions)
        .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_attributes(layer)
}

/// The exr crate takes names for Latin-1; other characters become question marks.
fn latin1(text: &str) -> Text {
    Text::new_or_none(text).unwrap_or_else(|| {
        let replaced: String =
            text.chars().map(|c| if u32::from(c) < 256 { c } else { '?' }).collect();
        Text::new_or_none(replaced).unwrap_or_default()
    })
}

//! Writes files row by row.

use std::{
    fs::File,
    io::{BufWriter, Read, Seek, SeekFrom, Write},
    ops::Range,
    path::PathBuf,
};

use exr::{
    block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock},
    meta::{
        BlockDescription, MetaData,
        attribute::{AttributeValue, ChannelDescription, Compression, LineOrder, Text},
        header::{Header, LayerAttributes},
        magic_number,
    },
    prelude::Vec2,
};
use rayon::prelude::*;

use super::{
    parts::{Attribute, Attributes, Channel, SAMPLE},
    zip,
};
use crate::{
    Error,
    limits::{BLOCK_ROWS, STRIP_BYTES},
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
    /// Compressed blocks, which are written while the next ones are compressed.
    pending: Vec<Vec<u8>>,
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
        Ok(Self { path, file, header, order, table, offsets: Vec::new(), pending: Vec::new() })
    }

    /// Appends rows: `planes` are the channels in the order given to
    /// [`RowWriter::create`], each the native bytes of the same number of rows.
    ///
    /// All calls but the last need a multiple of [`BLOCK_ROWS`] rows.
    pub(crate) fn push(&mut self, planes: &[&[u8]]) -> Result<(), Error> {
        self.check(planes)?;
        let block = self.row_bytes() * BLOCK_ROWS as usize;
        let count = planes[0].len().div_ceil(block);
        // Threads wait for each other after a group: it is of a few blocks for each, unless
        // these are large.
        let threads = rayon::current_num_threads();
        let group = (STRIP_BYTES / (block * planes.len())).clamp(threads, 4 * threads);
        for first in (0..count).step_by(group) {
            let pending = std::mem::take(&mut self.pending);
            let (row, order) = (self.row_bytes(), &self.order);
            let compress = |i| {
                let end = planes[0].len().min((i + 1) * block);
                compress(planes, order, i * block..end, row)
            };
            let blocks = first..count.min(first + group);
            let (file, offsets) = (&mut self.file, &mut self.offsets);
            let (written, blocks) = rayon::join(
                || pending.into_iter().try_for_each(|block| write(file, offsets, block)),
                || blocks.into_par_iter().map(compress).collect(),
            );
            written.map_err(|error| Error::exr("write", &self.path, error))?;
            self.pending = blocks;
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
        let blocks = self.offsets.len() + self.pending.len();
        let end = blocks * BLOCK_ROWS as usize + rows;
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

    /// Completes the file; all its rows must have been pushed. The caller commits the
    /// output.
    pub(crate) fn finish(mut self) -> Result<(), Error> {
        let pending = std::mem::take(&mut self.pending);
        let blocks = self.offsets.len() + pending.len();
        if blocks != self.header[0].chunk_count {
            let message = format!(
                "'{}': {blocks} of {} blocks of rows were given",
                self.path.display(),
                self.header[0].chunk_count
            );
            return Err(Error::Mismatch(message));
        }
        let (file, offsets) = (&mut self.file, &mut self.offsets);
        let written = pending.into_iter().try_for_each(|block| write(file, offsets, block));
        written.map_err(|error| Error::exr("write", &self.path, error))?;
        let table: Vec<u8> = self.offsets.iter().flat_map(|offset| offset.to_le_bytes()).collect();
        let written = self.file.seek(SeekFrom::Start(self.table));
        let written = written.and_then(|_| self.file.write_all(&table));
        written
            .and_then(|()| self.file.flush())
            .map_err(|error| Error::io("write", &self.path, error))
    }
}

/// Compresses a block: its range of bytes in each plane, whose rows have `row` bytes. The
/// file has the planes in this order.
fn compress(planes: &[&[u8]], order: &[usize], place: Range<usize>, row: usize) -> Vec<u8> {
    let starts = place.step_by(row);
    let rows = starts.flat_map(|start| order.iter().map(move |&i| &planes[i][start..start + row]));
    zip::compress(&rows.collect::<Vec<_>>())
}

/// Appends the next compressed block to the file.
fn write(
    file: &mut BufWriter<&mut File>,
    offsets: &mut Vec<u64>,
    block: Vec<u8>,
) -> exr::error::UnitResult {
    // EXR windows are i32.
    let y_coordinate = offsets.len() as i32 * BLOCK_ROWS as i32;
    let block = CompressedScanLineBlock { y_coordinate, compressed_pixels_le: block };
    offsets.push(file.stream_position()?);
    Chunk { layer_index: 0, compressed_block: CompressedBlock::ScanLine(block) }.write(file, 1)
}

/// The header of a file with these channels, which are sorted.
fn header<'a>(
    size: [u32; 2],
    channels: impl Iterator<Item = &'a Channel>,
    attributes: Attributes,
) -> Header {
    let descriptions = channels
        .map(|(name, kind)| ChannelDescription {
            // As OpenEXR writes names.
            name: Text::from_slice_unchecked(name.as_bytes()),
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
        layer.other.insert(Text::from_slice_unchecked(name.as_bytes()), value);
    }
    let size = Vec2(size[0] as usize, size[1] as usize);
    Header::new(Text::default(), size, descriptions)
        .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_attributes(layer)
}

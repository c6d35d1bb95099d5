//! Reads files row by row.

use std::{
    fs::File,
    io::{BufReader, Read, Seek, SeekFrom},
    ops::Range,
    path::{Path, PathBuf},
};

use exr::{
    block::{
        UncompressedBlock,
        chunk::{Chunk, CompressedBlock, CompressedScanLineBlock},
    },
    meta::{
        BlockDescription, MetaData,
        attribute::{AttributeValue, Compression, SampleType, Text},
        header::Header,
    },
    prelude::Vec2,
};
use rayon::prelude::*;

use super::parts::{Attribute, Channel, SAMPLE, text};
use crate::{Error, limits::MOST_DEFLATED, window::check_not_empty};

/// Reads a file row by row.
pub(crate) struct RowReader {
    path: PathBuf,
    file: BufReader<File>,
    /// The length of the file.
    length: u64,
    meta: MetaData,
    /// Where each block of rows begins.
    offsets: Vec<u64>,
}

impl RowReader {
    /// Reads and checks the header.
    pub(crate) fn open(path: &Path) -> Result<Self, Error> {
        let read = |error| Error::io("read", path, error);
        check_not_empty(path)?;
        let file = File::open(path).map_err(read)?;
        let length = file.metadata().map_err(read)?.len();
        let mut file = BufReader::new(file);
        let meta = MetaData::read_from_buffered(&mut file, false)
            .and_then(|meta| MetaData::validate(&meta.headers, false).map(|_| meta))
            .map_err(|error| Error::exr("read", path, error))?;

        let header = &meta.headers[0];
        if meta.requirements.has_multiple_layers {
            return Err(Error::malformed(path, "it has several parts; store one part alone"));
        }
        check(header, length).map_err(|why| Error::malformed(path, why))?;
        let table = 8 * header.chunk_count;
        let mut bytes = vec![0; table];
        file.read_exact(&mut bytes).map_err(read)?;
        let (offsets, _) = bytes.as_chunks();
        let offsets = offsets.iter().map(|&bytes| u64::from_le_bytes(bytes)).collect();
        Ok(Self { path: path.to_owned(), file, length, meta, offsets })
    }

    fn header(&self) -> &Header {
        &self.meta.headers[0]
    }

    /// Width and height in pixels.
    pub(crate) fn size(&self) -> [u32; 2] {
        // EXR windows are i32, and the header was validated.
        [self.header().layer_size.width() as u32, self.header().layer_size.height() as u32]
    }

    /// The channels in the order of [`Rows`], sorted by name.
    pub(crate) fn channels(&self) -> impl Iterator<Item = Channel> {
        self.header().channels.list.iter().map(|c| (text(&c.name), c.sample_type))
    }

    /// An attribute that is not one of EXR's own.
    pub(crate) fn attribute(&self, name: &str) -> Option<Attribute> {
        match self.header().own_attributes.other.get(&Text::new_or_none(name)?)? {
            AttributeValue::Text(value) => Some(Attribute::Text(text(value))),
            AttributeValue::I32(number) => Some(Attribute::I32(*number)),
            AttributeValue::F32(number) => Some(Attribute::F32(*number)),
            _ => None,
        }
    }

    /// Bytes of a row of all channels.
    pub(crate) fn row_bytes(&self) -> usize {
        self.header().layer_size.width() * self.header().channels.bytes_per_pixel
    }

    /// Reads some rows of the picture, at least one.
    pub(crate) fn read(&mut self, rows: Range<u32>) -> Result<Rows, Error> {
        debug_assert!(rows.start < rows.end && rows.end <= self.size()[1]);
        let lines = self.header().compression.scan_lines_per_block() as u32;
        let blocks = rows.start / lines..rows.end.div_ceil(lines);
        let skipped = (rows.start % lines) as usize;
        let chunks = blocks.map(|block| self.chunk(block, lines)).collect::<Result<Vec<_>, _>>()?;
        let blocks = chunks
            .into_par_iter()
            .map(|chunk| {
                UncompressedBlock::decompress_chunk(chunk, &self.meta, true).map(|block| block.data)
            })
            .collect::<Result<Vec<_>, _>>()
            .map_err(|error| Error::exr("read", &self.path, error))?;
        let row = self.header().layer_size.width() * SAMPLE;
        let channels = self.header().channels.list.len();
        Ok(Rows { blocks, skipped, rows: rows.len(), row, channels })
    }

    /// Reads a block, still compressed.
    fn chunk(&mut self, block: u32, lines: u32) -> Result<Chunk, Error> {
        let path = self.path.clone();
        let damaged = |why: &str| {
            Error::malformed(
                &path,
                format!("rows from {}: {why}; the file is cut off or damaged", block * lines),
            )
        };
        let rows = lines.min(self.size()[1] - block * lines);
        let wanted = u64::from(rows) * self.row_bytes() as u64;
        let y = i64::from(self.header().own_attributes.layer_position.y())
            + i64::from(block) * i64::from(lines);
        let offset = self.offsets[block as usize];
        let mut head = [0; 8];
        let end = offset.checked_add(8).filter(|&end| end <= self.length);
        let end = end.ok_or_else(|| damaged("they are missing"))?;
        self.file
            .seek(SeekFrom::Start(offset))
            .and_then(|_| self.file.read_exact(&mut head))
            .map_err(|error| Error::io("read", &path, error))?;
        let [a, b, c, d, size @ ..] = head;
        let size = u64::from(u32::from_le_bytes(size));
        if i64::from(i32::from_le_bytes([a, b, c, d])) != y {
            return Err(damaged("another block is in their place"));
        }
        if size > self.length - end || size > wanted || wanted / MOST_DEFLATED > size {
            return Err(damaged("their size is wrong"));
        }
        let mut bytes = vec![0; size as usize];
        self.file.read_exact(&mut bytes).map_err(|error| Error::io("read", &path, error))?;
        let block = CompressedScanLineBlock { y_coordinate: y as i32, compressed_pixels_le: bytes };
        Ok(Chunk { layer_index: 0, compressed_block: CompressedBlock::ScanLine(block) })
    }
}

/// Fails if this reader does not support the file, or if its `length` in bytes is too short
/// for its pixels.
fn check(header: &Header, length: u64) -> Result<(), String> {
    use Compression::{RLE, Uncompressed, ZIP1, ZIP16};
    let refuse = |why: &str| Err(why.to_owned());
    let Vec2(width, height) = header.layer_size;
    if header.blocks != BlockDescription::ScanLines {
        return refuse("it is tiled; store it in scan lines");
    }
    if !matches!(header.compression, Uncompressed | RLE | ZIP1 | ZIP16) {
        return refuse("its compression is not 'none', 'rle', 'zips' or 'zip'; store it as 'zip'");
    }
    for channel in &header.channels.list {
        if channel.sampling != Vec2(1, 1) || channel.sample_type == SampleType::F16 {
            return Err(format!(
                "channel '{}' is subsampled or of 16 bits; store all channels as 32-bit \
                 numbers, one per pixel",
                channel.name
            ));
        }
    }
    let bytes = u128::from(width as u64 * height as u64) * header.channels.bytes_per_pixel as u128;
    let table = 8 * header.chunk_count as u128;
    if bytes / u128::from(MOST_DEFLATED) + table > u128::from(length) {
        return Err(format!(
            "{length} bytes cannot contain {} channels of {width}x{height} pixels; the file is cut \
             off or damaged",
            header.channels.list.len()
        ));
    }
    Ok(())
}

/// Rows that were read.
pub(crate) struct Rows {
    /// Bytes `[row][channel][x]` of each block.
    blocks: Vec<Vec<u8>>,
    /// Rows of the first block that come before those that were asked for.
    skipped: usize,
    rows: usize,
    /// Bytes of a row of one channel.
    row: usize,
    channels: usize,
}

impl Rows {
    /// The number of pixels of these rows.
    pub(crate) fn pixels(&self) -> usize {
        self.rows * self.row / SAMPLE
    }

    /// Copies a channel's bytes, row after row, in the byte order of the machine.
    pub(crate) fn copy(&self, channel: usize, out: &mut [u8]) {
        let rows =
            self.blocks.iter().flat_map(|block| block.chunks_exact(self.row * self.channels));
        let rows = rows.skip(self.skipped).take(self.rows);
        for (out, row) in out.chunks_exact_mut(self.row).zip(rows) {
            out.copy_from_slice(&row[channel * self.row..][..self.row]);
        }
    }
}

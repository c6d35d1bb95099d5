//! Reads files row by row.

use std::{
    fs::File,
    io::{BufReader, Read, Seek, SeekFrom},
    ops::Range,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
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

use super::{
    parts::{Attribute, Channel, SAMPLE, text},
    unzip,
};
use crate::{Error, limits::MOST_DEFLATED, window::check_not_empty};

/// Reads a file row by row.
pub(crate) struct RowReader {
    path: PathBuf,
    file: Mutex<BufReader<File>>,
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
        Ok(Self { path: path.to_owned(), file: Mutex::new(file), length, meta, offsets })
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

    /// Rows that the file has compressed together, from a multiple of as many: those of a block.
    pub(crate) fn block_rows(&self) -> u32 {
        self.header().compression.scan_lines_per_block() as u32
    }

    /// Reads some rows of the picture. For each of them, `out` says where its samples of each of
    /// `channels` go, which are different places in the list of [`RowReader::channels`]. An f32 is
    /// there as its bits.
    pub(crate) fn read<'a>(
        &self,
        rows: Range<u32>,
        channels: &[usize],
        mut out: impl Iterator<Item = Vec<&'a mut [u32]>>,
    ) -> Result<(), Error> {
        debug_assert!(rows.end <= self.size()[1]);
        let lines = self.block_rows();
        let in_all = self.header().channels.list.len();
        // Lists of rows take memory, too, and much of it where rows are short.
        let at_once = (ROWS_AT_ONCE / (lines as usize * in_all)).clamp(1, BLOCKS_AT_ONCE);
        let blocks: Vec<u32> = (rows.start / lines..rows.end.div_ceil(lines)).collect();
        for blocks in blocks.chunks(at_once) {
            let wanted = blocks.iter().map(|&block| {
                let lines = self.rows_of(block).map(|row| {
                    let mut line: Vec<Option<&mut [u32]>> = Vec::new();
                    line.resize_with(in_all, || None);
                    if rows.contains(&row) {
                        let places = channels.iter().zip(out.next().into_iter().flatten());
                        places.for_each(|(&channel, place)| line[channel] = Some(place));
                    }
                    line
                });
                (block, lines.flatten().collect())
            });
            let wanted: Vec<(u32, Vec<_>)> = wanted.collect();
            let done: Vec<Result<(), Error>> = wanted
                .into_par_iter()
                .map(|(block, mut lines)| self.read_block(block, &mut lines))
                .collect();
            // The first error in the file, however the threads are scheduled.
            done.into_iter().collect::<Result<(), Error>>()?;
        }
        Ok(())
    }

    /// The rows of a block.
    fn rows_of(&self, block: u32) -> Range<u32> {
        let first = block * self.block_rows();
        first..self.size()[1].min(first.saturating_add(self.block_rows()))
    }

    /// Reads a block; `out` is `[row][channel]`.
    fn read_block(&self, block: u32, out: &mut [Option<&mut [u32]>]) -> Result<(), Error> {
        use Compression::{ZIP1, ZIP16};
        let bytes = self.chunk(block)?;
        let width = self.header().layer_size.width();
        if bytes.len() < out.len() * width * SAMPLE
            && matches!(self.header().compression, ZIP1 | ZIP16)
        {
            return unzip::decompress(&bytes, width, out).map_err(|why| self.damaged(block, why));
        }
        let y_coordinate = self.y_coordinate(block) as i32;
        let chunk = CompressedScanLineBlock { y_coordinate, compressed_pixels_le: bytes };
        let chunk = Chunk { layer_index: 0, compressed_block: CompressedBlock::ScanLine(chunk) };
        let block = UncompressedBlock::decompress_chunk(chunk, &self.meta, true)
            .map_err(|error| Error::exr("read", &self.path, error))?;
        for (out, row) in out.iter_mut().zip(block.data.chunks_exact(width * SAMPLE)) {
            let Some(out) = out else { continue };
            let samples = row.as_chunks().0.iter().map(|&sample| u32::from_ne_bytes(sample));
            out.iter_mut().zip(samples).for_each(|(out, sample)| *out = sample);
        }
        Ok(())
    }

    /// The number of a block's first row in the file, which may not begin with 0.
    fn y_coordinate(&self, block: u32) -> i64 {
        let first = i64::from(self.header().own_attributes.layer_position.y());
        first + i64::from(self.rows_of(block).start)
    }

    /// Says what is wrong with a block.
    fn damaged(&self, block: u32, why: &str) -> Error {
        let row = self.rows_of(block).start;
        Error::malformed(
            &self.path,
            format!("rows from {row}: {why}; the file is cut off or damaged"),
        )
    }

    /// The bytes of a block, still compressed.
    fn chunk(&self, block: u32) -> Result<Vec<u8>, Error> {
        let read = |error| Error::io("read", &self.path, error);
        let wanted = self.rows_of(block).len() as u64 * self.row_bytes() as u64;
        let offset = self.offsets[block as usize];
        let mut head = [0; 8];
        let end = offset.checked_add(8).filter(|&end| end <= self.length);
        let end = end.ok_or_else(|| self.damaged(block, "they are missing"))?;
        // Others wait meanwhile, but no longer than until these bytes are in memory.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(offset))
            .and_then(|_| file.read_exact(&mut head))
            .map_err(read)?;
        let [a, b, c, d, size @ ..] = head;
        let size = u64::from(u32::from_le_bytes(size));
        if i64::from(i32::from_le_bytes([a, b, c, d])) != self.y_coordinate(block) {
            return Err(self.damaged(block, "another block is in their place"));
        }
        if size > self.length - end || size > wanted || wanted / MOST_DEFLATED > size {
            return Err(self.damaged(block, "their size is wrong"));
        }
        let mut bytes = vec![0; size as usize];
        file.read_exact(&mut bytes).map_err(read)?;
        Ok(bytes)
    }
}

/// Blocks that are given to the threads together.
const BLOCKS_AT_ONCE: usize = 64;

/// Rows of a channel that are given to the threads together, if these are several blocks.
const ROWS_AT_ONCE: usize = 1 << 18;

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

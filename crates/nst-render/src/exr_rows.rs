//! Single-part scanline EXR files, read and written some rows at a time, so that
//! a picture with hundreds of channels need not fit the memory.
//!
//! The exr crate parses headers and (de)compresses blocks. Where blocks lie in the
//! file is read here, and every size is checked against the file's length before
//! memory is asked for.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

use exr::{
    block::{
        BlockIndex, UncompressedBlock,
        chunk::{Chunk, CompressedBlock, CompressedScanLineBlock},
    },
    meta::{
        BlockDescription, MetaData,
        attribute::{AttributeValue, ChannelDescription, Compression, LineOrder, SampleType, Text},
        header::{Header, LayerAttributes},
        magic_number,
    },
    prelude::Vec2,
};
use rayon::prelude::*;

use crate::{Error, output::OutputFile};

/// Rows that are compressed together in the files of this crate; every file's
/// blocks that [`RowReader`] accepts have this height or a divisor of it.
pub(crate) const BLOCK_ROWS: u32 = 16;

/// Bytes of a sample: the channels of these files are f32 or u32.
const SAMPLE: usize = 4;

/// No lossless EXR compression makes a block smaller than this fraction: deflate
/// stores at most 258 bytes in two bits.
const MAX_RATIO: u64 = 1032;

/// The value of an attribute.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Attribute {
    Text(String),
    I32(i32),
    F32(f32),
}

/// Attributes by name.
pub(crate) type Attributes = BTreeMap<String, Attribute>;

/// A channel's name and type, f32 or u32.
pub(crate) type Channel = (String, SampleType);

/// Writes a file row by row.
pub(crate) struct RowWriter<'a> {
    path: PathBuf,
    file: BufWriter<&'a mut File>,
    header: [Header; 1],
    /// For each of the file's channels, which are sorted, its place in the caller's list.
    order: Vec<usize>,
    /// Where the table of blocks begins, and what it will hold.
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
        let descriptions = order
            .iter()
            .map(|&i| ChannelDescription {
                name: latin1(&channels[i].0),
                sample_type: channels[i].1,
                quantize_linearly: false,
                sampling: Vec2(1, 1),
            })
            .collect();
        let mut layer = LayerAttributes {
            software_name: Some(Text::from(concat!("nst ", env!("CARGO_PKG_VERSION")))),
            ..Default::default()
        };
        for (name, value) in attributes {
            let value = match value {
                Attribute::Text(text) => AttributeValue::Text(latin1(&text)),
                Attribute::I32(number) => AttributeValue::I32(number),
                Attribute::F32(number) => AttributeValue::F32(number),
            };
            layer.other.insert(latin1(&name), value);
        }
        let size = Vec2(size[0] as usize, size[1] as usize);
        let header = Header::new(Text::default(), size, descriptions)
            .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
            .with_attributes(layer);
        let header = [header];

        let mut file = BufWriter::new(output.file());
        let blocks = header[0].chunk_count as u64;
        let table = MetaData::validate(&header, true)
            .and_then(|requirements| {
                magic_number::write(&mut file)?;
                requirements.write(&mut file)?;
                Header::write_all(&header, &mut file, false)?;
                let table = file.stream_position()?;
                // Zeros, which readers take for blocks that are missing.
                std::io::copy(&mut std::io::repeat(0).take(8 * blocks), &mut file)?;
                Ok(table)
            })
            .map_err(|error| failed(&path, "write", error))?;
        Ok(Self { path, file, header, order, table, offsets: Vec::new() })
    }

    /// Appends rows: `planes` are the channels in the order given to
    /// [`RowWriter::create`], each the native bytes of the same number of rows.
    ///
    /// All but the last rows of a file come in multiples of [`BLOCK_ROWS`].
    pub(crate) fn push(&mut self, planes: &[&[u8]]) -> Result<(), Error> {
        let row = SAMPLE * self.header[0].layer_size.width();
        let block_bytes = row * BLOCK_ROWS as usize;
        let count = planes[0].len().div_ceil(block_bytes);
        debug_assert_eq!(planes.len(), self.order.len());
        let rows = planes[0].len() / row;
        let end = self.offsets.len() * BLOCK_ROWS as usize + rows;
        let height = self.header[0].layer_size.height();
        if end > height || (end < height && !rows.is_multiple_of(BLOCK_ROWS as usize)) {
            return Err(Error::Settings(format!(
                "'{}': {rows} rows that end with {end} of {height}; all but the last come in multiples of {BLOCK_ROWS}",
                self.path.display()
            )));
        }
        // A few blocks for each thread, so that few wait to be written.
        let group = 2 * rayon::current_num_threads();
        let path = &self.path;
        for first in (0..count).step_by(group) {
            let blocks = (first..count.min(first + group))
                .into_par_iter()
                .map(|block| {
                    let place = block * block_bytes..planes[0].len().min((block + 1) * block_bytes);
                    let mut data = Vec::with_capacity(place.len() * planes.len());
                    for start in place.clone().step_by(row) {
                        for &channel in &self.order {
                            data.extend_from_slice(&planes[channel][start..start + row]);
                        }
                    }
                    let y = (self.offsets.len() + block - first) * BLOCK_ROWS as usize;
                    let index = BlockIndex {
                        layer: 0,
                        pixel_position: Vec2(0, y),
                        pixel_size: Vec2(row / SAMPLE, place.len() / row),
                        level: Vec2(0, 0),
                    };
                    UncompressedBlock { index, data }.compress_to_chunk(&self.header)
                })
                .collect::<Result<Vec<_>, _>>()
                .map_err(|error| failed(path, "write", error))?;
            for block in blocks {
                let written = self.file.stream_position().map_err(Into::into).and_then(|offset| {
                    self.offsets.push(offset);
                    block.write(&mut self.file, 1)
                });
                written.map_err(|error| failed(path, "write", error))?;
            }
        }
        Ok(())
    }

    /// Completes the file, whose rows must all be there. The caller commits the output.
    pub(crate) fn finish(mut self) -> Result<(), Error> {
        if self.offsets.len() != self.header[0].chunk_count {
            let message = format!(
                "{} of {} blocks of rows were given",
                self.offsets.len(),
                self.header[0].chunk_count
            );
            return Err(Error::image(&self.path, message));
        }
        let table: Vec<u8> = self.offsets.iter().flat_map(|offset| offset.to_le_bytes()).collect();
        let written = self.file.seek(SeekFrom::Start(self.table));
        let written = written.and_then(|_| self.file.write_all(&table));
        written
            .and_then(|()| self.file.flush())
            .map_err(|error| Error::io("write", &self.path, error))
    }
}

/// Reads a file row by row.
pub(crate) struct RowReader {
    path: PathBuf,
    file: BufReader<File>,
    /// The length of the file.
    length: u64,
    meta: MetaData,
    offsets: Vec<u64>,
    next_row: u32,
}

impl RowReader {
    /// Reads and checks the header.
    pub(crate) fn open(path: &Path) -> Result<Self, Error> {
        let read = |error| Error::io("read", path, error);
        let file = File::open(path).map_err(read)?;
        let length = file.metadata().map_err(read)?.len();
        let mut file = BufReader::new(file);
        let meta = MetaData::read_from_buffered(&mut file, false)
            .and_then(|meta| MetaData::validate(&meta.headers, false).map(|_| meta))
            .map_err(|error| failed(path, "read", error))?;

        let refuse = |why: &str| Err(Error::image(path, why));
        let header = &meta.headers[0];
        let Vec2(width, height) = header.layer_size;
        if meta.requirements.has_multiple_layers {
            return refuse("it has several parts; store one part alone");
        }
        if header.blocks != BlockDescription::ScanLines {
            return refuse("it is tiled; store it in scanlines");
        }
        use Compression::{RLE, Uncompressed, ZIP1, ZIP16};
        if !matches!(header.compression, Uncompressed | RLE | ZIP1 | ZIP16) {
            return refuse(
                "its compression is not 'none', 'rle', 'zips' or 'zip'; store it as 'zip'",
            );
        }
        if width == 0 || height == 0 {
            return refuse("it has no pixels");
        }
        for channel in &header.channels.list {
            if channel.sampling != Vec2(1, 1) || channel.sample_type == SampleType::F16 {
                let name = &channel.name;
                return refuse(&format!(
                    "channel '{name}' is subsampled or of 16 bits; store all channels as 32-bit numbers, one per pixel"
                ));
            }
        }
        let pixels = width as u64 * height as u64;
        let bytes = u128::from(pixels) * header.channels.bytes_per_pixel as u128;
        let table = 8 * header.chunk_count as u64;
        if bytes / u128::from(MAX_RATIO) + u128::from(table) > u128::from(length) {
            let channels = header.channels.list.len();
            return refuse(&format!(
                "{length} bytes cannot hold {channels} channels of {width}x{height} pixels; the file is cut off or damaged"
            ));
        }
        let mut bytes = vec![0; table as usize];
        file.read_exact(&mut bytes).map_err(read)?;
        let (offsets, _) = bytes.as_chunks();
        let offsets = offsets.iter().map(|&bytes| u64::from_le_bytes(bytes)).collect();
        Ok(Self { path: path.to_owned(), file, length, meta, offsets, next_row: 0 })
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
        self.header().channels.list.iter().map(|c| (c.name.to_string(), c.sample_type))
    }

    /// An attribute that is not one of EXR's own.
    pub(crate) fn attribute(&self, name: &str) -> Option<Attribute> {
        match self.header().own_attributes.other.get(&Text::new_or_none(name)?)? {
            AttributeValue::Text(text) => Some(Attribute::Text(text.to_string())),
            AttributeValue::I32(number) => Some(Attribute::I32(*number)),
            AttributeValue::F32(number) => Some(Attribute::F32(*number)),
            _ => None,
        }
    }

    /// Bytes of a row of all channels.
    pub(crate) fn row_bytes(&self) -> usize {
        self.header().layer_size.width() * self.header().channels.bytes_per_pixel
    }

    /// The number of the next row to be read.
    pub(crate) fn next_row(&self) -> u32 {
        self.next_row
    }

    /// Reads the next rows: a multiple of [`BLOCK_ROWS`], or what is left.
    pub(crate) fn read(&mut self, rows: u32) -> Result<Rows, Error> {
        let height = self.size()[1];
        let lines = self.header().compression.scan_lines_per_block() as u32;
        let end = self.next_row.saturating_add(rows).min(height);
        debug_assert!(self.next_row < end && (end == height || end.is_multiple_of(BLOCK_ROWS)));
        let blocks = (self.next_row / lines)..end.div_ceil(lines);
        let chunks = blocks.map(|block| self.chunk(block, lines)).collect::<Result<Vec<_>, _>>()?;
        let blocks = chunks
            .into_par_iter()
            .map(|chunk| {
                UncompressedBlock::decompress_chunk(chunk, &self.meta, true).map(|block| block.data)
            })
            .collect::<Result<Vec<_>, _>>()
            .map_err(|error| failed(&self.path, "read", error))?;
        self.next_row = end;
        let row = self.header().layer_size.width() * SAMPLE;
        Ok(Rows { blocks, row, channels: self.header().channels.list.len() })
    }

    /// Reads a block, still compressed.
    fn chunk(&mut self, block: u32, lines: u32) -> Result<Chunk, Error> {
        let path = self.path.clone();
        let damaged = |why: &str| {
            Error::image(
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
        if size > self.length - end || size > wanted || wanted / MAX_RATIO > size {
            return Err(damaged("their size is wrong"));
        }
        let mut bytes = vec![0; size as usize];
        self.file.read_exact(&mut bytes).map_err(|error| Error::io("read", &path, error))?;
        let block = CompressedScanLineBlock { y_coordinate: y as i32, compressed_pixels_le: bytes };
        Ok(Chunk { layer_index: 0, compressed_block: CompressedBlock::ScanLine(block) })
    }
}

/// Rows that were read.
pub(crate) struct Rows {
    /// Bytes `[row][channel][x]` of each block.
    blocks: Vec<Vec<u8>>,
    /// Bytes of a row of one channel.
    row: usize,
    channels: usize,
}

impl Rows {
    /// The number of pixels of these rows.
    pub(crate) fn pixels(&self) -> usize {
        self.blocks.iter().map(Vec::len).sum::<usize>() / (self.channels * SAMPLE)
    }

    /// Copies a channel's native bytes, row after row.
    pub(crate) fn copy(&self, channel: usize, out: &mut [u8]) {
        let rows =
            self.blocks.iter().flat_map(|block| block.chunks_exact(self.row * self.channels));
        for (out, row) in out.chunks_exact_mut(self.row).zip(rows) {
            out.copy_from_slice(&row[channel * self.row..][..self.row]);
        }
    }
}

/// An error of the exr crate, with the file that it is about.
fn failed(path: &Path, action: &'static str, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::Io(error) => Error::io(action, path, error),
        error => Error::image(path, format!("not a sound EXR file: {error}")),
    }
}

/// EXR stores text as Latin-1; other characters become question marks.
fn latin1(text: &str) -> Text {
    Text::new_or_none(text).unwrap_or_else(|| {
        let replaced: String =
            text.chars().map(|c| if u32::from(c) < 256 { c } else { '?' }).collect();
        Text::new_or_none(replaced).unwrap_or_default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes f32 channels of so many rows at a time.
    fn write(path: &Path, size: [u32; 2], planes: &[Vec<f32>], rows: usize) -> Result<(), Error> {
        let names = ["b", "a", "c"];
        let channels = names.map(|name| (name.to_owned(), SampleType::F32));
        let attributes = [("x".to_owned(), Attribute::Text("µ, β".into()))].into();
        let mut output = OutputFile::create(path)?;
        let mut writer = RowWriter::create(&mut output, size, &channels, attributes)?;
        let step = size[0] as usize * rows;
        for first in (0..planes[0].len()).step_by(step) {
            let part = |plane: &Vec<f32>| plane[first..plane.len().min(first + step)].to_vec();
            let part: Vec<Vec<f32>> = planes.iter().map(part).collect();
            let bytes: Vec<&[u8]> = part.iter().map(|plane| bytemuck::cast_slice(plane)).collect();
            writer.push(&bytes)?;
        }
        writer.finish()?;
        output.commit()
    }

    #[test]
    fn rows_come_back_however_they_are_cut() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("x.exr");
        for size in [[7, 50], [1, 1], [5, 16], [33, 17]] {
            let pixels = size[0] as usize * size[1] as usize;
            let plane = |c: usize| (0..pixels).map(|i| (i * i + c) as f32 / 7.0).collect();
            let planes: Vec<Vec<f32>> = (0..3).map(plane).collect();
            for (written, read) in [(16, 32), (1 << 20, 16), (32, 1 << 20)] {
                write(&path, size, &planes, written).expect("it can be written");
                let mut reader = RowReader::open(&path).expect("it can be read");
                assert_eq!(reader.size(), size);
                assert_eq!(reader.attribute("x"), Some(Attribute::Text("µ, ?".into())));
                let names: Vec<String> = reader.channels().map(|(name, _)| name).collect();
                assert_eq!(names, ["a", "b", "c"]);
                let mut found = vec![Vec::new(); 3];
                while reader.next_row() < size[1] {
                    let rows = reader.read(read).expect("rows");
                    for (channel, plane) in [(1, 0), (0, 1), (2, 2)] {
                        let mut values = vec![0.0_f32; rows.pixels()];
                        rows.copy(channel, bytemuck::cast_slice_mut(&mut values));
                        found[plane].extend(values);
                    }
                }
                assert_eq!(found, planes);
            }
        }
    }

    #[test]
    fn rows_that_do_not_fit_are_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("x.exr");
        let planes = |rows: usize| vec![vec![1.0; 7 * rows]; 3];
        assert!(write(&path, [7, 40], &planes(40), 16).is_ok());
        for (rows, step) in [(40, 10), (48, 16), (32, 16), (41, 1 << 20)] {
            assert!(write(&path, [7, 40], &planes(rows), step).is_err(), "{rows} {step}");
        }
    }
}

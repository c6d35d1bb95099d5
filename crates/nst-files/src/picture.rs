//! Pictures from EXR files of any program: RGB or a single channel, f16, f32 or u32, scan
//! lines or tiles, in any layer or part. They are read by ranges of rows, so that many
//! large files can be used together.

use std::{
    collections::BTreeSet,
    ops::Range,
    path::{Path, PathBuf},
};

use exr::{
    block::{
        UncompressedBlock,
        chunk::{Chunk, CompressedBlock},
        lines::LineRef,
    },
    meta::{MetaData, header::Header},
    prelude::{Compression, SampleType, f16},
};
use nst_core::Grid;
use rayon::prelude::*;

use crate::{
    Error, blender,
    header::{ExrHeader, Layer, Part, Window, open, title},
    primaries,
};

/// A layer of an EXR file whose header has been read and checked; its pixels
/// have not.
#[derive(Clone, Debug)]
pub struct Picture {
    path: PathBuf,
    part: usize,
    /// Indices of the file's channels, in the order of the lanes.
    channels: Vec<usize>,
    /// Width and height in pixels of the data window, which counts as the picture.
    pub size: [u32; 2],
    /// Where the data window's left upper corner lies.
    pub position: [i32; 2],
    /// The frame of the picture, of which the data window may be a part.
    pub display: Window,
    /// Red, green, blue and white in CIE xy, where the file says it.
    pub chromaticities: Option<[[f32; 2]; 4]>,
    /// The layer's name; empty for the main picture.
    pub layer: String,
    /// The names of its channels: R, G and B, or one.
    pub channel_names: Vec<String>,
    /// The attribute `samplesPerPixel`, or Blender's `cycles.VIEW.samples`, where the file
    /// has it as a whole number above 0.
    pub samples_per_pixel: Option<u32>,
    /// The name of the attribute that [`Self::samples_per_pixel`] is from.
    pub samples_attribute: Option<String>,
    /// What the file says instead, where that is no such number: the attribute and its value.
    pub samples_unclear: Option<String>,
    /// The attribute `renderTimeSeconds`, where it is a number above 0.
    pub render_seconds: Option<f64>,
    /// The colour space that the file names (`colorInteropID` of the Color Interop Forum),
    /// where it is another one than linear sRGB.
    color_space: Option<String>,
    /// Where the picture is denoised, the layer that has it before.
    before_denoising: Option<String>,
}

impl Picture {
    /// Reads the header of a file and picks a layer: the named one, else the main picture,
    /// else the only one. The name of a layer is the part of its channels' names before the
    /// last dot, the name of its part of the file, or both; a single channel by its whole
    /// name.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Malformed`] names the file, what is wrong with it, and
    /// the layers that it has.
    pub fn open(path: &Path, layer: Option<&str>) -> Result<Self, Error> {
        let header = ExrHeader::read(path)?;
        let layer = header.choose(layer).map_err(|message| Error::malformed(path, message))?;
        Self::of_layer(path, &header, layer)
    }

    /// The same of a layer of the header.
    ///
    /// # Errors
    /// [`Error::Malformed`] says what is wrong.
    pub(crate) fn of_layer(path: &Path, header: &ExrHeader, layer: Layer) -> Result<Self, Error> {
        let part = &header.parts[layer.part];
        let channels = || layer.channels.iter().map(|&channel| &part.channels[channel]);
        if part.deep {
            return Err(Error::malformed(
                path,
                "deep pixels are not supported; flatten them first",
            ));
        }
        // The library would look for the samples of the other channels in wrong places.
        if !part.channels.iter().all(|channel| channel.full_resolution) {
            let chroma = part.channels.iter().any(|channel| channel.name.ends_with("RY"));
            let message = if chroma {
                "luminance and chroma (Y, RY, BY) are not supported; save it as R, G and B"
            } else {
                "channels of reduced resolution are not supported; resample them first"
            };
            return Err(Error::malformed(path, message));
        }
        let [width, height] = part.size;
        Grid::new(width, height, layer.channels.len() as u32, 0)
            .map_err(|error| Error::malformed(path, error.to_string()))?;
        let samples = samples_per_pixel(header, &layer);
        let blended = layer.name.is_empty() && part.attributes.contains_key("nst.expert");
        let plain = blended.then(|| "S".to_owned());
        let before_denoising = plain.or_else(|| blender::before_denoising(&layer.name));
        Ok(Self {
            path: path.to_owned(),
            part: layer.part,
            size: part.size,
            position: part.position,
            display: part.display,
            chromaticities: part.chromaticities,
            channel_names: channels().map(|channel| channel.name.clone()).collect(),
            samples_per_pixel: samples.as_ref().and_then(|it| it.1.as_ref().ok().copied()),
            samples_attribute: samples.as_ref().map(|it| it.0.clone()),
            samples_unclear: samples.and_then(|it| it.1.err()),
            render_seconds: render_seconds(part),
            color_space: primaries::foreign_space(&part.attributes),
            before_denoising: before_denoising
                .filter(|noisy| header.layers().iter().any(|layer| layer.name == *noisy)),
            channels: layer.channels,
            layer: layer.name,
        })
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads the whole picture, as [`Self::read_rows`] does.
    ///
    /// # Errors
    /// As of [`Self::read_rows`].
    pub fn read(&self) -> Result<Vec<f32>, Error> {
        self.read_rows(0..self.size[1])
    }

    /// The data window: which pixels of the frame the file has.
    #[must_use]
    pub fn window(&self) -> Window {
        Window { position: self.position, size: self.size }
    }

    /// Reads a part of the data window, as planar lanes: `[channel][y][x]`.
    ///
    /// # Errors
    /// As of [`Self::read_rows`].
    ///
    /// # Panics
    /// If the data window does not contain it.
    pub fn read_window(&self, part: &Window) -> Result<Vec<f32>, Error> {
        assert_eq!(self.window().intersection(part), Some(*part), "{:?}", self.window());
        let from = |axis: usize| (part.position[axis] - self.position[axis]) as u32;
        let lanes = self.read_rows(from(1)..from(1) + part.size[1])?;
        if part.size[0] == self.size[0] {
            return Ok(lanes);
        }
        let (first, width) = (from(0) as usize, part.size[0] as usize);
        let rows = lanes.chunks_exact(self.size[0] as usize);
        Ok(rows.flat_map(|row| &row[first..first + width]).copied().collect())
    }

    /// What to tell about colours that are not linear sRGB: nothing here converts them.
    #[must_use]
    pub fn primaries_note(&self) -> Option<String> {
        let primaries = self.chromaticities.and_then(|found| primaries::note(&self.path, found));
        primaries.or_else(|| Some(primaries::space_note(&self.path, self.color_space.as_ref()?)))
    }

    /// Whether the colours of another picture mean the same.
    #[must_use]
    pub fn has_primaries_of(&self, other: &Self) -> bool {
        self.chromaticities == other.chromaticities && self.color_space == other.color_space
    }

    /// What to tell about a denoised picture that is to be one of several samples: denoisers
    /// err in the same way in all of them.
    #[must_use]
    pub fn denoised_note(&self) -> Option<String> {
        let (path, noisy) = (self.path.display(), self.before_denoising.as_ref()?);
        let layer = title(&self.layer);
        Some(format!(
            "'{path}' is denoised in {layer}: a mean of denoised pictures does not converge to \
             the true one; --layer '{noisy}' takes them as they were before"
        ))
    }

    /// Reads some rows, counted from the top, as planar lanes: `[channel][y][x]`.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Malformed`] names the file and what is wrong with it.
    ///
    /// # Panics
    /// If the picture does not have these rows.
    pub fn read_rows(&self, rows: Range<u32>) -> Result<Vec<f32>, Error> {
        assert!(rows.start <= rows.end && rows.end <= self.size[1], "{rows:?} of {:?}", self.size);
        let (meta, chunks) = self.chunks(&rows)?;
        let header = &meta.headers[self.part];
        if !chunks.iter().all(|chunk| sizes_are_plausible(chunk, header)) {
            return Err(Error::malformed(&self.path, "damaged: a block is larger than it can be"));
        }
        let blocks = chunks
            .into_par_iter()
            .map(|chunk| UncompressedBlock::decompress_chunk(chunk, &meta, false))
            .collect::<Result<Vec<_>, _>>()
            .map_err(|error| Error::exr("read", &self.path, error))?;

        let incomplete = || Error::malformed(&self.path, "damaged: it lacks some of its pixels");
        let width = self.size[0] as usize;
        let wanted = rows.start as usize..rows.end as usize;
        let plane = wanted.len() * width;
        // Memory only for pixels that the file has.
        let pixels = blocks.iter().map(|block| block.index.pixel_size.area()).sum::<usize>();
        if pixels < plane {
            return Err(incomplete());
        }
        let mut lanes = vec![0.0; plane * self.channels.len()];
        let mut seen = BTreeSet::new();
        let mut missing = plane;
        for block in blocks {
            let index = block.index;
            let (x, y) = (index.pixel_position.x(), index.pixel_position.y());
            let elsewhere =
                index.layer != self.part || (index.level.x(), index.level.y()) != (0, 0);
            if elsewhere || !seen.insert((x, y)) {
                return Err(incomplete());
            }
            for line in block.lines(&header.channels) {
                let (at, y) = (line.location, line.location.position.y());
                let Some(channel) = self.channels.iter().position(|&c| c == at.channel) else {
                    continue;
                };
                if !wanted.contains(&y) {
                    continue;
                }
                let first = channel * plane + (y - wanted.start) * width + at.position.x();
                let kind = header.channels.list[at.channel].sample_type;
                read_line(&line, kind, &mut lanes[first..first + at.sample_count])
                    .map_err(|error| Error::exr("read", &self.path, error))?;
                if channel == 0 {
                    missing = missing.checked_sub(at.sample_count).ok_or_else(incomplete)?;
                }
            }
        }
        if missing > 0 { Err(incomplete()) } else { Ok(lanes) }
    }

    /// The compressed blocks that contain any of the rows.
    fn chunks(&self, rows: &Range<u32>) -> Result<(MetaData, Vec<Chunk>), Error> {
        let reader = open(&self.path)?;
        let meta = reader.meta_data().clone();
        let unchanged = meta.headers.get(self.part).is_some_and(|header| {
            [header.layer_size.x(), header.layer_size.y()] == self.size.map(|n| n as usize)
                && self.channels.iter().all(|&channel| channel < header.channels.list.len())
        });
        if !unchanged {
            return Err(Error::malformed(&self.path, "it has changed since it was opened"));
        }
        let chunks = reader
            .filter_chunks(false, |_, tile, block| {
                let (first, end) = (
                    block.pixel_position.y(),
                    block.pixel_position.y().saturating_add(block.pixel_size.y()),
                );
                block.layer == self.part
                    && (tile.level_index.x(), tile.level_index.y()) == (0, 0)
                    && first < rows.end as usize
                    && end > rows.start as usize
            })
            .and_then(Iterator::collect)
            .map_err(|error| Error::exr("read", &self.path, error))?;
        Ok((meta, chunks))
    }
}

/// Whether the sizes at the start of a DWA block are possible for its pixels. The library
/// allocates as much as they say.
fn sizes_are_plausible(chunk: &Chunk, header: &Header) -> bool {
    if !matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return true;
    }
    let bytes = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        _ => return false,
    };
    // Version, nine sizes, the kind of entropy coding; pixels are coded by 8 by 8.
    let block = header.max_block_pixel_size();
    let pixels = block.x().next_multiple_of(8).saturating_mul(block.y().next_multiple_of(8));
    let most = pixels.saturating_mul(4 * header.channels.bytes_per_pixel) as u64 + (1 << 16);
    // A block that does not shrink is stored as it is.
    let raw = header
        .get_block_data_indices(&chunk.compressed_block)
        .and_then(|tile| header.get_absolute_block_pixel_coordinates(tile))
        .is_ok_and(|block| bytes.len() == block.size.area() * header.channels.bytes_per_pixel);
    let (numbers, _) = bytes.as_chunks();
    raw || numbers.iter().take(10).skip(1).all(|&number| u64::from_le_bytes(number) <= most)
}

/// Converts a line of samples; u32 beyond 2²⁴ are rounded.
fn read_line(line: &LineRef<'_>, kind: SampleType, lanes: &mut [f32]) -> exr::error::UnitResult {
    match kind {
        SampleType::F32 => {
            for (lane, sample) in lanes.iter_mut().zip(line.read_samples::<f32>()) {
                *lane = sample?;
            }
        }
        SampleType::F16 => {
            for (lane, sample) in lanes.iter_mut().zip(line.read_samples::<f16>()) {
                *lane = sample?.to_f32();
            }
        }
        SampleType::U32 => {
            for (lane, sample) in lanes.iter_mut().zip(line.read_samples::<u32>()) {
                *lane = sample? as f32;
            }
        }
    }
    Ok(())
}

/// The attribute with the samples per pixel, and its value: pbrt writes an integer; other
/// programs write text or a float; Blender, one for each view layer, all in the first part.
/// One that is no whole number above 0 is returned as text.
fn samples_per_pixel(header: &ExrHeader, layer: &Layer) -> Option<(String, Result<u32, String>)> {
    const OWN: &str = "samplesPerPixel";
    let own = header.parts[layer.part].attributes.get(OWN).map(|value| (OWN, value.as_str()));
    let all = || header.parts.iter().flat_map(|part| &part.attributes);
    let blenders = || blender::samples(all().map(|(name, value)| (&**name, &**value)), &layer.name);
    let (name, text) = own.or_else(blenders)?;
    let number = text.trim().parse::<f64>().unwrap_or_default();
    let is_count = number >= 1.0 && number <= f64::from(u32::MAX) && number.fract() == 0.0;
    let count = if is_count { Ok(number as u32) } else { Err(format!("{name} = {text}")) };
    Some((name.to_owned(), count))
}

/// How long the picture took, as pbrt and `nst` write it.
fn render_seconds(part: &Part) -> Option<f64> {
    let seconds: f64 = part.attributes.get("renderTimeSeconds")?.trim().parse().ok()?;
    Some(seconds).filter(|seconds| seconds.is_finite() && *seconds > 0.0)
}

#[cfg(test)]
mod tests {
    use exr::prelude::*;

    use super::{Layer, *};

    fn value(channel: usize, x: usize, y: usize) -> f32 {
        (100 * channel + 10 * y + x) as f32
    }

    fn samples(kind: SampleType, channel: usize, size: Vec2<usize>) -> FlatSamples {
        let all = (0..size.area()).map(|i| value(channel, i % size.0, i / size.0));
        match kind {
            SampleType::F16 => FlatSamples::F16(all.map(f16::from_f32).collect()),
            SampleType::F32 => FlatSamples::F32(all.collect()),
            SampleType::U32 => FlatSamples::U32(all.map(|x| x as u32).collect()),
        }
    }

    /// Writes channels whose samples follow from their index, the size and the position.
    fn write_file(path: &Path, encoding: Encoding, position: Vec2<i32>, names: &[&str]) {
        let size = Vec2(9, 37);
        let kinds = [SampleType::F16, SampleType::F32, SampleType::U32];
        let channels = names
            .iter()
            .enumerate()
            .map(|(i, name)| AnyChannel::new(*name, samples(kinds[i % 3], i, size)));
        let attributes = LayerAttributes::named("main").with_position(position);
        let layer = exr::prelude::Layer::new(
            size,
            attributes,
            encoding,
            AnyChannels::sort(channels.collect()),
        );
        Image::from_layer(layer).write().to_file(path).expect("a file");
    }

    #[test]
    fn all_kinds_of_blocks_and_any_rows() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.exr");
        let tiles = |side| Blocks::Tiles(Vec2(side, side));
        let order = LineOrder::Unspecified;
        for (compression, blocks, line_order) in [
            (Compression::Uncompressed, Blocks::ScanLines, LineOrder::Increasing),
            (Compression::RLE, Blocks::ScanLines, LineOrder::Increasing),
            (Compression::ZIP1, Blocks::ScanLines, LineOrder::Decreasing),
            (Compression::ZIP16, Blocks::ScanLines, LineOrder::Increasing),
            (Compression::PIZ, Blocks::ScanLines, LineOrder::Increasing),
            (Compression::ZIP16, tiles(4), order),
            (Compression::PIZ, tiles(16), order),
        ] {
            let encoding = Encoding { compression, blocks, line_order };
            write_file(&path, encoding, Vec2(-3, 7), &["x.B", "x.G", "x.R"]);
            let picture = Picture::open(&path, None).expect("a picture");
            assert_eq!((picture.size, picture.position), ([9, 37], [-3, 7]));
            assert_eq!(picture.channel_names, ["x.R", "x.G", "x.B"]);
            for rows in [0..37, 0..1, 15..18, 36..37, 20..20] {
                let lanes = picture.read_rows(rows.clone()).expect("rows");
                let expected = [2, 1, 0].into_iter().flat_map(|channel| {
                    let row = move |y| (0..9).map(move |x| value(channel, x, y as usize));
                    rows.clone().flat_map(row)
                });
                assert!(lanes.into_iter().eq(expected), "{compression:?} {blocks:?} {rows:?}");
            }
        }
    }

    #[test]
    fn windows_within_the_data_window() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.exr");
        let encoding = Encoding {
            compression: Compression::ZIP16,
            blocks: Blocks::ScanLines,
            line_order: LineOrder::Increasing,
        };
        write_file(&path, encoding, Vec2(-3, 7), &["Y"]);
        let picture = Picture::open(&path, None).expect("a picture");
        let part = Window { position: [-1, 20], size: [4, 2] };
        let expected: Vec<_> =
            [13, 14].iter().flat_map(|&y| (2..6).map(move |x| value(0, x, y))).collect();
        assert_eq!(picture.read_window(&part).expect("pixels"), expected);
        let whole = picture.read_window(&picture.window()).expect("pixels");
        assert_eq!(whole, picture.read().expect("pixels"));
    }

    #[test]
    fn damaged_files_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.exr");
        let encoding = Encoding {
            compression: Compression::Uncompressed,
            blocks: Blocks::ScanLines,
            line_order: LineOrder::Increasing,
        };
        write_file(&path, encoding, Vec2(0, 0), &["Y"]);
        let whole = std::fs::read(&path).expect("the file");
        let read = |bytes: &[u8]| {
            std::fs::write(&path, bytes).expect("a file");
            Picture::open(&path, None)?.read()
        };
        assert!(read(&whole).is_ok());
        assert!(read(&whole[..whole.len() - 1]).is_err_and(|e| e.to_string().contains("readable")));
        assert!(read(&whole[..60]).is_err());
        assert!(read(b"P6 1 1 255 abc").is_err());
        // A second entry of the chunk table that names the first row again.
        let row = 8 + 9 * 2;
        let table = whole.len() - 37 * (row + 8);
        let mut doubled = whole.clone();
        doubled.copy_within(table..table + 8, table + 8);
        assert!(read(&doubled).is_err_and(|e| e.to_string().contains("lacks")));
    }

    #[test]
    fn samples_per_pixel_in_any_type() {
        let of = |text: &str, layer: &str| {
            let part = |attributes| Part { attributes, ..Part::of_one_pixel() };
            let blender = ("cycles.View.samples".to_owned(), "32".to_owned());
            let own = ("samplesPerPixel".to_owned(), text.to_owned());
            let own = if text.is_empty() { None } else { Some(own) };
            let header =
                ExrHeader { parts: vec![part([blender].into()), part(own.into_iter().collect())] };
            samples_per_pixel(&header, &Layer { name: layer.into(), part: 1, channels: vec![] })
        };
        let some = |name: &str, value| Some((name.to_owned(), Ok(value)));
        assert_eq!(of("16", ""), some("samplesPerPixel", 16));
        assert_eq!(of("16.0", "View.Combined"), some("samplesPerPixel", 16));
        for bad in ["0", "-1", "1.5", "many", "NaN", "1e99"] {
            let unclear = Err(format!("samplesPerPixel = {bad}"));
            assert_eq!(of(bad, ""), Some(("samplesPerPixel".to_owned(), unclear)), "{bad}");
        }
        // Blender's is in another part than the layer.
        assert_eq!(of("", "View.Combined"), some("cycles.View.samples", 32));
    }
}

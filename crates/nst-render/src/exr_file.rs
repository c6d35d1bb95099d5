//! Single-part scanline EXR files of named f32 channels and attributes.

use std::{collections::BTreeMap, path::Path};

use exr::{
    block::lines::{LineIndex, LineRefMut},
    image::write::samples::{SamplesWriter, WritableSamples},
    math::RoundingMode,
    meta::{attribute::LevelMode, header::Header},
    prelude::*,
};

use crate::{Error, output::OutputFile};

/// The value of an attribute.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Attribute {
    Text(String),
    I32(i32),
    F32(f32),
}

/// Channels `[y][x]` to be written, by name.
pub(crate) type Channels<'a> = BTreeMap<String, &'a [f32]>;

/// Attributes by name.
pub(crate) type Attributes = BTreeMap<String, Attribute>;

/// A channel that the writer reads where it is: a picture may take up most of
/// the memory, and is not copied.
struct Borrowed<'a>(&'a [f32]);

struct BorrowedWriter<'a> {
    samples: &'a [f32],
    width: usize,
}

impl<'a> WritableSamples<'a> for Borrowed<'_> {
    type Writer = BorrowedWriter<'a>;

    fn sample_type(&self) -> SampleType {
        SampleType::F32
    }

    fn infer_level_modes(&self) -> (LevelMode, RoundingMode) {
        (LevelMode::Singular, RoundingMode::Down)
    }

    fn create_samples_writer(&'a self, header: &Header) -> Self::Writer {
        BorrowedWriter { samples: self.0, width: header.layer_size.width() }
    }
}

impl SamplesWriter for BorrowedWriter<'_> {
    fn extract_line(&self, line: LineRefMut<'_>) {
        let LineIndex { position, sample_count, .. } = line.location;
        let first = position.y() * self.width + position.x();
        line.write_samples_from_slice(&self.samples[first..first + sample_count])
            .expect("the line has room for its samples");
    }
}

/// Writes a single-part file, ZIP compressed. The caller commits `output`.
pub(crate) fn write(
    output: &mut OutputFile,
    size: [u32; 2],
    channels: Channels<'_>,
    attributes: Attributes,
) -> std::result::Result<(), Error> {
    let mut layer_attributes = LayerAttributes {
        software_name: Some(Text::from(concat!("nst ", env!("CARGO_PKG_VERSION")))),
        ..Default::default()
    };
    for (name, value) in attributes {
        let value = match value {
            Attribute::Text(text) => AttributeValue::Text(latin1(&text)),
            Attribute::I32(number) => AttributeValue::I32(number),
            Attribute::F32(number) => AttributeValue::F32(number),
        };
        layer_attributes.other.insert(latin1(&name), value);
    }
    let channels = channels
        .into_iter()
        .map(|(name, values)| AnyChannel::new(latin1(&name), Borrowed(values)))
        .collect();
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let size = Vec2(size[0] as usize, size[1] as usize);
    let layer = Layer::new(size, layer_attributes, encoding, AnyChannels::sort(channels));
    Image::from_layer(layer).write().to_buffered(std::io::BufWriter::new(output.file())).map_err(
        |error| match error {
            exr::error::Error::Io(error) => Error::io("write", output.path(), error),
            error => Error::image(output.path(), error.to_string()),
        },
    )
}

/// A file that was read: channels `[y][x]` and attributes by name.
#[derive(Clone, Debug)]
pub(crate) struct ExrFile {
    pub(crate) size: [u32; 2],
    pub(crate) channels: BTreeMap<String, Vec<f32>>,
    pub(crate) attributes: Attributes,
}

impl ExrFile {
    /// Reads the first part of an EXR file; f16 and u32 channels become f32.
    pub(crate) fn read(path: &Path) -> std::result::Result<Self, Error> {
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_file(path)
            .map_err(|error| match error {
                exr::error::Error::Io(error) => Error::io("read", path, error),
                error => Error::image(path, format!("not a readable EXR file: {error}")),
            })?;
        let layer = image.layer_data;
        let size = u32::try_from(layer.size.x()).ok().zip(u32::try_from(layer.size.y()).ok());
        let (width, height) = size.ok_or_else(|| Error::image(path, "it is too large"))?;
        let channels = layer
            .channel_data
            .list
            .into_iter()
            .map(|channel| {
                let values = match channel.sample_data {
                    FlatSamples::F32(values) => values,
                    other => other.values_as_f32().collect(),
                };
                (channel.name.to_string(), values)
            })
            .collect();
        let attributes = layer
            .attributes
            .other
            .into_iter()
            .filter_map(|(name, value)| {
                let value = match value {
                    AttributeValue::Text(text) => Attribute::Text(text.to_string()),
                    AttributeValue::I32(number) => Attribute::I32(number),
                    AttributeValue::F32(number) => Attribute::F32(number),
                    _ => return None,
                };
                Some((name.to_string(), value))
            })
            .collect();
        Ok(Self { size: [width, height], channels, attributes })
    }

    /// A channel by name, or an error that names it.
    pub(crate) fn take(&mut self, path: &Path, name: &str) -> std::result::Result<Vec<f32>, Error> {
        self.channels
            .remove(name)
            .ok_or_else(|| Error::image(path, format!("channel '{name}' is missing")))
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

//! Pictures: EXR with layers, PNG for the screen, and reading either back.

use std::{io::Write, path::Path};

use exr::prelude::SampleType;
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use crate::{
    Error,
    exr_file::ExrFile,
    exr_rows::{Attributes, Channel, RowWriter},
    output::OutputFile,
};

const RGB: [&str; 3] = ["R", "G", "B"];

/// The channels of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorModel {
    /// One channel, Y.
    Mono,
    /// R, G and B in linear sRGB primaries.
    Rgb,
}

impl ColorModel {
    /// The channels' names, in the order of planar lanes.
    #[must_use]
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Mono => &["Y"],
            Self::Rgb => &RGB,
        }
    }
}

/// The name of a layer's channel, `S.R` for instance; the main picture has no prefix.
pub(crate) fn channel_name(layer: &str, channel: &str) -> String {
    if layer.is_empty() { channel.to_owned() } else { format!("{layer}.{channel}") }
}

/// The f32 channels of some layers, layer by layer.
pub(crate) fn layer_channels<'a>(
    model: ColorModel,
    layers: impl IntoIterator<Item = &'a str>,
) -> Vec<Channel> {
    let channels = |layer: &'a str| {
        model.channels().iter().map(move |channel| (channel_name(layer, channel), SampleType::F32))
    };
    layers.into_iter().flat_map(channels).collect()
}

/// Takes a layer out of a file, as planar lanes.
pub(crate) fn take_layer(file: &mut ExrFile, path: &Path, layer: &str) -> Result<Vec<f32>, Error> {
    let mut lanes = Vec::new();
    for channel in RGB {
        lanes.extend(file.take(path, &channel_name(layer, channel))?);
    }
    Ok(lanes)
}

/// Writes an EXR picture row by row.
pub struct PictureWriter<'a> {
    rows: RowWriter<'a>,
    model: ColorModel,
}

impl<'a> PictureWriter<'a> {
    /// Begins a picture whose main channels have no prefix, with further named layers.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn create(
        output: &'a mut OutputFile,
        size: [u32; 2],
        model: ColorModel,
        layers: &[&str],
    ) -> Result<Self, Error> {
        let channels = layer_channels(model, [""].into_iter().chain(layers.iter().copied()));
        Ok(Self { rows: RowWriter::create(output, size, &channels, Attributes::new())?, model })
    }

    /// Appends rows: the main picture and then each layer, all planar lanes. All
    /// but the last rows of a picture come in multiples of 16.
    ///
    /// # Errors
    /// [`Error::Io`] if they cannot be written.
    pub fn push(&mut self, layers: &[&[f32]]) -> Result<(), Error> {
        let channels = self.model.channels().len();
        let planes: Vec<&[u8]> = layers
            .iter()
            .flat_map(|lanes| lanes.chunks_exact(lanes.len() / channels))
            .map(bytemuck::cast_slice)
            .collect();
        self.rows.push(&planes)
    }

    /// Completes the file, whose rows must all be there. The caller commits the output.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn finish(self) -> Result<(), Error> {
        self.rows.finish()
    }
}

/// Writes an EXR picture: `rgb` in the channels R, G, B, and further named
/// layers, all planar lanes in linear sRGB.
///
/// # Errors
/// [`Error::Io`] if it cannot be written.
pub fn write_exr(
    output: &mut OutputFile,
    size: [u32; 2],
    rgb: &[f32],
    layers: &[(&str, &[f32])],
) -> Result<(), Error> {
    let names: Vec<&str> = layers.iter().map(|&(name, _)| name).collect();
    let mut writer = PictureWriter::create(output, size, ColorModel::Rgb, &names)?;
    let lanes: Vec<&[f32]> = [rgb].into_iter().chain(layers.iter().map(|&(_, l)| l)).collect();
    writer.push(&lanes)?;
    writer.finish()
}

/// Writes an 8-bit PNG: planar linear lanes, clamped to [0, 1] and encoded by the
/// sRGB transfer function (IEC 61966-2-1).
///
/// # Errors
/// [`Error::Io`] or [`Error::Image`] if it cannot be written.
pub fn write_png(output: &mut OutputFile, size: [u32; 2], rgb: &[f32]) -> Result<(), Error> {
    let pixels = rgb.len() / RGB.len();
    let bytes: Vec<u8> = (0..pixels)
        .flat_map(|i| [0, 1, 2].map(|channel| srgb_byte(rgb[channel * pixels + i])))
        .collect();
    write_rgb8(output, size, &bytes)
}

/// Writes a PNG of bytes `[y][x][channel]`, as they are.
pub(crate) fn write_rgb8(
    output: &mut OutputFile,
    size: [u32; 2],
    bytes: &[u8],
) -> Result<(), Error> {
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(bytes, size[0], size[1], ExtendedColorType::Rgb8)
        .map_err(|error| Error::image(output.path(), error.to_string()))?;
    output.file().write_all(&png).map_err(|error| Error::io("write", output.path(), error))
}

/// Reads a layer of an EXR picture as planar lanes, with the picture's size.
///
/// # Errors
/// [`Error::Io`] or [`Error::Image`] names the file and what is missing.
pub fn read_exr_layer(path: &Path, layer: &str) -> Result<([u32; 2], Vec<f32>), Error> {
    let mut file = ExrFile::read(path)?;
    Ok((file.size, take_layer(&mut file, path, layer)?))
}

fn srgb_byte(linear: f32) -> u8 {
    let x = linear.clamp(0.0, 1.0);
    let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    // A NaN, which clamp lets through, becomes 0 here.
    (encoded * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_encodes_known_values() {
        let known = [(0.0, 0), (1.0, 255), (0.5, 188), (0.215_861, 128), (-1.0, 0), (f32::NAN, 0)];
        for (linear, byte) in known {
            assert_eq!(srgb_byte(linear), byte, "{linear}");
        }
    }
}

//! Pictures: EXR with layers, PNG for the screen, and reading either back.

use std::path::Path;

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use crate::{
    Error,
    exr_file::{self, Attributes, Channels, ExrFile},
    output::OutputFile,
};

const RGB: [&str; 3] = ["R", "G", "B"];

/// The channels of a layer, `S.R` for instance; the main picture has no prefix.
fn channel_name(layer: &str, channel: &str) -> String {
    if layer.is_empty() { channel.to_owned() } else { format!("{layer}.{channel}") }
}

/// Adds a layer of planar lanes to the channels of a file.
pub(crate) fn insert_layer<'a>(channels: &mut Channels<'a>, layer: &str, lanes: &'a [f32]) {
    for (channel, values) in RGB.iter().zip(lanes.chunks_exact(lanes.len() / RGB.len())) {
        channels.insert(channel_name(layer, channel), values);
    }
}

/// Takes a layer out of a file, as planar lanes.
pub(crate) fn take_layer(file: &mut ExrFile, path: &Path, layer: &str) -> Result<Vec<f32>, Error> {
    let mut lanes = Vec::new();
    for channel in RGB {
        lanes.extend(file.take(path, &channel_name(layer, channel))?);
    }
    Ok(lanes)
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
    let mut channels = Channels::new();
    insert_layer(&mut channels, "", rgb);
    for (name, lanes) in layers {
        insert_layer(&mut channels, name, lanes);
    }
    exr_file::write(output, size, channels, Attributes::new())
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
    PngEncoder::new(std::io::BufWriter::new(output.file()))
        .write_image(bytes, size[0], size[1], ExtendedColorType::Rgb8)
        .map_err(|error| match error {
            image::ImageError::IoError(error) => Error::io("write", output.path(), error),
            error => Error::image(output.path(), error.to_string()),
        })
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

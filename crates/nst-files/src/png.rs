//! PNG pictures for the screen.

use std::{
    fs::File,
    io::{BufReader, Write},
    path::Path,
};

use ::png::{Encoder, EncodingError, StreamWriter};

use crate::{
    Error,
    output_file::{OutputFile, SOFTWARE},
};

/// The first bytes of every PNG file (PNG specification, section 5.2).
pub(crate) const SIGNATURE: [u8; 8] = *b"\x89PNG\r\n\x1a\n";

/// Writes an 8-bit PNG: planar linear lanes R, G and B, clamped to [0, 1] and encoded by
/// the sRGB transfer function (IEC 61966-2-1).
///
/// # Errors
/// [`Error::Io`] or [`Error::Malformed`] if it cannot be written.
pub fn write(output: &mut OutputFile, size: [u32; 2], rgb: &[f32]) -> Result<(), Error> {
    let mut writer = PngWriter::create(output, size)?;
    writer.push(rgb, 3)?;
    writer.finish()
}

/// Writes a PNG of bytes `[y][x][channel]` with three channels, as they are. Its metadata name
/// `nst` as the program that wrote it.
///
/// # Errors
/// [`Error::Io`] or [`Error::Malformed`] if it cannot be written.
pub fn write_rgb8(output: &mut OutputFile, size: [u32; 2], bytes: &[u8]) -> Result<(), Error> {
    let mut writer = PngWriter::create(output, size)?;
    writer.push_bytes(bytes)?;
    writer.finish()
}

/// An 8-bit PNG that is written strip by strip.
pub struct PngWriter<'a> {
    output: &'a OutputFile,
    stream: StreamWriter<'static, File>,
}

impl<'a> PngWriter<'a> {
    /// Writes the header.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Malformed`] if it cannot be written.
    pub fn create(output: &'a mut OutputFile, size: [u32; 2]) -> Result<Self, Error> {
        let file = output.file().try_clone();
        let output = &*output;
        let file = file.map_err(|error| Error::io("write", output.path(), error))?;
        let mut png = Encoder::new(file, size[0], size[1]);
        png.set_color(::png::ColorType::Rgb);
        png.set_source_srgb(::png::SrgbRenderingIntent::Perceptual);
        let stream = png
            .add_text_chunk("Software".into(), SOFTWARE.into())
            .and_then(|()| png.write_header())
            .and_then(|png| png.into_stream_writer());
        match stream {
            Ok(stream) => Ok(Self { output, stream }),
            Err(error) => Err(failed(output.path(), error)),
        }
    }

    /// Writes whole rows: planar linear lanes of three channels, or of one that is grey, clamped to
    /// [0, 1] and encoded by the sRGB transfer function (IEC 61966-2-1).
    ///
    /// # Errors
    /// [`Error::Io`] if they cannot be written.
    pub fn push(&mut self, lanes: &[f32], channels: usize) -> Result<(), Error> {
        let pixels = lanes.len() / channels;
        let lane = |channel: usize, i: usize| lanes[channel.min(channels - 1) * pixels + i];
        let bytes: Vec<u8> = (0..pixels)
            .flat_map(|i| [0, 1, 2].map(|channel| srgb_byte(lane(channel, i))))
            .collect();
        self.push_bytes(&bytes)
    }

    fn push_bytes(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.stream.write_all(bytes).map_err(|error| Error::io("write", self.output.path(), error))
    }

    /// Writes the end.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Malformed`] if it cannot be written, or rows are missing.
    pub fn finish(self) -> Result<(), Error> {
        self.stream.finish().map_err(|error| failed(self.output.path(), error))
    }
}

fn failed(path: &Path, error: EncodingError) -> Error {
    match error {
        EncodingError::IoError(error) => Error::io("write", path, error),
        error => Error::malformed(path, error.to_string()),
    }
}

/// Which program wrote a PNG file, if the file says so before its pixels.
pub(crate) fn software(path: &Path) -> Option<String> {
    let file = BufReader::new(File::open(path).ok()?);
    let reader = ::png::Decoder::new(file).read_info().ok()?;
    let texts = &reader.info().uncompressed_latin1_text;
    texts.iter().find(|text| text.keyword == "Software").map(|text| text.text.clone())
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

    #[test]
    fn pixels_are_rows_from_the_top_and_the_writer_is_named() -> Result<(), Error> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.png");
        let mut output = OutputFile::create(&path)?;
        write(&mut output, [2, 1], &[1.0, 0.0, 0.5, 0.0, 0.0, 1.0])?;
        output.commit()?;
        let decoder = ::png::Decoder::new(BufReader::new(File::open(&path).expect("the file")));
        let mut reader = decoder.read_info().expect("a PNG file");
        let mut bytes = [0; 6];
        reader.next_frame(&mut bytes).expect("its pixels");
        assert_eq!(bytes, [255, 188, 0, 0, 0, 255]);
        assert_eq!(software(&path).as_deref(), Some(SOFTWARE));
        Ok(())
    }
}

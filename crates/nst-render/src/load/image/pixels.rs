//! Images of the formats that photographs and drawings have.

use std::{io::Cursor, path::Path};

use image::{ColorType, DynamicImage, ImageReader, Limits};

use super::{Pixels, Purpose};
use crate::{Error, load::exact::srgb_to_linear};

/// What a message says can be read.
const SUPPORTED: &str =
    "PNG, JPEG, TGA, BMP, WebP, GIF, TIFF, Radiance's HDR (which starts with '#?') and EXR";

/// PNG, JPEG, TGA, BMP, WebP, GIF (of an animation, the first picture) or TIFF. 8 and 16
/// bits are sRGB where colours are wanted, floats are linear.
pub(super) fn read(
    path: &Path,
    bytes: &[u8],
    most_bytes: u64,
    purpose: Purpose,
) -> Result<Pixels, Error> {
    let image = decode(path, bytes, most_bytes)?;
    let size = [image.width(), image.height()];
    let alpha = (purpose == Purpose::Numbers && image.color().has_alpha())
        .then(|| image.to_rgba32f().pixels().map(|pixel| pixel.0[3]).collect());
    let deep = matches!(
        image.color(),
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16
    );
    let floats = matches!(image.color(), ColorType::Rgb32F | ColorType::Rgba32F);
    let texels = match purpose {
        Purpose::Colors if deep => linear_16(image),
        Purpose::Colors if !floats => linear_8(image),
        _ => image.into_rgb32f().pixels().map(|pixel| pixel.0).collect(),
    };
    Ok(Pixels { size, texels, alpha, is_linear: floats })
}

fn decode(path: &Path, bytes: &[u8], most_bytes: u64) -> Result<DynamicImage, Error> {
    let malformed = |error: image::ImageError| match error {
        image::ImageError::IoError(error) => Error::io(path, error),
        image::ImageError::Unsupported(_) => {
            Error::image(path, format!("{error}; {SUPPORTED} are supported"))
        }
        error => Error::image(path, format!("not a readable image: {error}")),
    };
    let mut reader = ImageReader::new(Cursor::new(bytes));
    // The name's ending counts where the bytes do not tell, as in TGA files.
    if let Ok(format) = image::ImageFormat::from_path(path) {
        reader.set_format(format);
    }
    let mut reader = reader.with_guessed_format().map_err(|error| Error::io(path, error))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(most_bytes);
    reader.limits(limits);
    reader.decode().map_err(malformed)
}

fn linear_8(image: DynamicImage) -> Vec<[f32; 3]> {
    let linear: [f32; 256] = std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0));
    image.into_rgb8().pixels().map(|pixel| pixel.0.map(|x| linear[usize::from(x)])).collect()
}

fn linear_16(image: DynamicImage) -> Vec<[f32; 3]> {
    let linear = |x| srgb_to_linear(f32::from(x) / 65535.0);
    image.into_rgb16().pixels().map(|pixel| pixel.0.map(linear)).collect()
}

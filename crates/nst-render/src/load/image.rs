//! Textures from image files.

use std::{
    collections::HashMap,
    io::Cursor,
    path::{Path, PathBuf},
    sync::Arc,
};

use image::{ColorType, DynamicImage, ImageReader, Limits};

use nst_files::picture::Picture;

use super::{ranges::RADIANCE, report::Report};
use crate::{Error, Texture};

/// The most memory that one image may take: 2 GiB, some 13,000 by 13,000 pixels of RGB in f32.
const MOST_BYTES: u64 = 1 << 31;
/// The most that a byte of a file may decode to: formats compress one colour to
/// some thousandth. A header that promises more is malformed.
const MOST_BYTES_PER_BYTE: u64 = 1 << 16;

/// The images of a scene; each file is read once.
#[derive(Default)]
pub(super) struct Images {
    loaded: HashMap<PathBuf, Arc<Texture>>,
    /// Those of `loaded` that had texels above 1, limited to 1.
    limited: HashMap<PathBuf, Arc<Texture>>,
    /// Those whose numbers are something else than colours in the usual form; and what.
    pub(super) maps: HashMap<(PathBuf, String), Arc<Texture>>,
}

impl Images {
    /// An image of radiance: texels are finite and not negative.
    pub(super) fn radiance(
        &mut self,
        path: &Path,
        report: &mut Report,
    ) -> Result<Arc<Texture>, Error> {
        if let Some(texture) = self.loaded.get(path) {
            return Ok(texture.clone());
        }
        let texture = Arc::new(read(path, report)?);
        self.loaded.insert(path.to_owned(), texture.clone());
        Ok(texture)
    }

    /// An image of reflectance: texels are within 0 and 1.
    pub(super) fn reflectance(
        &mut self,
        path: &Path,
        report: &mut Report,
    ) -> Result<Arc<Texture>, Error> {
        if let Some(texture) = self.limited.get(path) {
            return Ok(texture.clone());
        }
        let texture = self.radiance(path, report)?;
        if texture.texels().iter().flatten().all(|&x| x <= 1.0) {
            return Ok(texture);
        }
        report.note(format!("texels of '{}' limited to 1", path.display()));
        let limited = Arc::new(texture.limited());
        self.limited.insert(path.to_owned(), limited.clone());
        Ok(limited)
    }
}

fn read(path: &Path, report: &mut Report) -> Result<Texture, Error> {
    let bytes = report.read(path)?;
    let is_exr = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"));
    let (size, texels) =
        if is_exr { read_exr(path, &bytes, report)? } else { read_srgb(path, &bytes)? };
    let no_pixels = || Error::image(path, "it has no pixels");
    Texture::of_file(size, texels, &bytes).ok_or_else(no_pixels)
}

/// The most memory that an image of these bytes may take.
fn most_bytes(bytes: &[u8]) -> u64 {
    MOST_BYTES.min((bytes.len() as u64).saturating_mul(MOST_BYTES_PER_BYTE))
}

/// Width and height, and the texels from the top.
pub(super) type Pixels = ([u32; 2], Vec<[f32; 3]>);

/// PNG, JPEG, TGA or BMP: 8 or 16 bits, sRGB. Alpha is left out.
fn read_srgb(path: &Path, bytes: &[u8]) -> Result<Pixels, Error> {
    let image = decode(path, bytes)?;
    let size = [image.width(), image.height()];
    let deep = matches!(
        image.color(),
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16
    );
    Ok((size, if deep { decode_16(image) } else { decode_8(image) }))
}

/// PNG, JPEG, TGA or BMP.
pub(super) fn decode(path: &Path, bytes: &[u8]) -> Result<DynamicImage, Error> {
    let malformed = |error: image::ImageError| match error {
        image::ImageError::IoError(error) => Error::io(path, error),
        image::ImageError::Unsupported(_) => {
            Error::image(path, format!("{error}; PNG, JPEG, TGA, BMP and EXR are supported"))
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
    limits.max_alloc = Some(most_bytes(bytes));
    reader.limits(limits);
    reader.decode().map_err(malformed)
}

fn decode_8(image: DynamicImage) -> Vec<[f32; 3]> {
    let linear: [f32; 256] = std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0));
    image.into_rgb8().pixels().map(|pixel| pixel.0.map(|x| linear[usize::from(x)])).collect()
}

fn decode_16(image: DynamicImage) -> Vec<[f32; 3]> {
    let linear = |x| srgb_to_linear(f32::from(x) / 65535.0);
    image.into_rgb16().pixels().map(|pixel| pixel.0.map(linear)).collect()
}

/// IEC 61966-2-1.
pub(super) fn srgb_to_linear(x: f32) -> f32 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// The channels R, G and B, or Y, as they are.
pub(super) fn read_exr(path: &Path, bytes: &[u8], report: &mut Report) -> Result<Pixels, Error> {
    let picture = Picture::open(path, None)?;
    let [width, height] = picture.size.map(u64::from);
    if width * height * (size_of::<f32>() * picture.channel_names.len()) as u64 > most_bytes(bytes)
    {
        let message = format!(
            "{width} by {height} pixels are too many, for this program or for the file's length"
        );
        return Err(Error::image(path, message));
    }
    let lanes = picture.read()?;
    let pixels = (width * height) as usize;
    let channel = |channel: usize| &lanes[channel * pixels..][..pixels];
    // One channel is grey.
    let [r, g, b] = if lanes.len() == pixels { [0; 3] } else { [0, 1, 2] }.map(channel);
    let mut negative = 0_usize;
    let mut texels = Vec::with_capacity(r.len());
    for ((&r, &g), &b) in r.iter().zip(g).zip(b) {
        let texel = [r, g, b];
        if !texel.iter().all(|x| x.is_finite() && x <= RADIANCE.end()) {
            let (i, width) = (texels.len(), width as usize);
            let message = format!(
                "the pixel at column {}, row {} is not finite or beyond 1e15",
                i % width,
                i / width
            );
            return Err(Error::image(path, message));
        }
        negative += usize::from(texel.iter().any(|&x| x < 0.0));
        texels.push(texel.map(|x| x.max(0.0)));
    }
    if negative > 0 {
        report.note(format!("negative texels of '{}', set to 0: {negative}", path.display()));
    }
    Ok((picture.size, texels))
}

#[cfg(test)]
mod tests {
    use exr::prelude::write_rgb_file;

    use super::*;

    fn folder() -> tempfile::TempDir {
        tempfile::tempdir().expect("a folder")
    }

    /// Values of the standard's own formula, in f64.
    #[test]
    fn srgb_is_decoded_in_8_and_16_bits() {
        let folder = folder();
        let close = |a: f32, b: f64| assert!((f64::from(a) - b).abs() < 1e-6, "{a} is not {b}");
        for name in ["x.png", "x.bmp", "x.tga"] {
            let path = folder.path().join(name);
            image::RgbImage::from_pixel(2, 1, image::Rgb([0, 128, 255])).save(&path).expect(name);
            let texture = Images::default().radiance(&path, &mut Report::default()).expect(name);
            assert_eq!(texture.size(), [2, 1]);
            let [r, g, b] = texture.texels()[1];
            close(r, 0.0);
            close(g, 0.215_860_500);
            close(b, 1.0);
        }
        let path = folder.path().join("deep.png");
        let pixel = image::Rgb([655_u16, 32896, 65535]);
        image::ImageBuffer::from_pixel(1, 1, pixel).save(&path).expect("a PNG file");
        let texture = Images::default().radiance(&path, &mut Report::default()).expect("a texture");
        let [r, g, _] = texture.texels()[0];
        close(r, 655.0 / 65535.0 / 12.92);
        close(g, 0.215_860_500);
        // JPEG is lossy: one level of 255 is 0.01 here.
        let path = folder.path().join("x.jpg");
        image::RgbImage::from_pixel(8, 8, image::Rgb([128; 3])).save(&path).expect("a JPEG file");
        let texture = Images::default().radiance(&path, &mut Report::default()).expect("a texture");
        assert!((texture.texels()[9][0] - 0.216).abs() < 0.01);
        let grey = folder.path().join("grey.png");
        image::GrayImage::from_pixel(1, 1, image::Luma([255])).save(&grey).expect("a PNG file");
        let texture = Images::default().radiance(&grey, &mut Report::default()).expect("a texture");
        assert_eq!(texture.texels(), [[1.0; 3]]);
    }

    #[test]
    fn exr_is_linear_and_limited_where_it_reflects() {
        let folder = folder();
        let path = folder.path().join("x.exr");
        write_rgb_file(&path, 2, 1, |x, _| (2.5_f32, -1.0_f32, x as f32)).expect("an EXR file");
        let (mut images, mut report) = (Images::default(), Report::default());
        let radiance = images.radiance(&path, &mut report).expect("a texture");
        assert_eq!(radiance.texels(), [[2.5, 0.0, 0.0], [2.5, 0.0, 1.0]]);
        assert!(report.notes()[0].ends_with("x.exr', set to 0: 2"), "{:?}", report.notes());
        let reflectance = images.reflectance(&path, &mut report).expect("a texture");
        assert_eq!(reflectance.texels(), [[1.0, 0.0, 0.0], [1.0, 0.0, 1.0]]);
        let again = images.reflectance(&path, &mut report).expect("a texture");
        assert!(Arc::ptr_eq(&reflectance, &again));
        assert!(Arc::ptr_eq(&radiance, &images.radiance(&path, &mut report).expect("a texture")));
        assert_eq!((report.notes().len(), report.inputs), (2, vec![path]));
    }

    #[test]
    fn malformed_images_are_refused() {
        let folder = folder();
        let message = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).expect("a file");
            let error = Images::default()
                .radiance(&path, &mut Report::default())
                .expect_err(name)
                .to_string();
            assert!(error.contains(name), "{error}");
            error
        };
        message("text.png", b"no image");
        message("empty.png", b"");
        message("empty.exr", b"");
        assert!(message("photo.webp", b"RIFF....WEBPVP8 ").contains("PNG, JPEG"));
        let path = folder.path().join("whole.exr");
        let nan = |x, _| if x == 1 { (f32::NAN, 0.0, 0.0) } else { (0.0_f32, 0.0_f32, 0.0_f32) };
        write_rgb_file(&path, 4, 4, nan).expect("an EXR file");
        let whole = std::fs::read(&path).expect("the file");
        assert!(message("nan.exr", &whole).contains("column 1, row 0"));
        message("cut.exr", &whole[..whole.len() / 2]);
        // A data window of 2³⁰ by 2³⁰ pixels.
        let key = b"dataWindow\0box2i\0";
        let at = whole.windows(key.len()).position(|part| part == key).expect("a data window");
        let mut huge = whole;
        let corner = (1_i32 << 30).to_le_bytes();
        huge[at + key.len() + 12..][..8].copy_from_slice(&[corner, corner].concat());
        message("huge.exr", &huge);
        // A TGA header of 65535 by 65535 pixels, and nothing else.
        let mut tga = [0; 18];
        (tga[2], tga[16]) = (2, 24);
        tga[12..16].fill(255);
        message("huge.tga", &tga);
    }
}

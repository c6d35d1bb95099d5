//! Textures from image files.

mod openexr;
mod pixels;
mod rgbe;

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use nst_files::header::is_exr;

use super::{ranges::RADIANCE, report::Report};
use crate::{Error, Texture};

/// The most memory that one image may take: 2 GiB, some 13,000 by 13,000 pixels of RGB in f32.
const MOST_BYTES: u64 = 1 << 31;
/// The most that a byte of a file may decode to: formats compress one colour to
/// some thousandth. A header that promises more is malformed.
const MOST_BYTES_PER_BYTE: u64 = 1 << 16;
/// What an infinite texel becomes where no other is above 0: the largest number of f16, as
/// infinities in images come from numbers too large for f16.
const LARGEST_HALF: f32 = 65504.0;

/// How the numbers of a file are to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Purpose {
    /// As linear colours.
    Colors,
    /// As they are, with alpha; those of 8 and 16 bits become 0 to 1.
    Numbers,
}

/// What a file contains.
struct Pixels {
    /// Width and height.
    size: [u32; 2],
    /// Rows from the top.
    texels: Vec<[f32; 3]>,
    /// If it was asked for and is there.
    alpha: Option<Vec<f32>>,
    /// Whether the numbers of the file are linear colours; else sRGB.
    is_linear: bool,
}

/// The numbers of an image file, without decoding.
pub(super) struct Numbers {
    /// Width and height.
    pub(super) size: [u32; 2],
    /// Finite; rows from the top.
    pub(super) texels: Vec<[f32; 3]>,
    pub(super) alpha: Option<Vec<f32>>,
    /// Whether they would be linear colours; else sRGB.
    pub(super) is_linear: bool,
    /// The file.
    pub(super) bytes: Vec<u8>,
}

/// The images of a scene, by file and by what is made of it: each is made once.
#[derive(Default)]
pub(super) struct Images {
    made: HashMap<(PathBuf, String), Arc<Texture>>,
}

impl Images {
    /// An image of radiance: texels are finite and not negative.
    pub(super) fn radiance(
        &mut self,
        path: &Path,
        report: &mut Report,
    ) -> Result<Arc<Texture>, Error> {
        self.once(path, "radiance", || {
            let (Pixels { size, mut texels, .. }, bytes) = read(path, Purpose::Colors, report)?;
            tidy(path, size, &mut texels, Purpose::Colors, report)?;
            Texture::of_file(size, texels, &bytes).ok_or_else(|| no_pixels(path))
        })
    }

    /// An image of reflectance: texels are within 0 and 1.
    pub(super) fn reflectance(
        &mut self,
        path: &Path,
        report: &mut Report,
    ) -> Result<Arc<Texture>, Error> {
        let radiance = self.radiance(path, report)?;
        if radiance.texels().iter().flatten().all(|&x| x <= 1.0) {
            return Ok(radiance);
        }
        self.once(path, "reflectance", || {
            report.note(format!("texels of '{}' limited to 1", path.display()));
            Ok(radiance.limited())
        })
    }

    /// What is made of a file; by `make` the first time, and named by `what`.
    pub(super) fn once(
        &mut self,
        path: &Path,
        what: &str,
        make: impl FnOnce() -> Result<Texture, Error>,
    ) -> Result<Arc<Texture>, Error> {
        let key = (path.to_owned(), what.to_owned());
        if let Some(texture) = self.made.get(&key) {
            return Ok(texture.clone());
        }
        let texture = Arc::new(make()?);
        self.made.insert(key, texture.clone());
        Ok(texture)
    }
}

/// The numbers of a file that are no colours, as normals are, or not in the usual form.
pub(super) fn numbers(path: &Path, report: &mut Report) -> Result<Numbers, Error> {
    let (pixels, bytes) = read(path, Purpose::Numbers, report)?;
    let Pixels { size, mut texels, alpha, is_linear } = pixels;
    tidy(path, size, &mut texels, Purpose::Numbers, report)?;
    Ok(Numbers { size, texels, alpha, is_linear, bytes })
}

pub(super) fn no_pixels(path: &Path) -> Error {
    Error::image(path, "it has no pixels")
}

/// The pixels of a file, and its bytes.
fn read(path: &Path, purpose: Purpose, report: &mut Report) -> Result<(Pixels, Vec<u8>), Error> {
    let bytes = report.read(path)?;
    let most = MOST_BYTES.min((bytes.len() as u64).saturating_mul(MOST_BYTES_PER_BYTE));
    let ends_in_exr = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("exr"));
    // What a file starts with counts more than its name.
    let pixels = if rgbe::is_radiance(&bytes) {
        rgbe::read(path, &bytes, most, report)?
    } else if ends_in_exr || is_exr(path)? {
        openexr::read(path, most, purpose, report)?
    } else {
        pixels::read(path, &bytes, most, purpose)?
    };
    Ok((pixels, bytes))
}

/// Whether a number is of a kind that no image should have.
type IsFault = fn(f32) -> bool;

/// Makes all texels finite numbers; of colours, not negative ones.
fn tidy(
    path: &Path,
    size: [u32; 2],
    texels: &mut [[f32; 3]],
    purpose: Purpose,
    report: &mut Report,
) -> Result<(), Error> {
    let most = *RADIANCE.end();
    let least = if purpose == Purpose::Colors { 0.0 } else { -most };
    if texels.iter().flatten().all(|x| (least..=most).contains(x)) {
        return Ok(());
    }
    let finite = texels.iter().flatten().filter(|x| x.is_finite());
    let largest = finite.fold(0.0_f32, |largest, x| largest.max(x.abs())).min(most);
    let largest = if largest > 0.0 { largest } else { LARGEST_HALF.min(most) };
    let kinds: [(&str, IsFault); 3] = [
        ("texels that are not a number, set to 0", f32::is_nan),
        ("infinite texels, set to the largest number of their image", f32::is_infinite),
        ("texels beyond 1e15, set to it", |x| x.is_finite() && x.abs() > *RADIANCE.end()),
    ];
    for (kind, is_fault) in kinds {
        let faulty = |texel: &[f32; 3]| texel.iter().any(|&x| is_fault(x));
        let count = texels.iter().filter(|texel| faulty(texel)).count();
        let fault = || {
            let first = texels.iter().position(faulty).unwrap_or_default();
            let (row, column) = (first / size[0] as usize, first % size[0] as usize);
            format!("the pixel at column {column}, row {row} is {:?}", texels[first])
        };
        report.forgive_texels(kind, path, count, fault)?;
    }
    if purpose == Purpose::Colors {
        let negative = texels.iter().filter(|texel| texel.iter().any(|&x| x < 0.0)).count();
        if negative > 0 {
            report.note(format!("negative texels of '{}', set to 0: {negative}", path.display()));
        }
    }
    for x in texels.iter_mut().flatten() {
        *x = match *x {
            x if x.is_nan() => 0.0,
            x if x.is_infinite() => largest.copysign(x).max(least),
            x => x.clamp(least, most),
        };
    }
    Ok(())
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
        // GIF has 256 colours, of which it finds these.
        for name in ["x.png", "x.bmp", "x.tga", "x.webp", "x.tiff", "x.gif"] {
            let path = folder.path().join(name);
            let image = image::RgbImage::from_pixel(2, 1, image::Rgb([0, 128, 255]));
            let image = image::DynamicImage::from(image);
            let image = if name == "x.gif" { image.into_rgba8().into() } else { image };
            image.save(&path).expect(name);
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
        let floats = folder.path().join("floats.tif");
        let pixel = image::Rgb([-0.5, 0.5, 7.0_f32]);
        image::Rgb32FImage::from_pixel(1, 1, pixel).save(&floats).expect("a TIFF file");
        let texture = Images::default().radiance(&floats, &mut Report::default());
        assert_eq!(texture.expect("a texture").texels(), [[0.0, 0.5, 7.0]]);
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

    /// What is no finite number becomes one, with a note of each kind for all images.
    #[test]
    fn texels_become_finite_numbers() {
        let folder = folder();
        let path = |name: &str| folder.path().join(name);
        const INF: f32 = f32::INFINITY;
        let row = [f32::NAN, -2.0, 3.0, INF, -INF, 1e30];
        write_rgb_file(path("a.exr"), 6, 2, |x, y| (if y == 1 { row[x] } else { 0.5 }, 1.0, 1.0))
            .expect("an EXR file");
        write_rgb_file(path("b.exr"), 1, 1, |_, _| (INF, INF, INF)).expect("an EXR file");
        let (mut images, mut report) = (Images::default(), Report::default());
        let mut red = |name: &str, load: fn(&mut Images, &Path, &mut Report) -> _| {
            let texture: Result<Arc<Texture>, Error> = load(&mut images, &path(name), &mut report);
            texture.expect(name).texels().iter().map(|texel| texel[0]).collect::<Vec<_>>()
        };
        assert_eq!(red("a.exr", Images::radiance)[6..], [0.0, 0.0, 3.0, 1e15, 0.0, 1e15]);
        assert_eq!(red("a.exr", Images::reflectance)[6..], [0.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
        assert_eq!(red("b.exr", Images::radiance), [65504.0]);
        let raw = numbers(&path("a.exr"), &mut report).expect("numbers");
        let raw: Vec<_> = raw.texels[6..].iter().map(|texel| texel[0]).collect();
        assert_eq!(raw, [0.0, -2.0, 3.0, 1e15, -1e15, 1e15]);
        let expected = [
            "texels that are not a number, set to 0: 2 (the first: a.exr, the pixel at column 0, \
             row 1 is [NaN, 1.0, 1.0])",
            "infinite texels, set to the largest number of their image: 5 (the first: a.exr, the \
             pixel at column 3, row 1 is [inf, 1.0, 1.0])",
            "texels beyond 1e15, set to it: 2 (the first: a.exr, the pixel at column 5, row 1 is \
             [1e30, 1.0, 1.0])",
        ];
        let notes = report.notes();
        assert_eq!(notes[..3], expected);
        assert!(notes[3].starts_with("negative texels of ") && notes.len() == 5, "{notes:?}");
        let error = Images::default().radiance(&path("b.exr"), &mut Report::new(true));
        let error = error.expect_err("it is strict").to_string();
        assert!(error.contains("b.exr") && error.contains("column 0, row 0"), "{error}");
    }

    /// Programs write files under other formats' names.
    #[test]
    fn the_first_bytes_count_more_than_the_name() {
        let folder = folder();
        let path = |name: &str| folder.path().join(name);
        write_rgb_file(path("sky.hdr"), 1, 1, |_, _| (7.0_f32, 7.0_f32, 7.0_f32)).expect("a file");
        let radiance = b"#?RGBE\n\n-Y 1 +X 1\n\x07\x07\x07\x88";
        std::fs::write(path("sky.pic"), radiance).expect("a file");
        std::fs::write(path("sky.exr"), radiance).expect("a file");
        image::RgbImage::from_pixel(1, 1, image::Rgb([255; 3]))
            .save(path("a.png"))
            .expect("a file");
        std::fs::rename(path("a.png"), path("a.jpg")).expect("a file");
        let texel = |name: &str| {
            let texture = Images::default().radiance(&path(name), &mut Report::default());
            texture.expect(name).texels()[0]
        };
        assert_eq!(
            ["sky.hdr", "sky.pic", "sky.exr", "a.jpg"].map(texel),
            [7.0, 7.0, 7.0, 1.0].map(|x| [x; 3])
        );
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
        assert!(message("sky.hdr", b"no image").contains("Radiance"));
        message("empty.png", b"");
        message("empty.exr", b"");
        assert!(message("photo.avif", b"\0\0\0\x1cftypavif....").contains("PNG, JPEG"));
        let path = folder.path().join("whole.exr");
        let nan = |x, _| if x == 1 { (f32::NAN, 0.0, 0.0) } else { (0.0_f32, 0.0_f32, 0.0_f32) };
        write_rgb_file(&path, 4, 4, nan).expect("an EXR file");
        let whole = std::fs::read(&path).expect("the file");
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

//! What numbers an image of a material means: colours, opacities, heights or normals.

use std::{path::Path, sync::Arc};

use super::{
    exact::srgb_to_linear,
    image::{Images, Numbers, no_pixels, numbers},
    ranges::{RADIANCE, UNIT},
    report::Report,
};
use crate::{Error, Texture, color::luminance};

/// What an image stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Meaning {
    Reflectance,
    Radiance,
    /// The alpha channel, if any of it is below 1; else how light the colour is.
    Opacity,
    Heights,
    Normals,
}

/// A channel of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Channel {
    Red,
    Green,
    Blue,
    Alpha,
    Luminance,
}

/// How the numbers of an image become values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Values {
    /// Whether colours are linear already; else sRGB, but for EXR files.
    pub(super) linear: bool,
    /// The one to use.
    pub(super) channel: Option<Channel>,
    /// A value is `base` + `gain` · number.
    pub(super) base: f32,
    pub(super) gain: f32,
}

impl Default for Values {
    fn default() -> Self {
        Self { linear: false, channel: None, base: 0.0, gain: 1.0 }
    }
}

impl Images {
    /// The values that an image stands for.
    ///
    /// # Errors
    /// When the file cannot be read as an image.
    pub(super) fn map(
        &mut self,
        path: &Path,
        meaning: Meaning,
        values: Values,
        report: &mut Report,
    ) -> Result<Arc<Texture>, Error> {
        match meaning {
            Meaning::Reflectance if values == Values::default() => {
                return self.reflectance(path, report);
            }
            Meaning::Radiance if values == Values::default() => return self.radiance(path, report),
            _ => {}
        }
        let decoding = format!("{meaning:?} {values:?}");
        self.once(path, &decoding, || {
            let numbers = numbers(path, report)?;
            values.texture(&numbers, meaning, &decoding).ok_or_else(|| no_pixels(path))
        })
    }
}

/// Whether these numbers are a normal map: most normals are near (0, 0, 1), which is light blue.
pub(super) fn are_normals(texture: &Texture) -> bool {
    let mut sums = [0.0; 3];
    for texel in texture.texels() {
        for (sum, &x) in sums.iter_mut().zip(texel) {
            *sum += f64::from(x);
        }
    }
    let [r, g, b] = sums.map(|sum| sum / texture.texels().len() as f64);
    // The mean of unit vectors, most of them within 45° of the surface's normal.
    (r - 0.5).abs() < 0.15 && (g - 0.5).abs() < 0.15 && b > 0.75
}

impl Values {
    /// `None` if there are no pixels.
    fn texture(self, numbers: &Numbers, meaning: Meaning, decoding: &str) -> Option<Texture> {
        let channel = match meaning {
            Meaning::Opacity if is_mask(numbers) => self.channel.or(Some(Channel::Alpha)),
            Meaning::Opacity | Meaning::Heights => self.channel.or(Some(Channel::Luminance)),
            Meaning::Normals => None,
            Meaning::Reflectance | Meaning::Radiance => self.channel,
        };
        let is_color = matches!(meaning, Meaning::Reflectance | Meaning::Radiance);
        let decoded = is_color && !self.linear && !numbers.is_linear;
        let range = match meaning {
            Meaning::Reflectance | Meaning::Opacity => UNIT,
            Meaning::Radiance => RADIANCE,
            Meaning::Heights | Meaning::Normals => -*RADIANCE.end()..=*RADIANCE.end(),
        };
        let value = |x: f32| {
            let x = if decoded { srgb_to_linear(x) } else { x };
            (self.base + self.gain * x).clamp(*range.start(), *range.end())
        };
        let texel = |i: usize| match channel {
            None => numbers.texels[i].map(value),
            Some(channel) => [value(channel.of(numbers, i)); 3],
        };
        let texels = (0..numbers.texels.len()).map(texel).collect();
        Texture::of_decoding(numbers.size, texels, &numbers.bytes, decoding)
    }
}

/// Whether alpha says where an image is opaque. Where it is 1 everywhere, beside greys, they
/// are the mask.
fn is_mask(numbers: &Numbers) -> bool {
    let is_grey = || numbers.texels.iter().all(|[r, g, b]| r == g && g == b);
    let alpha = numbers.alpha.as_ref();
    alpha.is_some_and(|alpha| alpha.iter().any(|&a| a != 1.0) || !is_grey())
}

impl Channel {
    /// Of pixel `i`; without alpha, a pixel is opaque.
    fn of(self, numbers: &Numbers, i: usize) -> f32 {
        let [r, g, b] = numbers.texels[i];
        match self {
            Self::Red => r,
            Self::Green => g,
            Self::Blue => b,
            Self::Alpha => numbers.alpha.as_ref().map_or(1.0, |alpha| alpha[i]),
            // Exact, so that white is no less than 1.
            Self::Luminance if r == g && g == b => r,
            Self::Luminance => luminance([r, g, b].into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_what_they_mean() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.png");
        let pixels = [[255, 0, 128, 51], [255, 255, 255, 255]];
        image::RgbaImage::from_fn(2, 1, |x, _| image::Rgba(pixels[x as usize]))
            .save(&path)
            .expect("an image");
        let mut images = Images::default();
        let mut texel = |meaning, values| {
            let map = images.map(&path, meaning, values, &mut Report::default());
            map.expect("an image").texels()[0]
        };
        let plain = Values::default();
        let half = 128.0 / 255.0;
        let close = |a: [f32; 3], b: [f32; 3]| {
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6), "{a:?}, not {b:?}");
        };
        close(texel(Meaning::Reflectance, plain), [1.0, 0.0, 0.215_860_5]);
        close(texel(Meaning::Reflectance, Values { linear: true, ..plain }), [1.0, 0.0, half]);
        let scaled = Values { base: 0.5, gain: 2.0, ..plain };
        close(texel(Meaning::Reflectance, scaled), [1.0, 0.5, 0.5 + 2.0 * 0.215_860_5]);
        close(texel(Meaning::Radiance, scaled), [2.5, 0.5, 0.5 + 2.0 * 0.215_860_5]);
        close(texel(Meaning::Opacity, plain), [0.2; 3]);
        let red = Values { channel: Some(Channel::Red), ..plain };
        close(texel(Meaning::Opacity, red), [1.0; 3]);
        close(texel(Meaning::Heights, Values { gain: -1.0, ..red }), [-1.0; 3]);
        close(texel(Meaning::Heights, plain), [0.2126 + 0.0722 * half; 3]);
        close(texel(Meaning::Normals, plain), [1.0, 0.0, half]);
    }

    /// Masks as programs write them: in alpha, in greys, or in greys with alpha that says
    /// nothing.
    #[test]
    fn opacity_is_alpha_or_grey() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        let rgba = |name: &str, pixels: [[u8; 4]; 2]| {
            let image = image::RgbaImage::from_vec(2, 1, pixels.concat()).expect("two pixels");
            image.save(path(name)).expect("a file");
        };
        let opacity = |name: &str| {
            let (mut images, mut report) = (Images::default(), Report::default());
            let map = images.map(&path(name), Meaning::Opacity, Values::default(), &mut report);
            map.expect(name).texels().iter().map(|texel| texel[1]).collect::<Vec<_>>()
        };
        rgba("alpha.png", [[255, 0, 0, 255], [9, 9, 9, 51]]);
        assert_eq!(opacity("alpha.png"), [1.0, 0.2]);
        rgba("clear.png", [[9, 9, 9, 0], [9, 9, 9, 0]]);
        assert_eq!(opacity("clear.png"), [0.0, 0.0]);
        rgba("grey.png", [[255, 255, 255, 255], [51, 51, 51, 255]]);
        assert_eq!(opacity("grey.png"), [1.0, 0.2]);
        rgba("wood.png", [[200, 100, 50, 255], [180, 90, 40, 255]]);
        assert_eq!(opacity("wood.png"), [1.0, 1.0]);
        let write = exr::prelude::write_rgba_file;
        write(path("a.exr"), 2, 1, |x, _| (0.5_f32, 0.5_f32, 0.5_f32, x as f32 * 0.25))
            .expect("an EXR file");
        assert_eq!(opacity("a.exr"), [0.0, 0.25]);
    }

    #[test]
    fn light_blue_images_are_normals() {
        let of = |texels: [[f32; 3]; 2]| {
            are_normals(&Texture::new([2, 1], texels.to_vec()).expect("two texels"))
        };
        assert!(of([[0.5, 0.5, 1.0]; 2]) && of([[0.2, 0.5, 0.85], [0.8, 0.4, 0.8]]));
        assert!(!of([[0.5; 3]; 2]) && !of([[1.0; 3]; 2]) && !of([[0.1, 0.3, 0.9]; 2]));
    }
}

//! What numbers an image of a material means: colours, opacities, heights or normals.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use super::{
    image::{Images, decode, read_exr, srgb_to_linear},
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

/// An image as it is in its file.
struct Raw {
    size: [u32; 2],
    /// Red, green, blue and alpha, from the top; in [0, 1] unless the file is an EXR file.
    texels: Vec<[f32; 4]>,
    is_linear: bool,
    /// Names the file.
    bytes: Vec<u8>,
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
        let key: (PathBuf, String) = (path.to_owned(), decoding);
        if let Some(texture) = self.maps.get(&key) {
            return Ok(texture.clone());
        }
        let raw = Raw::read(path, report)?;
        let texture = Arc::new(raw.texture(path, meaning, values, &key.1)?);
        self.maps.insert(key, texture.clone());
        Ok(texture)
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

impl Raw {
    fn read(path: &Path, report: &mut Report) -> Result<Self, Error> {
        let bytes = report.read(path)?;
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr")) {
            let (size, texels) = read_exr(path, &bytes, report)?;
            let texels = texels.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect();
            return Ok(Self { size, texels, is_linear: true, bytes });
        }
        let image = decode(path, &bytes)?;
        let size = [image.width(), image.height()];
        let texels = image.into_rgba32f().pixels().map(|pixel| pixel.0).collect();
        Ok(Self { size, texels, is_linear: false, bytes })
    }

    fn texture(
        &self,
        path: &Path,
        meaning: Meaning,
        values: Values,
        decoding: &str,
    ) -> Result<Texture, Error> {
        let has_alpha = self.texels.iter().any(|texel| texel[3] < 1.0);
        let channel = match meaning {
            Meaning::Opacity if has_alpha => values.channel.or(Some(Channel::Alpha)),
            Meaning::Opacity | Meaning::Heights => values.channel.or(Some(Channel::Luminance)),
            Meaning::Normals => None,
            Meaning::Reflectance | Meaning::Radiance => values.channel,
        };
        let is_color = matches!(meaning, Meaning::Reflectance | Meaning::Radiance);
        let decoded = is_color && !values.linear && !self.is_linear;
        let range = match meaning {
            Meaning::Reflectance | Meaning::Opacity => UNIT,
            Meaning::Radiance => RADIANCE,
            Meaning::Heights | Meaning::Normals => -*RADIANCE.end()..=*RADIANCE.end(),
        };
        let value = |x: f32| {
            let x = if decoded { srgb_to_linear(x) } else { x };
            (values.base + values.gain * x).clamp(*range.start(), *range.end())
        };
        let texel = |texel: &[f32; 4]| match channel {
            None => [texel[0], texel[1], texel[2]].map(value),
            Some(channel) => [value(channel.of(texel)); 3],
        };
        let texels = self.texels.iter().map(texel).collect();
        Texture::of_decoding(self.size, texels, &self.bytes, decoding)
            .ok_or_else(|| Error::image(path, "it has no pixels"))
    }
}

impl Channel {
    fn of(self, &[r, g, b, a]: &[f32; 4]) -> f32 {
        match self {
            Self::Red => r,
            Self::Green => g,
            Self::Blue => b,
            Self::Alpha => a,
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

    #[test]
    fn light_blue_images_are_normals() {
        let of = |texels: [[f32; 3]; 2]| {
            are_normals(&Texture::new([2, 1], texels.to_vec()).expect("two texels"))
        };
        assert!(of([[0.5, 0.5, 1.0]; 2]) && of([[0.2, 0.5, 0.85], [0.8, 0.4, 0.8]]));
        assert!(!of([[0.5; 3]; 2]) && !of([[1.0; 3]; 2]) && !of([[0.1, 0.3, 0.9]; 2]));
    }
}

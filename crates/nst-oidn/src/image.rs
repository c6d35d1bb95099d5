//! What is denoised.

use crate::Error;

/// Values per pixel: red, green, blue, or x, y, z.
pub(crate) const CHANNELS: usize = 3;

/// A picture that is to be denoised, with what else the camera saw. Each layer has three
/// values per pixel side by side, rows from the top: `[row][column][channel]`.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    /// Pixels in a row, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
    /// Linear radiance. Negative values count as 0, and unless [`Self::hdr`], those above 1
    /// as 1.
    pub color: &'a [f32],
    /// The share of light that a surface reflects, 0 to 1; what is outside is clamped.
    pub albedo: Option<&'a [f32]>,
    /// Normals of surfaces, in the world's or the camera's frame, of any length; (0, 0, 0)
    /// where there is no surface. Components are clamped to −1…1. Only beside
    /// [`Self::albedo`].
    pub normal: Option<&'a [f32]>,
    /// Whether colours may be above 1.
    pub hdr: bool,
    /// With [`Self::hdr`], what colours are multiplied by while they are denoised, above 0: a
    /// usual brightness should become about 0.2. Without, it follows from this picture's
    /// brightness, so that parts of a picture are denoised otherwise than the whole.
    pub input_scale: Option<f32>,
    /// Whether albedo and normals are without noise: their edges are then kept as they are.
    /// Without albedo it means nothing.
    pub clean_aux: bool,
}

impl<'a> Image<'a> {
    /// A picture of colours alone, between 0 and 1.
    #[must_use]
    pub fn new(width: usize, height: usize, color: &'a [f32]) -> Self {
        let [albedo, normal] = [None; 2];
        let input_scale = None;
        Self { width, height, color, albedo, normal, hdr: false, input_scale, clean_aux: false }
    }

    /// Compares the layers' sizes, and that of the output, with the image's, and looks for
    /// values that are not finite. Open Image Denoise would take NaN as 0, and so hide a
    /// fault of whoever made the picture.
    pub(crate) fn check(&self, output: &[f32]) -> Result<(), Error> {
        let &Self { width, height, .. } = self;
        let too_large = Error::Size { width, height };
        let values = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(CHANNELS));
        let expected = values.filter(|&values| values > 0).ok_or(too_large)?;
        if self.normal.is_some() && self.albedo.is_none() {
            return Err(Error::NormalAlone);
        }
        if let Some(scale) = self.input_scale.filter(|scale| !scale.is_normal() || *scale < 0.0) {
            return Err(Error::Scale { scale });
        }
        let length = |layer, values: &[f32]| match values.len() {
            values if values == expected => Ok(()),
            values => Err(Error::Length { layer, values, expected }),
        };
        length("output", output)?;
        let layers =
            [("color", Some(self.color)), ("albedo", self.albedo), ("normal", self.normal)];
        for (layer, values) in layers {
            let Some(values) = values else { continue };
            length(layer, values)?;
            self.finite(layer, values)?;
        }
        Ok(())
    }

    fn finite(&self, layer: &'static str, values: &[f32]) -> Result<(), Error> {
        let Some(first) = values.iter().position(|value| !value.is_finite()) else {
            return Ok(());
        };
        let count = not_finite(values);
        let (row, column) = (first / CHANNELS / self.width, first / CHANNELS % self.width);
        Err(Error::NotFinite { layer, count, column, row })
    }
}

/// How many values are infinite or NaN.
pub(crate) fn not_finite(values: &[f32]) -> usize {
    values.iter().filter(|value| !value.is_finite()).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAYER: [f32; 18] = [0.5; 18];

    /// The error of a picture of 3 × 2 pixels after a change of it.
    fn error<'a>(change: impl FnOnce(&mut Image<'a>)) -> String {
        let mut image = Image::new(3, 2, &LAYER);
        assert!(image.check(&[0.0; 18]).is_ok());
        change(&mut image);
        image.check(&[0.0; 18]).expect_err("a change for the worse").to_string()
    }

    #[test]
    fn sizes_must_fit() {
        let says = "an image of 0 × 2 pixels cannot be denoised";
        assert_eq!(error(|image| image.width = 0), says);
        let says = "an image of 3 × 0 pixels cannot be denoised";
        assert_eq!(error(|image| image.height = 0), says);
        assert!(error(|image| image.width = usize::MAX).contains("cannot be denoised"));
        let says = "output: 18 values instead of 27, three per pixel";
        assert_eq!(error(|image| image.height = 3), says);
        let says = "color: 17 values instead of 18, three per pixel";
        assert_eq!(error(|image| image.color = &[0.5; 17]), says);
        let says = "albedo: 6 values instead of 18, three per pixel";
        assert_eq!(error(|image| image.albedo = Some(&[0.5; 6])), says);
        let normal = error(|image| {
            image.albedo = Some(image.color);
            image.normal = Some(&[]);
        });
        assert_eq!(normal, "normal: 0 values instead of 18, three per pixel");
    }

    #[test]
    fn scales_are_above_zero() {
        for bad in [0.0, -1.0, 1e-40, f32::NAN, f32::INFINITY] {
            let says = error(|image| image.input_scale = Some(bad));
            assert_eq!(says, format!("colours cannot be denoised at a scale of {bad}"));
        }
    }

    #[test]
    fn normals_need_albedo() {
        let says = "normals help only beside albedo; give both, or neither";
        assert_eq!(error(|image| image.normal = Some(image.color)), says);
    }

    #[test]
    fn what_is_not_finite_is_refused() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut layer = LAYER;
            (layer[10], layer[17]) = (bad, bad);
            let says = ": 2 values are not finite, the first in column 0 of row 1; they must be \
                        replaced before denoising";
            assert_eq!(error(|image| image.color = &layer), format!("color{says}"));
            assert_eq!(error(|image| image.albedo = Some(&layer)), format!("albedo{says}"));
            let normal = error(|image| {
                image.albedo = Some(image.color);
                image.normal = Some(&layer);
            });
            assert_eq!(normal, format!("normal{says}"));
        }
    }
}

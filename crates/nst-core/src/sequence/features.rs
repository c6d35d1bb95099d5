//! [`FeatureSums`]: what is kept of the features of a pixel, beside its radiance.

use super::{FOLDS, Side, fold_count};

/// Sums over a pixel's samples of what the camera sees there. The samples are those of its
/// lanes, [`LaneSums`](super::LaneSums), with the same weights.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FeatureSums {
    /// Reflectance, linear RGB in [0, 1], of each fold: `[channel][fold]`.
    pub albedo: [[f64; FOLDS]; 3],
    /// Unit shading normals in world space, `[coordinate][fold]`; zero where there is no surface.
    pub normal: [[f64; FOLDS]; 3],
    /// Distances to the first surface; 0 where there is none.
    pub depth: f64,
    /// Radiance that the camera sees directly, `[channel][fold]`.
    pub emission: [[f64; FOLDS]; 3],
}

#[allow(unsafe_code)]
// SAFETY: all fields are f64, for which zero bytes are 0.
unsafe impl bytemuck::Zeroable for FeatureSums {}

impl FeatureSums {
    /// The sum that a channel of a side channel is the mean of, if it is that of a
    /// [feature](Side::FEATURES).
    ///
    /// # Panics
    /// If there is no such channel.
    #[must_use]
    pub fn sum(&self, side: &Side, channel: usize) -> Option<f64> {
        let all = |[a, b, c, d]: [f64; FOLDS]| a + b + c + d;
        Some(match *side {
            Side::Albedo => all(self.albedo[channel]),
            Side::Normal => all(self.normal[channel]),
            Side::Emission => all(self.emission[channel]),
            Side::Depth => self.depth,
            Side::AlbedoFold(fold) => self.albedo[channel][usize::from(fold)],
            Side::NormalFold(fold) => self.normal[channel][usize::from(fold)],
            Side::EmissionFold(fold) => self.emission[channel][usize::from(fold)],
            _ => return None,
        })
    }

    /// The place of a sum of which others are made: those of [`Side::STORED_FEATURES`].
    ///
    /// # Panics
    /// If there is no such channel.
    pub fn sum_mut(&mut self, side: &Side, channel: usize) -> Option<&mut f64> {
        Some(match *side {
            Side::Depth => &mut self.depth,
            Side::AlbedoFold(fold) => &mut self.albedo[channel][usize::from(fold)],
            Side::NormalFold(fold) => &mut self.normal[channel][usize::from(fold)],
            Side::EmissionFold(fold) => &mut self.emission[channel][usize::from(fold)],
            _ => return None,
        })
    }

    /// How many samples of n a sum of a side channel is over.
    #[must_use]
    pub fn count(side: &Side, n: u32) -> f64 {
        match *side {
            Side::AlbedoFold(fold) | Side::NormalFold(fold) | Side::EmissionFold(fold) => {
                fold_count(fold.into(), n)
            }
            _ => f64::from(n),
        }
    }

    /// Writes a channel of a side channel that is a [feature](Side::FEATURES) of pixels of n
    /// samples, `[pixel]`; leaves `out` as it is if the side channel is another.
    ///
    /// # Panics
    /// If there is no such channel.
    pub fn write_side(pixels: &[Self], side: &Side, channel: usize, n: u32, out: &mut [f32]) {
        let count = Self::count(side, n);
        for (out, pixel) in out.iter_mut().zip(pixels) {
            if let Some(sum) = pixel.sum(side, channel) {
                *out = (sum / count) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_are_means_of_their_sums() {
        let mut pixel = FeatureSums {
            albedo: [[0.25; FOLDS], [0.0, 0.0, 2.0, 0.0], [3.0, 0.0, 0.0, 0.0]],
            normal: [[0.0; FOLDS], [-2.0, -1.0, -1.0, -1.0], [0.0, 2.5, 0.0, 0.0]],
            depth: 20.0,
            emission: [[0.0; FOLDS], [1.0, 2.0, 3.0, 4.0], [8.0; FOLDS]],
        };
        let of = |pixel: &FeatureSums, side: Side, channel: usize| {
            let mut out = [9.0];
            FeatureSums::write_side(&[*pixel], &side, channel, 5, &mut out);
            out[0]
        };
        assert_eq!(of(&pixel, Side::Albedo, 2), 0.6);
        assert_eq!(of(&pixel, Side::Normal, 1), -1.0);
        assert_eq!(of(&pixel, Side::Depth, 0), 4.0);
        assert_eq!(of(&pixel, Side::Emission, 1), 2.0);
        // Of five samples, fold 0 has two.
        assert_eq!(of(&pixel, Side::AlbedoFold(0), 2), 1.5);
        assert_eq!(of(&pixel, Side::NormalFold(3), 1), -1.0);
        assert_eq!(of(&pixel, Side::EmissionFold(0), 2), 4.0);
        assert_eq!(of(&pixel, Side::EmissionFold(3), 2), 8.0);
        assert_eq!(of(&pixel, Side::Variance, 0), 9.0);
        for side in Side::STORED_FEATURES {
            for channel in 0..if *side == Side::Depth { 1 } else { 3 } {
                let sum = pixel.sum(side, channel).expect("a feature");
                assert_eq!(pixel.sum_mut(side, channel), Some(&mut { sum }));
            }
        }
        assert_eq!((pixel.sum(&Side::Skipped, 0), pixel.sum_mut(&Side::Emission, 0)), (None, None));
    }
}

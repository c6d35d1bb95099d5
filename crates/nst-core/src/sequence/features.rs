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

/// Which sum of a pixel a channel of a [feature](Side::FEATURES) is the mean of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeatureSum {
    /// That of all folds of one of the [planes](FeatureSums::planes).
    Plane(usize),
    /// That of one fold of a plane.
    Fold(usize, usize),
    /// That of the distances.
    Depth,
}

impl FeatureSum {
    /// That of a channel of a side channel, if it is a feature.
    ///
    /// # Panics
    /// If there is no such channel.
    #[must_use]
    pub fn of(side: &Side, channel: usize) -> Option<Self> {
        let (kind, fold) = match *side {
            Side::Albedo => (0, None),
            Side::Normal => (1, None),
            Side::Emission => (2, None),
            Side::AlbedoFold(fold) => (0, Some(fold)),
            Side::NormalFold(fold) => (1, Some(fold)),
            Side::EmissionFold(fold) => (2, Some(fold)),
            Side::Depth => return Some(Self::Depth),
            _ => return None,
        };
        assert!(channel < 3, "{side} has three channels");
        let plane = 3 * kind + channel;
        Some(fold.map_or(Self::Plane(plane), |fold| Self::Fold(plane, fold.into())))
    }

    /// How many samples of n it is over.
    #[must_use]
    pub fn count(self, n: u32) -> f64 {
        match self {
            Self::Fold(_, fold) => fold_count(fold, n),
            Self::Plane(_) | Self::Depth => f64::from(n),
        }
    }
}

impl FeatureSums {
    /// How many [planes](Self::planes) there are.
    pub const PLANES: usize = 9;

    /// The sums that have folds, `[plane]`: three channels of albedo, of normals, and of emission
    /// each.
    #[must_use]
    pub fn planes(&self) -> [&[f64; FOLDS]; Self::PLANES] {
        let kinds = [&self.albedo, &self.normal, &self.emission];
        std::array::from_fn(|plane| &kinds[plane / 3][plane % 3])
    }

    /// Those whose planes and distances these are.
    #[must_use]
    pub fn of_planes(plane: impl Fn(usize) -> [f64; FOLDS], depth: f64) -> Self {
        let [albedo, normal, emission] =
            [0, 3, 6].map(|first| std::array::from_fn(|channel| plane(first + channel)));
        Self { albedo, normal, depth, emission }
    }

    /// The sum that a channel of a side channel is the mean of, if it is that of a
    /// [feature](Side::FEATURES).
    ///
    /// # Panics
    /// If there is no such channel.
    #[must_use]
    pub fn sum(&self, side: &Side, channel: usize) -> Option<f64> {
        Some(match FeatureSum::of(side, channel)? {
            FeatureSum::Plane(plane) => {
                let [a, b, c, d] = self.planes()[plane];
                a + b + c + d
            }
            FeatureSum::Fold(plane, fold) => self.planes()[plane][fold],
            FeatureSum::Depth => self.depth,
        })
    }

    /// The place of a sum of which others are made: those of [`Side::STORED_FEATURES`].
    ///
    /// # Panics
    /// If there is no such channel.
    pub fn sum_mut(&mut self, side: &Side, channel: usize) -> Option<&mut f64> {
        match FeatureSum::of(side, channel)? {
            FeatureSum::Plane(_) => None,
            FeatureSum::Fold(plane, fold) => {
                let kinds = [&mut self.albedo, &mut self.normal, &mut self.emission];
                kinds.into_iter().flatten().nth(plane).map(|folds| &mut folds[fold])
            }
            FeatureSum::Depth => Some(&mut self.depth),
        }
    }

    /// How many samples of n a sum of a side channel is over.
    #[must_use]
    pub fn count(side: &Side, n: u32) -> f64 {
        FeatureSum::of(side, 0).map_or(n.into(), |sum| sum.count(n))
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
            pixel.sum(&side, channel).expect("a feature") / FeatureSums::count(&side, 5)
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
        for side in Side::STORED_FEATURES {
            for channel in 0..if *side == Side::Depth { 1 } else { 3 } {
                let sum = pixel.sum(side, channel).expect("a feature");
                assert_eq!(pixel.sum_mut(side, channel), Some(&mut { sum }));
            }
        }
        assert_eq!((pixel.sum(&Side::Skipped, 0), pixel.sum_mut(&Side::Emission, 0)), (None, None));
        let planes = pixel.planes().map(|folds| *folds);
        assert_eq!([planes[2], planes[4], planes[7]].map(|folds| folds[0]), [3.0, -2.0, 1.0]);
        assert_eq!(FeatureSums::of_planes(|plane| planes[plane], 20.0), pixel);
    }

    #[test]
    #[should_panic(expected = "three channels")]
    fn no_feature_has_a_fourth_channel() {
        let _ = FeatureSum::of(&Side::Albedo, 3);
    }
}

//! [`Side`]: the numbers that a sequence has beside its terms.

use std::{convert::Infallible, fmt, str::FromStr};

use super::Power;

/// How many folds the samples of a lane are split into: sample i belongs to fold i mod 4.
/// Files of sequences store this number of folds.
pub const FOLDS: usize = 4;

/// How many of a lane's n samples are in a fold, a number below [`FOLDS`].
#[must_use]
pub fn fold_count(fold: usize, n: u32) -> f64 {
    (n as usize).saturating_sub(fold).div_ceil(FOLDS) as f64
}

/// A side channel: one further number of each lane or pixel. Everything that depends on its
/// kind is defined here.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Side {
    /// The mean of a fold, with its number below [`FOLDS`]: `fold0` … `fold3`.
    Fold(u8),
    /// The mean of the [roots](super::root) of a fold's samples: `root0` … `root3`.
    Root(u8),
    /// The mean of the squares of a fold's samples: `square0` … `square3`.
    Square(u8),
    /// The [power mean](Power) of a fold's samples, for a power that is not one of those above:
    /// `power4fold0`, for 1/4 `root4fold0`. Most batches have none.
    PowerMean(Power, u8),
    /// The estimated variance of S_N: `Variance`.
    Variance,
    /// How many samples of a pixel were left out because they were not finite: `Skipped`.
    Skipped,
    /// A feature: the reflectance of what the camera sees, from 0 to 1: `albedo`.
    Albedo,
    /// A feature: the mean of its unit shading normals in world space, towards the camera:
    /// `normal`.
    Normal,
    /// A feature: the radiance that the camera sees directly, a part of S_N: `emission`.
    Emission,
    /// A feature: its mean distance from the camera: `depth`.
    Depth,
    /// The mean of [`Self::Albedo`] over a fold: `albedo0` … `albedo3`.
    AlbedoFold(u8),
    /// That of [`Self::Normal`]: `normal0` … `normal3`.
    NormalFold(u8),
    /// That of [`Self::Emission`]: `emission0` … `emission3`.
    EmissionFold(u8),
    /// A layer that this version does not know, by its name.
    Other(String),
}

/// What a side channel has one number for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// Each lane.
    Lane,
    /// Each pixel, whatever the number of its lanes; needs a [`Grid`](super::Grid).
    Pixel,
    /// Each of the three coordinates of a vector for each pixel, `[coordinate][pixel]`; needs a
    /// [`Grid`](super::Grid).
    Vector,
}

/// How the side channels of independent sequences become that of their mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Merging {
    /// Their mean, weighted as the sequences are: Σ w x.
    Mean,
    /// Their power mean, weighted as the sequences are: (Σ w x^p)^(1/p).
    PowerMean(Power),
    /// The variance of a weighted mean: Σ w² x.
    VarianceOfMean,
    /// Their sum.
    Sum,
    /// It is not known how: sequences that have one cannot be merged.
    Refuse,
}

impl Side {
    /// All means of folds, kind by kind.
    pub const EVERY_OF_FOLDS: &'static [Self; 3 * FOLDS] = &[
        Self::Fold(0),
        Self::Fold(1),
        Self::Fold(2),
        Self::Fold(3),
        Self::Root(0),
        Self::Root(1),
        Self::Root(2),
        Self::Root(3),
        Self::Square(0),
        Self::Square(1),
        Self::Square(2),
        Self::Square(3),
    ];

    /// The same, `[kind][fold]`: means, roots, squares.
    pub const OF_FOLDS: [&'static [Self; FOLDS]; 3] = match Self::EVERY_OF_FOLDS.as_chunks().0 {
        [folds, roots, squares] => [folds, roots, squares],
        _ => unreachable!(),
    };

    /// What a camera sees beside radiance. Renderings have all or none, packed pictures any.
    /// Those of folds are there from [`FOLDS`] samples on.
    pub const FEATURES: &'static [Self; 4 + 3 * FOLDS] = &[
        Self::Albedo,
        Self::Normal,
        Self::Emission,
        Self::Depth,
        Self::AlbedoFold(0),
        Self::AlbedoFold(1),
        Self::AlbedoFold(2),
        Self::AlbedoFold(3),
        Self::NormalFold(0),
        Self::NormalFold(1),
        Self::NormalFold(2),
        Self::NormalFold(3),
        Self::EmissionFold(0),
        Self::EmissionFold(1),
        Self::EmissionFold(2),
        Self::EmissionFold(3),
    ];

    /// Features whose sums the others follow from.
    pub const STORED_FEATURES: &'static [Self] = Self::FEATURES.split_at(3).1;

    /// Features by fold, `[kind][fold]`: albedo, normal, emission.
    pub const FEATURE_FOLDS: [&'static [Self; FOLDS]; 3] =
        match Self::FEATURES.split_at(4).1.as_chunks().0 {
            [albedo, normal, emission] => [albedo, normal, emission],
            _ => unreachable!(),
        };

    /// The four folds, which methods ask for together.
    pub const ALL_FOLDS: &'static [Self; FOLDS] = Self::OF_FOLDS[0];

    /// Those that follow from the sums of n samples: the means of the folds if n ≥ 4, the
    /// variance if n ≥ 2.
    pub fn of_sums(n: u32) -> impl Iterator<Item = &'static Self> {
        let folds = (n as usize >= FOLDS).then_some(Self::EVERY_OF_FOLDS);
        folds.into_iter().flatten().chain((n >= 2).then_some(&Self::Variance))
    }

    /// The [features](Self::FEATURES) of n samples.
    pub fn of_features(n: u32) -> impl Iterator<Item = &'static Self> {
        Self::FEATURES.iter().filter(move |side| n as usize >= FOLDS || !side.is_of_fold())
    }

    /// Whether it is one of the [features](Self::FEATURES).
    #[must_use]
    pub fn is_feature(&self) -> bool {
        Self::FEATURES.contains(self)
    }

    /// The same of a fold, for a feature that has folds.
    #[must_use]
    pub fn of_fold(&self, fold: u8) -> Option<Self> {
        match self {
            Self::Albedo => Some(Self::AlbedoFold(fold)),
            Self::Normal => Some(Self::NormalFold(fold)),
            Self::Emission => Some(Self::EmissionFold(fold)),
            _ => None,
        }
    }

    /// Whether it is a mean over a fold.
    #[must_use]
    pub fn is_of_fold(&self) -> bool {
        let usual = matches!(self, Self::Fold(_) | Self::Root(_) | Self::Square(_));
        let of_feature =
            matches!(self, Self::AlbedoFold(_) | Self::NormalFold(_) | Self::EmissionFold(_));
        usual || of_feature || matches!(self, Self::PowerMean(..))
    }

    /// The four folds' power means of a power that [every batch with folds](Power::is_usual)
    /// does not have.
    #[must_use]
    pub fn power_means(power: Power) -> [Self; FOLDS] {
        std::array::from_fn(|fold| Self::PowerMean(power, fold as u8))
    }

    /// All that have a name of their own.
    fn known() -> impl Iterator<Item = Self> {
        let further = Power::all().filter(|power| !power.is_usual());
        let others = [Self::Variance, Self::Skipped];
        let all = Self::EVERY_OF_FOLDS.iter().cloned().chain(others);
        let all = all.chain(Self::FEATURES.iter().cloned());
        all.chain(further.flat_map(Self::power_means))
    }

    /// What it has one number for.
    #[must_use]
    pub fn extent(&self) -> Extent {
        match self {
            Self::Skipped | Self::Depth => Extent::Pixel,
            Self::Normal | Self::NormalFold(_) => Extent::Vector,
            _ => Extent::Lane,
        }
    }

    /// How side channels of this kind are merged.
    #[must_use]
    pub fn merging(&self) -> Merging {
        match self {
            Self::Fold(_) | Self::Root(_) | Self::Square(_) => Merging::Mean,
            Self::Albedo | Self::Normal | Self::Depth => Merging::Mean,
            Self::AlbedoFold(_) | Self::NormalFold(_) => Merging::Mean,
            Self::Emission | Self::EmissionFold(_) => Merging::Mean,
            Self::PowerMean(power, _) => Merging::PowerMean(*power),
            Self::Variance => Merging::VarianceOfMean,
            Self::Skipped => Merging::Sum,
            Self::Other(_) => Merging::Refuse,
        }
    }
}

impl fmt::Display for Side {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fold(fold) => write!(f, "fold{fold}"),
            Self::Root(fold) => write!(f, "root{fold}"),
            Self::Square(fold) => write!(f, "square{fold}"),
            Self::PowerMean(power, fold) if power.value() < 1.0 => {
                write!(f, "root{}fold{fold}", power.value().recip())
            }
            Self::PowerMean(power, fold) => write!(f, "power{power}fold{fold}"),
            Self::Variance => f.write_str("Variance"),
            Self::Skipped => f.write_str("Skipped"),
            Self::Albedo => f.write_str("albedo"),
            Self::Normal => f.write_str("normal"),
            Self::Depth => f.write_str("depth"),
            Self::Emission => f.write_str("emission"),
            Self::AlbedoFold(fold) => write!(f, "albedo{fold}"),
            Self::NormalFold(fold) => write!(f, "normal{fold}"),
            Self::EmissionFold(fold) => write!(f, "emission{fold}"),
            Self::Other(name) => f.write_str(name),
        }
    }
}

impl FromStr for Side {
    type Err = Infallible;

    /// The side channel of a name; an unknown name gives [`Side::Other`].
    fn from_str(name: &str) -> Result<Self, Infallible> {
        let mut known = Self::known().filter(|side| side.to_string() == name);
        Ok(known.next().unwrap_or_else(|| Self::Other(name.to_owned())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        let other = Side::Other("fold4".into());
        for side in Side::known().chain([other]) {
            assert_eq!(side.to_string().parse(), Ok(side));
        }
        assert_eq!("fold2".parse(), Ok(Side::Fold(2)));
        let eighth = Power::of_value(0.125).expect("a power of two");
        assert_eq!("root8fold3".parse(), Ok(Side::PowerMean(eighth, 3)));
        assert_eq!("root2fold3".parse(), Ok(Side::Other("root2fold3".into())), "that is root3");
        assert_eq!("emission3".parse(), Ok(Side::EmissionFold(3)));
        assert_eq!("Albedo".parse(), Ok(Side::Other("Albedo".into())));
        assert_eq!("fold02".parse(), Ok(Side::Other("fold02".into())));
    }
}

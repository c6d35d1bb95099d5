//! Makes a sequence from pictures of other renderers: the running means of independent
//! renderings, or the snapshots of one progressive rendering. Pictures are read one after
//! the other, strip by strip: no more than a strip of the sequence is in memory, however
//! many files there are.

mod features;
mod moments;
mod names;

use std::{
    hash::{DefaultHasher, Hash, Hasher},
    ops::Range,
    path::{Path, PathBuf},
};

use ndarray::Array2;
use nst_core::{FOLDS, Grid, SequenceBatch, Side};

use crate::{
    ColorModel, Error,
    limits::{BLOCK_ROWS, strip_rows},
    picture::Picture,
};
pub use features::{Feature, FeatureNames, find as find_features};
use moments::Moments;
pub use names::samples_in_name;

/// What the pictures are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pack {
    /// Independent renderings with this many samples per pixel each. Term k is the mean of
    /// the first k; picture i belongs to fold i mod 4. Values that are not finite are left
    /// out of means, folds and variance.
    Samples(u32),
    /// The terms themselves, with these numbers of samples per pixel. There are neither
    /// folds nor a variance: they cannot be computed from rounded means.
    Estimates(Vec<u32>),
}

/// Pictures that agree in size and channels, and become one sequence.
#[derive(Debug)]
pub struct Packer {
    pictures: Vec<Picture>,
    pack: Pack,
    sample_counts: Vec<u32>,
    features: Vec<Feature>,
    /// What was seen of each picture so far.
    seen: Vec<Seen>,
}

#[derive(Clone, Debug, Default)]
struct Seen {
    hash: DefaultHasher,
    /// The bits of the first value, and whether another differs from it.
    first: Option<u32>,
    varies: bool,
    /// How many values are not finite.
    nonfinite: u64,
}

/// Opens pictures, and checks that all have the same size, position, primaries and number of
/// channels.
///
/// # Errors
/// [`Error::Io`] or [`Error::Malformed`] names the file and what is wrong, or how it differs
/// from the first.
pub fn open(paths: &[PathBuf], layer: Option<&str>) -> Result<Vec<Picture>, Error> {
    let mut pictures: Vec<Picture> = Vec::with_capacity(paths.len());
    for path in paths {
        let picture = Picture::open(path, layer)?;
        if pictures.first().is_some_and(|first| !first.has_primaries_of(&picture)) {
            let message = format!(
                "its colours have other primaries than those of '{}'; all must agree",
                pictures[0].path().display()
            );
            return Err(Error::malformed(path, message));
        }
        if let Some(first) = pictures.first() {
            let of = |picture: &Picture| {
                let ([width, height], [x, y]) = (picture.size, picture.position);
                let names = picture.channel_names.join(", ");
                format!("{width}x{height} pixels from ({x}, {y}) in {names}")
            };
            let same = picture.size == first.size
                && picture.position == first.position
                && picture.channel_names.len() == first.channel_names.len();
            if !same {
                let message = format!(
                    "it has {}, but '{}' has {}; all must agree",
                    of(&picture),
                    first.path().display(),
                    of(first)
                );
                return Err(Error::malformed(path, message));
            }
        }
        pictures.push(picture);
    }
    Ok(pictures)
}

impl Packer {
    /// Takes pictures of [`open`], in the order of the sequence.
    ///
    /// # Errors
    /// [`Error::Mismatch`] if there are none, if the sample counts do not increase from
    /// at least 1, or if they exceed u32.
    pub fn new(pictures: Vec<Picture>, pack: Pack) -> Result<Self, Error> {
        let sample_counts = match &pack {
            Pack::Samples(spp) => {
                let counts = (1..=pictures.len()).map(|k| u32::try_from(k).ok()?.checked_mul(*spp));
                counts.collect::<Option<Vec<_>>>().ok_or_else(|| {
                    let message =
                        format!("{} pictures of {spp} samples are too many", pictures.len());
                    Error::Mismatch(message)
                })?
            }
            Pack::Estimates(counts) => counts.clone(),
        };
        let increase = sample_counts.first().is_some_and(|&first| first > 0)
            && sample_counts.windows(2).all(|pair| pair[0] < pair[1]);
        if !increase || sample_counts.len() != pictures.len() {
            let message = format!(
                "{} pictures with the sample counts {sample_counts:?}, which must increase from 1 on",
                pictures.len()
            );
            return Err(Error::Mismatch(message));
        }
        let seen = vec![Seen::default(); pictures.len()];
        Ok(Self { pictures, pack, sample_counts, features: Vec::new(), seen })
    }

    /// The same with features of the pictures, of [`find_features`]: their means over all files,
    /// or those of the last snapshot.
    #[must_use]
    pub fn with_features(mut self, mut features: Vec<Feature>) -> Self {
        if let Pack::Estimates(_) = self.pack {
            features.iter_mut().for_each(Feature::keep_last);
        }
        self.features = features;
        self
    }

    /// What to tell of the features when all strips are read.
    #[must_use]
    pub fn feature_notes(&self) -> Vec<String> {
        self.features.iter().flat_map(Feature::notes).collect()
    }

    /// Width and height in pixels.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        self.pictures[0].size
    }

    /// The channels of the sequence; three count as R, G, B in linear sRGB.
    #[must_use]
    pub fn model(&self) -> ColorModel {
        match self.pictures[0].channel_names.len() {
            1 => ColorModel::Mono,
            _ => ColorModel::Rgb,
        }
    }

    /// The number of samples behind each term.
    #[must_use]
    pub fn sample_counts(&self) -> &[u32] {
        &self.sample_counts
    }

    /// The side channels that strips will have, sorted.
    #[must_use]
    pub fn sides(&self) -> Vec<Side> {
        let mut sides = self.sides_of_means();
        sides.extend(self.features.iter().flat_map(Feature::sides));
        sides.sort();
        sides
    }

    /// Those that are made of the pictures themselves.
    fn sides_of_means(&self) -> Vec<Side> {
        let count = self.pictures.len();
        match self.pack {
            Pack::Estimates(_) => Vec::new(),
            Pack::Samples(_) => {
                let of_folds = Side::EVERY_OF_FOLDS.iter();
                of_folds
                    .filter(|_| count >= FOLDS)
                    .cloned()
                    .chain((count >= 2).then_some(Side::Variance))
                    .collect()
            }
        }
    }

    /// The strips of rows to [read](Self::read), one after the other.
    pub fn strips(&self) -> impl Iterator<Item = Range<u32>> + use<> {
        let [width, height] = self.size();
        // Each picture's term; a picture as it is read; and what means are taken from.
        let lane = size_of::<f32>() * (self.pictures.len() + 1) + Moments::BYTES_PER_LANE;
        // A feature is at most three numbers, and their means, as those of four folds are.
        let feature = (1 + FOLDS) * (size_of::<f64>() + size_of::<u32>()) + size_of::<f32>();
        let lane = lane + self.features.len() * feature;
        let row = lane * self.model().channels().len() * width as usize;
        let rows = strip_rows(row).min(height.next_multiple_of(BLOCK_ROWS));
        (0..height)
            .step_by(rows as usize)
            .map(move |first| first..height.min(first.saturating_add(rows)))
    }

    /// Makes the sequences of a strip of rows, as planar lanes.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Malformed`] names the file and what is wrong with it.
    pub fn read(&mut self, rows: Range<u32>) -> Result<SequenceBatch, Error> {
        let channels = self.model().channels().len() as u32;
        let grid = Grid::new(self.size()[0], rows.len() as u32, channels, rows.start)?;
        let lanes = grid.lanes();
        let mut terms = Vec::with_capacity(self.pictures.len() * lanes);
        let mut moments = Moments::new(match self.pack {
            Pack::Samples(_) => lanes,
            Pack::Estimates(_) => 0,
        });
        for (picture, seen) in self.pictures.iter().zip(&mut self.seen) {
            let values = picture.read_rows(rows.clone())?;
            seen.take(&values);
            match self.pack {
                Pack::Samples(_) => moments.push(&values, &mut terms),
                Pack::Estimates(_) => terms.extend(values),
            }
        }
        let terms = Array2::from_shape_vec((self.pictures.len(), lanes), terms)
            .map_err(|error| Error::Mismatch(error.to_string()))?;
        let mut batch = SequenceBatch::new(terms, self.sample_counts.clone())?;
        batch.set_grid(grid)?;
        for side in self.sides_of_means() {
            let values = moments.of_fold(&side).unwrap_or_else(|| moments.variance());
            batch.set_side(side, values)?;
        }
        for feature in &mut self.features {
            for (side, values) in feature.read(&rows)? {
                batch.set_side(side, values)?;
            }
        }
        Ok(batch)
    }

    /// Checks, when all strips are read, that no two renderings have the same pixels: they
    /// would not be independent. Returns the pictures that contain values that are not
    /// finite, and how many.
    ///
    /// # Errors
    /// [`Error::Malformed`] names two equal files.
    pub fn finish(self) -> Result<Vec<(PathBuf, u64)>, Error> {
        if let Pack::Samples(_) = self.pack {
            let mut hashes = std::collections::BTreeMap::<u64, &Path>::new();
            for (picture, seen) in self.pictures.iter().zip(&self.seen) {
                // Several pictures may be black, or of another single value.
                let earlier = hashes.insert(seen.hash.finish(), picture.path());
                if let (true, Some(earlier)) = (seen.varies, earlier) {
                    let message = format!(
                        "it has the same pixels as '{}'; independent renderings need different seeds",
                        earlier.display()
                    );
                    return Err(Error::malformed(picture.path(), message));
                }
            }
        }
        let seen = self.pictures.iter().zip(&self.seen).filter(|(_, seen)| seen.nonfinite > 0);
        Ok(seen.map(|(picture, seen)| (picture.path().to_owned(), seen.nonfinite)).collect())
    }
}

impl Seen {
    fn take(&mut self, values: &[f32]) {
        for value in values {
            value.to_bits().hash(&mut self.hash);
            self.varies |= *self.first.get_or_insert(value.to_bits()) != value.to_bits();
            self.nonfinite += u64::from(!value.is_finite());
        }
    }
}

#[cfg(test)]
mod tests {
    use exr::prelude::*;

    use super::*;

    /// Pictures of 5x40 pixels, whose values follow from the picture and the pixel.
    fn value(picture: usize, lane: usize) -> f32 {
        ((picture * 7919 + lane * 104_729) % 1000) as f32 / 8.0
    }

    fn pictures(folder: &Path, names: &[&str], count: usize) -> Vec<PathBuf> {
        let pixels = 200;
        let write = |i: usize| {
            let path = folder.join(format!("{i}.exr"));
            let channels = names.iter().enumerate().map(|(channel, name)| {
                let values = (0..pixels).map(|pixel| value(i, channel * pixels + pixel)).collect();
                AnyChannel::new(*name, FlatSamples::F32(values))
            });
            let channels = AnyChannels::sort(channels.collect());
            Image::from_channels((5, 40), channels).write().to_file(&path).expect("a file");
            path
        };
        (0..count).map(write).collect()
    }

    fn close(a: f32, b: f64) {
        assert!((f64::from(a) - b).abs() <= 1e-6 * b.abs(), "{a} is not {b}");
    }

    #[test]
    fn independent_renderings() -> std::result::Result<(), crate::Error> {
        let folder = tempfile::tempdir().expect("a folder");
        let paths = pictures(folder.path(), &["R", "G", "B"], 6);
        let mut packer = Packer::new(open(&paths, None)?, Pack::Samples(4))?;
        assert_eq!(packer.sample_counts(), [4, 8, 12, 16, 20, 24]);
        let names: Vec<_> = packer.sides().iter().map(Side::to_string).collect();
        let of_folds = ["fold", "root", "square"].into_iter();
        let of_folds = of_folds.flat_map(|kind| (0..4).map(move |fold| format!("{kind}{fold}")));
        assert!(names.into_iter().eq(of_folds.chain(["Variance".to_owned()])));
        assert!(packer.strips().eq(std::iter::once(0..40)));
        let batch = packer.read(16..19)?;
        assert_eq!(batch.lanes(), 3 * 3 * 5);
        for lane in 0..45 {
            let samples: Vec<f64> =
                (0..6).map(|i| f64::from(value(i, lane / 15 * 200 + 80 + lane % 15))).collect();
            let mean = |samples: &[f64]| samples.iter().sum::<f64>() / samples.len() as f64;
            for k in 0..6 {
                close(batch.term(k)[lane], mean(&samples[..=k]));
            }
            let all = mean(&samples);
            let squares = samples.iter().map(|x| (x - all).powi(2)).sum::<f64>();
            close(batch.side(&Side::Variance).expect("a variance")[lane], squares / 30.0);
            close(
                batch.side(&Side::Fold(1)).expect("a fold")[lane],
                mean(&[samples[1], samples[5]]),
            );
            close(batch.side(&Side::Fold(3)).expect("a fold")[lane], samples[3]);
            let roots = (samples[1].sqrt() + samples[5].sqrt()) / 2.0;
            close(batch.side(&Side::Root(1)).expect("roots")[lane], roots);
            let squares = (samples[1].powi(2) + samples[5].powi(2)) / 2.0;
            close(batch.side(&Side::Square(1)).expect("squares")[lane], squares);
        }
        packer.read(0..16)?;
        assert_eq!(packer.finish()?, []);
        Ok(())
    }

    #[test]
    fn estimates_are_the_terms() -> std::result::Result<(), crate::Error> {
        let folder = tempfile::tempdir().expect("a folder");
        let paths = pictures(folder.path(), &["Y"], 2);
        let mut packer = Packer::new(open(&paths, None)?, Pack::Estimates(vec![3, 10]))?;
        assert_eq!((packer.model(), packer.sides()), (ColorModel::Mono, vec![]));
        let batch = packer.read(0..40)?;
        assert_eq!(batch.sample_counts(), [3, 10]);
        assert!((0..200).all(|lane| batch.term(1)[lane] == value(1, lane)));
        for bad in [vec![3], vec![3, 3], vec![10, 3], vec![0, 1]] {
            let pictures = open(&paths, None)?;
            assert!(Packer::new(pictures, Pack::Estimates(bad.clone())).is_err(), "{bad:?}");
        }
        assert!(Packer::new(open(&paths, None)?, Pack::Samples(u32::MAX)).is_err());
        assert!(Packer::new(vec![], Pack::Samples(1)).is_err());
        Ok(())
    }

    #[test]
    fn equal_renderings_are_refused_but_black_ones_are_not() -> std::result::Result<(), crate::Error>
    {
        let folder = tempfile::tempdir().expect("a folder");
        let paths = pictures(folder.path(), &["Y"], 2);
        let twice = [paths[0].clone(), paths[1].clone(), paths[0].clone()];
        let mut packer = Packer::new(open(&twice, None)?, Pack::Samples(1))?;
        packer.read(0..40)?;
        assert!(packer.finish().is_err_and(|e| e.to_string().contains("seeds")));

        let black = folder.path().join("black.exr");
        let channel = AnyChannel::new("Y", FlatSamples::F32(vec![0.0; 200]));
        let channels = AnyChannels::sort([channel].into_iter().collect());
        Image::from_channels((5, 40), channels).write().to_file(&black).expect("a file");
        let mut packer = Packer::new(open(&[black.clone(), black], None)?, Pack::Samples(1))?;
        packer.read(0..40)?;
        assert_eq!(packer.finish()?, []);
        Ok(())
    }
}

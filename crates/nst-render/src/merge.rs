//! Sequences of one scene with different seeds as one sequence of all their samples.
//!
//! Let file f stand for s_f seeds, with n_k samples of each behind term k. The merged
//! term is the mean at n_k Σ s_f samples: the mean of the files' terms with the
//! weights w_f = s_f / Σ s. So are the folds, which stay means of disjoint subsets.
//! The variance of the mean is Σ w_f² V_f, as the files are independent.

use std::{
    collections::BTreeMap,
    fmt::Display,
    path::{Path, PathBuf},
};

use ndarray::Array2;
use nst_core::SequenceBatch;

use crate::{
    Error, FOLDS, VARIANCE, fold_name,
    output::OutputFile,
    sequence_file::{SequenceInfo, SequenceReader, SequenceWriter},
};

/// Sequences that fit together. Their rows are read as they are written: no more
/// than a strip of each is in memory.
pub struct Merge {
    readers: Vec<SequenceReader>,
    info: SequenceInfo,
    /// w_f, which add up to 1.
    weights: Vec<f64>,
}

impl Merge {
    /// Opens sequences and checks that they are of one scene, with one sampler and
    /// different seeds, in one size and with the same terms for each seed.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Image`] names the file and what is wrong with it, or
    /// in what it differs from which other.
    pub fn open(paths: &[PathBuf]) -> Result<Self, Error> {
        let readers =
            paths.iter().map(|path| SequenceReader::open(path)).collect::<Result<Vec<_>, _>>()?;
        let infos: Vec<_> = paths.iter().zip(readers.iter().map(SequenceReader::info)).collect();
        let Some((&first, others)) = infos.split_first() else {
            return Err(Error::Settings("no sequences to merge".into()));
        };
        for &of_file in &infos {
            check_mergeable(of_file)?;
        }
        for &other in others {
            check_alike(first, other)?;
        }
        check_seeds(&infos)?;
        let seeds: Vec<u64> =
            infos.iter().flat_map(|(_, info)| info.seeds.iter().copied()).collect();
        let counts = (0..first.1.sample_counts.len()).map(|k| {
            let counts = infos.iter().map(|(_, info)| info.sample_counts[k]);
            counts.into_iter().try_fold(0, u32::checked_add)
        });
        let sample_counts = counts.collect::<Option<Vec<u32>>>().ok_or_else(|| {
            Error::image(first.0, "merged, there are more than 2^32 samples of a pixel")
        })?;
        let weights =
            infos.iter().map(|(_, info)| info.seeds.len() as f64 / seeds.len() as f64).collect();
        let info = SequenceInfo {
            sample_counts,
            render_seconds: infos.iter().map(|(_, info)| info.render_seconds).sum(),
            resume: None,
            seeds,
            ..first.1.clone()
        };
        Ok(Self { info, weights, readers })
    }

    /// What the merged file says about itself.
    #[must_use]
    pub fn info(&self) -> &SequenceInfo {
        &self.info
    }

    /// Reads, merges and writes all rows. The caller commits `output`.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Image`] names the file that cannot be read or written.
    pub fn write(mut self, output: &mut OutputFile) -> Result<(), Error> {
        let mut writer = SequenceWriter::create(output, &self.info)?;
        // Each has its part of the memory that one reader alone would take.
        let rows = self.readers.iter().map(SequenceReader::strip_rows).min().unwrap_or(16);
        let rows = (rows / self.readers.len() as u32).next_multiple_of(16).max(16);
        while !self.readers[0].is_done() {
            let strips = self
                .readers
                .iter_mut()
                .map(|reader| reader.read_rows(rows))
                .collect::<Result<Vec<_>, _>>()?;
            writer.push(&self.merge(&strips)?, None)?;
        }
        writer.finish()
    }

    fn merge(&self, strips: &[SequenceBatch]) -> Result<SequenceBatch, Error> {
        let lanes = strips[0].lanes();
        let mean = |values: &dyn Fn(&SequenceBatch) -> Vec<f32>, weight: &dyn Fn(f64) -> f64| {
            let mut sums = vec![0.0; lanes];
            for (strip, &share) in strips.iter().zip(&self.weights) {
                for (sum, value) in sums.iter_mut().zip(values(strip)) {
                    *sum += weight(share) * f64::from(value);
                }
            }
            sums.into_iter().map(|sum| sum as f32).collect::<Vec<f32>>()
        };
        let terms = (0..self.info.sample_counts.len())
            .flat_map(|k| mean(&|strip| strip.term(k).to_vec(), &|share| share));
        let shape = (self.info.sample_counts.len(), lanes);
        let terms = Array2::from_shape_vec(shape, terms.collect())
            .map_err(|error| Error::Settings(error.to_string()))?;
        let mut batch = SequenceBatch::new(terms, self.info.sample_counts.clone())?;
        for name in &self.info.sides {
            let values = |strip: &SequenceBatch| strip.side(name).unwrap_or_default().to_vec();
            let weight = |share| if name == VARIANCE { share * share } else { share };
            batch.set_side(name, mean(&values, &weight))?;
        }
        Ok(batch)
    }
}

type Named<'a> = (&'a PathBuf, &'a SequenceInfo);

fn check_alike((first_path, first): Named<'_>, (path, info): Named<'_>) -> Result<(), Error> {
    let differ = |what: &str, here: &dyn Display, there: &dyn Display| {
        let message = format!(
            "its {what} is {here}, but that of '{}' is {there}; only sequences that agree in it \
             can be merged",
            first_path.display()
        );
        Err(Error::image(path, message))
    };
    let size = |info: &SequenceInfo| format!("{}x{}", info.size[0], info.size[1]);
    if info.size != first.size {
        return differ("size", &size(info), &size(first));
    }
    if info.model != first.model {
        let names = |info: &SequenceInfo| info.model.channels().join(", ");
        return differ("list of channels", &names(info), &names(first));
    }
    let quoted = |text: &str| format!("'{text}'");
    if info.scene != first.scene {
        return differ("scene (nst.scene)", &quoted(&info.scene), &quoted(&first.scene));
    }
    if info.sampler != first.sampler {
        return differ("sampler (nst.sampler)", &quoted(&info.sampler), &quoted(&first.sampler));
    }
    if info.sides != first.sides {
        let names = |info: &SequenceInfo| quoted(&info.sides.join(", "));
        return differ("list of side channels", &names(info), &names(first));
    }
    // Terms with equally many samples of each seed.
    let same = info.sample_counts.len() == first.sample_counts.len()
        && info.sample_counts.iter().zip(&first.sample_counts).all(|(&here, &there)| {
            u64::from(here) * first.seeds.len() as u64 == u64::from(there) * info.seeds.len() as u64
        });
    if !same {
        let terms = |info: &SequenceInfo| {
            let counts: Vec<_> = info.sample_counts.iter().map(u32::to_string).collect();
            format!("'{}' of {} seeds", shortened(&counts.join(",")), info.seeds.len())
        };
        return differ("list of terms (nst.terms)", &terms(info), &terms(first));
    }
    Ok(())
}

fn check_mergeable((path, info): Named<'_>) -> Result<(), Error> {
    let known = |name: &String| name == VARIANCE || (0..FOLDS).any(|i| fold_name(i) == *name);
    if let Some(name) = info.sides.iter().find(|&name| !known(name)) {
        let message = format!("side channel '{name}': it is not known how to merge it");
        return Err(Error::image(path, message));
    }
    if info.seeds.is_empty() {
        let message = "it has no seed (nst.seed), so nothing tells whether it is independent of the \
             others; give different ones with 'nst pack --seed'";
        return Err(Error::image(path, message));
    }
    Ok(())
}

fn check_seeds(infos: &[Named<'_>]) -> Result<(), Error> {
    let mut seen = BTreeMap::<u64, &Path>::new();
    for (path, info) in infos {
        for &seed in &info.seeds {
            if let Some(other) = seen.insert(seed, path) {
                let message = format!(
                    "it has samples of seed {seed} (nst.seed), and so has '{}'; the same samples \
                     must not count twice",
                    other.display()
                );
                return Err(Error::image(path, message));
            }
        }
    }
    Ok(())
}

/// The start of a long text.
fn shortened(text: &str) -> String {
    const MOST: usize = 60;
    if text.len() <= MOST { text.to_owned() } else { format!("{}…", &text[..MOST]) }
}

//! Sequences of one scene with different seeds as one sequence of all their samples.
//!
//! Let file f have samples of s_f seeds, n_k of each behind term k. The merged term has n_k
//! Σ s_f samples: it is the mean of the files' terms with the weights w_f = s_f / Σ s. The
//! folds are merged in the same way, and stay means of disjoint subsets. The variance of
//! the merged mean is Σ w_f² V_f, as the files are independent. Power means are merged as means
//! of powers. Numbers of skipped samples are added.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Display,
    path::{Path, PathBuf},
};

use ndarray::Array2;
use nst_core::{Grid, Merging, SequenceBatch, Side, Strips};

use crate::{
    Error,
    limits::strip_rows,
    output_file::OutputFile,
    sequence_file::{SequenceInfo, SequenceReader, SequenceWriter},
};

/// Sequences that fit together. They are read one at a time, strip by strip: neither memory
/// nor the number of open files grows with the number of sequences.
pub struct Merge {
    paths: Vec<PathBuf>,
    info: SequenceInfo,
    /// w_f of each file; their sum is 1.
    weights: Vec<f64>,
}

impl Merge {
    /// Opens sequences and checks that they are of one scene, with one sampler and
    /// different seeds, in one size and with the same terms for each seed.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Malformed`] names the file and what is wrong with it, or
    /// how it differs from another.
    pub fn open(paths: &[PathBuf]) -> Result<Self, Error> {
        let infos = paths
            .iter()
            .map(|path| Ok((path, SequenceReader::open(path)?.info().clone())))
            .collect::<Result<Vec<_>, Error>>()?;
        let infos: Vec<Named<'_>> = infos.iter().map(|(path, info)| (*path, info)).collect();
        let Some((&first, others)) = infos.split_first() else {
            return Err(Error::Mismatch("no sequences to merge".into()));
        };
        infos.iter().try_for_each(|&of_file| check_mergeable(of_file))?;
        others.iter().try_for_each(|&other| check_alike(first, other))?;
        check_seeds(&infos)?;
        let seeds: Vec<u64> =
            infos.iter().flat_map(|(_, info)| info.seeds.iter().copied()).collect();
        let counts = (0..first.1.sample_counts.len()).map(|k| {
            let counts = infos.iter().map(|(_, info)| info.sample_counts[k]);
            counts.into_iter().try_fold(0, u32::checked_add)
        });
        let sample_counts = counts.collect::<Option<Vec<u32>>>().ok_or_else(|| {
            Error::malformed(first.0, "merged, there are more than 2^32 samples of a pixel")
        })?;
        let weights =
            infos.iter().map(|(_, info)| info.seeds.len() as f64 / seeds.len() as f64).collect();
        let sides: BTreeSet<Side> =
            infos.iter().flat_map(|(_, info)| info.sides.iter().cloned()).collect();
        let info = SequenceInfo {
            sample_counts,
            sides: sides.into_iter().collect(),
            render_seconds: infos.iter().map(|(_, info)| info.render_seconds).sum(),
            resume: None,
            seeds,
            ..first.1.clone()
        };
        Ok(Self { paths: paths.to_vec(), info, weights })
    }

    /// What the merged file says about itself.
    #[must_use]
    pub fn info(&self) -> &SequenceInfo {
        &self.info
    }

    /// Reads, merges and writes all rows. The caller commits `output`.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Malformed`] names the file that cannot be read or written.
    pub fn write(self, output: &mut OutputFile) -> Result<(), Error> {
        let mut writer = SequenceWriter::create(output, &self.info)?;
        let grid = self.info.grid()?;
        // A strip in f32 and its sums in f64.
        let layers = self.info.sample_counts.len() + self.info.sides.len();
        let lane = layers * (size_of::<f32>() + size_of::<f64>());
        let step = strip_rows(grid.channels() * grid.width() * lane) as usize;
        for first in (0..grid.rows()).step_by(step) {
            writer.push(&self.merge(first as u32, step as u32)?, None)?;
        }
        writer.finish()
    }

    /// Merges up to `step` rows.
    fn merge(&self, first: u32, step: u32) -> Result<SequenceBatch, Error> {
        let [width, height] = self.info.size;
        let channels = self.info.model.channels().len() as u32;
        let grid = Grid::new(width, step.min(height - first), channels, first)?;
        let mut terms = vec![0.0; self.info.sample_counts.len() * grid.lanes()];
        let mut sides: BTreeMap<&Side, Vec<f64>> = BTreeMap::new();
        for (path, &weight) in self.paths.iter().zip(&self.weights) {
            let mut reader = SequenceReader::open(path)?.with_strip_rows(step);
            reader.skip_to(first);
            let strip = reader.next_strip()?;
            // The file may have changed since it was checked.
            let strip = strip.filter(|strip| strip.lanes() == grid.lanes());
            let strip =
                strip.filter(|strip| strip.sample_counts().len() * grid.lanes() == terms.len());
            let Some(strip) = strip else {
                return Err(Error::malformed(path, "it has changed since it was opened"));
            };
            add(&mut terms, strip.terms().iter().map(|&term| term.into()), weight);
            for side in &self.info.sides {
                let Some(values) = strip.side(side) else { continue };
                let sums = sides.entry(side).or_insert_with(|| vec![0.0; values.len()]);
                let merging = side.merging();
                let values = values.iter().map(|&value| summand(merging, value.into()));
                add(sums, values, share(merging, weight));
            }
        }
        let rounded = |sums: Vec<f64>| sums.into_iter().map(|sum| sum as f32).collect::<Vec<_>>();
        let shape = (self.info.sample_counts.len(), grid.lanes());
        let terms = Array2::from_shape_vec(shape, rounded(terms))
            .map_err(|error| Error::Mismatch(error.to_string()))?;
        let mut batch = SequenceBatch::new(terms, self.info.sample_counts.clone())?;
        batch.set_grid(grid)?;
        for (side, mut sums) in sides {
            if let Merging::PowerMean(power) = side.merging() {
                sums.iter_mut().for_each(|sum| *sum = power.mean_of(*sum));
            }
            batch.set_side(side.clone(), rounded(sums))?;
        }
        Ok(batch)
    }
}

fn add(sums: &mut [f64], values: impl Iterator<Item = f64>, share: f64) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += share * value);
}

/// What is added of a value of a side channel.
fn summand(merging: Merging, value: f64) -> f64 {
    match merging {
        Merging::PowerMean(power) => power.of(value),
        _ => value,
    }
}

/// The factor of a side channel of a file with weight w.
fn share(merging: Merging, weight: f64) -> f64 {
    match merging {
        Merging::Mean | Merging::PowerMean(_) => weight,
        Merging::VarianceOfMean => weight * weight,
        Merging::Sum => 1.0,
        Merging::Refuse => unreachable!("the files were checked"),
    }
}

/// Side channels that all files must have if one has them. Sums are not among them: a file
/// without one counts as 0.
fn required(info: &SequenceInfo) -> Vec<&Side> {
    info.sides.iter().filter(|side| side.merging() != Merging::Sum).collect()
}

type Named<'a> = (&'a PathBuf, &'a SequenceInfo);

fn check_alike((first_path, first): Named<'_>, (path, info): Named<'_>) -> Result<(), Error> {
    let differ = |what: &str, here: &dyn Display, there: &dyn Display| {
        let message = format!(
            "its {what} is {here}, but that of '{}' is {there}; only sequences that agree in it \
             can be merged",
            first_path.display()
        );
        Err(Error::malformed(path, message))
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
    check_sides((first_path, first), (path, info))?;
    // Each term needs the same number of samples of every seed.
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

/// Fails if one file has side channels that the other lacks.
fn check_sides((first_path, first): Named<'_>, (path, info): Named<'_>) -> Result<(), Error> {
    let (here, there) = (required(info), required(first));
    let lacking = |all: &[&Side], some: &[&Side]| -> Vec<Side> {
        all.iter().filter(|side| !some.contains(side)).map(|side| (*side).clone()).collect()
    };
    let (missing, further) = (lacking(&there, &here), lacking(&here, &there));
    let (verb, sides) = match (&missing[..], &further[..]) {
        ([], []) => return Ok(()),
        ([], further) => ("has", further),
        (missing, _) => ("lacks", missing),
    };
    let names: Vec<_> = sides.iter().map(ToString::to_string).collect();
    let advice = match sides.iter().any(Side::is_feature) {
        true => "; 'nst render --features' stores features, whatever the transformation",
        false => "",
    };
    let message = format!(
        "it {verb} the side channels '{}', unlike '{}'; only sequences that agree in them can be \
         merged{advice}",
        names.join(", "),
        first_path.display()
    );
    Err(Error::malformed(path, message))
}

fn check_mergeable((path, info): Named<'_>) -> Result<(), Error> {
    if let Some(side) = info.sides.iter().find(|side| side.merging() == Merging::Refuse) {
        let message = format!("side channel '{side}': nst does not know how to merge it");
        return Err(Error::malformed(path, message));
    }
    if info.seeds.is_empty() {
        let message = "it has no seed (nst.seed), so nothing tells whether it is independent of the \
             others; set different seeds with 'nst pack --seed'";
        return Err(Error::malformed(path, message));
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
                return Err(Error::malformed(path, message));
            }
        }
    }
    Ok(())
}

/// The start of a long text.
fn shortened(text: &str) -> String {
    /// Characters that leave a message short enough for a line or two.
    const MOST: usize = 60;
    if text.len() <= MOST { text.to_owned() } else { format!("{}…", &text[..MOST]) }
}

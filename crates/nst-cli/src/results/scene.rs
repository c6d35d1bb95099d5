//! The rows of one scene, out of one table or several.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::PathBuf,
};

use super::{curves::Curves, metric::Metric, read::read_rows, row::Row, summary::Summary};
use crate::{
    error::Error,
    words::{counted, list},
};

/// The rows of one scene: at least one, all with one reference, no run twice.
#[derive(Clone, Debug)]
pub(crate) struct Results {
    rows: Vec<Row>,
    summaries: Vec<Summary>,
}

impl Results {
    /// Reads the rows of one scene from all tables; `scene` may be left out if there is only
    /// one.
    ///
    /// # Errors
    /// As [`read_rows`], and [`Error::Usage`] if the tables have not the scene, or have
    /// several and none was chosen; [`Error::Unlike`] if rows do not fit together.
    pub(crate) fn read(paths: &[PathBuf], scene: Option<&str>) -> Result<Self, Error> {
        let mut rows = Vec::new();
        for path in paths {
            rows.extend(read_rows(path)?);
        }
        let scenes: BTreeSet<&str> = rows.iter().map(|row| &*row.scene).collect();
        let all = || scenes.iter().map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ");
        let chosen = match scene {
            Some(name) if scenes.contains(name) => name.to_owned(),
            Some(name) => {
                return Err(Error::Usage(format!(
                    "there is no scene '{name}'; there are {}",
                    all()
                )));
            }
            None if scenes.len() > 1 => {
                return Err(Error::Usage(format!(
                    "there are several scenes, choose one with --scene: {}",
                    all()
                )));
            }
            None => rows[0].scene.clone(),
        };
        Self::of(rows.into_iter().filter(|row| row.scene == chosen))
    }

    /// Rows of one scene, of which there is at least one. A run that comes again with the same
    /// errors counts once. Runs are told apart by their seeds where these are known; where two
    /// of a method have one number, the second gets another.
    ///
    /// # Errors
    /// [`Error::Unlike`] if rows differ in what must agree, or if a run comes again with other
    /// errors.
    pub(crate) fn of(rows: impl IntoIterator<Item = Row>) -> Result<Self, Error> {
        let mut joined = Joined::default();
        rows.into_iter().try_for_each(|row| joined.add(row))?;
        Ok(Self { summaries: Summary::all(&joined.rows), rows: joined.rows })
    }

    pub(crate) fn rows(&self) -> &[Row] {
        &self.rows
    }

    pub(crate) fn scene(&self) -> &str {
        &self.rows[0].scene
    }

    /// Width and height of the film in pixels.
    pub(crate) fn size(&self) -> [u32; 2] {
        [self.rows[0].width, self.rows[0].height]
    }

    /// What the rows have in a field, each value once, in the order in which they first come:
    /// the machines, for instance.
    pub(crate) fn distinct<'a>(&'a self, field: impl Fn(&'a Row) -> &'a str) -> Vec<&'a str> {
        let mut seen = BTreeSet::new();
        self.rows.iter().map(field).filter(|value| seen.insert(*value)).collect()
    }

    /// All sample counts, from the smallest.
    pub(crate) fn sample_counts(&self) -> Vec<u32> {
        ascending(self.rows.iter().map(|row| row.spp))
    }

    /// All numbers of threads, from the smallest.
    pub(crate) fn threads(&self) -> Vec<u32> {
        ascending(self.rows.iter().filter_map(|row| row.threads))
    }

    /// How many runs the points have, as in "10 runs" or "3 to 12 runs".
    pub(crate) fn runs(&self) -> String {
        let all = self.summaries.iter().map(|it| it.runs).filter(|runs| *runs > 0);
        let (least, most) = (all.clone().min().unwrap_or(0), all.max().unwrap_or(0));
        let few = if least == most { String::new() } else { format!("{least} to ") };
        few + &counted(most, "run")
    }

    /// What to know of rows that were not measured in one go.
    pub(crate) fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let several = |names: &[&str]| (names.len() > 1).then(|| list(names, ""));
        if let Some(machines) = several(&self.distinct(|row| &row.machine)) {
            notes.push(format!(
                "Times are of several machines, and cannot be compared: {machines}."
            ));
        } else if let [first, .., last] = self.threads()[..] {
            notes.push(format!("Times are of {first} to {last} threads, and cannot be compared."));
        }
        if let Some(versions) = several(&self.distinct(|row| &row.version)) {
            notes.push(format!("Rows are of several versions of nst: {versions}."));
        }
        notes
    }

    /// One for each method and sample count.
    pub(crate) fn summaries(&self) -> &[Summary] {
        &self.summaries
    }

    /// The mean error of a method at a sample count, if it was measured.
    #[cfg(feature = "render")]
    pub(crate) fn error(&self, method: &str, spp: u32, metric: Metric) -> Option<f64> {
        let it = self.summaries.iter().find(|it| it.method == method && it.spp == spp)?;
        Some(it.error(metric)?.mean)
    }

    /// Errors against time, by one metric.
    pub(crate) fn curves(&self, metric: Metric) -> Curves {
        Curves::of(&self.summaries, metric)
    }
}

/// Rows that are being joined.
#[derive(Default)]
struct Joined {
    rows: Vec<Row>,
    /// By method, samples per pixel, and seed, or number where the seed is not known.
    places: BTreeMap<(String, u32, Option<u64>, u32), usize>,
    /// The numbers of runs that are taken, by method and samples per pixel.
    numbers: BTreeMap<(String, u32), BTreeSet<u32>>,
}

impl Joined {
    fn add(&mut self, mut row: Row) -> Result<(), Error> {
        if let Some((what, [a, b])) = self.rows.first().and_then(|first| first.difference(&row)) {
            return Err(Error::Unlike(format!(
                "the results differ in their {what}, '{a}' and '{b}', and cannot be compared; use \
                 tables of one bench"
            )));
        }
        let errors = |row: &Row| Metric::ALL.map(|metric| metric.of(row));
        let number = if row.seed.is_some() { 0 } else { row.run };
        let key = (row.method.clone(), row.spp, row.seed, number);
        let place = *self.places.entry(key).or_insert(self.rows.len());
        match self.rows.get(place) {
            Some(first) if errors(first) == errors(&row) => return Ok(()),
            Some(_) => {
                return Err(Error::Unlike(format!(
                    "run {} of '{}' at {} spp is there twice, with different errors; use tables \
                     whose runs have different seeds, or one table",
                    row.run, row.method, row.spp
                )));
            }
            None => {}
        }
        let taken = self.numbers.entry((row.method.clone(), row.spp)).or_default();
        if taken.contains(&row.run) {
            row.run = taken.last().map_or(0, |last| last.saturating_add(1));
        }
        taken.insert(row.run);
        self.rows.push(row);
        Ok(())
    }
}

/// Each number once, from the smallest.
fn ascending(numbers: impl Iterator<Item = u32>) -> Vec<u32> {
    numbers.collect::<BTreeSet<_>>().into_iter().collect()
}

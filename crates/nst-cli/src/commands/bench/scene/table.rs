//! The table that a bench writes. It is on disk after every pair of runs, so that a bench
//! that is cut off can go on.

use std::path::{Path, PathBuf};

use nst_files::output::OutputFile;

use crate::{
    error::Error,
    results::{Row, read_rows},
};

/// The rows so far, and where they are stored.
pub(super) struct Table {
    path: PathBuf,
    rows: Vec<Row>,
}

impl Table {
    /// The table of this name, with the rows that it has; `row` is one as this bench will
    /// write.
    ///
    /// # Errors
    /// [`Error::Unlike`] if a table of another bench is there.
    pub(super) fn open(path: &Path, row: &Row) -> Result<Self, Error> {
        let is_there = std::fs::metadata(path).is_ok_and(|file| file.len() > 0);
        let rows = if is_there { read_rows(path) } else { Ok(Vec::new()) };
        let rows = rows.map_err(|error| {
            Error::Unlike(format!(
                "{error}; a bench goes on with the rows that are there: name \
                                   another file"
            ))
        })?;
        if let Some(what) = rows.iter().find_map(|earlier| difference(earlier, row)) {
            return Err(Error::Unlike(format!(
                "'{}' has rows of another {what}; a bench goes on with the rows that are there: \
                 name another file",
                path.display()
            )));
        }
        Ok(Self { path: path.to_owned(), rows })
    }

    pub(super) fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Forgets the rows of other methods than these.
    pub(super) fn retain(&mut self, keep: impl Fn(&str) -> bool) {
        self.rows.retain(|row| keep(&row.method));
    }

    /// Whether a method on a run is there.
    pub(super) fn has(&self, method: &str, spp: u32, run: u32) -> bool {
        self.rows.iter().any(|row| (&*row.method, row.spp, row.run) == (method, spp, run))
    }

    /// Adds rows, or replaces those of the same method and run, and stores the table.
    pub(super) fn add(&mut self, rows: Vec<Row>) -> Result<(), Error> {
        for row in rows {
            let key = |row: &Row| (row.method.clone(), row.spp, row.run);
            match self.rows.iter().position(|earlier| key(earlier) == key(&row)) {
                Some(place) => self.rows[place] = row,
                None => self.rows.push(row),
            }
        }
        let mut output = OutputFile::create(&self.path)?;
        let mut writer = csv::Writer::from_writer(output.file());
        self.rows
            .iter()
            .try_for_each(|row| writer.serialize(row))
            .and_then(|()| Ok(writer.flush()?))
            .map_err(|source| Error::Csv { path: self.path.clone(), source })?;
        drop(writer);
        Ok(output.commit()?)
    }
}

/// In what two rows differ that must agree within one table.
fn difference(a: &Row, b: &Row) -> Option<&'static str> {
    // The first seed of the bench: seeds count up with the runs.
    let seed = |row: &Row| row.seed.map(|seed| seed.wrapping_sub(row.run.into()));
    [
        ("scene", a.scene != b.scene || a.fingerprint != b.fingerprint),
        ("sampler", a.sampler != b.sampler),
        ("size", [a.width, a.height] != [b.width, b.height]),
        ("reference", a.reference_mse != b.reference_mse),
        ("--seed", a.seed.is_some() && b.seed.is_some() && seed(a) != seed(b)),
        ("version of nst", a.version != b.version),
        ("machine, or another number of threads", a.machine != b.machine || a.threads != b.threads),
    ]
    .into_iter()
    .find_map(|(what, differs)| differs.then_some(what))
}

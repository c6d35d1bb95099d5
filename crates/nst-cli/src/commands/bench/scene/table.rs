//! The table that a bench writes. It is on disk after every pair of runs, so that a bench
//! that is cut off can go on, and so that several processes can write one table.

use std::{
    collections::BTreeSet,
    io::{ErrorKind, Write},
    path::{Path, PathBuf},
};

use nst_files::output::OutputFile;

use super::{cache::lock, source::File};
use crate::{
    args::TransformArg,
    error::Error,
    results::{Row, parse_table},
};

/// The rows so far, and where they are stored.
pub(super) struct Table {
    path: PathBuf,
    rows: Vec<Row>,
    /// The file as this process has read or written it last.
    stored: Vec<u8>,
    /// Methods, samples per pixel and numbers of runs that are measured anew.
    dropped: BTreeSet<(String, u32, u32)>,
    /// A row as this bench writes, once it is known.
    example: Option<Row>,
}

impl Table {
    /// The table of this name, with the rows that it has.
    ///
    /// # Errors
    /// [`Error::Unlike`] if something else is there.
    pub(super) fn open(path: &Path) -> Result<Self, Error> {
        let stored = read(path)?;
        let rows = rows(path, &stored)?;
        let path = path.to_owned();
        Ok(Self { path, rows, stored, dropped: BTreeSet::new(), example: None })
    }

    pub(super) fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// The samples per pixel of the reference's halves, which are rendered: those that were
    /// asked for, else those of the rows that are there, else `default`.
    ///
    /// # Errors
    /// [`Error::Unlike`] if the rows that are there have another reference.
    pub(super) fn reference_spp(&self, asked: Option<u32>, default: u32) -> Result<u32, Error> {
        match self.rows.first().map(|row| row.reference_spp) {
            None => Ok(asked.unwrap_or(default)),
            Some(Some(spp)) if asked.is_none_or(|asked| asked == spp) => Ok(spp),
            Some(_) => Err(refusal(&self.path, &self.rows, "reference")),
        }
    }

    /// Fails with [`Error::Unlike`] if rows are those of another bench than `row`, whose
    /// reference is not known yet.
    pub(super) fn check_all_but_reference(&self, row: Row) -> Result<(), Error> {
        let Some(Row { reference, reference_mse, .. }) = self.rows.first().cloned() else {
            return Ok(());
        };
        check(&self.path, &self.rows, &Row { reference, reference_mse, ..row })
    }

    /// Fails with [`Error::Unlike`] if rows are those of another bench; `row` is one as this
    /// bench will write.
    pub(super) fn check(&mut self, row: Row) -> Result<(), Error> {
        check(&self.path, &self.rows, &row)?;
        self.example = Some(row);
        Ok(())
    }

    /// Compares rows with the sequences that are named in their place now. Those that may be
    /// of others are measured anew.
    ///
    /// # Errors
    /// [`Error::Unlike`] if the seeds say that they are of others.
    pub(super) fn check_sequences(&mut self, files: &[File]) -> Result<(), Error> {
        let place = |row: &Row, file: &File| (row.spp, row.run) == (file.spp, file.run);
        for row in &self.rows {
            let file = files.iter().find(|file| place(row, file) && row.seed.is_some());
            let Some((was, is)) = file.and_then(|file| row.seed.zip(file.seed)) else { continue };
            if was != is {
                return Err(Error::Unlike(format!(
                    "'{}' has run {} at {} spp of a sequence of seed {was}, and the one that is \
                     named now has seed {is}; name the sequences in the same order, or another \
                     file",
                    self.path.display(),
                    row.run,
                    row.spp
                )));
            }
        }
        // Rows of other programs' pictures have no seed either; nothing transformed them.
        let of_sequence = |row: &Row| {
            let known = TransformArg::named(&row.method).is_some();
            known || row.seed.is_some() || row.transform_seconds.is_some()
        };
        self.drop_rows(|row| {
            let file = files.iter().find(|file| place(row, file) && of_sequence(row));
            file.is_some_and(|file| file.seed.is_none() || row.seed.is_none())
        });
        Ok(())
    }

    /// Forgets rows, which are then measured anew.
    pub(super) fn drop_rows(&mut self, is_dropped: impl Fn(&Row) -> bool) {
        let (dropped, kept) = self.rows.drain(..).partition(|row| is_dropped(row));
        self.rows = kept;
        self.dropped.extend(Vec::into_iter(dropped).map(|row| key(&row)));
    }

    /// Whether a method on a run is there.
    pub(super) fn has(&self, method: &str, spp: u32, run: u32) -> bool {
        self.rows.iter().any(|row| (&*row.method, row.spp, row.run) == (method, spp, run))
    }

    /// Adds rows, or replaces those of the same method and run, and stores the table with the
    /// rows that other processes have added to it.
    ///
    /// # Errors
    /// [`Error::Unlike`] if it has become a table of another bench.
    pub(super) fn add(&mut self, rows: Vec<Row>) -> Result<(), Error> {
        let _until_the_end = lock(&self.path);
        self.take_in()?;
        for row in rows {
            match self.rows.iter().position(|earlier| key(earlier) == key(&row)) {
                Some(place) => self.rows[place] = row,
                None => self.rows.push(row),
            }
        }
        self.store()
    }

    /// Takes in the rows that another process has written since this one read or wrote.
    fn take_in(&mut self) -> Result<(), Error> {
        let found = read(&self.path)?;
        if found == self.stored {
            return Ok(());
        }
        let theirs = rows(&self.path, &found)?;
        if let Some(row) = &self.example {
            check(&self.path, &theirs, row)?;
        }
        for row in theirs {
            if !self.has(&row.method, row.spp, row.run) && !self.dropped.contains(&key(&row)) {
                self.rows.push(row);
            }
        }
        Ok(())
    }

    fn store(&mut self) -> Result<(), Error> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let written = self.rows.iter().try_for_each(|row| writer.serialize(row));
        written.map_err(|source| Error::Csv { path: self.path.clone(), source })?;
        self.stored = writer.into_inner().expect("memory can be written to");
        let mut output = OutputFile::create(&self.path)?;
        output.file().write_all(&self.stored).map_err(|source| {
            let path = self.path.clone();
            Error::Files(nst_files::Error::Io { action: "write", path, source })
        })?;
        Ok(output.commit()?)
    }
}

fn key(row: &Row) -> (String, u32, u32) {
    (row.method.clone(), row.spp, row.run)
}

/// The file of a table, empty if there is none.
fn read(path: &Path) -> Result<Vec<u8>, Error> {
    match std::fs::read(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
        Err(source) => {
            let path = path.to_owned();
            Err(nst_files::Error::Io { action: "read", path, source }.into())
        }
        Ok(bytes) => Ok(bytes),
    }
}

/// The rows of a file, none of an empty one.
fn rows(path: &Path, bytes: &[u8]) -> Result<Vec<Row>, Error> {
    if bytes.is_empty() {
        return Ok(Vec::new());
    }
    parse_table(bytes).map_err(|message| {
        let path = path.to_owned();
        let error = nst_files::Error::Malformed { path, message };
        Error::Unlike(format!("{error}; a bench keeps the rows that are there: name another file"))
    })
}

/// Fails if rows are those of another bench than `row`.
fn check(path: &Path, rows: &[Row], row: &Row) -> Result<(), Error> {
    let what = rows.iter().find_map(|earlier| difference(earlier, row));
    what.map_or(Ok(()), |what| Err(refusal(path, rows, what)))
}

/// Says in what the rows of a table are those of another bench, and what to do.
fn refusal(path: &Path, rows: &[Row], what: &str) -> Error {
    let how = match rows.first().and_then(|row| row.reference_spp) {
        _ if what != "reference" => String::new(),
        Some(spp) => format!("use --reference-spp {spp} as they do, or "),
        None => "use the files of --reference as they do, or ".to_owned(),
    };
    Error::Unlike(format!(
        "'{}' has rows of another {what}, which those of this bench cannot be added to: {how}name \
         another file",
        path.display()
    ))
}

/// In what two rows differ that must agree within one table.
fn difference(a: &Row, b: &Row) -> Option<&'static str> {
    // The first seed of the bench: seeds count up with the runs.
    let seed = |row: &Row| row.seed.map(|seed| seed.wrapping_sub(row.run.into()));
    let others = [
        ("--seed", a.seed.is_some() && b.seed.is_some() && seed(a) != seed(b)),
        ("version of nst", a.version != b.version),
        ("machine, or another number of threads", a.machine != b.machine || a.threads != b.threads),
    ];
    let others = others.into_iter().find_map(|(what, differs)| differs.then_some(what));
    a.difference(b).map(|(what, _)| what).or(others)
}

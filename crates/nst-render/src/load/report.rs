//! What loading a scene tells beside the scene: which files were read, and what
//! a user should know about the result.

use std::path::{Path, PathBuf};

use super::place::error_at;
use crate::Error;

/// Grows while a scene is loaded.
#[derive(Default)]
pub(super) struct Report {
    /// Whether faults that could be forgiven are errors.
    strict: bool,
    notes: Vec<Note>,
    /// The files that were read, for [`crate::Scene::inputs`].
    pub(super) inputs: Vec<PathBuf>,
}

/// A line of [`crate::Scene::notes`].
struct Note {
    text: String,
    /// Of a kind of fault: how often it was forgiven, and where and what was the first.
    faults: Option<(usize, String)>,
}

impl Report {
    pub(super) fn new(strict: bool) -> Self {
        Self { strict, ..Self::default() }
    }

    /// Whether faults are errors.
    pub(super) fn is_strict(&self) -> bool {
        self.strict
    }

    /// Adds a note; the same one twice is of no use to anybody.
    pub(super) fn note(&mut self, text: impl Into<String>) {
        let text = text.into();
        if !self.notes.iter().any(|note| note.text == text) {
            self.notes.push(Note { text, faults: None });
        }
    }

    /// A fault in a file whose meaning is plain all the same. All of one `kind`, which says
    /// what is done about them, become one note: how many, and the first of them. `fault`
    /// says what is wrong with this one, and is asked for the first of a kind alone.
    ///
    /// # Errors
    /// The fault itself, where loading is strict.
    pub(super) fn forgive(
        &mut self,
        kind: &str,
        path: &Path,
        line: usize,
        fault: impl FnOnce() -> String,
    ) -> Result<(), Error> {
        if self.strict {
            return Err(error_at(path, line, fault()));
        }
        self.count(kind, path, 1, || format!("line {line}: {}", fault()));
        Ok(())
    }

    /// As [`Self::forgive`], for `count` texels of an image, which may be none. `fault` says
    /// where the first of them is, and what it is.
    ///
    /// # Errors
    /// The fault itself, where loading is strict.
    pub(super) fn forgive_texels(
        &mut self,
        kind: &str,
        path: &Path,
        count: usize,
        fault: impl FnOnce() -> String,
    ) -> Result<(), Error> {
        match count {
            0 => Ok(()),
            _ if self.strict => Err(Error::image(path, fault())),
            _ => {
                self.count(kind, path, count, fault);
                Ok(())
            }
        }
    }

    fn count(&mut self, kind: &str, path: &Path, more: usize, fault: impl FnOnce() -> String) {
        let notes = &mut self.notes;
        let known = notes.iter_mut().find(|note| note.faults.is_some() && note.text == kind);
        if let Some(Note { faults: Some((count, _)), .. }) = known {
            *count += more;
        } else {
            let file = path.file_name().unwrap_or_default().display();
            let first = format!("{file}, {}", fault());
            notes.push(Note { text: kind.to_owned(), faults: Some((more, first)) });
        }
    }

    /// The bytes of a file, which becomes one of the inputs. All files of a scene
    /// are read by this function, so that none is missing from the list.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read.
    pub(super) fn read(&mut self, path: &Path) -> Result<Vec<u8>, Error> {
        let bytes = std::fs::read(path).map_err(|error| Error::io(path, error))?;
        if !self.inputs.iter().any(|input| input == path) {
            self.inputs.push(path.to_owned());
        }
        Ok(bytes)
    }

    /// What was assumed and what was left out, for [`crate::Scene::notes`].
    pub(super) fn notes(&self) -> Vec<String> {
        let line = |note: &Note| match &note.faults {
            None => note.text.clone(),
            Some((1, first)) => format!("{} ({first})", note.text),
            Some((count, first)) => format!("{}: {count} (the first: {first})", note.text),
        };
        self.notes.iter().map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_of_one_kind_are_one_note() {
        let path = Path::new("folder/x.obj");
        let mut report = Report::default();
        for line in 3..1000 {
            let fault = || format!("normal {line} is NaN");
            report.forgive("normals left out", path, line, fault).expect("it is lenient");
        }
        report.note("a camera");
        report.note("a camera");
        let fault = || "no name".to_owned();
        report.forgive("names made up", path, 7, fault).expect("it is lenient");
        for (name, count) in [("a.exr", 3), ("b.exr", 0), ("c.exr", 4)] {
            let fault = || format!("row {count}: NaN");
            report.forgive_texels("set to 0", Path::new(name), count, fault).expect("lenient");
        }
        let expected = [
            "normals left out: 997 (the first: x.obj, line 3: normal 3 is NaN)",
            "a camera",
            "names made up (x.obj, line 7: no name)",
            "set to 0: 7 (the first: a.exr, row 3: NaN)",
        ];
        assert_eq!(report.notes(), expected);
    }

    #[test]
    fn strict_reports_forgive_nothing() {
        let mut report = Report::new(true);
        let fault = || "normal 3 is NaN".to_owned();
        let error = report.forgive("normals left out", Path::new("x.obj"), 3, fault);
        let error = error.expect_err("it is strict").to_string();
        assert_eq!(error, "scene 'x.obj': line 3: normal 3 is NaN");
        let fault = || "row 3: NaN".to_owned();
        let error = report.forgive_texels("set to 0", Path::new("a.exr"), 2, fault);
        assert_eq!(error.expect_err("it is strict").to_string(), "'a.exr': row 3: NaN");
        report.forgive_texels("set to 0", Path::new("a.exr"), 0, String::new).expect("no fault");
        assert!(report.notes().is_empty());
    }
}

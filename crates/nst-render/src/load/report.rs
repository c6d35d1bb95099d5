//! What loading a scene tells beside the scene: which files were read, and what
//! a user should know about the result.

use std::path::{Path, PathBuf};

use crate::Error;

/// Grows while a scene is loaded.
#[derive(Default)]
pub(super) struct Report {
    /// What was assumed and what was left out, for [`crate::Scene::notes`].
    pub(super) notes: Vec<String>,
    /// The files that were read, for [`crate::Scene::inputs`].
    pub(super) inputs: Vec<PathBuf>,
}

impl Report {
    /// Adds a note; the same one twice is of no use to anybody.
    pub(super) fn note(&mut self, note: impl Into<String>) {
        let note = note.into();
        if !self.notes.contains(&note) {
            self.notes.push(note);
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
}

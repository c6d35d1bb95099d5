//! Files that appear whole or not at all.

use std::{
    fs::File,
    path::{Path, PathBuf},
};

use tempfile::NamedTempFile;

use crate::Error;

/// A file that is written under a temporary name beside its own and renamed by
/// [`OutputFile::commit`]; dropped before that, it leaves no trace. A process that is
/// killed leaves the temporary file, `.nst-….tmp`, and whatever the name stood for.
/// Opening it before a long computation shows early whether the place can be written to.
#[derive(Debug)]
pub struct OutputFile {
    file: NamedTempFile,
    path: PathBuf,
}

impl OutputFile {
    /// Prepares to write `path`.
    ///
    /// # Errors
    /// [`Error::Io`] if `path` is a folder, or if its folder cannot be written to.
    pub fn create(path: &Path) -> Result<Self, Error> {
        let failed = |error| Error::io("write", path, error);
        if path.is_dir() {
            return Err(failed(std::io::ErrorKind::IsADirectory.into()));
        }
        let folder = match path.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(".nst-").suffix(".tmp");
        // A temporary file is private by default; an output follows the umask.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let file = builder.tempfile_in(folder).map_err(failed)?;
        Ok(Self { file, path: path.to_owned() })
    }

    /// Where the file will appear.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file under its temporary name, open for writing.
    pub fn file(&mut self) -> &mut File {
        self.file.as_file_mut()
    }

    /// Puts the finished file in its place, over what was there.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be stored or renamed.
    pub fn commit(self) -> Result<(), Error> {
        // Before the new name: a disk may report late that it is full, and after a
        // power failure the name must not stand for a file without content.
        self.file.as_file().sync_all().map_err(|error| Error::io("write", &self.path, error))?;
        match self.file.persist(&self.path) {
            Ok(_) => Ok(()),
            Err(error) => Err(Error::io("write", &self.path, error.error)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_abandoned_file_leaves_no_trace() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("x.exr");
        std::fs::write(&path, "old")?;
        drop(OutputFile::create(&path)?);
        assert_eq!(std::fs::read_to_string(&path)?, "old");
        assert_eq!(std::fs::read_dir(folder.path())?.count(), 1);
        OutputFile::create(&path)?.commit()?;
        assert_eq!(std::fs::read_to_string(&path)?, "");
        assert!(OutputFile::create(folder.path()).is_err());
        Ok(())
    }
}

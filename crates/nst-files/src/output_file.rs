//! Files that appear whole or not at all.

use std::{
    fs::File,
    io,
    path::{Path, PathBuf},
};

use crate::{Error, temporary::Temporary};

/// The program that wrote a file, as the files of this crate name it.
pub(crate) const SOFTWARE: &str = concat!("nst ", env!("CARGO_PKG_VERSION"));

/// A file that is written under a temporary name in the folder of its own, and renamed by
/// [`commit`]. If it is dropped before that, it is deleted. A process that is killed leaves
/// the temporary file, `.nst-….tmp`, which the next output in that folder deletes, and the
/// old file, if there was one. Opening an output before a long computation shows early
/// whether it can be written.
#[derive(Debug)]
pub struct OutputFile {
    file: Temporary,
    path: PathBuf,
    /// Where the file will be: `path`, or what it links to.
    target: PathBuf,
}

impl OutputFile {
    /// Prepares to write `path`, whatever file is there now;
    /// [`Outputs::open`](crate::output::Outputs::open) checks whether it may be replaced.
    ///
    /// # Errors
    /// [`Error::Io`] if `path` is a folder or a device, or if its folder cannot be
    /// written to.
    pub fn create(path: &Path) -> Result<Self, Error> {
        let failed = |error| Error::io("write", path, error);
        let target = target(path).map_err(failed)?;
        if target.is_dir() {
            let why = "it is a folder; give another name";
            return Err(failed(io::Error::new(io::ErrorKind::IsADirectory, why)));
        }
        if target.exists() && !target.is_file() {
            // A file that is renamed to the name of a device replaces the device.
            return Err(Error::output(path, "it is not an ordinary file; give another name"));
        }
        let old = std::fs::metadata(&target).ok();
        if old.as_ref().is_some_and(|file| file.permissions().readonly()) {
            return Err(Error::output(path, "the file there is read-only; give another name"));
        }
        let folder = folder_of(&target);
        let file = Temporary::create(folder).map_err(|error| failed(plain(error, folder)))?;
        // Who could not read the old file cannot read the new one.
        if let Some(old) = old {
            file.as_file().set_permissions(old.permissions()).map_err(failed)?;
        }
        Ok(Self { file, path: path.to_owned(), target })
    }

    /// Where the file will appear, as it was asked for.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where the file will be, links followed and the folder's name in full.
    pub(crate) fn place(&self) -> PathBuf {
        self.target.canonicalize().unwrap_or_else(|_| {
            // It is not there yet.
            let folder = folder_of(&self.target).canonicalize();
            let name = self.target.file_name().unwrap_or_default();
            folder.map_or_else(|_| self.target.clone(), |folder| folder.join(name))
        })
    }

    /// The file under its temporary name, open for writing.
    pub fn file(&mut self) -> &mut File {
        self.file.as_file_mut()
    }

    /// Puts the finished file in its place; a file that was there is replaced.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be stored or renamed.
    pub fn commit(self) -> Result<(), Error> {
        commit([self])
    }
}

/// Puts finished files in their places; files that were there are replaced. All are on the
/// disk before the first is renamed, so that a full disk leaves every old file; a signal finds
/// all of them renamed, or none.
///
/// # Errors
/// [`Error::Io`] if one cannot be stored or renamed.
pub fn commit(outputs: impl IntoIterator<Item = OutputFile>) -> Result<(), Error> {
    let outputs: Vec<OutputFile> = outputs.into_iter().collect();
    for output in &outputs {
        // A disk may report late that it is full; and after a power failure, the file must
        // not be there without its content.
        let stored = output.file.as_file().sync_all();
        stored.map_err(|error| Error::io("write", &output.path, error))?;
    }
    let renamed =
        outputs.into_iter().map(|OutputFile { file, path, target }| ((file, target), path));
    let (files, paths): (_, Vec<_>) = renamed.unzip();
    Temporary::persist(files).map_err(|(i, error)| Error::io("write", &paths[i], error))
}

/// Why no file could be created in a folder, without the name of the temporary file.
fn plain(error: io::Error, folder: &Path) -> io::Error {
    use io::ErrorKind::{
        NotADirectory, NotFound, PermissionDenied, ReadOnlyFilesystem, StorageFull,
    };
    let kind = error.kind();
    let folder = folder.display();
    let why = match kind {
        NotFound => format!("there is no folder '{folder}'; create it, or give another name"),
        NotADirectory => format!("'{folder}' is no folder; give another name"),
        PermissionDenied => format!("the folder '{folder}' may not be written to"),
        ReadOnlyFilesystem => format!("the folder '{folder}' is on a read-only disk"),
        StorageFull => format!("the disk of the folder '{folder}' is full"),
        _ => return error,
    };
    io::Error::new(kind, why)
}

/// Where a path leads: to the file behind a link, whether it exists or not.
fn target(path: &Path) -> io::Result<PathBuf> {
    if path.is_symlink() {
        let link = std::fs::read_link(path)?;
        // A link may lead to further links; if the last leads to no file, the first is
        // followed alone.
        return path.canonicalize().or_else(|_| Ok(folder_of(path).join(link)));
    }
    Ok(path.to_owned())
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    type Checked = Result<(), Box<dyn std::error::Error>>;

    #[test]
    fn an_abandoned_file_leaves_no_trace() -> Checked {
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

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_devices_are_left_alone() -> Checked {
        let folder = tempfile::tempdir()?;
        let [link, file, lost] = ["link", "file", "lost"].map(|name| folder.path().join(name));
        std::fs::write(&file, "old")?;
        std::os::unix::fs::symlink(&file, &link)?;
        OutputFile::create(&link)?.commit()?;
        assert!(link.is_symlink() && std::fs::read(&file)?.is_empty());
        std::os::unix::fs::symlink("new", &lost)?;
        OutputFile::create(&lost)?.commit()?;
        assert!(lost.is_symlink() && folder.path().join("new").is_file());
        assert!(OutputFile::create(Path::new("/dev/null")).is_err());
        Ok(())
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_kept() -> Checked {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("x");
        std::fs::write(&path, "old")?;
        let mode = |mode| std::fs::set_permissions(&path, PermissionsExt::from_mode(mode));
        mode(0o600)?;
        OutputFile::create(&path)?.commit()?;
        assert_eq!(std::fs::metadata(&path)?.permissions().mode() & 0o777, 0o600);
        mode(0o444)?;
        let error = OutputFile::create(&path).expect_err("it is read-only").to_string();
        assert!(error.contains("read-only"), "{error}");
        Ok(())
    }

    #[test]
    fn all_files_are_stored_before_the_first_is_named() -> Checked {
        let folder = tempfile::tempdir()?;
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        let mut outputs = [OutputFile::create(&a)?, OutputFile::create(&b)?];
        outputs[1].file().write_all(b"b")?;
        commit(outputs)?;
        assert_eq!((std::fs::read(&a)?, std::fs::read(&b)?), (vec![], b"b".to_vec()));
        Ok(())
    }
}

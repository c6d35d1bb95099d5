//! Temporary files that do not outlive their process for long.
//!
//! Each is locked while its process lives. The system releases the locks of a process that
//! was killed: the next one that writes to the folder deletes its files.

use std::{
    collections::BTreeSet,
    fs::File,
    io,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::Duration,
};

use tempfile::NamedTempFile;

const PREFIX: &str = ".nst-";
const SUFFIX: &str = ".tmp";

/// A file without a lock that is younger than this may be about to be locked.
const YOUNG: Duration = Duration::from_secs(10);

/// The temporary files of this process.
static ALL: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn all() -> std::sync::MutexGuard<'static, BTreeSet<PathBuf>> {
    ALL.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Deletes the temporary files of all outputs, for a process that ends at once: other
/// threads that open or close an output from now on wait for its end.
pub fn abandon_all() {
    let all = all();
    for path in &*all {
        // It may be gone, or be a finished file now; there is nobody to tell.
        let _ = std::fs::remove_file(path);
    }
    std::mem::forget(all);
}

/// A temporary file; it is deleted when it is dropped.
#[derive(Debug)]
pub(crate) struct Temporary {
    file: NamedTempFile,
    listed: Listed,
}

/// Is in the list of [`abandon_all`] until it is dropped.
#[derive(Debug)]
struct Listed(PathBuf);

impl Drop for Listed {
    fn drop(&mut self) {
        all().remove(&self.0);
    }
}

impl Temporary {
    /// A new file in a folder, which is first cleared of those of dead processes.
    pub(crate) fn create(folder: &Path) -> io::Result<Self> {
        clear(folder, YOUNG);
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).suffix(SUFFIX);
        // A temporary file is private by default; an output follows the umask.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        // There is no moment at which the file is there, but not in the list.
        let mut all = all();
        let file = builder.tempfile_in(folder)?;
        let listed = Listed(file.path().to_owned());
        all.insert(listed.0.clone());
        drop(all);
        // Where the file system knows no locks, nobody deletes what is left behind.
        let _ = file.as_file().try_lock();
        Ok(Self { file, listed })
    }

    pub(crate) fn as_file(&self) -> &File {
        self.file.as_file()
    }

    pub(crate) fn as_file_mut(&mut self) -> &mut File {
        self.file.as_file_mut()
    }

    /// Gives files their final names, under which they are no longer deleted. A process that
    /// ends at once meanwhile, see [`abandon_all`], does so after the last.
    ///
    /// # Errors
    /// Which of them could not be renamed; those after it are deleted.
    pub(crate) fn persist(files: Vec<(Self, PathBuf)>) -> Result<(), (usize, io::Error)> {
        // What is dropped here waits for the list, which is therefore free by then.
        let mut listed = Vec::new();
        let mut files = files.into_iter().enumerate();
        let _all = all();
        files.try_for_each(|(i, (file, path))| {
            listed.push(file.listed);
            file.file.persist(path).map(drop).map_err(|error| (i, error.error))
        })
    }
}

/// Deletes the temporary files of dead processes: those that nobody has locked, and that
/// nobody has written to for a while. What cannot be looked at is left alone.
fn clear(folder: &Path, young: Duration) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if !(name.starts_with(PREFIX) && name.ends_with(SUFFIX)) {
            continue;
        }
        let age = entry.metadata().and_then(|data| data.modified()).ok();
        let is_old = age.and_then(|time| time.elapsed().ok()).is_some_and(|age| age >= young);
        if is_old && File::open(entry.path()).is_ok_and(|file| file.try_lock().is_ok()) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Checked = Result<(), Box<dyn std::error::Error>>;

    #[test]
    fn files_of_the_living_stay_and_those_of_the_dead_go() -> Checked {
        let folder = tempfile::tempdir()?;
        let names = || -> io::Result<BTreeSet<String>> {
            let entries = std::fs::read_dir(folder.path())?;
            entries.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned())).collect()
        };
        let mine = Temporary::create(folder.path())?;
        let name = mine.file.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
        for other in [".nst-dead.tmp", ".nst-x.exr", "nst-x.tmp", "x.tmp"] {
            std::fs::write(folder.path().join(other), "")?;
        }
        clear(folder.path(), YOUNG);
        assert!(names()?.contains(".nst-dead.tmp"), "it is young");
        clear(folder.path(), Duration::ZERO);
        let expected: BTreeSet<_> =
            [&name, ".nst-x.exr", "nst-x.tmp", "x.tmp"].map(str::to_owned).into();
        assert_eq!(names()?, expected);
        drop(mine);
        assert!(!names()?.contains(&name));
        Ok(())
    }

    #[test]
    fn finished_files_are_not_abandoned() -> Checked {
        let folder = tempfile::tempdir()?;
        let [finished, open] =
            [Temporary::create(folder.path())?, Temporary::create(folder.path())?];
        let listed = |file: &Temporary| all().contains(file.file.path());
        assert!(listed(&finished) && listed(&open));
        let temporary = finished.file.path().to_owned();
        let missing = folder.path().join("missing").join("y");
        let [late, last] = [Temporary::create(folder.path())?, Temporary::create(folder.path())?];
        let files = vec![
            (finished, folder.path().join("x")),
            (late, missing),
            (last, folder.path().join("z")),
        ];
        let (failed, _) = Temporary::persist(files).expect_err("there is no such folder");
        assert_eq!(failed, 1);
        assert!(!folder.path().join("z").exists());
        assert!(!all().contains(&temporary) && listed(&open));
        assert!(folder.path().join("x").is_file());
        Ok(())
    }
}

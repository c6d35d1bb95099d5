//! What decides where the library is searched for. Tests make their own.

use std::{
    collections::BTreeMap,
    ffi::OsString,
    path::{Path, PathBuf},
};

/// The folders in which the system's loader looks first, separated as in `PATH`.
pub(crate) const LOADER_PATH: &str = if cfg!(windows) {
    "PATH"
} else if cfg!(target_os = "macos") {
    "DYLD_LIBRARY_PATH"
} else {
    "LD_LIBRARY_PATH"
};

/// Names the library, or its folder.
pub(crate) const OIDN_LIBRARY: &str = "OIDN_LIBRARY";

const VARIABLES: [&str; 6] = [OIDN_LIBRARY, LOADER_PATH, "PATH", "VIRTUAL_ENV", "HOME", "APPDATA"];

/// Environment variables, and the root of the file system.
pub(crate) struct Environment {
    pub(crate) variables: BTreeMap<&'static str, OsString>,
    pub(crate) root: PathBuf,
}

impl Environment {
    /// That of this process.
    pub(crate) fn current() -> Self {
        let set = |name| std::env::var_os(name).map(|value| (name, value));
        Self { variables: VARIABLES.into_iter().filter_map(set).collect(), root: "/".into() }
    }

    /// A variable's value as a path, if it is set and not empty.
    pub(crate) fn path(&self, name: &str) -> Option<PathBuf> {
        self.variables.get(name).filter(|value| !value.is_empty()).map(PathBuf::from)
    }

    /// The folders that a variable lists.
    pub(crate) fn folders(&self, name: &str) -> Vec<PathBuf> {
        let value = self.variables.get(name);
        let folders = value.iter().flat_map(|value| std::env::split_paths(value));
        // An empty name means the working directory; nobody wants to load code from there.
        folders.filter(|folder| !folder.as_os_str().is_empty()).collect()
    }

    /// An absolute path of the system.
    pub(crate) fn system(&self, path: &Path) -> PathBuf {
        self.root.join(path.strip_prefix("/").unwrap_or(path))
    }
}

/// What is in a folder, by name; nothing if it cannot be read.
pub(crate) fn entries(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

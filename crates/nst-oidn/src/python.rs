//! The folders of Python's packages, found by their usual names: running Python to ask for
//! them would take longer than all other searches.

use std::{
    cmp::Reverse,
    path::{Path, PathBuf},
};

use crate::environment::{Environment, entries};

/// The folder of the library within those of packages: the package `pyoidn` brings it along.
const PACKAGE: &str = if cfg!(windows) { "pyoidn/oidn/bin" } else { "pyoidn/oidn/lib" };

/// The folders that may contain the library.
pub(crate) fn folders(environment: &Environment) -> Vec<PathBuf> {
    let packages = prefixes(environment).into_iter().flat_map(|prefix| packages(&prefix));
    let all = packages.chain(user_packages(environment));
    all.map(|folder| folder.join(PACKAGE)).collect()
}

/// Where Pythons are installed: the active environment, and that of the first `python3` on
/// the `PATH`.
fn prefixes(environment: &Environment) -> Vec<PathBuf> {
    let mut prefixes: Vec<PathBuf> = environment.path("VIRTUAL_ENV").into_iter().collect();
    let program = if cfg!(windows) { "python.exe" } else { "python3" };
    let on_path = environment.folders("PATH").into_iter();
    if let Some(folder) = on_path.into_iter().find(|folder| folder.join(program).is_file()) {
        prefixes.extend(prefix_of(&folder));
        let linked = folder.join(program).canonicalize().ok();
        prefixes.extend(linked.as_deref().and_then(Path::parent).and_then(prefix_of));
    }
    // Where Debian's Python has its own packages, and where it installs others.
    if prefixes.contains(&environment.system(Path::new("/usr"))) {
        prefixes.push(environment.system(Path::new("/usr/local")));
    }
    prefixes
}

/// The prefix of a Python whose program is in this folder.
fn prefix_of(folder: &Path) -> Option<PathBuf> {
    let is_below = !cfg!(windows) || folder.ends_with("Scripts");
    if is_below { folder.parent().map(Path::to_owned) } else { Some(folder.to_owned()) }
}

/// The folders of packages below a prefix, newer versions of Python first.
fn packages(prefix: &Path) -> Vec<PathBuf> {
    if cfg!(windows) {
        return vec![prefix.join("Lib").join("site-packages")];
    }
    let versions = by_version(&prefix.join("lib"), "python3");
    let names = ["site-packages", "dist-packages"];
    versions.iter().flat_map(|version| names.map(|name| version.join(name))).collect()
}

/// The folders of packages that belong to the user alone.
fn user_packages(environment: &Environment) -> Vec<PathBuf> {
    if cfg!(windows) {
        let base = environment.path("APPDATA").map(|folder| folder.join("Python"));
        let versions = base.map(|base| by_version(&base, "Python3")).unwrap_or_default();
        return versions.iter().map(|version| version.join("site-packages")).collect();
    }
    let Some(home) = environment.path("HOME") else { return Vec::new() };
    let mut folders = packages(&home.join(".local"));
    if cfg!(target_os = "macos") {
        let versions = by_version(&home.join("Library").join("Python"), "3.");
        folders.extend(versions.iter().map(|version| version.join("lib/python/site-packages")));
    }
    folders
}

/// What is in a folder and begins so, as `python3.11` does, the highest number first.
fn by_version(folder: &Path, begin: &str) -> Vec<PathBuf> {
    let number = |path: &PathBuf| {
        let name = path.file_name()?.to_str()?;
        let rest = name.strip_prefix(begin)?.trim_start_matches('.');
        if rest.is_empty() { Some(0) } else { rest.parse::<u32>().ok() }
    };
    let mut versions: Vec<_> =
        entries(folder).into_iter().filter_map(|path| Some((number(&path)?, path))).collect();
    versions.sort_by_key(|&(number, _)| Reverse(number));
    versions.into_iter().map(|(_, path)| path).collect()
}

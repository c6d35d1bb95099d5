//! The folders in which the system's loader looks for libraries. They are searched here, and
//! the loader is given a file: asked for a name, it would not say in advance which file it
//! takes.

use std::path::{Path, PathBuf};

use crate::environment::{Environment, LOADER_PATH, entries};

/// `/etc/ld.so.conf` may include files that include files; so deep, none does in earnest.
const DEEPEST_INCLUDE: usize = 8;

/// The folders, first those where the loader looks first.
pub(crate) fn folders(environment: &Environment) -> Vec<PathBuf> {
    let mut folders = environment.folders(LOADER_PATH);
    if cfg!(target_os = "linux") {
        configured(environment, Path::new("/etc/ld.so.conf"), DEEPEST_INCLUDE, &mut folders);
    }
    // man ld.so: without a word in its configuration, glibc looks into the first four; musl
    // also into the fifth. Homebrew is where macOS's users have libraries, and MacPorts.
    let usual: &[&str] = if cfg!(windows) {
        &[]
    } else if cfg!(target_os = "macos") {
        &["/usr/local/lib", "/opt/homebrew/lib", "/opt/local/lib"]
    } else {
        &["/lib64", "/usr/lib64", "/lib", "/usr/lib", "/usr/local/lib"]
    };
    folders.extend(usual.iter().map(|folder| environment.system(Path::new(folder))));
    folders
}

/// Appends the folders that a file of glibc's loader names: one a line, and
/// `include PATTERN` (man ldconfig).
fn configured(environment: &Environment, file: &Path, depth: usize, folders: &mut Vec<PathBuf>) {
    let text = std::fs::read_to_string(environment.system(file)).unwrap_or_default();
    for line in text.lines() {
        let line = line.split('#').next().unwrap_or_default().trim();
        if let Some(pattern) = line.strip_prefix("include").map(str::trim_start) {
            // A pattern counts from the folder of its file.
            let pattern = file.with_file_name(pattern);
            for file in matching(environment, &pattern) {
                if depth > 0 {
                    configured(environment, &file, depth - 1, folders);
                }
            }
        } else if line.starts_with('/') {
            folders.push(environment.system(Path::new(line)));
        }
    }
}

/// The files that a pattern names: its last part may have one `*`.
fn matching(environment: &Environment, pattern: &Path) -> Vec<PathBuf> {
    let name = pattern.file_name().unwrap_or_default().to_string_lossy();
    let Some((begin, end)) = name.split_once('*') else { return vec![pattern.to_owned()] };
    let Some(folder) = pattern.parent() else { return Vec::new() };
    let names = entries(&environment.system(folder)).into_iter();
    let names = names.filter_map(|path| path.file_name().map(ToOwned::to_owned));
    let matches = |name: &str| {
        name.len() >= begin.len() + end.len() && name.starts_with(begin) && name.ends_with(end)
    };
    names.filter(|name| matches(&name.to_string_lossy())).map(|name| folder.join(name)).collect()
}

//! The user's folder of caches: references of earlier benches, and locks of tables.

use std::{
    fs::File,
    path::{Path, PathBuf},
};

use sha2::{Digest, Sha256};

use crate::error::Error;

/// A folder `nst/NAME` in the user's folder of caches, which is made where it is missing.
pub(super) fn folder(name: &str) -> Result<PathBuf, Error> {
    let of = |variable: &str| std::env::var_os(variable).filter(|it| !it.is_empty());
    let caches = of("XDG_CACHE_HOME")
        .map(PathBuf::from)
        .or_else(|| of("HOME").map(|home| PathBuf::from(home).join(".cache")))
        .or_else(|| of("LOCALAPPDATA").map(PathBuf::from))
        .unwrap_or_else(std::env::temp_dir);
    let folder = caches.join("nst").join(name);
    std::fs::create_dir_all(&folder).map_err(|error| {
        Error::Unlike(format!(
            "cannot make the folder '{}' for {name}: {error}; name another one with the \
             environment variable XDG_CACHE_HOME",
            folder.display()
        ))
    })?;
    Ok(folder)
}

/// Keeps other processes of this user from writing a table until it is dropped; waits for one
/// that does. `None` where files cannot be locked: two benches may then lose rows of each other
/// if they write in the same moment.
pub(super) fn lock(table: &Path) -> Option<File> {
    let parent = table.parent().filter(|parent| *parent != Path::new(""));
    let place = parent.unwrap_or(Path::new(".")).canonicalize().ok()?.join(table.file_name()?);
    let name = hash([place.as_os_str().as_encoded_bytes()]);
    let file = File::create(folder("locks").ok()?.join(name)).ok()?;
    file.lock().ok()?;
    Some(file)
}

/// The first 64 bits of the SHA-256 of these bytes, as 16 hexadecimal digits: enough to tell a
/// user's files apart.
pub(super) fn hash<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> String {
    let mut hash = Sha256::new();
    parts.into_iter().for_each(|part| hash.update(part));
    hash.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect()
}

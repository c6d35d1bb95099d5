//! Errors of scene files, with the place where they are.

use std::path::Path;

use crate::Error;

/// `message`, in this line of a file.
pub(super) fn error_at(path: &Path, line: usize, message: impl AsRef<str>) -> Error {
    scene_error(path, &format!("line {line}: {}", message.as_ref()))
}

/// An error of a scene file, however long the words are that it quotes.
pub(super) fn scene_error(path: &Path, message: &str) -> Error {
    const MOST: usize = 1000;
    match message.char_indices().nth(MOST) {
        None => Error::scene(path, message),
        Some((end, _)) => Error::scene(path, format!("{}…", &message[..end])),
    }
}

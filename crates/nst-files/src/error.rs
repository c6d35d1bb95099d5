//! The errors of this crate.

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::magic;

/// What can go wrong with files. The messages name the file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be opened, read or written.
    #[error("cannot {action} '{}': {source}", path.display())]
    Io {
        /// `read` or `write`.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file is malformed, or is not what it is used as.
    #[error("'{}': {message}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// An output would replace an input, another output, or a file that must not be lost.
    #[error("'{}' is not written: {message}", path.display())]
    Output {
        /// The output.
        path: PathBuf,
        /// What it would replace, and what to do about it.
        message: String,
    },
    /// Data that are to be written, or combined, do not fit together.
    #[error("{0}")]
    Mismatch(String),
    /// Sequences that do not fit together.
    #[error(transparent)]
    Core(#[from] nst_core::Error),
}

impl Error {
    pub(crate) fn io(action: &'static str, path: &Path, source: std::io::Error) -> Self {
        Self::Io { action, path: path.to_owned(), source }
    }

    pub(crate) fn malformed(path: &Path, message: impl Into<String>) -> Self {
        Self::Malformed { path: path.to_owned(), message: message.into() }
    }

    pub(crate) fn output(path: &Path, message: impl Into<String>) -> Self {
        Self::Output { path: path.to_owned(), message: message.into() }
    }

    /// An error of the exr crate while it reads or writes a file.
    pub(crate) fn exr(action: &'static str, path: &Path, error: exr::error::Error) -> Self {
        match error {
            exr::error::Error::Io(error) => Self::io(action, path, error),
            error if action == "read" => {
                Self::malformed(path, unreadable(path, &error.to_string()))
            }
            error => Self::malformed(path, error.to_string()),
        }
    }
}

/// Why a file cannot be read as EXR; `why` is what its reader says.
fn unreadable(path: &Path, why: &str) -> String {
    match magic::start(path).as_deref() {
        Ok([]) => "the file is empty".to_owned(),
        Ok(start) if start != magic::EXR => "not an EXR file".to_owned(),
        _ => format!("not a readable EXR file, or cut off: {why}"),
    }
}

impl From<Error> for nst_core::Error {
    fn from(error: Error) -> Self {
        match error {
            Error::Core(error) => error,
            error => Self::Input(Box::new(error)),
        }
    }
}

use std::path::{Path, PathBuf};

use thiserror::Error;

/// What can go wrong in this crate; every message names the file it is about.
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
    /// A scene file is malformed.
    #[error("scene '{}': {message}", path.display())]
    Scene {
        /// The OBJ, MTL or TOML file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// An image or sequence file is malformed, or is not what it is used as.
    #[error("'{}': {message}", path.display())]
    Image {
        /// The image file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// Settings that cannot be rendered.
    #[error("{0}")]
    Settings(String),
    /// Sequences that do not fit together.
    #[error(transparent)]
    Core(#[from] nst_core::Error),
}

impl Error {
    pub(crate) fn io(action: &'static str, path: &Path, source: std::io::Error) -> Self {
        Self::Io { action, path: path.to_owned(), source }
    }

    pub(crate) fn scene(path: &Path, message: impl Into<String>) -> Self {
        Self::Scene { path: path.to_owned(), message: message.into() }
    }

    pub(crate) fn image(path: &Path, message: impl Into<String>) -> Self {
        Self::Image { path: path.to_owned(), message: message.into() }
    }
}

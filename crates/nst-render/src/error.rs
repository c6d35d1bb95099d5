use std::path::{Path, PathBuf};

use thiserror::Error;

/// What can go wrong in this crate; every message names the file it is about.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// A file of a scene could not be opened or read.
    #[error("cannot read '{}': {source}", path.display())]
    Io {
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
    /// An image of a scene is malformed, or is not what it is used as.
    #[error("'{}': {message}", path.display())]
    Image {
        /// The image file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// An EXR image of a scene cannot be read.
    #[error(transparent)]
    Files(#[from] nst_files::Error),
    /// Settings that cannot be rendered.
    #[error("{0}")]
    Settings(String),
    /// A rendering that does not fit the memory.
    #[error("the rendering needs {needed} of memory, and {available} are free; {advice}")]
    Memory {
        /// As text, with the unit.
        needed: String,
        /// As text, with the unit.
        available: String,
        /// What would fit.
        advice: String,
    },
    /// Sequences that do not fit together.
    #[error(transparent)]
    Core(#[from] nst_core::Error),
}

impl Error {
    pub(crate) fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), source }
    }

    pub(crate) fn scene(path: &Path, message: impl Into<String>) -> Self {
        Self::Scene { path: path.to_owned(), message: message.into() }
    }

    pub(crate) fn image(path: &Path, message: impl Into<String>) -> Self {
        Self::Image { path: path.to_owned(), message: message.into() }
    }
}

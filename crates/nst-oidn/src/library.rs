//! The library, loaded.

use std::{
    fmt,
    path::{Path, PathBuf},
    sync::Arc,
};

use crate::{
    Candidate, Error, candidates,
    ffi::{Functions, LoadError},
};

/// Open Image Denoise 2, loaded. It stays loaded as long as the process lives.
#[derive(Clone)]
pub struct Library {
    path: PathBuf,
    functions: Arc<Functions>,
}

impl Library {
    /// Loads the first of the [`candidates`] that can be; `None` if there are none.
    /// `before` sees each before it is loaded: a damaged library may end the process, and
    /// users should know then which one it was.
    ///
    /// # Errors
    /// [`Error::Missing`], or why the first candidate cannot be loaded, if none can be.
    pub fn find(mut before: impl FnMut(&Candidate)) -> Result<Option<Self>, Error> {
        let mut first_error = None;
        for candidate in candidates()? {
            before(&candidate);
            match Self::load(candidate.path()) {
                Ok(library) => return Ok(Some(library)),
                Err(error) => drop(first_error.get_or_insert(error)),
            }
        }
        first_error.map_or(Ok(None), Err)
    }

    /// Loads a library. This runs code of it.
    ///
    /// # Errors
    /// [`Error::Load`], [`Error::VersionOne`] or [`Error::Function`].
    pub fn load(path: &Path) -> Result<Self, Error> {
        // The system's loader would search for a name without a folder, and the library
        // looks for its other files beside itself.
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        match Functions::load(&path) {
            Ok(functions) => Ok(Self { path, functions: Arc::new(functions) }),
            Err(LoadError::Loader(reason)) => Err(Error::Load { path, reason }),
            Err(LoadError::VersionOne) => Err(Error::VersionOne { path }),
            Err(LoadError::Function(function)) => Err(Error::Function { path, function }),
        }
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn functions(&self) -> &Arc<Functions> {
        &self.functions
    }
}

impl fmt::Debug for Library {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Library").field("path", &self.path).finish_non_exhaustive()
    }
}

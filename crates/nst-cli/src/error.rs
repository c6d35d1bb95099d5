//! The errors of commands, and the exit codes.

use std::path::PathBuf;

use thiserror::Error;

/// Why a command failed, in words for the user.
#[derive(Debug, Error)]
pub(crate) enum Error {
    #[cfg(feature = "render")]
    #[error(transparent)]
    Render(#[from] nst_render::Error),
    #[error(transparent)]
    Files(#[from] nst_files::Error),
    #[error(transparent)]
    Core(nst_core::Error),
    #[error("weights '{}': {source}", path.display())]
    Weights { path: PathBuf, source: nst_core::Error },
    #[error("cannot write '{}': {source}", path.display())]
    Csv { path: PathBuf, source: csv::Error },
    #[error("--backend gpu: {0}; --backend cpu needs none")]
    Gpu(nst_core::Error),
    /// The transformation failed; the samples are saved.
    #[error("the transformation failed: {why}; {saved}")]
    Transform { why: String, saved: String },
    /// Files that do not fit together; the message names them.
    #[error("{0}")]
    Unlike(String),
    #[error("cannot write to standard output: {0}")]
    Stdout(std::io::Error),
    #[error("cannot watch for Ctrl-C: {0}")]
    Signals(std::io::Error),
    /// A signal ended the job before there was anything to report; it has an exit code of
    /// its own.
    #[error("{0}")]
    Interrupted(String),
    /// The command line is wrong; the exit code is 2.
    #[error("{0}")]
    Usage(String),
}

impl From<nst_core::Error> for Error {
    fn from(error: nst_core::Error) -> Self {
        match error {
            // Without --backend gpu, the CPU takes over.
            nst_core::Error::Gpu(_) | nst_core::Error::NoAdapter(_) => Self::Gpu(error),
            error => Self::Core(error),
        }
    }
}

impl Error {
    /// 2 if the command line must be changed, else 1.
    pub(crate) fn exit_code(&self) -> u8 {
        match self {
            Self::Usage(_) | Self::Files(nst_files::Error::Output { .. }) => 2,
            _ => 1,
        }
    }
}

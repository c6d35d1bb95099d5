//! The errors of this crate.

use std::path::PathBuf;

use thiserror::Error;

use crate::version::Version;

/// What a user can do about a library that is of no use.
const REMEDY: &str = "install Open Image Denoise 2 (Python's package pyoidn contains it), or let \
                      OIDN_LIBRARY name another file";

/// What can go wrong with Open Image Denoise. The messages name the library's file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// `OIDN_LIBRARY` names nothing that could be loaded.
    #[error(
        "OIDN_LIBRARY: '{}' is neither a file nor a folder with {name}; correct it, or unset it, \
         and the usual places are searched", path.display()
    )]
    Missing {
        /// What the variable says.
        path: PathBuf,
        /// The library's file name on this system.
        name: &'static str,
    },
    /// The system's loader refuses the file.
    #[error("'{}' cannot be loaded: {reason}; {REMEDY}", path.display())]
    Load {
        /// The library.
        path: PathBuf,
        /// What the loader says.
        reason: String,
    },
    /// The library is Open Image Denoise 1, whose functions are others.
    #[error("'{}' is Open Image Denoise 1; {REMEDY}", path.display())]
    VersionOne {
        /// The library.
        path: PathBuf,
    },
    /// The library is of another major version than 2.
    #[error("'{}' is Open Image Denoise {version}; {REMEDY}", path.display())]
    Version {
        /// The library.
        path: PathBuf,
        /// What it says it is.
        version: Version,
    },
    /// The library lacks a function that every version 2 has.
    #[error("'{}' has no function {function}: it is not Open Image Denoise 2; {REMEDY}", path.display())]
    Function {
        /// The library.
        path: PathBuf,
        /// The function's name in C.
        function: &'static str,
    },
    /// The library finds no device that it can use, or cannot use the one it chose.
    #[error(
        "'{}' has no device: {reason}; its files OpenImageDenoise_device_* must be beside it, \
         and OIDN_DEFAULT_DEVICE=cpu lets it use the CPU", path.display()
    )]
    Device {
        /// The library.
        path: PathBuf,
        /// What the library says.
        reason: String,
    },
    /// The library failed while it denoised.
    #[error("'{}' failed to {action}: {reason}", path.display())]
    Failed {
        /// The library.
        path: PathBuf,
        /// What it was to do.
        action: &'static str,
        /// What the library says.
        reason: String,
    },
    /// The library returned infinities or NaN.
    #[error("'{}' returned {count} values that are not finite", path.display())]
    Rubbish {
        /// The library.
        path: PathBuf,
        /// How many.
        count: usize,
    },
    /// The image has no pixels, or more than can be counted.
    #[error("an image of {width} × {height} pixels cannot be denoised")]
    Size {
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// A layer has another size than the image.
    #[error("{layer}: {values} values instead of {expected}, three per pixel")]
    Length {
        /// `color`, `albedo`, `normal` or `output`.
        layer: &'static str,
        /// How many values it has.
        values: usize,
        /// How many it should have.
        expected: usize,
    },
    /// A layer of the input has infinities or NaN.
    #[error(
        "{layer}: {count} values are not finite, the first in column {column} of row {row}; \
         they must be replaced before denoising"
    )]
    NotFinite {
        /// `color`, `albedo` or `normal`.
        layer: &'static str,
        /// How many.
        count: usize,
        /// The first one's column, from 0.
        column: usize,
        /// The first one's row, from 0.
        row: usize,
    },
    /// The input scale is not above 0, or not finite.
    #[error("colours cannot be denoised at a scale of {scale}")]
    Scale {
        /// The scale.
        scale: f32,
    },
    /// Normals without albedo: Open Image Denoise has no network for these.
    #[error("normals help only beside albedo; give both, or neither")]
    NormalAlone,
}

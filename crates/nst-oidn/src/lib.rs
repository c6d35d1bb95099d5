//! Open Image Denoise 2, found and loaded at run time.
//!
//! A [`Library`] is what [`candidates`] found, loaded; a [`Device`] of it denoises an
//! [`Image`]. The device is the one that Open Image Denoise prefers: a GPU, or the CPU.
//!
//! ```no_run
//! # fn main() -> Result<(), nst_oidn::Error> {
//! # let (color, mut denoised) = (vec![0.0; 3 * 64 * 48], vec![0.0; 3 * 64 * 48]);
//! let library = nst_oidn::Library::find(|candidate| eprintln!("loading {candidate}"))?;
//! if let Some(library) = library {
//!     let device = nst_oidn::Device::new(&library)?;
//!     let image = nst_oidn::Image { hdr: true, ..nst_oidn::Image::new(64, 48, &color) };
//!     device.denoise(&image, &mut denoised)?;
//! }
//! # Ok(())
//! # }
//! ```
//!
//! Loading a library runs code of it, and a damaged one may end the process. That is why
//! [`Library::find`] names each file before it is loaded.

mod candidates;
mod device;
mod environment;
mod error;
mod ffi;
mod image;
mod library;
mod python;
mod system;
mod version;

pub use candidates::{Candidate, Source, candidates};
pub use device::{Device, DeviceKind, Tiling};
pub use error::Error;
pub use image::Image;
pub use library::Library;
pub use version::Version;

//! From a scene to sequences: a path tracer that records, for every pixel, the
//! progressive estimates S_1 … S_N of its radiance.
//!
//! Data flow one way: [`Scene::load`] reads OBJ, MTL and the TOML sidecar;
//! [`render()`] traces paths and accumulates a [`nst_core::SequenceBatch`];
//! [`sequence_file`] and [`film`] read and write EXR and PNG.
//!
//! Lanes are planar: lane = channel · width · height + y · width + x, with the
//! channels R, G, B in linear sRGB primaries and y counted from the top.

mod accelerator;
mod bsdf;
mod camera;
mod color;
pub mod dataset;
mod environment;
mod error;
mod exr_file;
pub mod exr_header;
mod exr_rows;
pub mod false_color;
pub mod film;
mod instructions;
mod kept;

mod light;
mod load;
mod material;
pub mod merge;
pub mod output;
pub mod pack;
mod packet;
mod path;
pub mod picture;
mod render;
mod sampler;
mod scene;
pub mod sequence_file;
mod sums;
mod texture;
mod tiles;

pub use camera::{Camera, PixelFilter};
pub use error::Error;
pub use material::{Disney, Material, Scattering};
pub use render::{
    Control, Keep, RenderSettings, Rendering, VARIANCE, fold_name, render, render_from,
};
pub use sampler::{SampleStream, Sampler, SamplerKind};
pub use scene::{Environment, Scene, Triangle};
pub use sums::{FOLDS, LaneSums};
pub use texture::Texture;

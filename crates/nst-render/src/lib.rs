//! From a scene to sequences: a path tracer that records, for every pixel, the
//! progressive estimates S_1 … S_N of its radiance.
//!
//! Data flow one way: [`Scene::load`] reads OBJ, MTL and the TOML sidecar;
//! [`render()`] traces paths and accumulates the sums that a [`nst_core::SequenceBatch`] of some
//! rows, or of all, is made from.
//!
//! Lanes are planar: lane = channel · width · height + y · width + x, with the
//! channels R, G, B in linear sRGB primaries and y counted from the top.

mod accelerator;
mod bands;
mod bsdf;
mod camera;
mod color;
mod develop;
mod environment;
mod error;
mod estimate;
mod feature_planes;
mod film;
mod instructions;
mod light;
mod load;
mod material;
mod memory;
mod packet;
mod path;
mod render;
mod rendering;
mod sampler;
mod scene;
mod settings;
mod slots;
mod texture;
mod tiles;

pub use bands::{Band, Consumer};
pub use camera::{Camera, PixelFilter};
pub use error::Error;
pub use estimate::Estimator;
pub use instructions::instruction_set;
pub use load::{Lighting, LoadOptions, View};
pub use material::{Disney, Material, Relief, Scattering};
pub use memory::check_memory;
pub use render::{Control, render, render_from, render_to};
pub use rendering::{Rendering, RenderingStrips};
pub use sampler::{SampleStream, Sampler, SamplerKind};
pub use scene::{Environment, Scene, Triangle};
pub use settings::{RenderSettings, Start};
pub use texture::{Texture, TextureMap};

//! Reads a scene: OBJ and MTL files, the images that they name, and the TOML
//! sidecar beside them. `docs/scenes.md` describes the formats.

mod exact;
mod files;
mod image;
mod keys;
mod mtl;
mod obj;
mod place;
mod polygon;
mod ranges;
mod report;
mod sidecar;
mod text;
mod units;

use std::path::Path;

use glam::Vec3A;

use crate::{Camera, Environment, Error, Scene, Triangle, scene::bounds};

use self::{
    exact::length_squared, image::Images, obj::Loaded, report::Report, sidecar::Sidecar,
    units::Placement,
};

/// A square picture that needs seconds, not minutes.
const DEFAULT_SIZE: [u32; 2] = [512, 512];
/// Enough for light from several walls; further vertices add little but time.
const DEFAULT_MAX_DEPTH: u32 = 8;
/// In degrees, of the camera that frames a scene: as a lens of 50 mm sees the longer
/// side of a small picture, without much distortion.
const DEFAULT_FOV: f32 = 40.0;
/// sin(`DEFAULT_FOV` / 2), as f32. A constant, as machines differ in their sines.
const SIN_HALF_FOV: f32 = 0.342_020_12;

/// How to read a scene.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// Refuses what would otherwise be forgiven with a note.
    pub strict: bool,
}

impl Scene {
    /// Reads a scene with the default options.
    ///
    /// # Errors
    /// As [`Self::load_with`].
    pub fn load(path: &Path) -> Result<Self, Error> {
        Self::load_with(path, &LoadOptions::default())
    }

    /// Reads an OBJ file, the MTL files and images that it names, and the sidecar
    /// (`x.toml` beside `x.obj`) if there is one. What the files leave open gets
    /// a default, which [`Scene::notes`] names.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Scene`] or [`Error::Image`] names the file, where
    /// in it, and what is wrong.
    pub fn load_with(path: &Path, options: &LoadOptions) -> Result<Self, Error> {
        let mut report = Report::new(options.strict);
        let mut images = Images::default();
        let Loaded { triangles, vertex_colors, mut materials, placement } =
            obj::load(path, &mut images, &mut report)?;

        let sidecar_path = path.with_extension("toml");
        let sidecar = Sidecar::read(&sidecar_path, &mut materials, &mut images, &mut report)?;
        let camera = match sidecar.camera {
            Some((position, target, camera)) => {
                let [position, target] = [position, target].map(|p| placement.point(p).as_vec3a());
                let camera = Camera { position, target, ..camera };
                if !Placement::is_distinct(&camera, &triangles) {
                    let message =
                        "[camera] is too far from the scene, or too near its target, for f32";
                    return Err(Error::scene(&sidecar_path, message));
                }
                camera
            }
            None => {
                report.note("no camera is given: it frames the bounding box");
                framing_camera(&triangles)
            }
        };
        let lit = triangles.iter().any(|t| materials[t.material as usize].emits());
        let environment = sidecar.environment.unwrap_or_else(|| {
            if lit {
                return Environment::default();
            }
            report.note("nothing emits light: a uniform white environment does");
            Environment { radiance: Vec3A::ONE, ..Default::default() }
        });
        Ok(Self {
            name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            triangles,
            vertex_colors,
            materials,
            camera,
            size: sidecar.size.unwrap_or(DEFAULT_SIZE),
            max_depth: sidecar.max_depth.unwrap_or(DEFAULT_MAX_DEPTH),
            russian_roulette: sidecar.russian_roulette.unwrap_or(true),
            pixel_filter: Default::default(),
            environment,
            notes: report.notes(),
            inputs: report.inputs,
        })
    }
}

/// Looks at the middle of the bounding box from the front, a little from the
/// right and from above, so far away that its bounding sphere fills the picture.
fn framing_camera(triangles: &[Triangle]) -> Camera {
    let (low, high) = bounds(triangles);
    let target = low * 0.5 + high * 0.5;
    let radius = length_squared(high - low).sqrt() / 2.0;
    let distance = radius / SIN_HALF_FOV;
    let direction = Vec3A::new(0.5, 0.35, 1.0);
    let direction = direction / length_squared(direction).sqrt();
    Camera {
        position: target + direction * distance,
        target,
        up: Vec3A::Y,
        vertical_fov: DEFAULT_FOV,
    }
}

#[cfg(test)]
mod tests;

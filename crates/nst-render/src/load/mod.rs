//! Reads a scene: OBJ and MTL files, the images that they name, and the TOML
//! sidecar beside them. `docs/scenes.md` describes the formats.

mod exact;
mod files;
mod glass;
mod image;
mod keys;
mod maps;
mod mtl;
mod obj;
mod opacity;
mod polygon;
mod ranges;
mod report;
mod sidecar;
mod text;
mod tidy;
mod units;

use std::path::Path;

use glam::Vec3A;

use crate::{Camera, Environment, Error, Scene, Triangle, scene::bounds};

use self::{exact::length_squared, image::Images, report::Report, sidecar::Sidecar, units::Unit};

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
        let (mut triangles, mut materials) = obj::load(path, &mut images, &mut report)?;
        let unit = Unit::of(&triangles);
        unit.scale(&mut triangles, &mut report);
        unit.scale_bumps(&mut materials);
        drop_degenerate(path, &mut triangles, &mut report)?;

        let sidecar_path = path.with_extension("toml");
        let sidecar = Sidecar::read(&sidecar_path, &mut materials, &mut images, &mut report)?;
        let camera = match sidecar.camera {
            Some(camera) => unit.scale_camera(camera, &triangles).ok_or_else(|| {
                let message = "[camera] is too far from the scene, or too near its target, for f32";
                Error::scene(&sidecar_path, message)
            })?,
            None => {
                report.note("no camera is given: it frames the bounding box");
                framing_camera(&triangles)
            }
        };
        glass::settle(&mut triangles, &mut materials, &mut report);
        opacity::settle(&triangles, &mut materials, &mut report);
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

/// Leaves out the triangles that have no direction: f32 cannot even square their areas.
fn drop_degenerate(
    path: &Path,
    triangles: &mut Vec<Triangle>,
    report: &mut Report,
) -> Result<(), Error> {
    let all = triangles.len();
    triangles.retain(|triangle| length_squared(triangle.area_vector()).is_normal());
    if triangles.is_empty() {
        let message = "all of its faces have zero area; there is nothing to render";
        return Err(Error::scene(path, message));
    }
    if triangles.len() < all {
        report.note(format!("triangles of zero area, left out: {}", all - triangles.len()));
    }
    Ok(())
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

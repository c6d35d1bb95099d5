//! Reads a scene: OBJ and MTL files, the images that they name, and the TOML
//! sidecar beside them. `docs/scenes.md` describes the formats.

mod files;
mod image;
mod keys;
mod mtl;
mod obj;
mod polygon;
mod sidecar;
mod text;
mod tidy;
mod units;

use std::path::Path;

use glam::Vec3A;

use crate::{Camera, Environment, Error, Scene, Triangle, scene::bounds};

use self::{image::Images, sidecar::Sidecar, units::Unit};

const DEFAULT_SIZE: [u32; 2] = [512, 512];
const DEFAULT_MAX_DEPTH: u32 = 8;
const DEFAULT_FOV: f32 = 40.0;

impl Scene {
    /// Reads an OBJ file, the MTL files and images that it names, and the sidecar
    /// (`x.toml` beside `x.obj`) if there is one. What the files leave open gets
    /// a default, which [`Scene::defaults`] names.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Scene`] or [`Error::Image`] names the file, where
    /// in it, and what is wrong.
    pub fn load(path: &Path) -> Result<Self, Error> {
        let mut defaults = Vec::new();
        let mut images = Images::default();
        let (mut triangles, mut materials) = obj::load(path, &mut images, &mut defaults)?;
        let unit = Unit::of(&triangles);
        unit.scale(&mut triangles, &mut defaults);
        drop_degenerate(path, &mut triangles, &mut defaults)?;

        let sidecar_path = path.with_extension("toml");
        let sidecar = Sidecar::read(&sidecar_path, &mut materials, &mut images, &mut defaults)?;
        let camera = match sidecar.camera {
            Some(camera) => unit.scale_camera(camera, &triangles).ok_or_else(|| {
                let message = "[camera] is too far from the scene, or too near its target, for f32";
                Error::scene(&sidecar_path, message)
            })?,
            None => {
                defaults.push("a camera that frames the bounding box".to_owned());
                framing_camera(&triangles)
            }
        };
        let lit = triangles.iter().any(|t| materials[t.material as usize].emits());
        let environment = sidecar.environment.unwrap_or_else(|| {
            if lit {
                return Environment::default();
            }
            defaults.push("a uniform white environment, as nothing emits light".to_owned());
            Environment { radiance: Vec3A::ONE, image: None }
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
            defaults,
        })
    }
}

/// Leaves out the triangles that have no direction: f32 cannot even square their areas.
fn drop_degenerate(
    path: &Path,
    triangles: &mut Vec<Triangle>,
    defaults: &mut Vec<String>,
) -> Result<(), Error> {
    let all = triangles.len();
    triangles.retain(|triangle| triangle.area_vector().length_squared().is_normal());
    if triangles.is_empty() {
        let message = "all of its faces have zero area; there is nothing to render";
        return Err(Error::scene(path, message));
    }
    if triangles.len() < all {
        defaults.push(format!("{} triangles of zero area left out", all - triangles.len()));
    }
    Ok(())
}

/// Looks at the middle of the bounding box from the front, a little from the
/// right and from above, so far away that its bounding sphere fills the picture.
fn framing_camera(triangles: &[Triangle]) -> Camera {
    let (low, high) = bounds(triangles);
    let target = low * 0.5 + high * 0.5;
    let radius = (high - low).length() / 2.0;
    let distance = radius / (DEFAULT_FOV.to_radians() / 2.0).sin();
    let direction = Vec3A::new(0.5, 0.35, 1.0).normalize();
    Camera {
        position: target + direction * distance,
        target,
        up: Vec3A::Y,
        vertical_fov: DEFAULT_FOV,
    }
}

#[cfg(test)]
mod tests;

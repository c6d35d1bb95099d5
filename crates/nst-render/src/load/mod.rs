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
mod place;
mod polygon;
mod ranges;
mod report;
mod room;
mod sidecar;
mod studio;
mod text;
mod units;
mod view;

use std::path::Path;

use crate::{Error, Scene};

use self::{image::Images, obj::Loaded, report::Report, sidecar::Sidecar, studio::Stage};
pub use self::{studio::Lighting, view::View};

/// A square picture that needs seconds, not minutes.
const DEFAULT_SIZE: [u32; 2] = [512, 512];
/// Enough for light from several walls; further vertices add little but time.
const DEFAULT_MAX_DEPTH: u32 = 8;

/// The radiance of white paper in the sun of a picture. What emits no more than this is meant
/// to glow, as signs and screens do, not to light a scene: many programs write colours of
/// 0 to 1 there.
const WHITE: f32 = 1.0;

/// How to read a scene.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// Refuses what would otherwise be forgiven with a note.
    pub strict: bool,
    /// The camera, as far as it is to differ from the sidecar's.
    pub view: View,
    /// Width and height of the film in pixels, if it is to differ from the sidecar's.
    pub size: Option<[u32; 2]>,
    /// The light that replaces the environment.
    pub lighting: Option<Lighting>,
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
        let Loaded { mut triangles, vertex_colors, mut materials, placement } =
            obj::load(path, &mut images, &mut report)?;
        placement.scale_bumps(&mut materials);
        let sidecar_path = path.with_extension("toml");
        let sidecar = Sidecar::read(&sidecar_path, &mut materials, &mut images, &mut report)?;
        glass::settle(&mut triangles, &mut materials, &mut report);
        opacity::settle(&triangles, &mut materials, &mut report);
        let size = options.size.or(sidecar.size).unwrap_or(DEFAULT_SIZE);
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        let view = options.view.or(sidecar.view);
        if view.position.is_none() {
            report.note("no camera is given: it frames the scene from the front, +z");
            if let Some(note) = room::closed_room(&triangles, &materials) {
                report.note(format!("{note} (--camera-position, --camera-target)"));
            }
        }
        let camera = view.camera(&triangles, &placement, aspect).map_err(|(part, message)| {
            if sidecar.view.has(part) && !options.view.has(part) {
                sidecar.camera_error(&sidecar_path, part, message)
            } else {
                Error::Settings(format!("the camera's {part} {message}"))
            }
        })?;
        let brightest = studio::brightest(&triangles, &materials);
        let lit = brightest > WHITE;
        let environment = match options.lighting.or(sidecar.lighting) {
            None if sidecar.environment.is_some() || lit => sidecar.environment.unwrap_or_default(),
            lighting => {
                let chosen = lighting.unwrap_or(Lighting::Studio);
                if lighting.is_none() {
                    let what =
                        if brightest > 0.0 { "nothing is a lamp" } else { "nothing emits light" };
                    report.note(format!("{what}: {} lights the scene", chosen.description()));
                }
                let (triangles, materials) = (&mut triangles, &mut materials);
                Stage { triangles, materials, camera: &camera, aspect }.light(chosen)
            }
        };
        Ok(Self {
            name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            triangles,
            vertex_colors,
            materials,
            camera,
            size,
            max_depth: sidecar.max_depth.unwrap_or(DEFAULT_MAX_DEPTH),
            russian_roulette: sidecar.russian_roulette.unwrap_or(true),
            pixel_filter: Default::default(),
            environment,
            notes: report.notes(),
            inputs: report.inputs,
        })
    }
}

#[cfg(test)]
mod tests;

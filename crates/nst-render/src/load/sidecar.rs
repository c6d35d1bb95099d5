//! The TOML file beside an OBJ file: what OBJ has no place for.

use std::{collections::BTreeMap, ops::RangeInclusive, path::Path};

use glam::Vec3A;
use serde::Deserialize;

use super::{
    files::find,
    image::Images,
    keys::{Document, Table, suggestion},
    mtl::{IOR, RADIANCE, UNIT, make_dielectric},
    text::scene_error,
};
use crate::{Camera, Disney, Environment, Error, Material, Scattering};

const TABLES: [Table; 5] = [
    Table { name: "camera", keys: &["position", "target", "up", "vertical_fov"], of_tables: false },
    Table { name: "film", keys: &["size"], of_tables: false },
    Table {
        name: "integrator",
        keys: &["kind", "max_depth", "russian_roulette"],
        of_tables: false,
    },
    Table { name: "environment", keys: &["radiance", "image"], of_tables: false },
    Table {
        name: "materials",
        keys: &[
            "color",
            "base_color",
            "emission",
            "metallic",
            "roughness",
            "specular",
            "specular_tint",
            "anisotropic",
            "sheen",
            "sheen_tint",
            "clearcoat",
            "clearcoat_gloss",
            "ior",
        ],
        of_tables: true,
    },
];

/// What the file says; what it leaves out is `None`, or the format's default.
#[derive(Debug, Default)]
pub(super) struct Sidecar {
    pub(super) camera: Option<Camera>,
    pub(super) size: Option<[u32; 2]>,
    pub(super) max_depth: Option<u32>,
    pub(super) russian_roulette: Option<bool>,
    pub(super) environment: Option<Environment>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Tables {
    camera: Option<CameraTable>,
    film: Option<FilmTable>,
    integrator: Option<IntegratorTable>,
    environment: Option<EnvironmentTable>,
    #[serde(default)]
    materials: BTreeMap<String, MaterialTable>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    position: [f32; 3],
    target: [f32; 3],
    #[serde(default = "y_axis")]
    up: [f32; 3],
    vertical_fov: f32,
}

fn y_axis() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FilmTable {
    size: [u32; 2],
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct IntegratorTable {
    #[serde(default)]
    kind: IntegratorKind,
    max_depth: Option<u32>,
    russian_roulette: Option<bool>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum IntegratorKind {
    #[default]
    Path,
    Direct,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct EnvironmentTable {
    radiance: Option<[f32; 3]>,
    image: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MaterialTable {
    #[serde(alias = "base_color")]
    color: Option<[f32; 3]>,
    emission: Option<[f32; 3]>,
    metallic: Option<f32>,
    roughness: Option<f32>,
    specular: Option<f32>,
    specular_tint: Option<f32>,
    anisotropic: Option<f32>,
    sheen: Option<f32>,
    sheen_tint: Option<f32>,
    clearcoat: Option<f32>,
    clearcoat_gloss: Option<f32>,
    ior: Option<f32>,
}

impl Sidecar {
    /// Reads the file, if there is one, and applies its overrides to `materials`.
    ///
    /// # Errors
    /// Names the line and the key that is malformed.
    pub(super) fn read(
        path: &Path,
        materials: &mut [Material],
        images: &mut Images,
        defaults: &mut Vec<String>,
    ) -> Result<Self, Error> {
        let bytes = match std::fs::read(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Ok(Self::default());
            }
            bytes => bytes.map_err(|error| Error::io("read", path, error))?,
        };
        let malformed = |message: String| scene_error(path, &message);
        let text = str::from_utf8(&bytes).map_err(|error| {
            let before = &bytes[..error.valid_up_to()];
            let line = before.iter().filter(|&&byte| byte == b'\n').count() + 1;
            malformed(format!("line {line}: this is not UTF-8"))
        })?;
        let document = Document::parse(text).map_err(malformed)?;
        document.check(&TABLES).map_err(malformed)?;
        let tables: Tables =
            toml::from_str(text).map_err(|error| malformed(format!("\n{error}")))?;

        let refused = |keys: &[&str], message: &str| {
            let place = match keys {
                [table @ .., key] => format!("[{}] {key} ", table.join(".")),
                [] => String::new(),
            };
            malformed(document.error(keys, &format!("{place}{message}")))
        };
        let mut sidecar = Self::default();
        if let Some(camera) = tables.camera {
            sidecar.camera = Some(camera.check().map_err(|(key, m)| refused(&["camera", key], m))?);
        }
        if let Some(film) = tables.film {
            if film.size.contains(&0) {
                return Err(refused(&["film", "size"], "must be at least 1 by 1"));
            }
            sidecar.size = Some(film.size);
        }
        if let Some(integrator) = tables.integrator {
            if integrator.max_depth == Some(0) {
                return Err(refused(&["integrator", "max_depth"], "must be at least 1"));
            }
            sidecar.max_depth = match integrator.kind {
                IntegratorKind::Path => integrator.max_depth,
                IntegratorKind::Direct => Some(2),
            };
            sidecar.russian_roulette = integrator.russian_roulette;
        }
        if let Some(environment) = tables.environment {
            if environment.radiance.is_none() && environment.image.is_none() {
                let message =
                    document.error(&["environment"], "[environment] needs radiance, image or both");
                return Err(malformed(message));
            }
            let radiance = Vec3A::from(environment.radiance.unwrap_or([1.0; 3]));
            if !is_within(radiance, &RADIANCE) {
                let message = "must be within 0 and 1e15";
                return Err(refused(&["environment", "radiance"], message));
            }
            let image = match environment.image {
                Some(name) => {
                    let file = find(path, &name);
                    std::fs::metadata(&file).map_err(|error| {
                        let message = format!("cannot be read: '{}': {error}", file.display());
                        refused(&["environment", "image"], &message)
                    })?;
                    Some(images.radiance(&file, defaults)?)
                }
                None => None,
            };
            sidecar.environment = Some(Environment { radiance, image });
        }
        for (name, table) in &tables.materials {
            // Where a name occurs twice, the later material is the one in use.
            let Some(material) = materials.iter_mut().rev().find(|m| m.name == *name) else {
                let names: Vec<_> = materials.iter().map(|m| m.name.as_str()).collect();
                let message =
                    format!("the scene has no material '{name}'; {}", suggestion(name, &names));
                return Err(malformed(document.error(&["materials", name], &message)));
            };
            table
                .apply(material)
                .map_err(|(key, message)| refused(&["materials", name, key], &message))?;
        }
        Ok(sidecar)
    }
}

/// Finite, as `range` is.
fn is_within(v: Vec3A, range: &RangeInclusive<f32>) -> bool {
    v.to_array().iter().all(|x| range.contains(x))
}

impl CameraTable {
    /// The camera, or the key that is wrong and what it must be.
    fn check(self) -> Result<Camera, (&'static str, &'static str)> {
        let [position, target, up] = [self.position, self.target, self.up].map(Vec3A::from);
        for (key, vector) in [("position", position), ("target", target), ("up", up)] {
            if !vector.is_finite() {
                return Err((key, "must be finite"));
            }
        }
        let forward = (target.as_dvec3() - position.as_dvec3()).normalize_or_zero();
        if position == target {
            return Err(("target", "must differ from position"));
        }
        if forward.cross(up.as_dvec3().normalize_or_zero()).length() < 1e-4 {
            return Err(("up", "must not be zero or parallel to the view"));
        }
        if !(self.vertical_fov > 0.0 && self.vertical_fov < 180.0) {
            return Err(("vertical_fov", "must lie between 0 and 180 degrees"));
        }
        let squarable = (1e-6..=1e6).contains(&up.length());
        let up = if squarable { up } else { up.as_dvec3().normalize().as_vec3a() };
        Ok(Camera { position, target, up, vertical_fov: self.vertical_fov })
    }
}

impl MaterialTable {
    /// Changes the material, or returns the key that is wrong and why.
    fn apply(&self, material: &mut Material) -> Result<(), (&'static str, String)> {
        let mut disney = match material.scattering {
            Scattering::Disney(disney) => disney,
            _ => Disney::default(),
        };
        let mut is_disney = false;
        for (key, value, parameter) in [
            ("metallic", self.metallic, &mut disney.metallic),
            ("roughness", self.roughness, &mut disney.roughness),
            ("specular", self.specular, &mut disney.specular),
            ("specular_tint", self.specular_tint, &mut disney.specular_tint),
            ("anisotropic", self.anisotropic, &mut disney.anisotropic),
            ("sheen", self.sheen, &mut disney.sheen),
            ("sheen_tint", self.sheen_tint, &mut disney.sheen_tint),
            ("clearcoat", self.clearcoat, &mut disney.clearcoat),
            ("clearcoat_gloss", self.clearcoat_gloss, &mut disney.clearcoat_gloss),
        ] {
            let Some(value) = value else { continue };
            if !UNIT.contains(&value) {
                return Err((key, format!("is {value}, but must be within 0 and 1")));
            }
            *parameter = value;
            is_disney = true;
        }
        if is_disney {
            material.scattering = Scattering::Disney(disney);
        }
        if let Some(ior) = self.ior {
            if !IOR.contains(&ior) {
                let (least, most) = (IOR.start(), IOR.end());
                return Err(("ior", format!("is {ior}, but must be within {least} and {most}")));
            }
            if is_disney || self.color.is_some() {
                let message = "makes it a clear dielectric, which has no other parameters";
                return Err(("ior", message.to_owned()));
            }
            make_dielectric(material, ior);
        }
        if let Some(color) = self.color.map(Vec3A::from) {
            if !is_within(color, &UNIT) {
                return Err(("color", "must be within 0 and 1".to_owned()));
            }
            material.color = color;
        }
        if let Some(emission) = self.emission.map(Vec3A::from) {
            if !is_within(emission, &RADIANCE) {
                return Err(("emission", "must be within 0 and 1e15".to_owned()));
            }
            material.emission = emission;
        }
        Ok(())
    }
}

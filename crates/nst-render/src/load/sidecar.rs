//! The TOML file beside an OBJ file: what OBJ has no place for.

use std::{collections::BTreeMap, io::ErrorKind, path::Path};

use glam::Vec3A;
use serde::Deserialize;

use super::{
    files::find,
    image::Images,
    keys::{Document, Table, suggestion},
    mtl::make_dielectric,
    ranges::{IOR, RADIANCE, UNIT, is_within},
    report::Report,
    studio::Lighting,
    text::{error_at, scene_error},
    view::View,
};
use crate::{Disney, Environment, Error, Material, Scattering};

const TABLES: [Table; 5] = [
    Table { name: "camera", keys: &["position", "target", "up", "vertical_fov"], of_tables: false },
    Table { name: "film", keys: &["size"], of_tables: false },
    Table {
        name: "integrator",
        keys: &["kind", "max_depth", "russian_roulette"],
        of_tables: false,
    },
    Table {
        name: "environment",
        keys: &["radiance", "image", "rotation", "light"],
        of_tables: false,
    },
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

/// Path vertices of `kind = "direct"`: a surface, and the light that it reflects.
const DIRECT_DEPTH: u32 = 2;

/// What the file says; what it leaves out is `None`, or the format's default.
#[derive(Debug, Default)]
pub(super) struct Sidecar {
    text: String,
    pub(super) view: View,
    pub(super) size: Option<[u32; 2]>,
    pub(super) max_depth: Option<u32>,
    pub(super) russian_roulette: Option<bool>,
    pub(super) environment: Option<Environment>,
    /// Light instead of an environment.
    pub(super) lighting: Option<Lighting>,
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
    position: Option<[f64; 3]>,
    target: Option<[f64; 3]>,
    up: Option<[f32; 3]>,
    vertical_fov: Option<f32>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FilmTable {
    size: [u32; 2],
}

#[derive(Debug, Default, Deserialize)]
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
    rotation: Option<f32>,
    light: Option<String>,
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
        report: &mut Report,
    ) -> Result<Self, Error> {
        let Some(text) = read_text(path, report)? else { return Ok(Self::default()) };
        let malformed = |message: String| scene_error(path, &message);
        let document = Document::parse(&text).map_err(malformed)?;
        document.check(&TABLES).map_err(malformed)?;
        let tables: Tables =
            toml::from_str(&text).map_err(|error| malformed(format!("\n{error}")))?;

        let place = Place { path, document };
        let integrator = tables.integrator.unwrap_or_default();
        let lighting =
            tables.environment.as_ref().map(|table| place.lighting(table)).transpose()?;
        let sidecar = Self {
            text: String::new(),
            view: tables.camera.map(CameraTable::view).unwrap_or_default(),
            size: tables.film.map(|table| place.size(&table)).transpose()?,
            max_depth: place.max_depth(&integrator, report)?,
            russian_roulette: integrator.russian_roulette,
            lighting: lighting.flatten(),
            environment: tables
                .environment
                .filter(|table| table.light.is_none())
                .map(|table| place.environment(table, images, report))
                .transpose()?,
        };
        for (name, table) in &tables.materials {
            place.override_material(name, table, materials)?;
        }
        drop(place);
        Ok(Self { text, ..sidecar })
    }

    /// `[camera] key message`, with the line of the key.
    pub(super) fn camera_error(&self, path: &Path, key: &str, message: &str) -> Error {
        let message = format!("[camera] {key} {message}");
        match Document::parse(&self.text) {
            Ok(document) => scene_error(path, &document.error(&["camera", key], &message)),
            Err(_) => Error::scene(path, message),
        }
    }
}

/// The file's text; `None` if there is no file.
fn read_text(path: &Path, report: &mut Report) -> Result<Option<String>, Error> {
    let bytes = match report.read(path) {
        Err(Error::Io { source, .. }) if source.kind() == ErrorKind::NotFound => return Ok(None),
        bytes => bytes?,
    };
    let text = String::from_utf8(bytes).map_err(|error| {
        let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = before.iter().filter(|&&byte| byte == b'\n').count() + 1;
        error_at(path, line, "this is not UTF-8")
    })?;
    Ok(Some(text))
}

/// The file that tables are from, for errors that name the line of a key.
struct Place<'a> {
    path: &'a Path,
    document: Document<'a>,
}

impl Place<'_> {
    /// `[table.inner] key message`, at the line of the last of `keys` that is there.
    fn error(&self, keys: &[&str], message: &str) -> Error {
        let named = match keys {
            [table @ .., key] => format!("[{}] {key} {message}", table.join(".")),
            [] => message.to_owned(),
        };
        self.error_as_is(keys, &named)
    }

    /// `message`, at the line of the last of `keys` that is there.
    fn error_as_is(&self, keys: &[&str], message: &str) -> Error {
        scene_error(self.path, &self.document.error(keys, message))
    }

    fn size(&self, table: &FilmTable) -> Result<[u32; 2], Error> {
        if table.size.contains(&0) {
            return Err(self.error(&["film", "size"], "must be at least 1 by 1"));
        }
        Ok(table.size)
    }

    fn max_depth(
        &self,
        table: &IntegratorTable,
        report: &mut Report,
    ) -> Result<Option<u32>, Error> {
        match (&table.kind, table.max_depth) {
            (_, Some(0)) => Err(self.error(&["integrator", "max_depth"], "must be at least 1")),
            (IntegratorKind::Path, depth) => Ok(depth),
            (IntegratorKind::Direct, depth) => {
                if let Some(depth) = depth.filter(|&depth| depth != DIRECT_DEPTH) {
                    report
                        .note(format!("max_depth = {depth} left out, as kind = 'direct' sets it"));
                }
                Ok(Some(DIRECT_DEPTH))
            }
        }
    }

    fn lighting(&self, table: &EnvironmentTable) -> Result<Option<Lighting>, Error> {
        let Some(light) = &table.light else { return Ok(None) };
        if table.radiance.is_some() || table.image.is_some() || table.rotation.is_some() {
            let message = "replaces the environment: leave it out, or the other keys";
            return Err(self.error(&["environment", "light"], message));
        }
        light
            .parse()
            .map(Some)
            .map_err(|message: String| self.error(&["environment", "light"], &message))
    }

    fn environment(
        &self,
        table: EnvironmentTable,
        images: &mut Images,
        report: &mut Report,
    ) -> Result<Environment, Error> {
        if table.radiance.is_none() && table.image.is_none() {
            let message = "[environment] needs radiance or image or both, or light";
            return Err(self.error_as_is(&["environment"], message));
        }
        let radiance = Vec3A::from(table.radiance.unwrap_or([1.0; 3]));
        if !is_within(radiance, &RADIANCE) {
            return Err(self.error(&["environment", "radiance"], "must be within 0 and 1e15"));
        }
        let rotation = table.rotation.unwrap_or_default();
        if !rotation.is_finite() {
            return Err(self.error(&["environment", "rotation"], "must be finite"));
        }
        let Some(name) = table.image else {
            if table.rotation.is_some() {
                report.note("rotation of the environment left out, as it has no image");
            }
            return Ok(Environment { radiance, ..Default::default() });
        };
        let file = find(self.path, &name, report);
        std::fs::metadata(&file).map_err(|error| {
            let message = format!("cannot be read: '{}': {error}", file.display());
            self.error(&["environment", "image"], &message)
        })?;
        let image = Some(images.radiance(&file, report)?);
        // A full turn is none; the remainder is exact.
        let rotation = rotation % 360.0;
        Ok(Environment { radiance, image, rotation, ..Default::default() })
    }

    fn override_material(
        &self,
        name: &str,
        table: &MaterialTable,
        materials: &mut [Material],
    ) -> Result<(), Error> {
        // Where a name occurs twice, the later material is the one in use.
        let Some(material) = materials.iter_mut().rev().find(|m| m.name == name) else {
            let names: Vec<_> = materials.iter().map(|m| m.name.as_str()).collect();
            let hint = suggestion(name, &names);
            let message = format!("the scene has no material '{name}'; {hint}");
            return Err(self.error_as_is(&["materials", name], &message));
        };
        let refused = |(key, message): (_, String)| self.error(&["materials", name, key], &message);
        table.apply(material).map_err(refused)
    }
}

impl CameraTable {
    fn view(self) -> View {
        View {
            position: self.position,
            target: self.target,
            up: self.up,
            vertical_fov: self.vertical_fov,
        }
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

//! The TOML file beside an OBJ file: what OBJ has no place for.

use std::path::Path;

use glam::Vec3A;
use serde::Deserialize;

use crate::{Camera, Error};

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Sidecar {
    pub(crate) camera: Option<CameraTable>,
    pub(crate) film: Option<FilmTable>,
    pub(crate) integrator: Option<IntegratorTable>,
    pub(crate) environment: Option<EnvironmentTable>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CameraTable {
    position: [f32; 3],
    target: [f32; 3],
    #[serde(default = "y_axis")]
    up: [f32; 3],
    vertical_fov: f32,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FilmTable {
    pub(crate) size: [u32; 2],
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct IntegratorTable {
    #[serde(rename = "kind")]
    _kind: IntegratorKind,
    pub(crate) max_depth: u32,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum IntegratorKind {
    Path,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct EnvironmentTable {
    pub(crate) radiance: [f32; 3],
}

fn y_axis() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}

impl From<CameraTable> for Camera {
    fn from(table: CameraTable) -> Self {
        Self {
            position: table.position.into(),
            target: table.target.into(),
            up: table.up.into(),
            vertical_fov: table.vertical_fov,
        }
    }
}

impl Sidecar {
    pub(crate) fn read(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|error| Error::io("read", path, error))?;
        // The error of the parser quotes the line and marks the place.
        let sidecar: Self =
            toml::from_str(&text).map_err(|error| Error::scene(path, format!("\n{error}")))?;
        sidecar.check().map_err(|message| Error::scene(path, message))?;
        Ok(sidecar)
    }

    fn check(&self) -> Result<(), String> {
        if let Some(camera) = &self.camera {
            let [position, target, up] =
                [camera.position, camera.target, camera.up].map(Vec3A::from);
            let forward = target - position;
            if !(forward.is_finite() && up.is_finite()) || forward == Vec3A::ZERO {
                return Err("[camera] position and target must be finite and differ".into());
            }
            if forward.normalize().cross(up.normalize_or_zero()).length() < 1e-4 {
                return Err("[camera] up must not be zero or parallel to the view".into());
            }
            if !(camera.vertical_fov > 0.0 && camera.vertical_fov < 180.0) {
                return Err("[camera] vertical_fov must lie between 0 and 180 degrees".into());
            }
        }
        if self.film.as_ref().is_some_and(|film| film.size.contains(&0)) {
            return Err("[film] size must be at least 1 by 1".into());
        }
        if self.integrator.as_ref().is_some_and(|integrator| integrator.max_depth == 0) {
            return Err("[integrator] max_depth must be at least 1".into());
        }
        let valid = |x: &f32| x.is_finite() && *x >= 0.0;
        if self.environment.as_ref().is_some_and(|e| !e.radiance.iter().all(valid)) {
            return Err("[environment] radiance must be finite and not negative".into());
        }
        Ok(())
    }
}

//! Scenes.

use std::{fmt, path::Path};

use nst_core::Network;
use nst_render::Scene;
use serde::Serialize;

use crate::{
    error::Error,
    words::{counted, list},
};

#[derive(Serialize)]
pub(super) struct SceneInfo {
    fingerprint: String,
    /// The built-in networks that were trained on it.
    networks: Vec<&'static str>,
    triangles: usize,
    lights: usize,
    materials: usize,
    width: u32,
    height: u32,
    max_depth: u32,
    camera: Camera,
    /// The corners of the axis-aligned bounding box.
    bounds: [[f32; 3]; 2],
    /// What was assumed, and what was left out.
    notes: Vec<String>,
}

#[derive(Serialize)]
struct Camera {
    position: [f32; 3],
    target: [f32; 3],
    up: [f32; 3],
    /// In degrees.
    vertical_fov: f32,
}

impl SceneInfo {
    pub(super) fn read(path: &Path) -> Result<Self, Error> {
        let scene = Scene::load(path)?;
        let emits = |material: u32| scene.materials[material as usize].emits();
        let fingerprint = scene.fingerprint();
        let networks = Network::builtins_trained_on(&fingerprint)?;
        let networks = networks.into_iter().map(|(name, _)| name).collect();
        let (low, high) = scene.bounds();
        Ok(Self {
            networks,
            fingerprint,
            triangles: scene.triangles.len(),
            lights: scene.triangles.iter().filter(|triangle| emits(triangle.material)).count(),
            materials: scene.materials.len(),
            width: scene.size[0],
            height: scene.size[1],
            max_depth: scene.max_depth,
            camera: Camera {
                position: scene.camera.position.to_array(),
                target: scene.camera.target.to_array(),
                up: scene.camera.up.to_array(),
                vertical_fov: scene.camera.vertical_fov,
            },
            bounds: [low.to_array(), high.to_array()],
            notes: scene.notes,
        })
    }
}

impl fmt::Display for SceneInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let point = |[x, y, z]: [f32; 3]| format!("[{x}, {y}, {z}]");
        let Self { triangles, lights, materials, width, height, camera, .. } = self;
        writeln!(
            f,
            "scene, {} ({lights} emitting light), {}",
            counted(*triangles, "triangle"),
            counted(*materials, "material")
        )?;
        writeln!(f, "fingerprint {}", self.fingerprint)?;
        let none = "none of the built-in ones was trained on it";
        writeln!(f, "networks    {}", list(&self.networks, none))?;
        writeln!(
            f,
            "film        {width}x{height} pixels, paths of up to {} vertices",
            self.max_depth
        )?;
        writeln!(
            f,
            "camera      at {}, towards {}, {} degrees high",
            point(camera.position),
            point(camera.target),
            camera.vertical_fov
        )?;
        writeln!(f, "bounds      {} to {}", point(self.bounds[0]), point(self.bounds[1]))?;
        self.notes.iter().try_for_each(|note| writeln!(f, "note        {note}"))
    }
}

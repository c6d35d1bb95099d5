//! Reads a scene: OBJ and MTL through tobj, and the TOML sidecar beside them.

use std::{
    cell::RefCell,
    fs::File,
    io::BufReader,
    path::{Path, PathBuf},
};

use glam::Vec3A;

use crate::{
    Camera, Environment, Error, Material, Scene, Triangle, scene::bounds, sidecar::Sidecar,
};

/// Reflectance of triangles without a material, or of a material without `Kd`.
const DEFAULT_DIFFUSE: f32 = 0.8;
const DEFAULT_SIZE: [u32; 2] = [512, 512];
const DEFAULT_MAX_DEPTH: u32 = 8;
const DEFAULT_FOV: f32 = 40.0;

impl Scene {
    /// Reads an OBJ file, the MTL files that it names, and the sidecar
    /// (`x.toml` beside `x.obj`) if there is one. What the files leave open gets
    /// a default, which [`Scene::defaults`] names.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Scene`] names the file and what is wrong with it.
    pub fn load(path: &Path) -> Result<Self, Error> {
        let mut defaults = Vec::new();
        let (triangles, materials) = load_obj(path, &mut defaults)?;
        let sidecar_path = path.with_extension("toml");
        let sidecar =
            if sidecar_path.exists() { Sidecar::read(&sidecar_path)? } else { Sidecar::default() };

        let camera = match sidecar.camera {
            Some(camera) => camera.into(),
            None => {
                defaults.push("a camera that frames the bounding box".to_owned());
                framing_camera(&triangles)
            }
        };
        let size = sidecar.film.map_or(DEFAULT_SIZE, |film| film.size);
        let max_depth =
            sidecar.integrator.map_or(DEFAULT_MAX_DEPTH, |integrator| integrator.max_depth);
        let lit = triangles.iter().any(|t| materials[t.material as usize].emits());
        let environment = match sidecar.environment {
            Some(environment) => Vec3A::from(environment.radiance),
            None if lit => Vec3A::ZERO,
            None => {
                defaults.push("a uniform white environment, as nothing emits light".to_owned());
                Vec3A::ONE
            }
        };
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Self {
            name,
            triangles,
            materials,
            camera,
            size,
            max_depth,
            russian_roulette: true,
            pixel_filter: Default::default(),
            environment: Environment { radiance: environment, image: None },
            defaults,
        })
    }
}

fn load_obj(
    path: &Path,
    defaults: &mut Vec<String>,
) -> Result<(Vec<Triangle>, Vec<Material>), Error> {
    let file = File::open(path).map_err(|error| Error::io("read", path, error))?;
    let options = tobj::LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..Default::default()
    };
    // tobj says neither which MTL file failed nor why; the closure remembers.
    let missing: RefCell<Option<Error>> = RefCell::new(None);
    let load_mtl = |name: &Path| {
        let name: PathBuf = path.with_file_name(name);
        let file = File::open(&name).map_err(|error| {
            missing.borrow_mut().get_or_insert(Error::io("read", &name, error));
            tobj::LoadError::OpenFileFailed
        })?;
        tobj::load_mtl_buf(&mut BufReader::new(file)).inspect_err(|error| {
            missing.borrow_mut().get_or_insert(Error::scene(&name, error.to_string()));
        })
    };
    let (models, materials) = tobj::load_obj_buf(&mut BufReader::new(file), &options, load_mtl)
        .map_err(|error| Error::scene(path, error.to_string()))?;
    if let Some(error) = missing.take() {
        return Err(error);
    }
    let mut materials = materials
        .map_err(|error| Error::scene(path, error.to_string()))?
        .into_iter()
        .map(|material| load_material(path, material))
        .collect::<Result<Vec<_>, _>>()?;

    let default_material = materials.len() as u32;
    let mut triangles = Vec::new();
    for model in &models {
        load_mesh(path, model, default_material, &mut triangles)?;
    }
    if triangles.iter().any(|triangle| triangle.material == default_material) {
        defaults.push(format!("a grey material ({DEFAULT_DIFFUSE}) where the file names none"));
        materials.push(Material {
            name: "default".to_owned(),
            color: Vec3A::splat(DEFAULT_DIFFUSE),
            color_texture: None,
            emission: Vec3A::ZERO,
            emission_texture: None,
            scattering: Default::default(),
        });
    }

    let faces = triangles.len();
    triangles.retain(|triangle| {
        let area = triangle.area_vector().length();
        area > 0.0 && area.is_finite()
    });
    if triangles.is_empty() {
        let message =
            if faces == 0 { "it has no faces" } else { "all of its faces have zero area" };
        return Err(Error::scene(path, format!("{message}; there is nothing to render")));
    }
    if triangles.len() < faces {
        defaults.push(format!("{} triangles of zero area left out", faces - triangles.len()));
    }
    Ok((triangles, materials))
}

fn load_material(path: &Path, material: tobj::Material) -> Result<Material, Error> {
    let emission = material.unknown_param.get("Ke").map_or(Ok([0.0; 3]), |text| {
        let numbers: Vec<f32> = text.split_whitespace().map_while(|n| n.parse().ok()).collect();
        <[f32; 3]>::try_from(numbers).map_err(|_| {
            Error::scene(
                path,
                format!("material '{}': 'Ke {text}' is not three numbers", material.name),
            )
        })
    });
    let emission = match material.emissive {
        Some(emission) => emission,
        None => emission?,
    };
    let colour = |key: &str, rgb: [f32; 3], most: f32| {
        if rgb.iter().all(|x| (0.0..=most).contains(x)) {
            return Ok(Vec3A::from(rgb));
        }
        let name = &material.name;
        Err(Error::scene(
            path,
            format!("material '{name}': {key} {rgb:?} is not within 0 and {most}"),
        ))
    };
    Ok(Material {
        color: colour("Kd", material.diffuse.unwrap_or([DEFAULT_DIFFUSE; 3]), 1.0)?,
        color_texture: None,
        emission: colour("Ke", emission, f32::MAX)?,
        emission_texture: None,
        scattering: Default::default(),
        name: material.name,
    })
}

fn load_mesh(
    path: &Path,
    model: &tobj::Model,
    default_material: u32,
    triangles: &mut Vec<Triangle>,
) -> Result<(), Error> {
    let mesh = &model.mesh;
    let vector = |kind: &str, values: &[f32], index: u32| {
        let at = index as usize * 3;
        match values.get(at..at + 3) {
            Some(v) if v.iter().all(|x| x.is_finite()) => Ok(Vec3A::from_slice(v)),
            Some(v) => Err(Error::scene(
                path,
                format!("object '{}': {kind} {v:?} is not finite", model.name),
            )),
            None => Err(Error::scene(
                path,
                format!(
                    "object '{}': a face names {kind} {index}, which does not exist",
                    model.name
                ),
            )),
        }
    };
    let material = mesh.material_id.map_or(default_material, |id| id as u32);
    let corners = |i: usize, kind: &str, values: &[f32], indices: &[u32]| -> Result<_, Error> {
        let corner = |k: usize| vector(kind, values, indices[i + k]);
        Ok([corner(0)?, corner(1)?, corner(2)?])
    };
    for i in (0..mesh.indices.len()).step_by(3) {
        let positions = corners(i, "vertex", &mesh.positions, &mesh.indices)?;
        let normals = if mesh.normal_indices.is_empty() {
            None
        } else {
            let normals = corners(i, "normal", &mesh.normals, &mesh.normal_indices)?;
            Some(normals.map(Vec3A::normalize_or_zero)).filter(|n| !n.contains(&Vec3A::ZERO))
        };
        triangles.push(Triangle { positions, normals, uvs: None, material });
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

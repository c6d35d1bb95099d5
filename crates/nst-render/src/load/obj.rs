//! Triangles from an OBJ file, which tobj reads once it is tidied.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use glam::{Vec2, Vec3A};

use super::{
    exact::unit_or_zero,
    files::{find, is_found},
    image::Images,
    mtl,
    polygon::Triangulator,
    report::Report,
    text::{self, quoted},
    tidy::{WHOLE, tidy},
};
use crate::{Error, Material, Triangle};

/// Reflectance of triangles without a material: as light as white paint.
const DEFAULT_COLOR: f32 = 0.8;

/// Reads the triangles of an OBJ file, in the order of its faces, and the
/// materials of the MTL files that it names.
pub(super) fn load(
    path: &Path,
    images: &mut Images,
    report: &mut Report,
) -> Result<(Vec<Triangle>, Vec<Material>), Error> {
    let text = text::read(path, report)?;
    let mut materials = Vec::new();
    for library in libraries(path, &text, report)? {
        materials.append(&mut mtl::load(&library, images, report)?);
    }
    // Where a name occurs twice, the later material counts.
    let names = (0..).zip(&materials).map(|(id, m): (u32, &Material)| (m.name.as_str(), id));
    let tidied = tidy(path, &text, &names.collect())?;
    drop(text);

    let mut triangles = triangulate(path, &tidied.text, materials.len() as u32, report)?;
    if triangles.is_empty() {
        return Err(Error::scene(path, "it has no faces; there is nothing to render"));
    }
    tidied.losses.note(report);
    add_default_material(&mut triangles, &mut materials, &tidied.unknown, report);
    Ok((triangles, materials))
}

/// The MTL files, each once, in the order of the file. A name with spaces means
/// one file if there is one, and several otherwise.
fn libraries(path: &Path, text: &str, report: &mut Report) -> Result<Vec<PathBuf>, Error> {
    let mut libraries = Vec::new();
    for line in text::lines(text).filter(|line| line.keyword() == "mtllib") {
        if line.name().is_empty() {
            return Err(line.error(path, "mtllib without a name"));
        }
        let several = !is_found(path, line.name()) && line.words().any(|name| is_found(path, name));
        let names = if several { line.words().collect() } else { vec![line.name()] };
        for name in names {
            let library = find(path, name, report);
            if let Err(error) = std::fs::metadata(&library) {
                let message = format!("mtllib: cannot read '{}': {error}", library.display());
                return Err(line.error(path, message));
            }
            if !libraries.contains(&library) {
                libraries.push(library);
            }
        }
    }
    Ok(libraries)
}

/// Triangles of the tidied text; those that name no material, or an unknown one, have
/// the one behind the last.
fn triangulate(
    path: &Path,
    text: &str,
    materials: u32,
    report: &mut Report,
) -> Result<Vec<Triangle>, Error> {
    let options =
        tobj::LoadOptions { ignore_points: true, ignore_lines: true, ..Default::default() };
    let names = || Ok((vec![], (0..materials as usize).map(|id| (id.to_string(), id)).collect()));
    // The materials that tobj returns are no more than the names that it is given.
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| names())
        .map_err(|error| Error::scene(path, error.to_string()))?;

    let mut triangulator = Triangulator::new();
    let mut triangles = Vec::new();
    for tobj::Model { mesh, .. } in &models {
        let material = mesh.material_id.map_or(materials, |id| id as u32);
        let corner = |i: usize| Corner::new(mesh, i);
        // tobj leaves the arities out where all faces are triangles.
        let arities = match mesh.face_arities.as_slice() {
            [] => &vec![3; mesh.indices.len() / 3],
            arities => arities,
        };
        let mut start = 0;
        for &arity in arities {
            let corners: Vec<_> = (start..start + arity as usize).map(corner).collect();
            start += arity as usize;
            let positions: Vec<_> = corners.iter().map(|corner| corner.position).collect();
            for triangle in triangulator.triangulate(&positions) {
                triangles.push(Corner::triangle(triangle.map(|i| corners[i]), material));
            }
        }
    }
    if triangulator.uncut > 0 {
        let count = triangulator.uncut;
        report
            .note(format!("faces that cross themselves, cut into fans that may overlap: {count}"));
    }
    Ok(triangles)
}

#[derive(Clone, Copy)]
struct Corner {
    position: Vec3A,
    /// Zero where the file has none.
    normal: Vec3A,
    /// NaN where the file has none.
    uv: Vec2,
}

impl Corner {
    fn new(mesh: &tobj::Mesh, i: usize) -> Self {
        let vector = |values: &[f32], index: u32| Vec3A::from_slice(&values[index as usize * 3..]);
        let uv = Vec2::from_slice(&mesh.texcoords[mesh.texcoord_indices[i] as usize * 2..]);
        Self {
            position: vector(&mesh.positions, mesh.indices[i]),
            normal: vector(&mesh.normals, mesh.normal_indices[i]),
            uv: Vec2::select(uv.abs().cmpge(Vec2::splat(WHOLE)), Vec2::ZERO, uv),
        }
    }

    fn triangle(corners: [Self; 3], material: u32) -> Triangle {
        let normals = corners.map(|corner| unit_or_zero(corner.normal));
        let uvs = corners.map(|corner| corner.uv);
        Triangle {
            positions: corners.map(|corner| corner.position),
            normals: Some(normals).filter(|normals| !normals.contains(&Vec3A::ZERO)),
            uvs: Some(uvs).filter(|uvs| !uvs.iter().any(|uv| uv.is_nan())),
            material,
        }
    }
}

/// Gives the triangles that need one a grey material, and says so.
fn add_default_material(
    triangles: &mut [Triangle],
    materials: &mut Vec<Material>,
    unknown: &BTreeSet<String>,
    report: &mut Report,
) {
    let default = materials.len() as u32;
    if !triangles.iter().any(|triangle| triangle.material == default) {
        return;
    }
    let mut note = format!("a grey material ({DEFAULT_COLOR}) where the file names none");
    if !unknown.is_empty() {
        let names: Vec<_> = unknown.iter().take(8).map(|name| quoted(name)).collect();
        let more = if unknown.len() > names.len() { ", …" } else { "" };
        note += &format!(", or one that no MTL file has ({}{more})", names.join(", "));
    }
    report.note(note);
    materials.push(Material {
        name: "default".to_owned(),
        color: Vec3A::splat(DEFAULT_COLOR),
        ..Material::default()
    });
}

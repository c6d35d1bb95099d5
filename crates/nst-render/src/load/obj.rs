//! Triangles and materials from an OBJ file.

mod colors;
mod faces;
mod foreign;
mod keywords;
mod libraries;
mod reader;
mod words;

use std::path::Path;

use glam::Vec3A;

use super::{
    image::Images,
    mtl,
    report::Report,
    text::{self, COMMENT, Text, error_at, quoted, without_comment},
    units::Placement,
};
use crate::{Error, Material, Triangle, material::GREY};

use self::{
    colors::Colors,
    faces::Triangles,
    libraries::{Names, libraries, plain},
    reader::Contents,
};

/// What an OBJ file and the MTL files that it names make.
pub(super) struct Loaded {
    /// In the order of the faces, where `placement` puts them.
    pub(super) triangles: Vec<Triangle>,
    /// As [`crate::Scene::vertex_colors`].
    pub(super) vertex_colors: Vec<[[f32; 3]; 3]>,
    pub(super) materials: Vec<Material>,
    pub(super) placement: Placement,
}

/// Reads an OBJ file, and the materials of the MTL files that it names.
///
/// # Errors
/// Names the file, the line, and what is wrong.
pub(super) fn load(path: &Path, images: &mut Images, report: &mut Report) -> Result<Loaded, Error> {
    let contents = read(path, report)?;
    let mut materials = Vec::new();
    for library in libraries(path, &contents.libraries, report)? {
        materials.append(&mut mtl::load(&library, images, report)?);
    }
    let default = materials.len() as u32;
    let (ids, unknown) = resolve(path, &contents.materials, &mut materials, report)?;

    let (low, high) = faces::bounds(path, &contents)?;
    let mut placement = Placement::around(low, high, report);
    let colors = Colors::of_vertices(&contents, report);
    let ids = (ids.as_slice(), default);
    let mut all = faces::triangles(path, &contents, placement, ids, &colors, report)?;
    contents.note_losses(report);
    if all.triangles.iter().any(|triangle| triangle.material == default) {
        materials.push(default_material(&unknown, !colors.is_empty(), report));
    }
    placement.scale(&mut all.triangles, report);
    all.drop_degenerate(path, report)?;
    let Triangles { triangles, colors } = all;
    Ok(Loaded { triangles, vertex_colors: colors, materials, placement })
}

/// The statements of a file that has faces.
fn read(path: &Path, report: &mut Report) -> Result<Contents, Error> {
    let bytes = report.read(path)?;
    if let Some(message) = foreign::refused(path, &bytes) {
        return Err(Error::scene(path, message));
    }
    let text: Text = text::decode(path, bytes, report)?;
    let contents = Contents::read(path, &text, report)?;
    if !contents.faces.is_empty() {
        return Ok(contents);
    }
    if let Some(bad) = contents.bad.first() {
        let message = format!("vertex {} {}, and there are no faces", bad.index + 1, bad.fault);
        return Err(error_at(path, bad.line, message));
    }
    Err(Error::scene(
        path,
        foreign::without_faces(path, &text, contents.positions.len(), contents.other_elements()),
    ))
}

/// The scene's material for each name (with its line), that behind the last for those that
/// there is none of; and the latter names. Materials whose names end in a comment lose it,
/// unless a face names them so.
fn resolve<'a>(
    path: &Path,
    names: &'a [(usize, String)],
    materials: &mut [Material],
    report: &mut Report,
) -> Result<(Vec<u32>, Vec<&'a str>), Error> {
    let known = Names::new(materials);
    let mut unknown = Vec::new();
    let mut is_whole = vec![false; materials.len()];
    let mut ids = Vec::new();
    for (line, name) in names {
        let found = known.get(name);
        if without_comment(name).len() < name.len() && !found.is_some_and(|(_, whole)| whole) {
            report
                .forgive(COMMENT, path, *line, || format!("{} ends in a comment", quoted(name)))?;
        }
        if let Some((id, whole)) = found {
            is_whole[id as usize] |= whole;
            ids.push(id);
        } else {
            unknown.extend(Some(plain(name)).filter(|name| !name.is_empty()));
            ids.push(materials.len() as u32);
        }
    }
    for (material, _) in materials.iter_mut().zip(is_whole).filter(|(_, whole)| !whole) {
        if plain(&material.name).len() < material.name.len() {
            material.name = plain(&material.name).to_owned();
        }
    }
    Ok((ids, unknown))
}

/// The material of faces that need one: grey, or white for the colours of vertices.
fn default_material(unknown: &[&str], colored: bool, report: &mut Report) -> Material {
    let color = if colored { 1.0 } else { GREY };
    let what = if colored {
        "a white material for the vertices' colours".to_owned()
    } else {
        format!("a grey material ({GREY})")
    };
    let mut note = format!("{what} where the file names none");
    if !unknown.is_empty() {
        let mut names: Vec<_> = unknown.iter().map(|name| quoted(name)).collect();
        names.sort_unstable();
        let more = if names.len() > 8 { ", …" } else { "" };
        names.truncate(8);
        note += &format!(", or one that no MTL file has ({}{more})", names.join(", "));
    }
    report.note(note);
    Material { name: "default".to_owned(), color: Vec3A::splat(color), ..Material::default() }
}

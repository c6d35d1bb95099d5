//! Triangles from the faces of an OBJ file.

use std::path::Path;

use glam::{DVec3, Vec2, Vec3A};

use super::{
    super::{
        exact::length_squared, polygon::Triangulator, report::Report, text::error_at,
        units::Placement,
    },
    colors::Colors,
    reader::{Contents, Face, KINDS, MISSING},
};
use crate::{Error, Triangle};

/// Triangles, in the order of the faces, and their colours.
#[derive(Default)]
pub(super) struct Triangles {
    pub(super) triangles: Vec<Triangle>,
    /// As [`crate::Scene::vertex_colors`].
    pub(super) colors: Vec<[[f32; 3]; 3]>,
}

/// The corners of the box around the vertices that faces name.
///
/// # Errors
/// Names the first face whose vertex is not there, or is not finite.
pub(super) fn bounds(path: &Path, contents: &Contents) -> Result<(DVec3, DVec3), Error> {
    let mut low = DVec3::INFINITY;
    let mut high = DVec3::NEG_INFINITY;
    let mut start = 0;
    for face in &contents.faces {
        for &[vertex, ..] in &contents.corners[start..face.end] {
            match contents.positions.get(vertex as usize - 1) {
                Some(&position) if !position.is_nan() => {
                    low = low.min(position);
                    high = high.max(position);
                }
                _ => return Err(unusable(path, contents, face, vertex)),
            }
        }
        start = face.end;
    }
    Ok((low, high))
}

/// Why a face's vertex is of no use.
fn unusable(path: &Path, contents: &Contents, face: &Face, vertex: u32) -> Error {
    if let Some(bad) = contents.bad.iter().find(|bad| bad.index + 1 == vertex as usize) {
        let message =
            format!("vertex {vertex} {}, and the face of line {} needs it", bad.fault, face.line);
        return error_at(path, bad.line, message);
    }
    let number = contents.beyond.filter(|_| vertex == u32::MAX).unwrap_or(vertex.into());
    let count = contents.positions.len();
    error_at(
        path,
        face.line,
        format!("a face names {} {number}, but there are only {count}", KINDS[0]),
    )
}

/// Cuts the faces into triangles. `materials`: the scene's material of each of the
/// contents'; `default` is that of faces without one.
///
/// # Errors
/// If there is nothing to render, or a fault that strict reports do not forgive.
pub(super) fn triangles(
    path: &Path,
    contents: &Contents,
    placement: &Placement,
    (materials, default): (&[u32], u32),
    colors: &Colors,
    report: &mut Report,
) -> Result<Triangles, Error> {
    let positions: Vec<Vec3A> =
        contents.positions.iter().map(|&position| placement.centred(position)).collect();
    // A face of n corners becomes n − 2 triangles.
    let count = contents.corners.len() - 2 * contents.faces.len();
    let mut all = Triangles::default();
    all.triangles.reserve_exact(count);
    let mut triangulator = Triangulator::default();
    let (mut corners, mut polygon, mut start) = (Vec::new(), Vec::new(), 0);
    for face in &contents.faces {
        corners.clear();
        for &numbers in &contents.corners[start..face.end] {
            corners.push(Corner::new(path, contents, &positions, numbers, face.line, report)?);
        }
        start = face.end;
        polygon.clear();
        polygon.extend(corners.iter().map(|corner| corner.position));
        let material = materials.get(face.material as usize).copied().unwrap_or(default);
        for triangle in triangulator.triangulate(&polygon) {
            let corners = triangle.map(|i| corners[i]);
            all.triangles.push(Corner::triangle(corners, material));
            if !colors.is_empty() {
                let color = |corner: Corner| colors.of(corner.vertex, material == default);
                all.colors.push(corners.map(color));
            }
        }
    }
    if triangulator.uncut > 0 {
        let count = triangulator.uncut;
        report
            .note(format!("faces that cross themselves, cut into fans that may overlap: {count}"));
    }
    Ok(all)
}

#[derive(Clone, Copy)]
struct Corner {
    /// From 0.
    vertex: usize,
    position: Vec3A,
    /// Zero where the file has none.
    normal: Vec3A,
    /// NaN where the file has none.
    uv: Vec2,
}

impl Corner {
    #[inline]
    fn new(
        path: &Path,
        contents: &Contents,
        positions: &[Vec3A],
        [vertex, uv, normal]: [u32; 3],
        line: usize,
        report: &mut Report,
    ) -> Result<Self, Error> {
        let vertex = vertex as usize - 1;
        let mut corner =
            Self { vertex, position: positions[vertex], normal: Vec3A::ZERO, uv: Vec2::NAN };
        let mut forgive = |kind: usize, number: u32, count: usize| {
            report.forgive(MISSING[kind], path, line, || {
                let what = KINDS[kind];
                format!("a face names {what} {number}, but there are only {count}")
            })
        };
        if uv > 0 {
            match contents.uvs.get(uv as usize - 1) {
                Some(&uv) => corner.uv = uv,
                None => forgive(1, uv, contents.uvs.len())?,
            }
        }
        if normal > 0 {
            match contents.normals.get(normal as usize - 1) {
                Some(&normal) => corner.normal = normal.into(),
                None => forgive(2, normal, contents.normals.len())?,
            }
        }
        Ok(corner)
    }

    #[inline]
    fn triangle(corners: [Self; 3], material: u32) -> Triangle {
        let normals = corners.map(|corner| corner.normal);
        let uvs = corners.map(|corner| corner.uv);
        Triangle {
            positions: corners.map(|corner| corner.position),
            normals: Some(normals).filter(|normals| !normals.contains(&Vec3A::ZERO)),
            uvs: Some(uvs).filter(|uvs| !uvs.iter().any(|uv| uv.is_nan())),
            material,
        }
    }
}

impl Triangles {
    /// Leaves out the triangles that have no direction: f32 cannot even square their areas.
    ///
    /// # Errors
    /// If there are no others.
    pub(super) fn drop_degenerate(
        &mut self,
        path: &Path,
        report: &mut Report,
    ) -> Result<(), Error> {
        let is_sound = |triangle: &Triangle| length_squared(triangle.area_vector()).is_normal();
        let all = self.triangles.len();
        let mut triangles = self.triangles.iter();
        self.colors.retain(|_| triangles.next().is_some_and(is_sound));
        self.triangles.retain(is_sound);
        if self.triangles.is_empty() {
            let message = "all of its faces have zero area; there is nothing to render";
            return Err(Error::scene(path, message));
        }
        if self.triangles.len() < all {
            let count = all - self.triangles.len();
            report.note(format!("triangles of zero area, left out: {count}"));
        }
        Ok(())
    }
}

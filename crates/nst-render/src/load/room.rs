//! Rooms that a camera outside of them cannot look into.
//!
//! Walls around a point are found by their winding number (Jacobson et al. 2013): the sum
//! of the solid angles of all triangles as seen from the point, divided by 4π. It is 1
//! inside a closed surface whose normals point outwards, −1 where they point inwards, and
//! near 0 outside, or where a wall is missing.

use glam::DVec3;
use rayon::prelude::*;

use crate::{Material, Scattering, Triangle, scene::bounds};

/// Least winding number of a closed room: a hole of 2 % of all directions lets enough light
/// through to see something.
const CLOSED: f64 = 0.98;
/// How far from a side of the bounding box a wall may be, as a share of the box.
const WALL: f32 = 1e-3;
/// How many lamps are looked at: each takes some milliseconds among a million triangles.
const LAMPS: usize = 8;

/// Why a camera outside of everything shows nothing of what is in there; `None` where it
/// shows all that it can.
pub(super) fn closed_room(triangles: &[Triangle], materials: &[Material]) -> Option<String> {
    let is_wall = |triangle: &&Triangle| {
        let material = &materials[triangle.material as usize];
        let is_glass = matches!(
            material.scattering,
            Scattering::Dielectric { .. } | Scattering::ThinDielectric { .. }
        );
        !(material.emits() || material.is_cut_out() || is_glass)
    };
    let walls: Vec<_> = triangles.iter().filter(is_wall).collect();
    let lamps: Vec<_> =
        triangles.iter().filter(|t| materials[t.material as usize].emits()).collect();
    let step = lamps.len().div_ceil(LAMPS).max(1);
    let is_closed_in = |lamp: &&Triangle| {
        beside(lamp).iter().any(|&point| winding_number(&walls, point).abs() >= CLOSED)
    };
    if !lamps.is_empty() {
        let dark = lamps.iter().step_by(step).all(is_closed_in);
        return dark.then(|| "its lamps are in a closed room, and the camera is outside".into());
    }
    let (low, high) = bounds(triangles);
    let middle = ((low + high) * 0.5).as_dvec3();
    let inwards = winding_number(&walls, middle) <= -CLOSED;
    (inwards || is_furnished_box(&walls)).then(|| {
        "a closed room, seen from outside: a camera within it needs a lamp within it".into()
    })
}

/// The points a little off the middle of a triangle, on both sides.
fn beside(triangle: &Triangle) -> [DVec3; 2] {
    let [a, b, c] = triangle.positions.map(|p| p.as_dvec3());
    let off = (b - a).cross(c - a).normalize_or_zero() * 1e-3 * (b - a).length();
    [(a + b + c) / 3.0 + off, (a + b + c) / 3.0 - off]
}

/// By the solid angles of van Oosterom and Strackee (1983).
fn winding_number(triangles: &[&Triangle], point: DVec3) -> f64 {
    let half_angle = |triangle: &&Triangle| {
        let [a, b, c] = triangle.positions.map(|p| p.as_dvec3() - point);
        let [la, lb, lc] = [a, b, c].map(DVec3::length);
        let volume = a.dot(b.cross(c));
        volume.atan2(la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb)
    };
    triangles.par_iter().map(half_angle).sum::<f64>() / (2.0 * std::f64::consts::PI)
}

/// Whether walls cover all six sides of the bounding box, whichever way they face, and
/// something else is in it.
fn is_furnished_box(walls: &[&Triangle]) -> bool {
    let (low, high) = bounds(walls.iter().copied());
    let size = high - low;
    let is_on = |wall: &Triangle, side: usize| {
        let (axis, end) = (side % 3, if side < 3 { low } else { high });
        wall.positions.iter().all(|p| (p[axis] - end[axis]).abs() <= size[axis] * WALL)
    };
    let mut covered = [0.0; 6];
    let mut is_furnished = false;
    for wall in walls {
        match (0..6).find(|&side| is_on(wall, side)) {
            Some(side) => covered[side] += wall.area_vector().length() / 2.0,
            None => is_furnished = true,
        }
    }
    let area = [size.y * size.z, size.z * size.x, size.x * size.y];
    let is_closed = |side: usize| covered[side] >= CLOSED as f32 * area[side % 3];
    is_furnished && area.iter().all(|&area| area > 0.0) && (0..6).all(is_closed)
}

#[cfg(test)]
mod tests {
    use glam::Vec3A;

    use super::*;

    fn material(emission: f32) -> Material {
        Material { emission: Vec3A::splat(emission), ..Material::default() }
    }

    /// The sides of a box about the origin; normals point outwards.
    fn sides(half: f32, material: u32) -> Vec<Triangle> {
        let corner = |i: usize| {
            Vec3A::from([0, 1, 2].map(|axis| if i >> axis & 1 == 0 { -half } else { half }))
        };
        let quads =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangle = |quad: [usize; 3]| Triangle {
            positions: quad.map(corner),
            normals: None,
            uvs: None,
            material,
        };
        quads.iter().flat_map(|&[a, b, c, d]| [triangle([a, b, c]), triangle([a, c, d])]).collect()
    }

    fn turned(mut triangles: Vec<Triangle>) -> Vec<Triangle> {
        triangles.iter_mut().for_each(|triangle| triangle.positions.swap(1, 2));
        triangles
    }

    fn note(triangles: &[Triangle]) -> Option<String> {
        closed_room(triangles, &[material(0.0), material(1.0)])
    }

    #[test]
    fn winding_numbers_count_closed_surfaces() {
        let cube = sides(1.0, 0);
        let all: Vec<_> = cube.iter().collect();
        let inside = DVec3::new(0.3, -0.2, 0.7);
        assert!((winding_number(&all, inside) - 1.0).abs() < 1e-9);
        assert!(winding_number(&all, DVec3::new(0.3, -0.2, 1.7)).abs() < 1e-9);
        let open: Vec<_> = cube[..10].iter().collect();
        assert!((winding_number(&open, DVec3::ZERO) - 5.0 / 6.0).abs() < 1e-9);
        let turned = turned(cube.clone());
        let turned: Vec<_> = turned.iter().collect();
        assert!((winding_number(&turned, inside) + 1.0).abs() < 1e-9);
    }

    #[test]
    fn rooms_are_told_from_bodies() {
        let (room, body, lamp) = (sides(1.0, 0), sides(0.3, 0), sides(0.1, 1));
        assert_eq!(note(&room), None, "a cube is no room");
        assert!(note(&turned(room.clone())).expect("a room").contains("needs a lamp"));
        let furnished = [room.clone(), body.clone()].concat();
        assert!(note(&furnished).expect("a room").contains("needs a lamp"));
        assert_eq!(note(&furnished[2..]), None, "one side is open");
        let lit = [room.clone(), lamp.clone()].concat();
        assert!(note(&lit).expect("a room").contains("lamps"));
        assert!(note(&[turned(room), lamp.clone()].concat()).is_some());
        assert_eq!(note(&lit[2..]), None, "one side is open");
        assert_eq!(note(&[body, turned(lamp)].concat()[12..]), None, "a lamp alone");
    }
}

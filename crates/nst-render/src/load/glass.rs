//! Which glass is solid and which is a thin pane, and which side of its surface is outside.
//!
//! Light is bent where it enters glass, and bent back where it comes out. A single sheet has
//! no inside: it is a thin pane. Which corners of triangles are at one place decides what is
//! one piece, and whether the piece is closed.

use std::collections::HashMap;

use glam::{DVec3, Vec3A};

use super::report::Report;
use crate::{Material, Scattering, Triangle};

/// A closed piece that contains less is a sheet of two sides at one place: f32 rounds
/// coordinates to 6e-8 of their size. In units of the area to the power 3/2, of which a ball
/// contains 0.09.
const LEAST_VOLUME: f64 = 1e-6;
/// No piece of a scene is compared with more triangles than these in all, to find out whether it
/// is inside another one: with more pieces, none counts as inside.
const MOST_COMPARISONS: usize = 1 << 28;

/// Triangles of one material that hang together.
struct Piece {
    /// Indices of triangles, and whether each winds otherwise than the first.
    members: Vec<(usize, bool)>,
    closed: bool,
    /// Sixfold, by the winding of the first triangle.
    volume: f64,
    /// Whether all wind alike.
    consistent: bool,
    bounds: (Vec3A, Vec3A),
}

/// A corner's place in space, as a multiple of [`Places::step`] along each axis.
type Place = [i64; 3];

/// Corners that programs mean to be at one place may differ in the last digits of f32, or
/// by sines that are almost 0: as a share of the largest coordinate, which f32 knows to 6e-8.
const SAME_PLACE: f64 = 1e-6;

/// Which corners are at one place.
#[derive(Clone, Copy)]
struct Places {
    step: f64,
}

impl Places {
    fn new(triangles: &[Triangle]) -> Self {
        let positions = triangles.iter().flat_map(|triangle| triangle.positions);
        let largest = positions.map(|p| p.abs().max_element()).fold(0.0, f32::max);
        Self { step: f64::from(largest) * SAME_PLACE }
    }

    fn of(self, position: Vec3A) -> Place {
        position.as_dvec3().to_array().map(|x| (x / self.step).round() as i64)
    }
}

/// Makes sheets of glass thin panes, with a copy of their material where it has closed pieces,
/// too; and turns the triangles of closed pieces so that all normals point out of the glass.
pub(super) fn settle(
    triangles: &mut [Triangle],
    materials: &mut Vec<Material>,
    report: &mut Report,
) {
    let mut turned = 0;
    let mut solids = Vec::new();
    for (id, ior) in glasses(materials) {
        let members: Vec<_> =
            (0..triangles.len()).filter(|&i| triangles[i].material as usize == id).collect();
        let (closed, sheets): (Vec<_>, Vec<_>) =
            pieces(triangles, &members).into_iter().partition(Piece::is_solid);
        if !sheets.is_empty() {
            let thin = Scattering::ThinDielectric { ior };
            let mut thin_id = id;
            if closed.is_empty() {
                materials[id].scattering = thin;
            } else {
                thin_id = materials.len();
                materials.push(Material { scattering: thin, ..materials[id].clone() });
            }
            for &(i, _) in sheets.iter().flat_map(|piece| &piece.members) {
                triangles[i].material = thin_id as u32;
            }
        }
        solids.extend(closed);
    }
    for (piece, outwards) in solids.iter().zip(orientations(triangles, &solids)) {
        for &(i, otherwise) in &piece.members {
            if otherwise == outwards {
                turn(&mut triangles[i]);
                turned += 1;
            }
        }
    }
    if turned > 0 {
        report.note(format!("triangles of glass whose outside was inside, turned: {turned}"));
    }
}

fn glasses(materials: &[Material]) -> Vec<(usize, f32)> {
    let ior = |material: &Material| match material.scattering {
        Scattering::Dielectric { ior } => Some(ior),
        _ => None,
    };
    materials.iter().enumerate().filter_map(|(id, m)| Some((id, ior(m)?))).collect()
}

/// The same triangle with the other side outside.
fn turn(triangle: &mut Triangle) {
    triangle.positions.swap(1, 2);
    triangle.normals.iter_mut().for_each(|normals| normals.swap(1, 2));
    triangle.uvs.iter_mut().for_each(|uvs| uvs.swap(1, 2));
}

/// The three edges, each from its lower place to its higher one, and whether the triangle
/// goes along it that way.
fn edges(triangle: &Triangle, places: Places) -> [((Place, Place), bool); 3] {
    let corners = triangle.positions.map(|position| places.of(position));
    [0, 1, 2].map(|i| {
        let (a, b) = (corners[i], corners[(i + 1) % 3]);
        if a < b { ((a, b), true) } else { ((b, a), false) }
    })
}

fn pieces(triangles: &[Triangle], members: &[usize]) -> Vec<Piece> {
    let places = Places::new(triangles);
    let mut neighbours: HashMap<(Place, Place), Vec<(usize, bool)>> = HashMap::new();
    for &i in members {
        for (edge, forwards) in edges(&triangles[i], places) {
            neighbours.entry(edge).or_default().push((i, forwards));
        }
    }
    let mut pieces = Vec::new();
    let mut seen: HashMap<usize, bool> = HashMap::new();
    for &first in members {
        if seen.contains_key(&first) {
            continue;
        }
        seen.insert(first, false);
        let mut found = vec![(first, false)];
        let (mut closed, mut consistent) = (true, true);
        let mut next = 0;
        while let Some(&(i, otherwise)) = found.get(next) {
            next += 1;
            for (edge, forwards) in edges(&triangles[i], places) {
                let sharing = &neighbours[&edge];
                closed &= sharing.len() > 1;
                for &(other, its_forwards) in sharing.iter().filter(|(other, _)| *other != i) {
                    // Two that wind alike go along their edge in opposite directions. Where
                    // three or more meet, nothing is known.
                    let flipped = if sharing.len() == 2 {
                        otherwise ^ (forwards == its_forwards)
                    } else {
                        false
                    };
                    consistent &= !flipped;
                    if let std::collections::hash_map::Entry::Vacant(entry) = seen.entry(other) {
                        entry.insert(flipped);
                        found.push((other, flipped));
                    }
                }
            }
        }
        pieces.push(Piece::new(triangles, found, closed, consistent));
    }
    pieces
}

impl Piece {
    fn new(
        triangles: &[Triangle],
        members: Vec<(usize, bool)>,
        closed: bool,
        consistent: bool,
    ) -> Self {
        let all: Vec<_> = members.iter().map(|&(i, _)| triangles[i]).collect();
        let bounds = crate::scene::bounds(&all);
        // About its own middle, where rounding is least.
        let middle = (bounds.0.as_dvec3() + bounds.1.as_dvec3()) / 2.0;
        let mut volume = 0.0;
        for (triangle, (_, otherwise)) in all.iter().zip(&members) {
            let [a, b, c] = triangle.positions.map(|p| p.as_dvec3() - middle);
            volume += a.dot(b.cross(c)) * if *otherwise { -1.0 } else { 1.0 };
        }
        let area: f64 = all.iter().map(|t| f64::from(t.area_vector().length()) / 2.0).sum();
        let closed = closed && volume.abs() / 6.0 > LEAST_VOLUME * area.powf(1.5);
        Self { members, closed, volume, consistent, bounds }
    }

    fn is_solid(&self) -> bool {
        self.closed
    }

    /// Whether the point is inside: a ray from it passes an odd number of triangles.
    fn contains(&self, triangles: &[Triangle], point: Vec3A) -> bool {
        let (low, high) = self.bounds;
        if point.cmplt(low).any() || point.cmpgt(high).any() {
            return false;
        }
        // A direction that no edge of a model is likely to have.
        let direction = DVec3::new(0.301_97, 0.713_42, 0.632_31);
        let passes = |&&(i, _): &&(usize, bool)| {
            let [a, b, c] = triangles[i].positions.map(|p| p.as_dvec3());
            let (e1, e2, s) = (b - a, c - a, point.as_dvec3() - a);
            let p = direction.cross(e2);
            let inverse = 1.0 / e1.dot(p);
            let u = s.dot(p) * inverse;
            let q = s.cross(e1);
            let v = direction.dot(q) * inverse;
            u >= 0.0 && v >= 0.0 && u + v <= 1.0 && e2.dot(q) * inverse > 0.0
        };
        self.members.iter().filter(passes).count() % 2 == 1
    }
}

/// For each solid piece, whether the winding of its first triangle is right. An outermost piece
/// has a positive volume. One inside it may be a bubble, whose outside is the air within, or
/// glass in glass: it is as the file says, unless the file has the outermost one inside out.
fn orientations(triangles: &[Triangle], solids: &[Piece]) -> Vec<bool> {
    let total: usize = solids.iter().map(|piece| piece.members.len()).sum();
    let compared = total.saturating_mul(solids.len()) <= MOST_COMPARISONS;
    let outermost = |inner: usize| {
        let point = triangles[solids[inner].members[0].0].positions[0];
        let around = |&outer: &usize| outer != inner && solids[outer].contains(triangles, point);
        let candidates = (0..solids.len()).filter(|_| compared).filter(around);
        let size = |&a: &usize| solids[a].volume.abs();
        candidates.max_by(|a, b| size(a).total_cmp(&size(b)))
    };
    (0..solids.len())
        .map(|i| match outermost(i) {
            Some(outer) if solids[outer].consistent => solids[outer].volume > 0.0,
            Some(_) => true,
            None => solids[i].volume > 0.0,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tetrahedron about a point, with its normals outwards.
    fn tetrahedron(middle: Vec3A, size: f32) -> Vec<Triangle> {
        let corner = |i: usize| {
            let corners =
                [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
            middle + Vec3A::from(corners[i]) * size
        };
        [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]
            .map(|corners| Triangle {
                positions: corners.map(corner),
                normals: None,
                uvs: None,
                material: 0,
            })
            .to_vec()
    }

    fn glass() -> Vec<Material> {
        let scattering = Scattering::Dielectric { ior: 1.5 };
        vec![Material { scattering, ..Material::default() }]
    }

    fn turned(mut triangles: Vec<Triangle>) -> Vec<Triangle> {
        triangles.iter_mut().for_each(turn);
        triangles
    }

    /// What becomes of triangles of glass: they, their materials and the number of notes.
    fn settled(triangles: &[Triangle]) -> (Vec<Triangle>, Vec<Material>, usize) {
        let (mut triangles, mut materials) = (triangles.to_vec(), glass());
        let mut report = Report::default();
        settle(&mut triangles, &mut materials, &mut report);
        (triangles, materials, report.notes().len())
    }

    /// Programs write the seams of balls with sines that are almost 0.
    #[test]
    fn corners_at_almost_one_place_close_a_piece() {
        for off in [0.0, 1e-17, -1e-17, 1e-9] {
            let mut triangles = tetrahedron(Vec3A::ONE, 1.0);
            // A corner of one triangle alone, which would be at the origin.
            let corner = triangles[2].positions.iter_mut().find(|p| p.x == 0.0 && p.y == 0.0);
            corner.expect("a corner near the z axis").x += off;
            assert_eq!(settled(&triangles).1, glass(), "{off}");
        }
        let mut open = tetrahedron(Vec3A::ONE, 1.0);
        open[2].positions[0].x += 1e-3;
        assert_ne!(settled(&open).1, glass());
    }

    #[test]
    fn closed_glass_keeps_its_outside_or_gets_it() {
        let solid = tetrahedron(Vec3A::X * 9.0, 1.0);
        let expected = (solid.clone(), glass(), 0);
        assert_eq!(settled(&solid), expected);
        let expected = (solid.clone(), glass(), 1);
        assert_eq!(settled(&turned(solid.clone())), expected);
        // Of one triangle alone, and of all others.
        let mut one = solid.clone();
        turn(&mut one[2]);
        assert_eq!(settled(&one), expected);
        let mut first = solid.clone();
        turn(&mut first[0]);
        assert_eq!(settled(&first), expected);
    }

    #[test]
    fn bubbles_keep_their_outside_within() {
        let outer = tetrahedron(Vec3A::ZERO, 8.0);
        let bubble = turned(tetrahedron(Vec3A::splat(0.25), 1.0));
        let both = [outer.clone(), bubble.clone()].concat();
        assert_eq!(settled(&both), (both.clone(), glass(), 0));
        let nested = [outer.clone(), turned(bubble.clone())].concat();
        assert_eq!(settled(&nested), (nested.clone(), glass(), 0));
        // All of it inside out.
        assert_eq!(settled(&turned(both.clone())), (both, glass(), 1));
        // Beside the other one, a piece is as any.
        let beside = [outer, turned(tetrahedron(Vec3A::X * 40.0, 1.0))].concat();
        assert_eq!(settled(&beside).2, 1);
    }

    #[test]
    fn sheets_are_thin() {
        let thin = |materials: &[Material]| {
            materials
                .iter()
                .map(|m| m.scattering == Scattering::ThinDielectric { ior: 1.5 })
                .collect()
        };
        let open = &tetrahedron(Vec3A::ZERO, 1.0)[..3];
        let (triangles, materials, notes) = settled(open);
        let is_thin: Vec<bool> = thin(&materials);
        assert_eq!((&triangles[..], is_thin, notes), (open, vec![true], 0));
        // A sheet that has two sides at one place is closed, and contains nothing.
        let both_sides = [open[..1].to_vec(), turned(open[..1].to_vec())].concat();
        let is_thin: Vec<bool> = thin(&settled(&both_sides).1);
        assert_eq!(is_thin, [true]);
        // Beside a solid piece of the same material.
        let solid = tetrahedron(Vec3A::X * 9.0, 1.0);
        let (triangles, materials, _) = settled(&[open, &solid[..]].concat());
        let is_thin: Vec<bool> = thin(&materials);
        assert_eq!(is_thin, [false, true]);
        let ids: Vec<_> = triangles.iter().map(|t| t.material).collect();
        assert_eq!(ids, [1, 1, 1, 0, 0, 0, 0]);
    }

    #[test]
    fn other_materials_stay_as_they_are() {
        let solid = turned(tetrahedron(Vec3A::ZERO, 1.0));
        let mut triangles = solid.clone();
        let mut materials = vec![Material::default()];
        settle(&mut triangles, &mut materials, &mut Report::default());
        assert_eq!((triangles, materials), (solid, vec![Material::default()]));
    }
}

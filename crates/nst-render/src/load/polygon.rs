//! Polygons to triangles.

use earcut::Earcut;
use glam::{DVec2, DVec3, Vec3A};

/// Sine of the angle by which a corner may bend inwards before it counts as
/// concave: corners on a straight edge do so by rounding, of f32, which is 6e-8
/// of the coordinates.
const STRAIGHT: f64 = 1e-6;
/// Share of a polygon's area by which its triangles may miss it. Rounding of f64 is
/// far below; polygons that cross themselves are missed by far more.
const AREA_TOLERANCE: f64 = 1e-6;

/// Cuts polygons into triangles. Keeps its memory from one to the next.
#[derive(Default)]
pub(super) struct Triangulator {
    earcut: Option<Earcut<f64>>,
    flat: Vec<DVec2>,
    cut: Vec<usize>,
    triangles: Vec<[usize; 3]>,
    /// How many concave polygons were no use to the ear cutter, so that they became fans.
    pub(super) uncut: usize,
}

impl Triangulator {
    /// Corners of triangles that cover the polygon, wound as it is. A convex
    /// polygon becomes a fan about its first corner; a concave one is cut by its
    /// ears, in the plane across its normal (Newell's). Where that fails, as the
    /// polygon crosses itself or has no area, it is a fan too.
    pub(super) fn triangulate(&mut self, polygon: &[Vec3A]) -> &[[usize; 3]] {
        self.triangles.clear();
        if polygon.len() >= 4 && flatten(polygon, &mut self.flat) && !is_convex(&self.flat) {
            if self.cut_ears() {
                return &self.triangles;
            }
            self.uncut += 1;
            self.triangles.clear();
        }
        self.triangles.extend((2..polygon.len()).map(|i| [0, i - 1, i]));
        &self.triangles
    }

    /// Whether the triangles cover the polygon.
    fn cut_ears(&mut self) -> bool {
        let Self { earcut, flat: polygon, cut, triangles, .. } = self;
        let earcut = earcut.get_or_insert_with(Earcut::new);
        earcut.earcut(polygon.iter().map(|p| p.to_array()), &[], cut);
        triangles.extend(cut.chunks_exact(3).map(|c| {
            let area = (polygon[c[1]] - polygon[c[0]]).perp_dot(polygon[c[2]] - polygon[c[0]]);
            if area < 0.0 { [c[0], c[2], c[1]] } else { [c[0], c[1], c[2]] }
        }));
        let covered: f64 = triangles
            .iter()
            .map(|&[a, b, c]| (polygon[b] - polygon[a]).perp_dot(polygon[c] - polygon[a]))
            .sum();
        let area = twice_area(polygon);
        (covered - area).abs() <= AREA_TOLERANCE * area
    }
}

/// The polygon seen against its normal, so that it winds counterclockwise; `false` if it has
/// no area. In f64, in which no f32 overflows when squared.
fn flatten(polygon: &[Vec3A], flat: &mut Vec<DVec2>) -> bool {
    let origin = polygon[0].as_dvec3();
    let corner = |p: &Vec3A| p.as_dvec3() - origin;
    let normal: DVec3 =
        polygon.windows(2).map(|pair| corner(&pair[0]).cross(corner(&pair[1]))).sum();
    let length = normal.length();
    if !(length > 0.0 && length.is_finite()) {
        return false;
    }
    let (right, up) = (normal / length).any_orthonormal_pair();
    flat.clear();
    flat.extend(polygon.iter().map(corner).map(|p| DVec2::new(p.dot(right), p.dot(up))));
    true
}

fn twice_area(polygon: &[DVec2]) -> f64 {
    polygon.windows(2).map(|pair| (pair[0] - polygon[0]).perp_dot(pair[1] - polygon[0])).sum()
}

/// Whether no corner bends inwards, and no triangle of the fan is turned over.
fn is_convex(polygon: &[DVec2]) -> bool {
    let left = |a: DVec2, b: DVec2| a.perp_dot(b) >= -STRAIGHT * a.length() * b.length();
    let n = polygon.len();
    (0..n).all(|i| {
        let [a, b, c] = [i, i + 1, i + 2].map(|k| polygon[k % n]);
        left(b - a, c - b) && left(b - polygon[0], c - polygon[0])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether the triangles cover the polygon, once, and nothing else.
    fn covers(polygon: &[Vec3A], triangles: &[[usize; 3]]) -> bool {
        let mut flat = Vec::new();
        assert!(flatten(polygon, &mut flat));
        let area = twice_area(&flat);
        let areas =
            triangles.iter().map(|&[a, b, c]| (flat[b] - flat[a]).perp_dot(flat[c] - flat[a]));
        let inside = |&[a, b, c]: &[usize; 3]| contains(&flat, (flat[a] + flat[b] + flat[c]) / 3.0);
        areas.clone().all(|area| area > 0.0)
            && (areas.sum::<f64>() - area).abs() < 1e-9 * area
            && triangles.iter().all(inside)
    }

    fn check(polygon: &[Vec3A]) {
        let mut triangulator = Triangulator::default();
        let triangles = triangulator.triangulate(polygon);
        assert!(covers(polygon, triangles), "{polygon:?}: {triangles:?}");
    }

    /// The even-odd rule.
    fn contains(polygon: &[DVec2], p: DVec2) -> bool {
        let n = polygon.len();
        (0..n)
            .filter(|&i| {
                let (a, b) = (polygon[i], polygon[(i + 1) % n]);
                (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
            })
            .count()
            % 2
            == 1
    }

    const L: [[f32; 2]; 6] = [[0., 0.], [3., 0.], [3., 1.], [1., 1.], [1., 2.], [0., 2.]];

    fn star() -> Vec<[f32; 2]> {
        (0..10)
            .map(|i| {
                let (sin, cos) = (i as f32 * std::f32::consts::PI / 5.0).sin_cos();
                let radius = if i % 2 == 0 { 1.0 } else { 0.4 };
                [radius * cos, radius * sin]
            })
            .collect()
    }

    #[test]
    fn triangles_cover_concave_polygons_and_nothing_else() {
        for polygon in [L.to_vec(), star()] {
            for turn in 0..polygon.len() {
                for backwards in [false, true] {
                    let mut polygon = polygon.clone();
                    polygon.rotate_left(turn);
                    if backwards {
                        polygon.reverse();
                    }
                    // Upright, tilted, and in units of 1e-20 and 1e18.
                    let at = |axes: [Vec3A; 2]| -> Vec<Vec3A> {
                        polygon.iter().map(|p| axes[0] * p[0] + axes[1] * p[1]).collect()
                    };
                    check(&at([Vec3A::X, Vec3A::Y]));
                    check(&at([Vec3A::new(1.0, 2.0, -1.0), Vec3A::new(0.0, 1.0, 2.0)]));
                    check(&at([Vec3A::Z * 1e-20, Vec3A::Y * 1e-20]));
                    check(&at([Vec3A::Z * 1e18, Vec3A::X * 1e18]));
                }
            }
        }
    }

    /// `covers` itself, with what this module is there to avoid.
    #[test]
    fn fans_do_not_cover_concave_polygons() {
        let fan: Vec<_> = (2..6).map(|i| [0, i - 1, i]).collect();
        let mut polygon = L.map(|[x, y]| Vec3A::new(x, y, 0.0));
        polygon.rotate_left(1);
        assert!(!covers(&polygon, &fan));
        assert!(!covers(&polygon, &Triangulator::default().triangulate(&polygon)[1..]));
    }

    #[test]
    fn convex_and_hopeless_polygons_are_fans() {
        let fan = |polygon: &[[f32; 2]]| {
            let corners: Vec<_> = polygon.iter().map(|p| Vec3A::new(p[0], p[1], 0.0)).collect();
            let expected: Vec<_> = (2..corners.len()).map(|i| [0, i - 1, i]).collect();
            let mut triangulator = Triangulator::default();
            assert_eq!(triangulator.triangulate(&corners), expected, "{polygon:?}");
            triangulator.uncut
        };
        assert_eq!(fan(&[[0., 0.], [1., 0.], [0., 1.]]), 0);
        assert_eq!(fan(&[[0., 0.], [1., 0.], [2., 0.], [2., 1.], [0., 1.]]), 0);
        // A bow tie, a pentagram, a line and a point.
        assert_eq!(fan(&[[0., 0.], [1., 1.], [1., 0.], [0., 1.5]]), 1);
        let star = star();
        assert_eq!(fan(&[0, 4, 8, 2, 6].map(|i| star[i])), 1);
        assert_eq!(fan(&[[0., 0.], [1., 0.], [2., 0.], [3., 0.]]), 0);
        assert_eq!(fan(&[[1., 1.]; 5]), 0);
        assert!(Triangulator::default().triangulate(&[Vec3A::ZERO; 2]).is_empty());
    }
}

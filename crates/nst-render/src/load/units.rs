//! Where the file's coordinates are in the scene.
//!
//! Coordinates of maps, such as UTM's, leave few of f32's digits for the scene itself: its
//! centre is subtracted in f64. Areas are products of two lengths, and their squares of
//! four, so that coordinates of 1e-12 or 1e12 leave the range of f32. Radiance depends
//! neither on the origin nor on the unit of length: such scenes are scaled, by a power of
//! two, which rounds nothing.

use std::ops::RangeInclusive;

use glam::{DVec3, Vec3A};

use super::{
    exact::{exponent, power_of_two},
    report::Report,
};
use crate::{Camera, Material, Relief, Triangle};

/// The largest coordinate of a scene that stays as it is.
const FINE: RangeInclusive<f32> = 1e-3..=1e6;
/// How far a scene may be from the origin, in units of its longest side, and stay there.
/// f32 has 24 binary digits. At 2⁴ sides, 20 are left for the scene, which is a millionth of
/// its side: what files of six or seven decimal digits can say. Rays start some of these
/// steps off their surface, which no picture shows.
const NEAR_ORIGIN: f64 = 16.0;
/// How far away from the scene a camera may be, in units of its largest coordinate.
const FAR: f32 = 1e9;
/// How near its target a camera may be, in the same units.
const NEAR: f32 = 1e-9;

/// From the file's coordinates to the scene's: a point to subtract, and a power of two that
/// multiplies all lengths.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Placement {
    centre: DVec3,
    exponent: i32,
}

impl Placement {
    /// For vertices in a box, between its lower and upper corner: subtracts its centre if it
    /// is far from the origin, and says so. [`Self::scale`] finds the unit later.
    ///
    /// The centre is rounded to a multiple of a power of two of the size of the box, so
    /// that no difference rounds: both numbers are multiples of the coordinate's last digit.
    pub(super) fn around(low: DVec3, high: DVec3, report: &mut Report) -> Self {
        let side = (high - low).max_element();
        let centre = low * 0.5 + high * 0.5;
        if !(side > 0.0 && centre.abs().max_element() > NEAR_ORIGIN * side) {
            return Self::default();
        }
        // Of a scene that f32 can tell from a point: the box has finite f32 for corners.
        let step = power_of_two(exponent((side as f32).max(f32::MIN_POSITIVE)));
        let centre = (centre / step).round() * step;
        let [x, y, z] = centre.to_array();
        report.note(format!(
            "the scene is far from the origin: ({x}, {y}, {z}) is subtracted from all coordinates"
        ));
        Self { centre, exponent: 0 }
    }

    /// Where a vertex of the file is, before it is scaled.
    pub(super) fn centred(&self, vertex: DVec3) -> Vec3A {
        (vertex - self.centre).as_vec3a()
    }

    /// Scales the triangles, which are centred, to a unit in which their largest coordinate
    /// is fine, and says so.
    pub(super) fn scale(&mut self, triangles: &mut [Triangle], report: &mut Report) {
        let largest = largest_coordinate(triangles);
        if largest == 0.0 || FINE.contains(&largest) {
            return;
        }
        self.exponent = -exponent(largest);
        let unit = power_of_two(self.exponent);
        for position in triangles.iter_mut().flat_map(|triangle| &mut triangle.positions) {
            *position = (position.as_dvec3() * unit).as_vec3a();
        }
        report.note(format!("lengths scaled by 2^{}, so that areas fit f32", self.exponent));
    }

    /// Scales the heights of bump maps, which are lengths.
    pub(super) fn scale_bumps(&self, materials: &mut [Material]) {
        for material in materials {
            if let Some(Relief::Bumps { scale, .. }) = &mut material.relief {
                let scaled = (f64::from(*scale) * power_of_two(self.exponent)) as f32;
                *scale = scaled.clamp(f32::MIN, f32::MAX);
            }
        }
    }

    /// Where a point of the file is in the scene.
    pub(super) fn point(&self, p: DVec3) -> DVec3 {
        (p - self.centre) * power_of_two(self.exponent)
    }

    /// Whether f32 can tell where a camera is and looks, among the scene's triangles.
    pub(super) fn is_distinct(camera: &Camera, triangles: &[Triangle]) -> bool {
        let largest = largest_coordinate(triangles);
        let reach = camera.position.abs().max(camera.target.abs()).max_element();
        let distance = camera.position.as_dvec3().distance(camera.target.as_dvec3());
        reach <= FAR * largest && distance >= f64::from(NEAR * largest)
    }
}

fn largest_coordinate(triangles: &[Triangle]) -> f32 {
    let positions = triangles.iter().flat_map(|triangle| triangle.positions);
    positions.fold(0.0, |largest, position| position.abs().max_element().max(largest))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(size: f32) -> Triangle {
        let positions = [Vec3A::ZERO, Vec3A::X * size, Vec3A::Y * size];
        Triangle { positions, normals: None, uvs: None, material: 0 }
    }

    fn scaled(triangles: &mut [Triangle]) -> (Placement, Vec<String>) {
        let (mut placement, mut report) = (Placement::default(), Report::default());
        placement.scale(triangles, &mut report);
        (placement, report.notes())
    }

    #[test]
    fn scales_by_powers_of_two_where_f32_needs_it() {
        for size in [1e-3, 1.0, 555.5, 1e6] {
            assert_eq!(scaled(&mut [triangle(size)]), (Placement::default(), vec![]));
        }
        for size in [1e-45, 3e-39, 1e-20, 9.9e-4, 1.1e6, 1e20, 3.4e38] {
            let mut triangles = [triangle(size)];
            let (placement, notes) = scaled(&mut triangles);
            let largest = largest_coordinate(&triangles);
            assert!((1.0..2.0).contains(&largest), "{size} became {largest}");
            let back = f64::from(largest) * 2.0_f64.powi(-placement.exponent);
            assert_eq!(back as f32, size);
            assert_eq!(placement.point(DVec3::X * back), DVec3::X * f64::from(largest));
            assert!(notes[0].contains("scaled"));
        }
        assert_eq!(scaled(&mut [triangle(0.0)]).0, Placement::default());
    }

    #[test]
    fn cameras_keep_their_place_in_the_scene() {
        let camera = |position: f32, target: f32| Camera {
            position: Vec3A::Z * position,
            target: Vec3A::Z * target,
            up: Vec3A::Y,
            vertical_fov: 40.0,
        };
        let mut triangles = [triangle(4e20)];
        let (placement, _) = scaled(&mut triangles);
        let position = placement.point(DVec3::Z * 8e20).as_vec3a();
        let ratio = position.z / triangles[0].positions[1].x;
        assert!((ratio - 2.0).abs() < 1e-6);
        assert!(Placement::is_distinct(&camera(position.z, 0.0), &triangles));
        assert!(!Placement::is_distinct(&camera(1e10, 0.0), &triangles));
        assert!(!Placement::is_distinct(&camera(1e-10, 0.0), &triangles));
    }

    #[test]
    fn centres_of_far_scenes_are_subtracted_without_rounding() {
        let around = |low: DVec3, high: DVec3| {
            let mut report = Report::default();
            (Placement::around(low, high, &mut report), report.notes())
        };
        let low = DVec3::new(399_995.3, 30.1, 4_999_995.7);
        let (placement, notes) = around(low, low + 10.0);
        assert_eq!(placement.centre, DVec3::new(400_000.0, 32.0, 5_000_000.0));
        assert!(notes[0].contains("(400000, 32, 5000000) is subtracted"), "{notes:?}");
        for i in 0..1000 {
            let p = low + 0.01 * f64::from(i);
            // Subtracting rounded nothing, as adding again gives the same.
            assert_eq!((p - placement.centre) + placement.centre, p);
            assert_eq!(placement.point(p).as_vec3a(), placement.centred(p));
        }
        // Just within the distance; a point; the smallest box at the end of f32.
        assert_eq!(around(DVec3::X * 15.5, DVec3::X * 16.5), (Placement::default(), vec![]));
        assert_ne!(around(DVec3::X * 16.0, DVec3::X * 17.0).0, Placement::default());
        assert_eq!(around(DVec3::X, DVec3::X).0, Placement::default());
        let (placement, _) = around(DVec3::X * 3e38, DVec3::new(3e38, 1e-320, 0.0));
        assert!(placement.centre.is_finite(), "{placement:?}");
    }
}

//! Units that f32 can compute with.
//!
//! Areas are products of two lengths, and their squares of four, so that
//! coordinates of 1e-12 or 1e12 leave the range of f32. Radiance does not depend
//! on the unit of length: such scenes are scaled, by a power of two, which
//! rounds nothing.

use std::ops::RangeInclusive;

use glam::Vec3A;

use super::{
    exact::{exponent, power_of_two},
    report::Report,
};
use crate::{Camera, Material, Relief, Triangle};

/// The largest coordinate of a scene that stays as it is.
const FINE: RangeInclusive<f32> = 1e-3..=1e6;
/// How far away from the scene a camera may be, in units of its largest coordinate.
const FAR: f32 = 1e9;
/// How near its target a camera may be, in the same units.
const NEAR: f32 = 1e-9;

/// A power of two that multiplies all lengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Unit {
    exponent: i32,
}

impl Unit {
    /// The unit in which the largest coordinate of the triangles is fine.
    pub(super) fn of(triangles: &[Triangle]) -> Self {
        let largest = largest_coordinate(triangles);
        let fine = largest == 0.0 || FINE.contains(&largest);
        Self { exponent: if fine { 0 } else { -exponent(largest) } }
    }

    fn scaled(self, v: Vec3A) -> Vec3A {
        if self.exponent == 0 {
            return v;
        }
        (v.as_dvec3() * power_of_two(self.exponent)).as_vec3a()
    }

    /// Scales the triangles, and says so.
    pub(super) fn scale(self, triangles: &mut [Triangle], report: &mut Report) {
        if self.exponent == 0 {
            return;
        }
        for position in triangles.iter_mut().flat_map(|triangle| &mut triangle.positions) {
            *position = self.scaled(*position);
        }
        report.note(format!("lengths scaled by 2^{}, so that areas fit f32", self.exponent));
    }

    /// Scales the heights of bump maps, which are lengths.
    pub(super) fn scale_bumps(self, materials: &mut [Material]) {
        for material in materials {
            if let Some(Relief::Bumps { scale, .. }) = &mut material.relief {
                *scale = self.scaled(Vec3A::X * *scale).x.clamp(f32::MIN, f32::MAX);
            }
        }
    }

    /// Scales a camera that came with the triangles, which are scaled already;
    /// `None` if f32 cannot tell where it is or looks.
    pub(super) fn scale_camera(self, camera: Camera, triangles: &[Triangle]) -> Option<Camera> {
        let (position, target) = (self.scaled(camera.position), self.scaled(camera.target));
        let largest = largest_coordinate(triangles);
        let reach = position.abs().max(target.abs()).max_element();
        let distance = position.as_dvec3().distance(target.as_dvec3());
        let possible = reach <= FAR * largest && distance >= f64::from(NEAR * largest);
        possible.then_some(Camera { position, target, ..camera })
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

    #[test]
    fn scales_by_powers_of_two_where_f32_needs_it() {
        for size in [1e-3, 1.0, 555.5, 1e6] {
            assert_eq!(Unit::of(&[triangle(size)]).exponent, 0);
        }
        for size in [1e-45, 3e-39, 1e-20, 9.9e-4, 1.1e6, 1e20, 3.4e38] {
            let mut triangles = [triangle(size)];
            let unit = Unit::of(&triangles);
            let mut report = Report::default();
            unit.scale(&mut triangles, &mut report);
            let largest = largest_coordinate(&triangles);
            assert!((1.0..2.0).contains(&largest), "{size} became {largest}");
            let back = f64::from(largest) * 2.0_f64.powi(-unit.exponent);
            assert_eq!(back as f32, size);
            assert!(report.notes()[0].contains("scaled"));
        }
        assert_eq!(Unit::of(&[triangle(0.0)]).exponent, 0);
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
        let unit = Unit::of(&triangles);
        unit.scale(&mut triangles, &mut Report::default());
        let scaled = unit.scale_camera(camera(8e20, 0.0), &triangles).expect("a good camera");
        let ratio = scaled.position.z / triangles[0].positions[1].x;
        assert!((ratio - 2.0).abs() < 1e-6);
        assert!(unit.scale_camera(camera(3e38, 0.0), &triangles).is_none());
        assert!(unit.scale_camera(camera(1.0, 0.0), &triangles).is_none());
    }
}

//! A pinhole camera.

use std::{fmt, str::FromStr};

use glam::{Vec2, Vec3A};

/// Where the picture is taken from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The pinhole, in world space.
    pub position: Vec3A,
    /// The point in the middle of the picture.
    pub target: Vec3A,
    /// A direction that points up in the picture.
    pub up: Vec3A,
    /// The angle between the upper and the lower edge of the picture, in degrees.
    pub vertical_fov: f32,
}

/// How positions within a pixel are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum PixelFilter {
    /// Uniformly over the pixel: anti-aliased.
    #[default]
    Box,
    /// Always the centre, as in the paper's experiments.
    Center,
}

/// The name in sequence files and on the command line.
impl fmt::Display for PixelFilter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Box => "box",
            Self::Center => "center",
        })
    }
}

impl FromStr for PixelFilter {
    type Err = String;

    /// Undoes `to_string`.
    fn from_str(name: &str) -> Result<Self, String> {
        let mut kinds = [Self::Box, Self::Center].into_iter();
        kinds
            .find(|kind| kind.to_string() == name)
            .ok_or_else(|| format!("'{name}' is not 'box' or 'center'"))
    }
}

/// The camera's frame, scaled so that film coordinates map to directions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Projection {
    pub(crate) origin: Vec3A,
    forward: Vec3A,
    right: Vec3A,
    up: Vec3A,
    size: Vec2,
}

impl Projection {
    pub(crate) fn new(camera: &Camera, size: [u32; 2]) -> Self {
        let size = Vec2::new(size[0] as f32, size[1] as f32);
        let forward = (camera.target - camera.position).normalize();
        let right = forward.cross(camera.up).normalize();
        let up = right.cross(forward);
        let half_height = (camera.vertical_fov.to_radians() / 2.0).tan();
        let half_width = half_height * size.x / size.y;
        Self {
            origin: camera.position,
            forward,
            right: right * half_width,
            up: up * half_height,
            size,
        }
    }

    /// The unit direction through a point of the film, in pixels from the top left.
    pub(crate) fn direction(&self, film: Vec2) -> Vec3A {
        let p = film / self.size * 2.0 - 1.0;
        (self.forward + self.right * p.x - self.up * p.y).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_span_the_field_of_view() {
        let camera = Camera {
            position: Vec3A::ZERO,
            target: Vec3A::NEG_Z,
            up: Vec3A::Y,
            vertical_fov: 90.0,
        };
        let projection = Projection::new(&camera, [200, 100]);
        let close = |a: Vec3A, b: Vec3A| assert!(a.distance(b) < 1e-6, "{a} is not {b}");
        close(projection.direction(Vec2::new(100.0, 50.0)), Vec3A::NEG_Z);
        // Top left: x and y to the edges of a film two wide and one high.
        close(projection.direction(Vec2::ZERO), Vec3A::new(-2.0, 1.0, -1.0).normalize());
        close(
            projection.direction(Vec2::new(100.0, 100.0)),
            Vec3A::new(0.0, -1.0, -1.0).normalize(),
        );
    }
}

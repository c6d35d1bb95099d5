//! The colours of vertices: `v x y z r g b`, as MeshLab and many scanners write them.

use super::{
    super::{exact::srgb_to_linear, report::Report},
    reader::Contents,
};
use crate::material::GREY;

/// From here on, values are not those of colours a little too bright, but of 0 to 255.
const BYTES: f32 = 2.0;
/// The brightest of 0 to 255.
const MOST: f32 = 255.0;
/// Values below are no darkness of colours that was rounded: half a step of 0 to 255.
const LEAST: f32 = -0.5 / MOST;

/// Linear RGB by vertex, NaN where there is none; of the first vertices alone.
#[derive(Default)]
pub(super) struct Colors(Vec<[f32; 3]>);

impl Colors {
    /// From the numbers of the file: sRGB, in 0 to 1 or in 0 to 255.
    pub(super) fn of_vertices(contents: &Contents, report: &mut Report) -> Self {
        let stated = &contents.colors;
        let numbers = || stated.iter().flatten();
        let most = numbers().copied().fold(0.0, f32::max);
        let least = numbers().copied().fold(0.0, f32::min);
        if stated.is_empty() {
            return Self::default();
        }
        if least < LEAST || most == f32::INFINITY {
            report.note("numbers behind vertices that are no colours, left out");
            return Self::default();
        }
        let unit = if most >= BYTES { MOST } else { 1.0 };
        if unit == MOST {
            report.note("colours of vertices are in 0 to 255: divided by 255");
        }
        let linear = |stated: f32| {
            if stated.is_nan() { stated } else { srgb_to_linear((stated / unit).clamp(0.0, 1.0)) }
        };
        let linear = |rgb: &[f32; 3]| {
            if rgb.iter().any(|x| x.is_nan()) { [f32::NAN; 3] } else { rgb.map(linear) }
        };
        Self(stated.iter().map(linear).collect())
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// What multiplies the material's colour at a vertex, numbered from 0. The default
    /// material is white where there are colours: without one, a vertex makes it grey.
    pub(super) fn of(&self, vertex: usize, is_default: bool) -> [f32; 3] {
        match self.0.get(vertex) {
            Some(color) if !color[0].is_nan() => *color,
            _ => [if is_default { GREY } else { 1.0 }; 3],
        }
    }
}

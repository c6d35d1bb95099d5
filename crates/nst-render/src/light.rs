//! Area lights: every emitting triangle, chosen in proportion to its power.

use glam::{Vec2, Vec3A};

use crate::Scene;

/// A point on a light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightSample {
    pub(crate) position: Vec3A,
    /// Unit geometric normal.
    pub(crate) normal: Vec3A,
    pub(crate) emission: Vec3A,
    /// Probability density with respect to surface area.
    pub(crate) pdf_area: f32,
}

/// The emitting triangles of a scene.
pub(crate) struct Lights {
    /// Triangle index and cumulative probability, which ends at 1.
    table: Vec<(u32, f32)>,
    /// By material: the density with respect to area, because a triangle's
    /// probability is proportional to its area times its luminance.
    pdf_area: Vec<f32>,
}

/// Luminance of linear sRGB (ITU-R BT.709).
fn luminance(rgb: Vec3A) -> f32 {
    rgb.dot(Vec3A::new(0.2126, 0.7152, 0.0722))
}

impl Lights {
    pub(crate) fn new(scene: &Scene) -> Self {
        let power = |&(_, power): &(u32, f64)| power;
        let emitters: Vec<(u32, f64)> = (0..)
            .zip(&scene.triangles)
            .filter_map(|(index, triangle)| {
                let material = &scene.materials[triangle.material as usize];
                let area = f64::from(triangle.area_vector().length()) / 2.0;
                material.emits().then(|| (index, area * f64::from(luminance(material.emission))))
            })
            .collect();
        let total: f64 = emitters.iter().map(power).sum();
        let mut cumulative = 0.0;
        let table = emitters
            .iter()
            .map(|emitter| {
                cumulative += power(emitter);
                (emitter.0, (cumulative / total) as f32)
            })
            .collect();
        let pdf_area = scene
            .materials
            .iter()
            .map(
                |m| if m.emits() { (f64::from(luminance(m.emission)) / total) as f32 } else { 0.0 },
            )
            .collect();
        Self { table, pdf_area }
    }

    /// The density, with respect to area, of sampling a point of this material.
    pub(crate) fn pdf_area(&self, material: u32) -> f32 {
        self.pdf_area[material as usize]
    }

    /// A point on a light; `None` if there is no light.
    pub(crate) fn sample(&self, scene: &Scene, pick: f32, u: Vec2) -> Option<LightSample> {
        let last = self.table.len().checked_sub(1)?;
        let chosen = self.table.partition_point(|&(_, cumulative)| cumulative <= pick).min(last);
        let triangle = &scene.triangles[self.table[chosen].0 as usize];
        let [a, b, c] = triangle.positions;
        // Uniform on the triangle: fold the square's upper half onto the lower.
        let u = if u.x + u.y > 1.0 { 1.0 - u } else { u };
        Some(LightSample {
            position: a + (b - a) * u.x + (c - a) * u.y,
            normal: triangle.area_vector().normalize(),
            emission: scene.materials[triangle.material as usize].emission,
            pdf_area: self.pdf_area(triangle.material),
        })
    }
}

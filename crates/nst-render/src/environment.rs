//! Light from outside the scene. If it is an image, its bright parts are sampled more.

pub(crate) mod importance;

use std::f32::consts::PI;

use glam::Vec3A;

use crate::{Environment, Texture};

impl Environment {
    /// The radiance that arrives from the unit direction `towards` it.
    pub(crate) fn radiance(&self, towards: Vec3A) -> Vec3A {
        match &self.image {
            None => self.radiance,
            Some(image) => {
                let place = Place::of(towards, self.rotation, image.size());
                self.radiance * place.color(image.texels())
            }
        }
    }
}

/// The place in an image that shows what is seen in a direction: between the centres of
/// four texels. Columns go round; beyond the centres of the first and the last row are the
/// polar caps, where only one row counts.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// The angle from +y.
    theta: f32,
    /// How many rows have their centres above; 0 and all are the polar caps.
    strip: usize,
    /// Where the rows above and below begin in the list of texels; in the caps they are one.
    rows: [usize; 2],
    /// The columns to the left and to the right.
    columns: [usize; 2],
    /// How far the place is from the column to the left towards that to the right, 0 to 1.
    across: f32,
    /// How far it is from the row above towards that below, 0 to 1.
    down: f32,
}

impl Place {
    /// Without rotation, u = 0 is −z, u = 1/4 is +x, and the first row is +y. Mitsuba's
    /// `envmap` has the same orientation. `rotation` turns the image about +y by degrees,
    /// from +z towards +x.
    fn of(direction: Vec3A, rotation: f32, [width, height]: [u32; 2]) -> Self {
        let turn = direction.x.atan2(-direction.z) / (2.0 * PI) + rotation / 360.0;
        // Exact near the poles, where the arc cosine is not.
        let theta = (direction.x * direction.x + direction.z * direction.z).sqrt();
        let theta = theta.atan2(direction.y);
        let x = (turn - turn.floor()) * width as f32 - 0.5;
        let y = theta / PI * height as f32 - 0.5;
        let (width, height) = (width as usize, height as usize);
        // The first half of column 0 lies to the right of the last column's centre.
        let left = if x < 0.0 { width - 1 } else { (x as usize).min(width - 1) };
        let right = if left + 1 == width { 0 } else { left + 1 };
        let strip = ((y + 1.0) as usize).min(height);
        Self {
            theta,
            strip,
            rows: adjacent_rows(strip, height).map(|row| row * width),
            columns: [left, right],
            across: x - x.floor(),
            down: y - y.floor(),
        }
    }

    /// The bilinear interpolation of the four texels.
    fn color(&self, texels: &[[f32; 3]]) -> Vec3A {
        let texel = |row: usize, column: usize| Vec3A::from(texels[row + column]);
        let [left, right] = self.columns;
        let [top, bottom] =
            self.rows.map(|row| texel(row, left).lerp(texel(row, right), self.across));
        top.lerp(bottom, self.down)
    }
}

/// The rows between whose centres a strip lies; in a polar cap they are the same.
fn adjacent_rows(strip: usize, height: usize) -> [usize; 2] {
    [strip.saturating_sub(1), strip.min(height - 1)]
}

/// A texture's rows of texels.
fn rows(image: &Texture) -> std::slice::ChunksExact<'_, [f32; 3]> {
    image.texels().chunks_exact(image.size()[0] as usize)
}

#[cfg(test)]
mod tests;

//! Images over surfaces.

use glam::{Vec2, Vec3A};

/// A linear RGB image.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    size: [u32; 2],
    texels: Vec<[f32; 3]>,
}

impl Texture {
    /// An image of rows from the top; `None` unless there is one texel per pixel, and at least one.
    #[must_use]
    pub fn new(size: [u32; 2], texels: Vec<[f32; 3]>) -> Option<Self> {
        let pixels = size[0] as usize * size[1] as usize;
        (pixels > 0 && texels.len() == pixels).then_some(Self { size, texels })
    }

    /// Width and height.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The texels, row by row from the top.
    #[must_use]
    pub fn texels(&self) -> &[[f32; 3]] {
        &self.texels
    }

    /// The colour at `uv`, interpolated between texel centres; it repeats beyond [0, 1]², and v points up.
    #[must_use]
    pub fn sample(&self, uv: Vec2) -> Vec3A {
        let [width, height] = self.size;
        let x = uv.x * width as f32 - 0.5;
        let y = (1.0 - uv.y) * height as f32 - 0.5;
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let texel = |dx: i64, dy: i64| {
            let column = (x.floor() as i64 + dx).rem_euclid(i64::from(width));
            let row = (y.floor() as i64 + dy).rem_euclid(i64::from(height));
            Vec3A::from(self.texels[(row * i64::from(width) + column) as usize])
        };
        let top = texel(0, 0).lerp(texel(1, 0), fx);
        let bottom = texel(0, 1).lerp(texel(1, 1), fx);
        top.lerp(bottom, fy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_centres_and_between_and_beyond() {
        let texels = [[0.0; 3], [1.0; 3], [2.0; 3], [4.0; 3]].to_vec();
        let texture = Texture::new([2, 2], texels).expect("four texels");
        let at = |u, v| texture.sample(Vec2::new(u, v)).x;
        // The top row is v = 0.75.
        assert_eq!(
            [at(0.25, 0.75), at(0.75, 0.75), at(0.25, 0.25), at(0.75, 0.25)],
            [0.0, 1.0, 2.0, 4.0]
        );
        assert_eq!(at(0.5, 0.75), 0.5);
        assert_eq!(at(0.25, 0.5), 1.0);
        assert_eq!(at(1.25, -1.25), 0.0);
        assert!(Texture::new([2, 2], vec![[0.0; 3]; 3]).is_none());
        assert!(Texture::new([0, 2], vec![]).is_none());
    }
}

//! Images over surfaces.

use glam::{Vec2, Vec3A};
use sha2::{Digest, Sha256};

/// A linear RGB image.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    size: [u32; 2],
    texels: Vec<[f32; 3]>,
    /// See [`Texture::digest`].
    digest: [u8; 32],
}

impl Texture {
    /// An image of rows from the top; `None` unless there is one texel per pixel, and at least one.
    #[must_use]
    pub fn new(size: [u32; 2], texels: Vec<[f32; 3]>) -> Option<Self> {
        let mut hash = Sha256::new_with_prefix("texels");
        for number in size {
            hash.update(number.to_le_bytes());
        }
        for number in texels.iter().flatten() {
            hash.update(number.to_le_bytes());
        }
        Self::with_digest(size, texels, hash.finalize().into())
    }

    /// The image that the bytes of a file were decoded to; `None` as in [`Self::new`].
    pub(crate) fn of_file(size: [u32; 2], texels: Vec<[f32; 3]>, file: &[u8]) -> Option<Self> {
        let digest = Sha256::new_with_prefix("file").chain_update(file).finalize();
        Self::with_digest(size, texels, digest.into())
    }

    fn with_digest(size: [u32; 2], texels: Vec<[f32; 3]>, digest: [u8; 32]) -> Option<Self> {
        let pixels = size[0] as usize * size[1] as usize;
        (pixels > 0 && texels.len() == pixels).then_some(Self { size, texels, digest })
    }

    /// The same image with texels of 1 at most.
    pub(crate) fn limited(&self) -> Self {
        let digest = Sha256::new_with_prefix("limited").chain_update(self.digest).finalize();
        let texels = self.texels.iter().map(|texel| texel.map(|x| x.min(1.0))).collect();
        Self { size: self.size, texels, digest: digest.into() }
    }

    /// Names the image, for the scene's fingerprint. An image from a file is named by
    /// the file's bytes: its texels may differ in the last bits between machines, as
    /// decoders of sRGB and JPEG do. Any other image is named by its texels.
    pub(crate) fn digest(&self) -> &[u8; 32] {
        &self.digest
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

    #[test]
    fn digests_tell_images_apart() {
        let texels = vec![[0.5; 3], [1.0, 2.0, 3.0]];
        let plain = Texture::new([2, 1], texels.clone()).expect("two texels");
        let [mut texel, mut order] = [texels.clone(), texels.clone()];
        texel[1][2] = 3.5;
        order.swap(0, 1);
        let file =
            |bytes: &[u8]| Texture::of_file([2, 1], texels.clone(), bytes).expect("two texels");
        let digests = [
            *plain.digest(),
            *Texture::new([1, 2], texels.clone()).expect("two texels").digest(),
            *Texture::new([2, 1], texel).expect("two texels").digest(),
            *Texture::new([2, 1], order).expect("two texels").digest(),
            *plain.limited().digest(),
            *file(b"a").digest(),
            *file(b"b").digest(),
        ];
        for (i, digest) in digests.iter().enumerate() {
            assert!(!digests[..i].contains(digest), "{i}");
        }
        assert_eq!(Texture::new([2, 1], texels.clone()), Some(plain));
        assert_eq!(file(b"a"), file(b"a"));
    }
}

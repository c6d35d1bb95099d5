//! Images over surfaces.

use std::sync::Arc;

use glam::{Vec2, Vec3A};
use sha2::{Digest, Sha256};

/// How an image lies on surfaces: the colour at a texture coordinate t is that of the image at
/// t · `scale` + `offset`.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureMap {
    /// The image.
    pub image: Arc<Texture>,
    /// How often the image is repeated where u and v grow by 1; finite.
    pub scale: Vec2,
    /// Where the image is at u = v = 0; finite.
    pub offset: Vec2,
    /// Whether there is one copy of the image, whose edges go on for ever; else it repeats.
    pub clamp: bool,
}

impl From<Arc<Texture>> for TextureMap {
    /// The image as it is.
    fn from(image: Arc<Texture>) -> Self {
        Self { image, scale: Vec2::ONE, offset: Vec2::ZERO, clamp: false }
    }
}

impl TextureMap {
    /// The colour at a texture coordinate, interpolated between texel centres.
    #[must_use]
    pub fn sample(&self, uv: Vec2) -> Vec3A {
        self.patch(uv).sample()
    }

    /// How fast the first channel of [`Self::sample`] grows with u and with v.
    #[must_use]
    pub fn gradient(&self, uv: Vec2) -> Vec2 {
        let patch = self.patch(uv);
        let texel = |column, row| patch.texel(column, row).x;
        let Vec2 { x, y } = patch.fraction;
        let [left, right] = [0, 1].map(|column| [texel(column, 0), texel(column, 1)]);
        let across = (right[0] - left[0]) * (1.0 - y) + (right[1] - left[1]) * y;
        let down = (left[1] - left[0]) * (1.0 - x) + (right[1] - right[0]) * x;
        let [width, height] = self.image.size.map(|size| size as f32);
        Vec2::new(across * width, -down * height) * self.scale
    }

    fn patch(&self, uv: Vec2) -> Patch<'_> {
        self.image.patch(uv * self.scale + self.offset, self.clamp)
    }
}

/// The four texels about a point.
struct Patch<'a> {
    texture: &'a Texture,
    columns: [usize; 2],
    rows: [usize; 2],
    /// Where the point is between the first and the second of them.
    fraction: Vec2,
}

impl Patch<'_> {
    fn texel(&self, column: usize, row: usize) -> Vec3A {
        let index = self.rows[row] * self.texture.size[0] as usize + self.columns[column];
        Vec3A::from(self.texture.texels[index])
    }

    fn sample(&self) -> Vec3A {
        let Vec2 { x, y } = self.fraction;
        let top = self.texel(0, 0).lerp(self.texel(1, 0), x);
        let bottom = self.texel(0, 1).lerp(self.texel(1, 1), x);
        top.lerp(bottom, y)
    }
}

/// An RGB image; linear if it contains colours.
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

    /// The numbers that `decoding` makes of the bytes of a file; `None` as in [`Self::new`].
    pub(crate) fn of_decoding(
        size: [u32; 2],
        texels: Vec<[f32; 3]>,
        file: &[u8],
        decoding: &str,
    ) -> Option<Self> {
        let digest = Sha256::new_with_prefix("decoding")
            .chain_update((decoding.len() as u64).to_le_bytes())
            .chain_update(decoding)
            .chain_update(file)
            .finalize();
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
        self.patch(uv, false).sample()
    }

    /// Beyond [0, 1]² the image repeats, or, with `clamp`, the texels at its edges do.
    fn patch(&self, uv: Vec2, clamp: bool) -> Patch<'_> {
        let [width, height] = self.size;
        let x = uv.x * width as f32 - 0.5;
        let y = (1.0 - uv.y) * height as f32 - 0.5;
        let fraction = Vec2::new(x - x.floor(), y - y.floor());
        let place = |first: f32, size: u32| {
            [0, 1].map(|step| {
                let (place, size) = ((first as i64).saturating_add(step), i64::from(size));
                let place = if clamp { place.clamp(0, size - 1) } else { place.rem_euclid(size) };
                place as usize
            })
        };
        Patch {
            texture: self,
            columns: place(x.floor(), width),
            rows: place(y.floor(), height),
            fraction,
        }
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
    fn maps_scale_move_and_end() {
        let texels = vec![[0.0; 3], [1.0; 3], [2.0; 3], [3.0; 3]];
        let image = Arc::new(Texture::new([4, 1], texels).expect("four texels"));
        let plain = TextureMap::from(image);
        let at = |map: &TextureMap, u| map.sample(Vec2::new(u, 0.5)).x;
        assert_eq!([at(&plain, 0.125), at(&plain, 1.125), at(&plain, 0.0)], [0.0, 0.0, 1.5]);
        let clamped = TextureMap { clamp: true, ..plain.clone() };
        assert_eq!([at(&clamped, 0.0), at(&clamped, -7.0), at(&clamped, 9.0)], [0.0, 0.0, 3.0]);
        let scale = Vec2::new(2.0, 1.0);
        let moved = TextureMap { scale, offset: Vec2::new(0.125, 0.0), ..plain };
        assert_eq!([at(&moved, 0.0), at(&moved, 0.25)], [0.0, 2.0]);
        // A texel is a quarter of u; u is doubled.
        assert_eq!(moved.gradient(Vec2::new(0.2, 0.5)), Vec2::new(8.0, 0.0));
        assert_eq!(clamped.gradient(Vec2::new(9.0, 0.5)), Vec2::ZERO);
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

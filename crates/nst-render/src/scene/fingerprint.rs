//! [`Scene::fingerprint`], the name of a family of integrals.

use sha2::{Digest, Sha256};

use super::{Scene, Triangle};
use crate::{Disney, Material, Scattering};

/// Changes whenever the same scene gets another hash.
const VERSION: &str = "v2";

impl Scene {
    /// Names the family of integrals that the pixels are: `NAME:v2:HASH`, with the
    /// scene's name and 16 hexadecimal digits. A network that was trained on a scene
    /// carries its fingerprint, and so does a sequence file.
    ///
    /// The hash covers everything that decides a pixel's integral but the size of the
    /// film: triangles, materials, environment, camera, the pixel filter and the
    /// number of vertices, as they are now. It covers neither Russian roulette, which
    /// keeps the integral, nor names of materials, notes and paths. Images from files
    /// count by the bytes of the file, all other numbers by their values, which are
    /// the same on every machine: what the loader computes, it computes with
    /// operations whose results IEEE 754 fixes.
    ///
    /// It is SHA-256, cut to 64 bits, of named fields, each with its length
    /// (see the source). Of a million scenes, two have the same with a probability of
    /// 3e-8; somebody who looks for two on purpose can find them.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        let mut fields = Fields::default();
        fields.text("format", "nst-scene-2");
        fields.integers("materials", [self.materials.len() as u32]);
        self.materials.iter().for_each(|material| fields.material(material));
        fields.triangles(&self.triangles);
        if !self.vertex_colors.is_empty() {
            let colors = self.vertex_colors.as_flattened().as_flattened();
            fields.numbers("triangles.colors", colors.iter().copied());
        }
        fields.numbers("environment.radiance", self.environment.radiance.to_array());
        let image = self.environment.image.as_deref();
        fields.bytes("environment.image", image.map_or(&[], |image| image.digest()));
        if image.is_some() && self.environment.rotation != 0.0 {
            fields.numbers("environment.rotation", [self.environment.rotation]);
        }
        if let Some(background) = self.environment.background {
            fields.numbers("environment.background", background.to_array());
        }
        fields.numbers("camera.position", self.camera.position.to_array());
        fields.numbers("camera.target", self.camera.target.to_array());
        fields.numbers("camera.up", self.camera.up.to_array());
        fields.numbers("camera.vertical_fov", [self.camera.vertical_fov]);
        fields.integers("max_depth", [self.max_depth]);
        fields.text("pixel_filter", &self.pixel_filter.to_string());
        format!("{}:{VERSION}:{}", self.name, fields.finish())
    }
}

/// A hash of named fields: of each, the length of the name, the name, the length of
/// the value and the value, all lengths in bytes as 64-bit integers, and all numbers
/// little-endian. So no two lists of fields give the hash the same bytes.
#[derive(Default)]
struct Fields {
    hash: Sha256,
}

impl Fields {
    fn bytes(&mut self, name: &str, value: &[u8]) {
        self.begin(name, value.len());
        self.hash.update(value);
    }

    fn text(&mut self, name: &str, value: &str) {
        self.bytes(name, value.as_bytes());
    }

    /// −0 counts as 0: it is the same number, and machines differ in which one is
    /// the smaller.
    fn numbers<N>(&mut self, name: &str, values: N)
    where
        N: IntoIterator<Item = f32, IntoIter: Clone>,
    {
        let bits = values.into_iter().map(|x| (x + 0.0).to_bits());
        self.integers(name, bits);
    }

    fn integers<N>(&mut self, name: &str, values: N)
    where
        N: IntoIterator<Item = u32, IntoIter: Clone>,
    {
        let values = values.into_iter();
        self.begin(name, values.clone().count() * size_of::<u32>());
        for value in values {
            self.hash.update(value.to_le_bytes());
        }
    }

    fn begin(&mut self, name: &str, length: usize) {
        self.hash.update((name.len() as u64).to_le_bytes());
        self.hash.update(name);
        self.hash.update((length as u64).to_le_bytes());
    }

    /// One field per quantity, with the values of all triangles: normals and texture
    /// coordinates of those that have them, and which ones these are.
    fn triangles(&mut self, triangles: &[Triangle]) {
        let all = triangles.iter();
        let positions = all.clone().flat_map(|t| t.positions);
        self.numbers("triangles.positions", positions.flat_map(|p| p.to_array()));
        self.integers("triangles.material", all.clone().map(|t| t.material));
        self.integers("triangles.has_normals", all.clone().map(|t| t.normals.is_some().into()));
        let normals = all.clone().filter_map(|t| t.normals).flatten();
        self.numbers("triangles.normals", normals.flat_map(|n| n.to_array()));
        self.integers("triangles.has_uvs", all.clone().map(|t| t.uvs.is_some().into()));
        let uvs = all.filter_map(|t| t.uvs).flatten();
        self.numbers("triangles.uvs", uvs.flat_map(|uv| uv.to_array()));
    }

    fn material(&mut self, material: &Material) {
        // Without `..`: a new field must be thought of here.
        let Material { name: _, color, color_texture, emission, emission_texture, scattering } =
            material;
        self.numbers("material.color", color.to_array());
        let texture = color_texture.as_deref();
        self.bytes("material.color_texture", texture.map_or(&[], |texture| texture.digest()));
        self.numbers("material.emission", emission.to_array());
        let texture = emission_texture.as_deref();
        self.bytes("material.emission_texture", texture.map_or(&[], |texture| texture.digest()));
        match scattering {
            Scattering::Lambert => self.text("material.scattering", "lambert"),
            Scattering::Disney(disney) => {
                self.text("material.scattering", "disney");
                self.disney(disney);
            }
            Scattering::Dielectric { ior } => {
                self.text("material.scattering", "dielectric");
                self.numbers("dielectric.ior", [*ior]);
            }
        }
    }

    fn disney(&mut self, disney: &Disney) {
        let &Disney {
            metallic,
            roughness,
            specular,
            specular_tint,
            anisotropic,
            sheen,
            sheen_tint,
            clearcoat,
            clearcoat_gloss,
        } = disney;
        self.numbers("disney.metallic", [metallic]);
        self.numbers("disney.roughness", [roughness]);
        self.numbers("disney.specular", [specular]);
        self.numbers("disney.specular_tint", [specular_tint]);
        self.numbers("disney.anisotropic", [anisotropic]);
        self.numbers("disney.sheen", [sheen]);
        self.numbers("disney.sheen_tint", [sheen_tint]);
        self.numbers("disney.clearcoat", [clearcoat]);
        self.numbers("disney.clearcoat_gloss", [clearcoat_gloss]);
    }

    fn finish(self) -> String {
        self.hash.finalize()[..8].iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

#[cfg(test)]
mod tests;

//! What surfaces are made of.

use std::sync::Arc;

use glam::Vec3A;

use crate::Texture;

/// A surface: how it scatters light, and what it emits.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The name in the MTL file.
    pub name: String,
    /// Reflectance or base colour, linear RGB in [0, 1]; multiplies the texture if there is one.
    pub color: Vec3A,
    /// Reflectance over the surface.
    pub color_texture: Option<Arc<Texture>>,
    /// Emitted radiance, linear RGB; nonzero makes the surface an area light that shines from both sides.
    pub emission: Vec3A,
    /// Emission over the surface; multiplies `emission`.
    pub emission_texture: Option<Arc<Texture>>,
    /// How the surface scatters light.
    pub scattering: Scattering,
}

/// How a surface scatters light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Scattering {
    /// The same radiance in all directions, from both sides.
    #[default]
    Lambert,
    /// Disney's principled BRDF, on both sides.
    Disney(Disney),
    /// A smooth boundary between air and a medium that does not absorb.
    Dielectric {
        /// Index of refraction of the side that the geometric normal points away from.
        ior: f32,
    },
}

/// Parameters of Disney's principled BRDF (Burley 2012), all in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disney {
    /// Dielectric (0) to metal (1).
    pub metallic: f32,
    /// Squared, it is the GGX width α.
    pub roughness: f32,
    /// Reflectance of the dielectric at normal incidence, in units of 8 %.
    pub specular: f32,
    /// Tints the dielectric's reflection towards the base colour.
    pub specular_tint: f32,
    /// Stretches the highlight along the tangent.
    pub anisotropic: f32,
    /// Strength of the sheen at grazing angles.
    pub sheen: f32,
    /// Tints the sheen towards the base colour.
    pub sheen_tint: f32,
    /// Strength of a second, clear layer.
    pub clearcoat: f32,
    /// Satin (0) to gloss (1) of that layer.
    pub clearcoat_gloss: f32,
}

impl Default for Disney {
    fn default() -> Self {
        Self {
            metallic: 0.0,
            roughness: 0.5,
            specular: 0.5,
            specular_tint: 0.0,
            anisotropic: 0.0,
            sheen: 0.0,
            sheen_tint: 0.0,
            clearcoat: 0.0,
            clearcoat_gloss: 1.0,
        }
    }
}

impl Material {
    /// Whether surfaces of this material are lights.
    #[must_use]
    pub fn emits(&self) -> bool {
        self.emission.max_element() > 0.0
    }
}

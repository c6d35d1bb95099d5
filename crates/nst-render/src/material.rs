//! What surfaces are made of.

use glam::Vec3A;

use crate::TextureMap;

/// A surface: how it scatters light, and what it emits.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The name in the MTL file.
    pub name: String,
    /// Reflectance or base colour, linear RGB in [0, 1]; multiplies the texture if there is one.
    pub color: Vec3A,
    /// Reflectance over the surface.
    pub color_texture: Option<TextureMap>,
    /// Emitted radiance, linear RGB; nonzero makes the surface an area light that shines from both sides.
    pub emission: Vec3A,
    /// Emission over the surface; multiplies `emission`.
    pub emission_texture: Option<TextureMap>,
    /// Opacity in [0, 1]: the share of the light that meets the surface; the rest goes straight
    /// through. Multiplies the texture if there is one.
    pub opacity: f32,
    /// Opacity over the surface, in all three channels alike.
    pub opacity_texture: Option<TextureMap>,
    /// Shading normals that differ from the surface's own.
    pub relief: Option<Relief>,
    /// How the surface scatters light.
    pub scattering: Scattering,
}

/// Small shapes that only shading shows. They need texture coordinates, and look the same from
/// both sides of the surface.
#[derive(Clone, Debug, PartialEq)]
pub enum Relief {
    /// Shading normals n as colours (n + 1) / 2, in the frame of the directions in which u and v
    /// grow, and the surface's normal.
    Normals(TextureMap),
    /// Heights above the surface.
    Bumps {
        /// Heights, in all three channels alike.
        map: TextureMap,
        /// Multiplies them, in the scene's unit of length.
        scale: f32,
    },
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
    /// A pane of a medium that does not absorb, so thin that light comes out opposite to where it
    /// went in; the same from both sides.
    ThinDielectric {
        /// Index of refraction of the medium.
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

/// GGX widths α up to this one are mirrors to whoever looks at features: Cycles, too, follows
/// paths through them (`intern/cycles/kernel/film/denoising_passes.h`).
const MIRROR_ALPHA: f32 = 0.075;

/// Reflectance of a surface of which nobody says it: as light as white paint.
pub(crate) const GREY: f32 = 0.8;

/// A surface without a name that reflects 80 % of the light in all directions, and emits none.
impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            color: Vec3A::splat(GREY),
            color_texture: None,
            emission: Vec3A::ZERO,
            emission_texture: None,
            opacity: 1.0,
            opacity_texture: None,
            relief: None,
            scattering: Scattering::Lambert,
        }
    }
}

impl Material {
    /// Whether light goes straight through parts of the surface, or through all of it by chance.
    #[must_use]
    pub fn is_cut_out(&self) -> bool {
        self.opacity < 1.0 || self.opacity_texture.is_some()
    }

    /// Whether a camera sees others in surfaces of this material, rather than their own colour:
    /// glass, and metals that are smooth.
    pub(crate) fn shows_others(&self) -> bool {
        match self.scattering {
            Scattering::Lambert => false,
            Scattering::Dielectric { .. } | Scattering::ThinDielectric { .. } => true,
            Scattering::Disney(Disney { metallic, roughness, anisotropic, .. }) => {
                // The greater of both widths.
                let alpha = roughness * roughness / (1.0 - 0.9 * anisotropic).sqrt();
                metallic == 1.0 && alpha <= MIRROR_ALPHA
            }
        }
    }

    /// About the share of light that a surface of a reflectance or base colour reflects, whatever
    /// the directions: for Disney's materials, that of diffuse and specular reflection at normal
    /// incidence; for glass, 1, as it reflects or passes everything.
    pub(crate) fn albedo(&self, color: Vec3A) -> Vec3A {
        match self.scattering {
            Scattering::Lambert => color,
            Scattering::Disney(Disney { metallic, specular, .. }) => {
                // `Disney::specular` says what its unit is.
                color + (1.0 - metallic) * 0.08 * specular
            }
            Scattering::Dielectric { .. } | Scattering::ThinDielectric { .. } => Vec3A::ONE,
        }
    }

    /// Whether surfaces of this material are lights.
    #[must_use]
    pub fn emits(&self) -> bool {
        self.emission.max_element() > 0.0
    }
}

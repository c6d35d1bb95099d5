//! How surfaces scatter light: bidirectional scattering distribution functions.
//!
//! Every direction is a unit vector in the local frame of the surface, points
//! away from it, and has z along the shading normal. `wo` is where light goes,
//! to the camera; `wi` is where it comes from, and what paths sample.
//!
//! The frame must not depend on `wo`: z is the *outward* side of the surface, the
//! side that its geometric normal points to, and `wo.z < 0` means that the surface is
//! seen from behind. A frame that is turned to face `wo` makes no difference to Lambert
//! and Disney, which are the same on both sides, but with it no path could leave a
//! dielectric.
//! Light passes through a surface if and only if `wo.z · wi.z < 0`; where normals
//! are interpolated, the caller compares that with the geometric normal.

mod dielectric;
mod disney;
mod energy;
mod frame;
pub(crate) mod lambert;
mod microfacet;
mod sample;

#[cfg(test)]
mod chi2;
#[cfg(test)]
mod reference;
#[cfg(test)]
mod test_data;
#[cfg(test)]
mod tests;

use glam::{Vec2, Vec3A};

use crate::{Material, Scattering};

pub(crate) use {
    dielectric::Dielectric,
    disney::{DisneyBsdf, PreparedDisney},
    frame::Frame,
    sample::BsdfSample,
};

/// What a material's scattering needs at every hit, computed once per material.
#[derive(Clone, Debug)]
pub(crate) enum Prepared {
    Lambert,
    Disney(Box<PreparedDisney>),
    Dielectric(Dielectric),
}

/// The scattering at one point of a surface.
#[derive(Clone, Debug)]
pub(crate) enum Bsdf<'a> {
    Lambert { reflectance: Vec3A },
    Disney(DisneyBsdf<'a>),
    Dielectric(Dielectric),
}

impl Prepared {
    /// For Disney, this tabulates how much light is reflected, which takes milliseconds.
    pub(crate) fn new(material: &Material) -> Self {
        Self::with(material, &[Vec3A::ONE])
    }

    /// The same, where colours of vertices multiply the material's: any within 0 and 1.
    pub(crate) fn colored(material: &Material) -> Self {
        // As bright and as pure as any.
        Self::with(material, &[Vec3A::ONE, Vec3A::X, Vec3A::Y, Vec3A::Z])
    }

    /// `factors`: what may multiply the material's colour.
    fn with(material: &Material, factors: &[Vec3A]) -> Self {
        match material.scattering {
            Scattering::Lambert => Self::Lambert,
            Scattering::Disney(parameters) => {
                Self::Disney(Box::new(PreparedDisney::new(&parameters, colors(material, factors))))
            }
            Scattering::Dielectric { ior } => Self::Dielectric(Dielectric::new(ior)),
        }
    }

    /// The scattering where the reflectance or base colour, texture included, is
    /// `color`. A dielectric has none.
    #[inline]
    pub(crate) fn at(&self, color: Vec3A) -> Bsdf<'_> {
        match self {
            Self::Lambert => Bsdf::Lambert { reflectance: color },
            Self::Disney(disney) => Bsdf::Disney(disney.at(color)),
            Self::Dielectric(dielectric) => Bsdf::Dielectric(*dielectric),
        }
    }
}

/// Colours whose convex hull contains every colour of the material, or whose brightest and
/// purest are as bright and as pure.
fn colors(material: &Material, factors: &[Vec3A]) -> impl Iterator<Item = Vec3A> {
    let texels = material.color_texture.as_ref().map_or(&[[1.0; 3]][..], |t| t.texels());
    texels.iter().flat_map(move |&texel| {
        factors.iter().map(move |factor| material.color * Vec3A::from(texel) * factor)
    })
}

impl Bsdf<'_> {
    /// f(wo, wi) · |cos θi|; zero for a delta distribution.
    #[cfg(test)]
    pub(crate) fn eval(&self, wo: Vec3A, wi: Vec3A) -> Vec3A {
        self.eval_pdf(wo, wi).0
    }

    /// The density of `sample` with respect to solid angle at `wi`; zero for a
    /// delta distribution. Its integral over `wi` falls short of 1 by the
    /// probability that `sample` returns `None`.
    #[cfg(test)]
    pub(crate) fn pdf(&self, wo: Vec3A, wi: Vec3A) -> f32 {
        self.eval_pdf(wo, wi).1
    }

    /// `eval` and `pdf`, in little more time than one of them takes.
    #[inline]
    pub(crate) fn eval_pdf(&self, wo: Vec3A, wi: Vec3A) -> (Vec3A, f32) {
        match self {
            Self::Lambert { reflectance } => {
                let pdf = lambert::density(wo.z, wi.z);
                (*reflectance * pdf, pdf)
            }
            Self::Disney(disney) => disney.eval_pdf(wo, wi),
            Self::Dielectric(_) => (Vec3A::ZERO, 0.0),
        }
    }

    /// Draws `wi` with `u` and `u2` uniform on [0, 1) and [0, 1)². `None` is a
    /// sample too: one that carries no light.
    #[inline]
    pub(crate) fn sample(&self, wo: Vec3A, u: f32, u2: Vec2) -> Option<BsdfSample> {
        match self {
            Self::Lambert { reflectance } => {
                let wi = Vec3A::from(lambert::sample(wo.z, u2));
                let pdf = lambert::density(wo.z, wi.z);
                (pdf > 0.0).then_some(BsdfSample { wi, weight: *reflectance, pdf, delta: false })
            }
            Self::Disney(disney) => disney.sample(wo, u, u2),
            Self::Dielectric(dielectric) => dielectric.sample(wo, u),
        }
    }

    /// Whether every sample is a delta sample, so that light sampling finds nothing.
    #[inline]
    pub(crate) fn is_delta(&self) -> bool {
        matches!(self, Self::Dielectric(_))
    }
}

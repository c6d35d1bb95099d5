//! What paths need of a scene, and how light samples and BSDF samples share the work.

use glam::Vec3;

use crate::{
    Scattering, Scene, Triangle, accelerator::Accelerator, bsdf::Prepared,
    instructions::Instructions, light::Lights,
};

/// A scene with everything that paths need.
pub(crate) struct PathTracer<'a> {
    pub(super) scene: &'a Scene,
    pub(super) accelerator: Accelerator,
    pub(super) lights: Lights,
    /// By triangle.
    pub(super) facets: Vec<Facet>,
    /// By material.
    pub(super) scattering: Vec<Prepared>,
    /// [`Scene::scale`], for [`crate::accelerator::offset`].
    pub(super) scale: f32,
    pub(super) strategy: Strategy,
    /// Whether any facet is cut out.
    pub(super) has_cut_outs: bool,
    /// Whether any facet shows others.
    pub(super) has_mirrors: bool,
    pub(super) instructions: Instructions,
}

/// What most hits need of a triangle, in one cache line.
#[repr(align(64))]
pub(super) struct Facet {
    pub(super) corners: [Vec3; 3],
    /// Unit geometric normal.
    pub(super) normal: Vec3,
    pub(super) material: u32,
    /// The density of its points among light samples, with respect to area; 0 if it is no
    /// light.
    pub(super) pdf_area: f32,
    pub(super) emits: bool,
    /// Whether it scatters as Lambert's law says.
    pub(super) lambert: bool,
    /// Whether it has shading normals.
    pub(super) smooth: bool,
    /// Whether its colour comes from a texture, or from its corners.
    pub(super) textured: bool,
    /// Whether it has a relief.
    pub(super) relief: bool,
    /// Whether light may pass as if it was not there.
    pub(super) cut_out: bool,
    /// Whether the camera sees others in it: [`Material::shows_others`].
    pub(super) shows_others: bool,
}

/// Which samples count where light sampling and BSDF sampling can find the same light.
/// All strategies have the same expectation; tests compare them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Strategy {
    /// Both, weighted by the power heuristic.
    Both,
    #[cfg(test)]
    LightsOnly,
    #[cfg(test)]
    BsdfOnly,
}

impl<'a> PathTracer<'a> {
    pub(crate) fn new(scene: &'a Scene) -> Self {
        let colored = !scene.vertex_colors.is_empty();
        let prepare = if colored { Prepared::colored } else { Prepared::new };
        let facet = |triangle: &Triangle| {
            let material = &scene.materials[triangle.material as usize];
            Facet {
                corners: triangle.positions.map(Vec3::from),
                normal: triangle.area_vector().normalize().into(),
                material: triangle.material,
                pdf_area: 0.0,
                emits: material.emits(),
                lambert: matches!(material.scattering, Scattering::Lambert),
                smooth: triangle.normals.is_some(),
                textured: material.color_texture.is_some() || colored,
                relief: material.relief.is_some(),
                cut_out: material.is_cut_out(),
                shows_others: material.shows_others(),
            }
        };
        // First, as building it takes the most memory.
        let accelerator = Accelerator::new(&scene.triangles);
        let lights = Lights::new(scene);
        let mut facets: Vec<_> = scene.triangles.iter().map(facet).collect();
        for (triangle, pdf_area) in lights.densities() {
            facets[triangle as usize].pdf_area = pdf_area;
        }
        let has_cut_outs = facets.iter().any(|facet| facet.cut_out);
        let has_mirrors = facets.iter().any(|facet| facet.shows_others);
        Self {
            scene,
            has_cut_outs,
            has_mirrors,
            accelerator,
            lights,
            facets,
            scattering: scene.materials.iter().map(prepare).collect(),
            scale: scene.scale(),
            strategy: Strategy::Both,
            instructions: Instructions::detect(),
        }
    }

    /// The weight of a light that a BSDF sample found.
    pub(super) fn weight_bsdf(&self, pdf_bsdf: f32, pdf_light: f32) -> f32 {
        match self.strategy {
            _ if pdf_bsdf == f32::INFINITY => 1.0,
            Strategy::Both => power_heuristic(pdf_bsdf, pdf_light),
            #[cfg(test)]
            Strategy::LightsOnly => {
                if pdf_light > 0.0 {
                    0.0
                } else {
                    1.0
                }
            }
            #[cfg(test)]
            Strategy::BsdfOnly => 1.0,
        }
    }

    /// The weight of a light sample.
    #[inline(always)]
    pub(super) fn weight_light(&self, pdf_light: f32, pdf_bsdf: f32) -> f32 {
        match self.strategy {
            Strategy::Both => power_heuristic(pdf_light, pdf_bsdf),
            #[cfg(test)]
            Strategy::LightsOnly => 1.0,
            #[cfg(test)]
            Strategy::BsdfOnly => 0.0,
        }
    }
}

/// The weight of a sample that was drawn with density `pdf`, where another technique
/// draws it with density `other`: pdf² / (pdf² + other²).
#[inline(always)]
fn power_heuristic(pdf: f32, other: f32) -> f32 {
    // Both sides of the fraction are divided by pdf², which may overflow near a light.
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}

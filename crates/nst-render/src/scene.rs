//! [`Scene`]: everything that decides what each pixel's integral is.

use glam::Vec3A;
use sha2::{Digest, Sha256};

use crate::{Camera, PixelFilter};

/// A surface: Lambertian reflection and two-sided emission.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The name in the MTL file.
    pub name: String,
    /// Diffuse reflectance (MTL `Kd`), linear RGB in [0, 1].
    pub diffuse: Vec3A,
    /// Emitted radiance (MTL `Ke`), linear RGB; nonzero makes the surface an area light.
    pub emission: Vec3A,
}

impl Material {
    /// Whether surfaces of this material are lights.
    #[must_use]
    pub fn emits(&self) -> bool {
        self.emission.max_element() > 0.0
    }
}

/// A triangle of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// The corners, in world space.
    pub positions: [Vec3A; 3],
    /// Unit shading normals at the corners, if the file has them.
    pub normals: Option<[Vec3A; 3]>,
    /// Index into [`Scene::materials`].
    pub material: u32,
}

impl Triangle {
    /// The vector whose length is twice the area, along the geometric normal.
    #[must_use]
    pub fn area_vector(&self) -> Vec3A {
        let [a, b, c] = self.positions;
        (b - a).cross(c - a)
    }
}

/// A scene, ready to be rendered.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The OBJ file's stem.
    pub name: String,
    /// At least one; none has a zero area or a coordinate that is not finite.
    pub triangles: Vec<Triangle>,
    /// What the triangles are made of.
    pub materials: Vec<Material>,
    /// Where the picture is taken from.
    pub camera: Camera,
    /// Width and height of the film, in pixels.
    pub size: [u32; 2],
    /// Path vertices after the camera that may scatter or emit: 1 shows lights
    /// only, 2 adds direct light.
    pub max_depth: u32,
    /// How positions within a pixel are chosen.
    pub pixel_filter: PixelFilter,
    /// Radiance that arrives from outside the scene, the same from everywhere.
    pub environment: Vec3A,
    /// What the files did not say, in words for a summary.
    pub defaults: Vec<String>,
}

impl Scene {
    /// Names the family of integrals: the scene's name and a hash of everything
    /// that decides a pixel's integral but the size of the film. A network that
    /// was trained on a scene carries its fingerprint.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        let mut hash = Sha256::new();
        let mut vector = |v: Vec3A| {
            for x in v.to_array() {
                hash.update(x.to_le_bytes());
            }
        };
        for material in &self.materials {
            vector(material.diffuse);
            vector(material.emission);
        }
        for triangle in &self.triangles {
            triangle.positions.into_iter().for_each(&mut vector);
            triangle.normals.into_iter().flatten().for_each(&mut vector);
        }
        vector(self.environment);
        vector(self.camera.position);
        vector(self.camera.target);
        vector(self.camera.up);
        vector(Vec3A::splat(self.camera.vertical_fov));
        for triangle in &self.triangles {
            hash.update(triangle.material.to_le_bytes());
        }
        hash.update(self.max_depth.to_le_bytes());
        hash.update([self.pixel_filter as u8]);
        let digest: String =
            hash.finalize()[..8].iter().map(|byte| format!("{byte:02x}")).collect();
        format!("{}:{digest}", self.name)
    }

    /// The corners of the axis-aligned bounding box.
    #[must_use]
    pub fn bounds(&self) -> (Vec3A, Vec3A) {
        bounds(&self.triangles)
    }
}

/// The corners of the axis-aligned bounding box of some triangles.
pub(crate) fn bounds(triangles: &[Triangle]) -> (Vec3A, Vec3A) {
    triangles
        .iter()
        .flat_map(|triangle| triangle.positions)
        .fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(low, high), position| {
            (low.min(position), high.max(position))
        })
}

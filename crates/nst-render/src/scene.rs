//! [`Scene`]: everything that decides what each pixel's integral is.

mod fingerprint;

use std::{path::PathBuf, sync::Arc};

use glam::{Vec2, Vec3A};

use crate::{Camera, Material, PixelFilter, Texture};

/// A triangle of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// The corners, in world space.
    pub positions: [Vec3A; 3],
    /// Unit shading normals at the corners, if the file has them.
    pub normals: Option<[Vec3A; 3]>,
    /// Texture coordinates at the corners, if the file has them; v points up.
    pub uvs: Option<[Vec2; 3]>,
    /// Index into [`Scene::materials`].
    pub material: u32,
}

impl Triangle {
    /// The point at the barycentric weights of the second and third corner.
    #[must_use]
    pub fn position(&self, barycentric: Vec2) -> Vec3A {
        interpolate(self.positions, barycentric)
    }

    /// The direction in which u grows over the surface; zero without texture coordinates.
    pub(crate) fn tangent(&self) -> Vec3A {
        let Some([a, b, c]) = self.uvs else { return Vec3A::ZERO };
        let (du, dv) = (b - a, c - a);
        let [p, q, r] = self.positions;
        ((q - p) * dv.y - (r - p) * du.y) * (du.x * dv.y - dv.x * du.y).signum()
    }

    /// The vector whose length is twice the area, along the geometric normal.
    #[must_use]
    pub fn area_vector(&self) -> Vec3A {
        let [a, b, c] = self.positions;
        (b - a).cross(c - a)
    }
}

/// Light that arrives from outside the scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Environment {
    /// Radiance, linear RGB; multiplies the image if there is one.
    pub radiance: Vec3A,
    /// Latitude-longitude image: u turns about the y axis, the first row is +y.
    pub image: Option<Arc<Texture>>,
    /// Turns the image about +y, in degrees, counterclockwise as seen from above: from +z
    /// towards +x. At 0, the image's left and right edge are −z, and its middle is +z.
    pub rotation: f32,
    /// What the camera sees where nothing is, instead of the environment; it lights nothing.
    pub background: Option<Vec3A>,
}

/// A scene, ready to be rendered.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The OBJ file's stem.
    pub name: String,
    /// At least one; none has a zero area or a coordinate that is not finite.
    pub triangles: Vec<Triangle>,
    /// Colours at the corners of each triangle, linear RGB within 0 and 1, which multiply
    /// that of its material; empty if the file has none.
    pub vertex_colors: Vec<[[f32; 3]; 3]>,
    /// What the triangles are made of.
    pub materials: Vec<Material>,
    /// Where the picture is taken from.
    pub camera: Camera,
    /// Width and height of the film, in pixels.
    pub size: [u32; 2],
    /// Path vertices after the camera that may scatter or emit: 1 shows lights
    /// only, 2 adds direct light.
    pub max_depth: u32,
    /// Whether Russian roulette may end paths early; it changes the noise, not the mean.
    pub russian_roulette: bool,
    /// How positions within a pixel are chosen.
    pub pixel_filter: PixelFilter,
    /// Light from outside the scene.
    pub environment: Environment,
    /// What was assumed, as the files do not say it, and what was left out of them;
    /// each a line of a summary.
    pub notes: Vec<String>,
    /// The files that the scene was read from (OBJ, MTL, TOML, images), each once, by
    /// the paths that opened them. A job must not write to any of them.
    pub inputs: Vec<PathBuf>,
}

impl Scene {
    /// The radiance that a point of a triangle emits, to either side.
    pub(crate) fn emission(&self, triangle: &Triangle, barycentric: Vec2) -> Vec3A {
        let material = &self.materials[triangle.material as usize];
        material.emission * textured(material.emission_texture.as_deref(), triangle, barycentric)
    }

    /// The reflectance or base colour of a point of the triangle of this index.
    pub(crate) fn color(&self, triangle: u32, barycentric: Vec2) -> Vec3A {
        let colors = self.vertex_colors.get(triangle as usize);
        let triangle = &self.triangles[triangle as usize];
        let material = &self.materials[triangle.material as usize];
        let color =
            material.color * textured(material.color_texture.as_deref(), triangle, barycentric);
        match colors {
            Some(colors) => color * interpolate(colors.map(Vec3A::from), barycentric),
            None => color,
        }
    }

    /// The largest coordinate: rounding is relative to it, for rays that leave surfaces.
    pub(crate) fn scale(&self) -> f32 {
        let (low, high) = self.bounds();
        low.abs().max(high.abs()).max_element()
    }

    /// The corners of the axis-aligned bounding box.
    #[must_use]
    pub fn bounds(&self) -> (Vec3A, Vec3A) {
        bounds(&self.triangles)
    }
}

/// A quantity given at the corners, at the barycentric weights of the second and third.
pub(crate) fn interpolate<T>([a, b, c]: [T; 3], Vec2 { x: u, y: v }: Vec2) -> T
where
    T: Copy + std::ops::Add<Output = T> + std::ops::Mul<f32, Output = T>,
{
    a * (1.0 - u - v) + b * u + c * v
}

/// What a texture says there; white without one, or without texture coordinates.
fn textured(texture: Option<&Texture>, triangle: &Triangle, barycentric: Vec2) -> Vec3A {
    match (texture, triangle.uvs) {
        (Some(texture), Some(uvs)) => texture.sample(interpolate(uvs, barycentric)),
        _ => Vec3A::ONE,
    }
}

/// The corners of the axis-aligned bounding box of some triangles.
pub(crate) fn bounds<'a>(triangles: impl IntoIterator<Item = &'a Triangle>) -> (Vec3A, Vec3A) {
    triangles
        .into_iter()
        .flat_map(|triangle| triangle.positions)
        .fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(low, high), position| {
            (low.min(position), high.max(position))
        })
}

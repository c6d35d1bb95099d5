//! Shading normals from images: normal maps, and bump maps (Blinn 1978).

use glam::{Vec2, Vec3, Vec3A};

use super::tracer::PathTracer;
use crate::{Relief, scene::interpolate};

impl PathTracer<'_> {
    /// The shading normal of a surface with a relief, on the side of the geometric normal.
    /// `shading` is the normal without, and `direction` where the ray went that came there.
    ///
    /// Normals rise towards the viewer, on either side of the surface, so that a relief looks
    /// the same whichever way its triangles wind. Where a normal would face away from the
    /// viewer, it is the one without relief.
    #[cold]
    #[inline(never)]
    pub(super) fn relief_normal(
        &self,
        triangle: u32,
        barycentric: Vec2,
        direction: Vec3,
        shading: Vec3,
    ) -> Vec3 {
        let side = 1.0_f32.copysign(-direction.dot(self.facets[triangle as usize].normal));
        let triangle = &self.scene.triangles[triangle as usize];
        let relief = self.scene.materials[triangle.material as usize].relief.as_ref();
        let (Some(relief), Some(uvs), Some(derivatives)) =
            (relief, triangle.uvs, triangle.derivatives())
        else {
            return shading;
        };
        let normal = Vec3A::from(shading) * side;
        let raised = raised(relief, interpolate(uvs, barycentric), derivatives, normal);
        let raised = raised.normalize_or(normal);
        if raised.dot(direction.into()) < 0.0 { (raised * side).into() } else { shading }
    }
}

/// The normal of a relief, not of unit length. `derivatives`: how the position changes with u
/// and v; `normal`: without relief, towards the viewer.
fn raised(relief: &Relief, uv: Vec2, derivatives: [Vec3A; 2], normal: Vec3A) -> Vec3A {
    match relief {
        Relief::Normals(map) => {
            // Where the image's own u and v grow.
            let along_u = derivatives[0] * 1.0_f32.copysign(map.scale.x);
            let along_v = derivatives[1] * 1.0_f32.copysign(map.scale.y);
            let x = (along_u - normal * normal.dot(along_u)).normalize_or_zero();
            let y = normal.cross(x);
            let y = y * 1.0_f32.copysign(y.dot(along_v));
            let local = map.sample(uv) * 2.0 - 1.0;
            x * local.x + y * local.y + normal * local.z
        }
        Relief::Bumps { map, scale } => {
            let slope = map.gradient(uv) * *scale;
            let [along_u, along_v] = derivatives;
            let u = along_u + normal * (slope.x - normal.dot(along_u));
            let v = along_v + normal * (slope.y - normal.dot(along_v));
            let across = u.cross(v);
            across * 1.0_f32.copysign(across.dot(normal))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::{Texture, TextureMap};

    /// A texture of 4 × 4 texels, and where its u and v grow over the surface z = 0.
    fn map(texel: impl Fn(usize, usize) -> [f32; 3]) -> TextureMap {
        let texels = (0..16).map(|i| texel(i % 4, i / 4)).collect();
        Arc::new(Texture::new([4, 4], texels).expect("16 texels")).into()
    }

    const AXES: [Vec3A; 2] = [Vec3A::new(2.0, 0.0, 0.0), Vec3A::new(0.0, 3.0, 0.0)];
    const MIDDLE: Vec2 = Vec2::splat(0.5);

    #[test]
    fn normal_maps_lean_along_u_and_v() {
        let slanted = |relief: &Relief, axes, normal| raised(relief, MIDDLE, axes, normal);
        let right = Relief::Normals(map(|_, _| [0.9, 0.5, 0.8]));
        let up = Relief::Normals(map(|_, _| [0.5, 0.9, 0.8]));
        let close = |a: Vec3A, b: [f32; 3]| assert!(a.abs_diff_eq(b.into(), 1e-6), "{a}");
        close(slanted(&right, AXES, Vec3A::Z), [0.8, 0.0, 0.6]);
        close(slanted(&up, AXES, Vec3A::Z), [0.0, 0.8, 0.6]);
        // The same lean from behind, and where the image is mirrored.
        close(slanted(&up, AXES, Vec3A::NEG_Z), [0.0, 0.8, -0.6]);
        close(slanted(&up, [-AXES[0], AXES[1]], Vec3A::Z), [0.0, 0.8, 0.6]);
        close(slanted(&right, [-AXES[0], AXES[1]], Vec3A::Z), [-0.8, 0.0, 0.6]);
        let Relief::Normals(mut turned) = up else { panic!("it is a normal map") };
        turned.scale.y = -2.0;
        close(slanted(&Relief::Normals(turned), AXES, Vec3A::Z), [0.0, -0.8, 0.6]);
    }

    /// A slope of 1/4 in height from texel to texel is one of 1 in u, over which the surface is
    /// 2 long; v grows against the rows.
    #[test]
    fn bump_maps_lean_down_the_slope() {
        let lean = |map: TextureMap, scale, normal: Vec3A| {
            let relief = Relief::Bumps { map, scale };
            raised(&relief, MIDDLE, AXES, normal).normalize()
        };
        let close = |a: Vec3A, b: Vec3A| assert!(a.abs_diff_eq(b.normalize(), 1e-6), "{a} {b}");
        let columns = || map(|column, _| [column as f32 / 4.0; 3]);
        close(lean(columns(), 1.0, Vec3A::Z), Vec3A::new(-0.5, 0.0, 1.0));
        close(lean(columns(), 4.0, Vec3A::Z), Vec3A::new(-2.0, 0.0, 1.0));
        close(lean(columns(), 1.0, Vec3A::NEG_Z), Vec3A::new(-0.5, 0.0, -1.0));
        let rows = map(|_, row| [row as f32 / 4.0; 3]);
        close(lean(rows, 1.0, Vec3A::Z), Vec3A::new(0.0, 1.0 / 3.0, 1.0));
        let twice =
            TextureMap { scale: Vec2::new(0.5, 1.0), offset: Vec2::new(0.25, 0.0), ..columns() };
        close(lean(twice, 1.0, Vec3A::Z), Vec3A::new(-0.25, 0.0, 1.0));
    }
}

//! Paths through cut-outs and panes, and over reliefs.

use super::*;
use crate::{Material, Relief, Scattering, TextureMap, Triangle};

/// A horizontal square about the y axis, with texture coordinates from 0 to 1.
pub(super) fn sheet(y: f32, half: f32, material: u32) -> [Triangle; 2] {
    let corner = |i: usize| {
        let (x, z) = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)][i];
        (Vec3A::new(x * half, y, z * half), Vec2::new(x, z) * 0.5 + 0.5)
    };
    [[0, 1, 2], [0, 2, 3]].map(|corners| Triangle {
        positions: corners.map(|i| corner(i).0),
        normals: None,
        uvs: Some(corners.map(|i| corner(i).1)),
        material,
    })
}

/// Only sheets, seen from above, in a white environment.
pub(super) fn sheets(heights: &[f32], material: Material) -> Scene {
    let mut scene = scene("cornell");
    scene.triangles = heights.iter().flat_map(|&y| sheet(y, 1.0, 0)).collect();
    scene.materials = vec![material];
    scene.environment = Environment { radiance: Vec3A::ONE, ..Default::default() };
    scene.camera.position = Vec3A::new(0.3, 4.0, 0.2);
    scene.camera.target = Vec3A::ZERO;
    scene.camera.up = Vec3A::X;
    scene.camera.vertical_fov = 10.0;
    scene
}

fn texture(texels: &[f32]) -> TextureMap {
    let size = [texels.len() as u32, 1];
    let texels = texels.iter().map(|&x| [x; 3]).collect();
    Arc::new(Texture::new(size, texels).expect("a row of texels")).into()
}

fn grey(color: f32, opacity: f32) -> Material {
    Material { color: Vec3A::splat(color), opacity, ..Material::default() }
}

/// Of opacity a and reflectance 0, a sheet lets 1 − a of the light through, and two of them its
/// square, also where they are at one place.
#[test]
fn sheets_let_the_rest_of_the_light_through() {
    for (heights, opacity, expected) in
        [(&[0.0][..], 0.3, 0.7), (&[0.0, -0.5], 0.3, 0.49), (&[0.0, -0.5, -0.7, -0.8], 0.5, 0.0625)]
    {
        let (value, variance) = mean(&sheets(heights, grey(0.0, opacity)), Strategy::Both, 1);
        let z = (value / 3.0 - expected) / (variance.sqrt() / 3.0);
        assert!(z.abs() < 4.0, "{heights:?}: {value} ± {}", variance.sqrt());
        // What a sheet less would let through.
        let z = (value / 3.0 - expected / (1.0 - f64::from(opacity))) / (variance.sqrt() / 3.0);
        assert!(z.abs() > 4.0, "{heights:?}");
    }
    // Reflected and passed: ρ a + 1 − a.
    let (value, variance) = mean(&sheets(&[0.0], grey(0.5, 0.4)), Strategy::Both, 1);
    assert!((value / 3.0 - 0.8).abs() < 4.0 * variance.sqrt() / 3.0, "{value}");
}

/// Where opacity is 0 or 1, nothing is random.
#[test]
fn binary_masks_make_no_noise() {
    let mask =
        |texels: &[f32]| Material { opacity_texture: Some(texture(texels)), ..grey(0.5, 1.0) };
    let seen = |material: Material| {
        let mut scene = sheets(&[0.0, 0.0, -0.001, -0.5], material);
        scene.max_depth = 2;
        radiances(&PathTracer::new(&scene))
    };
    assert!(seen(mask(&[0.0])).iter().all(|&radiance| radiance == Vec3A::ONE));
    let opaque = seen(grey(0.5, 1.0));
    assert!(seen(mask(&[1.0])) == opaque && opaque.iter().all(|r| *r != Vec3A::ONE));
    // Half of it is there. Between both halves, there is as much of a ramp as of texels.
    let half = seen(mask(&[1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]));
    let count = |value: fn(&Vec3A) -> bool| half.iter().filter(|r| value(r)).count();
    let white = count(|r| *r == Vec3A::ONE);
    assert!(white > half.len() / 4 && white < half.len() * 3 / 4, "{white}");
}

/// Thousands of sheets, all at one place or not, and rays that are almost in their planes.
#[test]
fn rays_end() {
    let heights: Vec<f32> = (0..3000).map(|i| (i / 3) as f32 * 1e-6).collect();
    let mut scene = sheets(&heights, grey(0.9, 0.001));
    scene.camera.position = Vec3A::new(5.0, 2e-3, 0.1);
    scene.camera.up = Vec3A::Y;
    scene.camera.vertical_fov = 1.0;
    let projection = Projection::new(&scene.camera, [4, 4]);
    let tracer = PathTracer::new(&scene);
    let sampler = Sampler::new(SamplerKind::Random, 7);
    let rays = (0..16_u32).map(|i| {
        let film = Vec2::new((i % 4) as f32, (i / 4) as f32) + 0.5;
        (projection.direction(film), sampler.stream(i, 0))
    });
    let mut workspace = Workspace::default();
    let radiances =
        tracer.radiances(&mut workspace, SamplerKind::Random, projection.origin, rays).to_vec();
    assert!(radiances.iter().all(|radiance| radiance.is_finite()), "{radiances:?}");
}

/// Two black sheets under the ceiling, which the light crosses once on its way from the lamp to
/// the camera: by light samples as by BSDF samples.
#[test]
fn shadows_of_cut_outs_are_as_dark_as_they() {
    let plain = Scene { max_depth: 2, ..scene("cornell") };
    let mut under = plain.clone();
    let material = under.materials.len() as u32;
    under.materials.push(grey(0.0, 0.4));
    for y in [530.0, 540.0] {
        let moved = |mut triangle: Triangle| {
            triangle.positions.iter_mut().for_each(|p| *p += Vec3A::new(278.0, 0.0, 279.6));
            triangle
        };
        // Wider than the box, and not as far as the camera.
        under.triangles.extend(sheet(y, 300.0, material).map(moved));
    }
    let share = 0.36;
    for strategy in [Strategy::Both, Strategy::LightsOnly, Strategy::BsdfOnly] {
        let (a, va) = mean(&plain, strategy, 1);
        let through = mean(&under, strategy, 2);
        assert!(z((a * share, va * share * share), through) < 4.0, "{strategy:?}");
        // BSDF samples alone find the lamp too rarely to tell.
        let tells = strategy != Strategy::BsdfOnly;
        let as_one = z((a * 0.6, va * 0.36), through);
        assert!(!tells || as_one > 4.0, "{strategy:?}: as one sheet");
    }
}

#[test]
fn strategies_agree_about_cut_outs() {
    let mut scene = scene("cornell");
    scene.max_depth = 2;
    // The lamp itself, of which there may be much or nothing, would be most of the noise.
    scene.camera.position.y = 100.0;
    scene.camera.target.y = 100.0;
    scene.camera.vertical_fov = 20.0;
    let mask = texture(&[1.0, 0.5, 0.0, 0.25]);
    for material in &mut scene.materials {
        material.opacity = 0.7;
        if material.emits() {
            material.opacity_texture = Some(mask.clone());
        }
    }
    let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE];
    scene.triangles.iter_mut().for_each(|triangle| triangle.uvs = Some(corners));
    assert_strategies_agree("cut-outs", &scene);
    // Light samples that took the lamp for opaque would find more.
    let both = mean(&scene, Strategy::LightsOnly, 1);
    scene.materials.iter_mut().filter(|m| m.emits()).for_each(|m| m.opacity_texture = None);
    assert!(z(both, mean(&scene, Strategy::LightsOnly, 2)) > 4.0);
}

/// Reflected or straight through, all light comes from the same environment.
#[test]
fn panes_cannot_be_seen_in_a_uniform_environment() {
    let pane =
        Material { scattering: Scattering::ThinDielectric { ior: 1.5 }, ..Material::default() };
    for turned in [false, true] {
        let mut scene = sheets(&[0.0, -0.5], pane.clone());
        scene.max_depth = 100;
        scene.russian_roulette = false;
        if turned {
            scene.triangles.iter_mut().for_each(|triangle| triangle.positions.swap(0, 1));
        }
        let tracer = PathTracer::new(&scene);
        assert!(radiances(&tracer).iter().all(|&radiance| radiance == Vec3A::ONE));
    }
}

/// A relief that is flat changes nothing but rounding; one that is not, much.
#[test]
fn flat_reliefs_are_none() {
    let plain = scene("teapot-glossy");
    let flat = Texture::new([1, 1], vec![[0.5, 0.5, 1.0]]).expect("a texel");
    let slanted = Texture::new([1, 1], vec![[0.8, 0.5, 0.9]]).expect("a texel");
    let with = |relief: Relief| {
        let mut scene = plain.clone();
        let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE];
        scene.triangles.iter_mut().for_each(|triangle| triangle.uvs = Some(corners));
        scene.materials.iter_mut().for_each(|m| m.relief = Some(relief.clone()));
        let together = radiances(&PathTracer::new(&scene));
        let before = radiances(&PathTracer::new(&plain));
        let differ = |(a, b): &(&Vec3A, &Vec3A)| !a.abs_diff_eq(**b, 1e-3 * a.length());
        together.iter().zip(&before).filter(differ).count()
    };
    let few = 64 * 64 / 100;
    let same = with(Relief::Normals(Arc::new(flat).into()));
    assert!(same < few, "{same}");
    let same = with(Relief::Bumps { map: texture(&[0.5, 0.5]), scale: 9.0 });
    assert!(same < few, "{same}");
    assert!(with(Relief::Normals(Arc::new(slanted).into())) > few);
    assert!(with(Relief::Bumps { map: texture(&[0.1, 0.9, 0.4]), scale: 9.0 }) > few);
}

//! Features against what scenes are made of.

use glam::Vec3;

use super::{
    surfaces::{sheet, sheets},
    *,
};
use crate::{Disney, Material, Scattering};

const WALL: Vec3A = Vec3A::new(0.2, 0.5, 0.7);

/// Sheets of these heights and materials, seen from above at an angle of about 5 degrees, in an
/// environment of this radiance.
fn stack(sheets_of: &[(f32, Material)], radiance: f32) -> Scene {
    let mut scene = sheets(&[], Material::default());
    scene.triangles =
        (0..).zip(sheets_of).flat_map(|(i, &(y, _))| sheet(y, 2.0, i as u32)).collect();
    scene.materials = sheets_of.iter().map(|(_, material)| material.clone()).collect();
    scene.environment.radiance = Vec3A::splat(radiance);
    scene
}

fn matt(color: Vec3A) -> Material {
    Material { color, ..Material::default() }
}

fn metal(color: Vec3A, roughness: f32) -> Material {
    let disney = Disney { metallic: 1.0, roughness, ..Disney::default() };
    Material { scattering: Scattering::Disney(disney), ..matt(color) }
}

fn features(scene: &Scene) -> Vec<FeatureSample> {
    traced::<true>(&PathTracer::new(scene)).1
}

fn mean(samples: &[FeatureSample], of: impl Fn(&FeatureSample) -> Vec3) -> Vec3 {
    samples.iter().map(of).sum::<Vec3>() / samples.len() as f32
}

/// How far the camera of [`sheets`] is from a height, along paths to it.
fn distances(scene: &Scene, y: f32) -> Vec<f32> {
    let projection = Projection::new(&scene.camera, [64, 64]);
    let sampler = Sampler::new(SamplerKind::Random, 7);
    let distance = |i: u32| {
        let film = Vec2::new((i % 64) as f32, (i / 64) as f32) + sampler.stream(i, 0).next_2d();
        (y - scene.camera.position.y) / projection.direction(film).y
    };
    (0..64 * 64).map(distance).collect()
}

/// Whether depths are distances to a height, but for f32's rounding of numbers about 4.
fn are_depths(scene: &Scene, samples: &[FeatureSample], y: f32) -> bool {
    let expected = distances(scene, y);
    samples.iter().zip(expected).all(|(sample, t)| (sample.depth - t).abs() < 1e-5)
}

/// Whichever way its triangles wind.
#[test]
fn a_wall_is_what_it_is_made_of() {
    let mut scene = stack(&[(0.0, matt(WALL))], 2.0);
    for _ in 0..2 {
        let samples = features(&scene);
        for sample in &samples {
            assert_eq!((sample.albedo, sample.normal), (WALL.into(), Vec3::Y));
            assert_eq!((sample.emission, sample.is_settled), (Vec3::ZERO, true));
        }
        assert!(are_depths(&scene, &samples, 0.0) && !are_depths(&scene, &samples, 0.001));
        scene.triangles.iter_mut().for_each(|triangle| triangle.positions.swap(1, 2));
    }
}

/// Where nothing is, the camera sees the environment.
#[test]
fn nothing_has_no_distance() {
    let mut scene = stack(&[(0.0, matt(WALL))], 0.25);
    scene.camera.target = scene.camera.position + Vec3A::Y;
    for sample in features(&scene) {
        assert_eq!((sample.albedo, sample.emission), (Vec3::splat(0.25), Vec3::splat(0.25)));
        assert_eq!((sample.normal, sample.depth), (Vec3::ZERO, 0.0));
    }
    scene.environment.radiance = Vec3A::splat(3.0);
    scene.environment.background = Some(Vec3A::new(0.5, 1.0, 7.0));
    for sample in features(&scene) {
        assert_eq!(sample.albedo, Vec3::new(0.5, 1.0, 1.0));
        assert_eq!(sample.emission, Vec3::new(0.5, 1.0, 7.0));
    }
}

/// Tolerance: what Fresnel adds and the facets of a mirror lose at ten degrees.
#[test]
fn mirrors_show_the_wall_that_they_reflect() {
    let silver = Vec3A::new(0.5, 0.9, 0.8);
    let scene = |roughness| stack(&[(0.0, metal(silver, roughness)), (6.0, matt(WALL))], 1.0);
    let mirror = scene(0.01);
    let samples = features(&mirror);
    let expected = Vec3::from(silver * WALL);
    assert!(samples.iter().all(|sample| sample.albedo.abs_diff_eq(expected, 1e-3)));
    // The wall is above the camera, and seen from below.
    assert!(samples.iter().all(|sample| sample.normal == Vec3::NEG_Y));
    assert!(are_depths(&mirror, &samples, 0.0));
    // A brushed metal shows itself.
    for sample in features(&scene(0.5)) {
        assert_eq!((sample.albedo, sample.normal), (silver.into(), Vec3::Y));
    }
    // A mirror at the end of all paths does, too.
    let short = Scene { max_depth: 1, ..mirror };
    for sample in features(&short) {
        assert_eq!((sample.albedo, sample.normal), (silver.into(), Vec3::Y));
        assert!(!sample.is_settled);
    }
}

/// A metal keeps its colour at normal incidence, plastic reflects 4 % more than its base.
#[test]
fn albedos_of_materials() {
    let disney = |metallic, specular| {
        let disney = Disney { metallic, specular, ..Disney::default() };
        Material { scattering: Scattering::Disney(disney), ..Material::default() }
    };
    assert_eq!(disney(1.0, 0.5).albedo(WALL), WALL);
    assert!(disney(0.0, 0.5).albedo(WALL).abs_diff_eq(WALL + 0.04, 1e-7));
    let white = Vec3A::ONE;
    let samples = features(&stack(&[(0.0, Material { color: white, ..disney(0.0, 1.0) })], 1.0));
    assert!(samples.iter().all(|sample| sample.albedo == Vec3::ONE), "at most 1");
    let lamp = Material { emission: Vec3A::new(0.1, 9.0, 0.0), ..matt(WALL) };
    for sample in features(&stack(&[(0.0, lamp)], 1.0)) {
        assert_eq!(sample.emission, Vec3::new(0.1, 9.0, 0.0));
        assert!(sample.albedo.abs_diff_eq(Vec3::new(0.3, 1.0, 0.7), 1e-6));
    }
}

/// A pane over a wall shows it but for what it reflects: 2R / (1 + R) of the dark, where R is 4 %
/// for an index of 1.5. Tolerance: four standard deviations of a binomial share.
#[test]
fn a_pane_shows_what_is_behind_it() {
    let glass = Scattering::ThinDielectric { ior: 1.5 };
    let pane = Material { scattering: glass, ..Material::default() };
    let scene = stack(&[(1.0, pane), (0.0, matt(WALL))], 0.0);
    let samples = features(&scene);
    let mut share = [0.0; 2];
    for sample in &samples {
        let passed = sample.albedo != Vec3::ZERO;
        assert_eq!(sample.albedo, if passed { WALL.into() } else { Vec3::ZERO });
        assert_eq!(sample.normal, if passed { Vec3::Y } else { Vec3::ZERO });
        share[usize::from(passed)] += 1.0 / samples.len() as f32;
    }
    let reflected = 2.0 * 0.04 / 1.04_f32;
    let sigma = (reflected * (1.0 - reflected) / samples.len() as f32).sqrt();
    assert!((share[0] - reflected).abs() < 4.0 * sigma, "{share:?}");
    assert!((share[0] - 0.04).abs() > 4.0 * sigma, "one side alone reflects less");
    assert!(are_depths(&scene, &samples, 1.0) && !are_depths(&scene, &samples, 0.0));
}

/// Where no surface but mirrors and glass scatters, all light is seen directly: of the same
/// paths, bit by bit.
#[test]
fn what_is_seen_directly_is_all_that_black_surfaces_leave() {
    for name in ["cornell", "many-lights", "caustic"] {
        let mut scene = scene(name);
        // Something is seen in glass: a wall of it, or a ball.
        scene.environment.radiance = Vec3A::splat(0.3);
        if let Some(wall) = scene.materials.iter_mut().find(|material| material.name == "red") {
            wall.scattering = Scattering::Dielectric { ior: 1.5 };
        }
        let mut black = scene.clone();
        for material in &mut black.materials {
            if matches!(material.scattering, Scattering::Lambert) {
                (material.color, material.color_texture) = (Vec3A::ZERO, None);
            }
        }
        let (radiances, samples) = traced::<true>(&PathTracer::new(&scene));
        let alone = self::radiances(&PathTracer::new(&black));
        let seen: Vec<Vec3A> = samples.iter().map(|sample| sample.emission.into()).collect();
        assert!(seen == alone, "{name}");
        let first = Scene { max_depth: 1, ..scene };
        let at_first = self::radiances(&PathTracer::new(&first));
        assert!(seen.iter().any(|emission| *emission != Vec3A::ZERO), "{name} has no lamp in view");
        assert!(seen != at_first || name == "many-lights", "{name} has none in glass");
        assert!(seen != radiances, "{name}");
        // No sample scatters less than nothing, but for rounding.
        let least = |(all, seen): (&Vec3A, &Vec3A)| (*all - *seen).min_element();
        assert!(radiances.iter().zip(&seen).map(least).all(|rest| rest >= -1e-6), "{name}");
    }
}

#[test]
fn features_change_no_radiance() {
    for name in ["cornell", "teapot-glossy", "caustic"] {
        let scene = scene(name);
        let with =
            |instructions| traced::<true>(&PathTracer { instructions, ..PathTracer::new(&scene) });
        let (radiances, features) = with(Instructions::Portable);
        let (plain, none) = traced::<false>(&PathTracer::new(&scene));
        assert!(radiances == plain && none.is_empty(), "{name}");
        for instructions in Instructions::available() {
            assert!(with(instructions) == (radiances.clone(), features.clone()), "{name}");
        }
        let sees = mean(&features, |sample| sample.normal.abs());
        assert!(sees.max_element() > 0.01, "{name}: {sees}");
        assert!(features.iter().all(|sample| sample.normal.length() < 1.000_01), "{name}");
    }
}

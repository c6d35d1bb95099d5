//! Tests of whole paths.

mod features;
mod surfaces;

use std::{path::Path, sync::Arc};

use glam::{Vec2, Vec3A};

use super::{tracer::Strategy, *};
use crate::{
    Environment, Sampler, SamplerKind, Scene, Texture, camera::Projection,
    instructions::Instructions,
};

fn scene(name: &str) -> Scene {
    let path = format!("{}/../../scenes/{name}/{name}.obj", env!("CARGO_MANIFEST_DIR"));
    Scene::load(Path::new(&path)).expect("the scene is part of the repository")
}

/// The mean radiance over a film of 4 × 4 pixels, and its variance.
fn mean(scene: &Scene, strategy: Strategy, seed: u64) -> (f64, f64) {
    const COUNT: u32 = 20_000;
    let tracer = PathTracer { strategy, ..PathTracer::new(scene) };
    let projection = Projection::new(&scene.camera, [4, 4]);
    let sampler = Sampler::new(SamplerKind::Random, seed);
    let camera = |i: u32| {
        let mut samples = sampler.stream(i % 16, i / 16);
        let film = Vec2::new((i % 4) as f32, (i / 4 % 4) as f32) + samples.next_2d();
        (projection.direction(film), samples)
    };
    let mut workspace = Workspace::default();
    let rays = (0..COUNT).map(camera);
    let radiances = tracer.radiances(&mut workspace, SamplerKind::Random, projection.origin, rays);
    let (mut sum, mut squares) = (0.0, 0.0);
    for radiance in radiances {
        let value = f64::from(radiance.element_sum());
        sum += value;
        squares += value * value;
    }
    let n = f64::from(COUNT);
    (sum / n, (squares / n - (sum / n).powi(2)) / n)
}

/// |z| of the difference between two estimates of a mean.
fn z((a, va): (f64, f64), (b, vb): (f64, f64)) -> f64 {
    (a - b).abs() / (va + vb).sqrt()
}

fn assert_strategies_agree(name: &str, scene: &Scene) {
    let both = mean(scene, Strategy::Both, 1);
    for (seed, strategy) in [(2, Strategy::LightsOnly), (3, Strategy::BsdfOnly)] {
        let other = mean(scene, strategy, seed);
        assert!(z(both, other) < 4.0, "{name}: {both:?}, {strategy:?}: {other:?}");
    }
    // More precise than the difference that one missing bounce makes.
    let fewer = Scene { max_depth: scene.max_depth - 1, ..scene.clone() };
    assert!(z(both, mean(&fewer, Strategy::Both, 4)) > 4.0, "{name}");
}

/// The radiances of a few thousand paths of a scene.
fn radiances(tracer: &PathTracer<'_>) -> Vec<Vec3A> {
    traced::<false>(tracer).0
}

/// The same, with their features if they are wanted.
fn traced<const FEATURES: bool>(tracer: &PathTracer<'_>) -> (Vec<Vec3A>, Vec<FeatureSample>) {
    let projection = Projection::new(&tracer.scene.camera, [64, 64]);
    let sampler = Sampler::new(SamplerKind::Random, 7);
    let paths = (0..64 * 64_u32).map(|i| {
        let mut samples = sampler.stream(i, 0);
        let film = Vec2::new((i % 64) as f32, (i / 64) as f32) + samples.next_2d();
        (projection.direction(film), samples)
    });
    let mut workspace = Workspace::default();
    let (kind, origin) = (SamplerKind::Random, projection.origin);
    let (radiances, features) = tracer.trace::<FEATURES>(&mut workspace, kind, origin, paths);
    let features = features.iter().flat_map(|packet| (0..PACKET).map(|i| packet.get(i)));
    (radiances.to_vec(), features.collect())
}

#[test]
fn all_instructions_give_the_same_bits() {
    for name in ["cornell", "teapot-glossy", "caustic"] {
        let scene = scene(name);
        let with =
            |instructions| radiances(&PathTracer { instructions, ..PathTracer::new(&scene) });
        let portable = with(Instructions::Portable);
        assert!(portable.iter().any(|radiance| *radiance != Vec3A::ZERO));
        for instructions in Instructions::available() {
            assert!(with(instructions) == portable, "{name}, {instructions:?}");
        }
    }
}

/// The oracle: every surface scatters one path at a time. Rounding differs, and
/// where it sends a path past an edge, all that follows does; so rarely.
#[test]
fn paths_side_by_side_are_those_one_by_one() {
    for name in ["cornell", "teapot-diffuse", "many-lights"] {
        let scene = scene(name);
        let together = radiances(&PathTracer::new(&scene));
        let others = |scene: &Scene| {
            let mut tracer = PathTracer::new(scene);
            tracer.facets.iter_mut().for_each(|facet| facet.lambert = false);
            let one_by_one = radiances(&tracer);
            let differ = |(a, b): &(&Vec3A, &Vec3A)| !a.abs_diff_eq(**b, 1e-3 * a.length());
            together.iter().zip(&one_by_one).filter(differ).count()
        };
        let few = together.len() / 200;
        assert!(others(&scene) < few, "{name}: {}", others(&scene));
        let fewer = Scene { max_depth: scene.max_depth - 1, ..scene.clone() };
        assert!(others(&fewer) > few, "{name}");
    }
}

#[test]
fn lights_and_bsdf_alone_agree_with_both() {
    for name in ["plane-lambert", "plane-ggx", "teapot-glossy"] {
        assert_strategies_agree(name, &scene(name));
    }
    let direct = Scene { max_depth: 2, ..scene("cornell") };
    assert_strategies_agree("cornell", &direct);
}

#[test]
fn they_agree_under_an_image_of_the_sky() {
    let texel = |i: usize| if i == 90 { [30.0, 20.0, 10.0] } else { [0.2, 0.3, 0.4] };
    let sky = Texture::new([16, 8], (0..128).map(texel).collect()).expect("128 texels");
    let mut scene = scene("teapot-glossy");
    scene.environment =
        Environment { radiance: Vec3A::ONE, image: Some(Arc::new(sky)), ..Default::default() };
    assert_strategies_agree("sky and lamp", &scene);
    for material in &mut scene.materials {
        material.emission = Vec3A::ZERO;
    }
    assert_strategies_agree("sky alone", &scene);
}

#[test]
fn russian_roulette_keeps_the_mean() {
    let with = scene("cornell");
    let without = Scene { russian_roulette: false, ..with.clone() };
    assert!(with.max_depth > ROULETTE_START);
    let z = z(mean(&with, Strategy::Both, 5), mean(&without, Strategy::Both, 6));
    assert!(z < 4.0, "{z}");
}

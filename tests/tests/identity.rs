//! Determinism over thread counts, and what a scene's fingerprint covers.

use std::path::Path;

use nst_core::{FurtherPowers, Keep};
use nst_render::{RenderSettings, SamplerKind, Scene, render};

fn cornell(size: [u32; 2]) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/cornell/cornell.obj");
    Scene { size, ..Scene::load(&path).expect("the scene is part of the repository") }
}

#[test]
fn thread_count_does_not_change_a_bit() {
    let scene = cornell([50, 34]);
    let settings = RenderSettings {
        spp: 9,
        sampler: SamplerKind::Random,
        seed: 3,
        keep: Keep::All,
        features: false,
        powers: FurtherPowers::NONE,
    };
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| render(&scene, &settings, &|_| {})).expect("the scene renders").batch()
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
    let other = RenderSettings { seed: 4, ..settings };
    assert_ne!(one, render(&scene, &other, &|_| {}).expect("the scene renders").batch());
}

#[test]
fn fingerprints_tell_integrals_apart() {
    let scene = cornell([64, 64]);
    let fingerprint = scene.fingerprint();
    assert!(fingerprint.starts_with("cornell:"));
    assert_eq!(fingerprint, cornell([512, 512]).fingerprint(), "the film's size does not matter");
    let change: [fn(&mut Scene); 6] = [
        |scene| scene.max_depth = 7,
        |scene| scene.camera.vertical_fov = 40.0,
        |scene| scene.camera.position.x += 1.0,
        |scene| scene.materials[0].color.y = 0.5,
        |scene| scene.triangles[3].positions[1].z += 1.0,
        |scene| scene.pixel_filter = nst_render::PixelFilter::Center,
    ];
    for (case, change) in change.iter().enumerate() {
        let mut changed = scene.clone();
        change(&mut changed);
        assert_ne!(changed.fingerprint(), fingerprint, "case {case}");
    }
}

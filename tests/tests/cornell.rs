//! The Cornell box against Mitsuba 3, and bit-equality over thread counts.

use std::path::{Path, PathBuf};

use nst_render::{Keep, RenderSettings, SamplerKind, Scene, VARIANCE, film, render};
use nst_tests::image_test::{Estimate, compare};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a workspace member").to_owned()
}

fn cornell(size: [u32; 2]) -> Scene {
    let path = repository().join("scenes/cornell/cornell.obj");
    Scene { size, ..Scene::load(&path).expect("the scene is part of the repository") }
}

/// `tests/peers/mitsuba_reference.py` made the reference.
#[test]
fn agrees_with_mitsuba() {
    let path = repository().join("tests/data/reference/cornell-64.exr");
    let (size, mean) = film::read_exr_layer(&path, "").expect("the reference");
    let (_, variance) = film::read_exr_layer(&path, VARIANCE).expect("the reference's variance");
    let reference = Estimate { mean: &mean, variance: &variance };

    let with = |scene: &Scene, seed| {
        let settings =
            RenderSettings { spp: 4096, sampler: SamplerKind::Random, seed, keep: Keep::Window(1) };
        let batch = render(scene, &settings, &|_| {}).expect("the scene renders").batch;
        let variance = batch.side(VARIANCE).expect("a variance").to_vec();
        (batch.last().to_vec(), variance)
    };
    let scene = cornell(size);
    let (mean, variance) = with(&scene, 1);
    let ours = Estimate { mean: &mean, variance: &variance };
    let comparison = compare(ours, reference);
    eprintln!("{comparison:?}");
    assert!(comparison.same(), "{comparison:?}");
    // The test is about nearly all lanes.
    assert!(comparison.left_out * 10 < mean.len(), "{comparison:?}");

    // It must see what is wrong by two per cent, or lacks a bounce.
    let brighter: Vec<f32> = mean.iter().map(|x| 1.02 * x).collect();
    assert!(!compare(Estimate { mean: &brighter, ..ours }, reference).same());
    let (mean, variance) = with(&Scene { max_depth: 7, ..scene }, 2);
    assert!(!compare(Estimate { mean: &mean, variance: &variance }, reference).same());
}

#[test]
fn thread_count_does_not_change_a_bit() {
    let scene = cornell([50, 34]);
    let settings =
        RenderSettings { spp: 9, sampler: SamplerKind::Random, seed: 3, keep: Keep::All };
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| render(&scene, &settings, &|_| {})).expect("the scene renders").batch
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
    let other = RenderSettings { seed: 4, ..settings };
    assert_ne!(one, render(&scene, &other, &|_| {}).expect("the scene renders").batch);
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

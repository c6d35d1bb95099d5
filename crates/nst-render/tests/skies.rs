//! Scenes that an image of the sky lights, read from files.

use std::path::Path;

use exr::prelude::*;
use nst_core::{FurtherPowers, Keep, Side};
use nst_render::{RenderSettings, SamplerKind, Scene, render};

/// A camera that looks down at a white floor, which reflects the mean radiance of the sky by
/// the cosine, or into a direction where there is nothing but sky.
fn scene(folder: &Path, image: &str, camera: &str) -> Scene {
    let obj = "mtllib m.mtl\nv -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nusemtl a\nf 1 2 3 4\n";
    let toml =
        format!("[camera]\n{camera}\n[film]\nsize = [16, 16]\n[environment]\nimage = '{image}'\n");
    for (name, text) in [("s.obj", obj), ("m.mtl", "newmtl a\nKd 1 1 1\n"), ("s.toml", &toml)] {
        std::fs::write(folder.join(name), text).expect("a file");
    }
    Scene::load(&folder.join("s.obj")).expect("a good scene")
}

const DOWN: &str = "position = [0, 3, 0]\ntarget = [0, 0, 0]\nup = [0, 0, -1]\nvertical_fov = 10";

/// The mean of all pixels, and the mean standard deviation of a pixel.
fn statistics(scene: &Scene, spp: u32) -> [f64; 2] {
    let settings = RenderSettings {
        spp,
        sampler: SamplerKind::Random,
        seed: 1,
        keep: Keep::Window(1),
        features: false,
        powers: FurtherPowers::NONE,
    };
    let batch = render(scene, &settings, &|_| {}).expect("the scene renders").batch();
    let variance = batch.side(&Side::Variance).expect("a variance");
    let n = variance.len() as f64;
    let mean = batch.last().iter().copied().map(f64::from).sum::<f64>() / n;
    let deviation = variance.iter().map(|&x| f64::from(x).sqrt()).sum::<f64>() / n;
    [mean, deviation]
}

/// A sky of 1 with a sun: one texel, which is a tent of its own solid angle. Σ L cos θ ω / π
/// is 1 + 10⁶ · (2π/512) (π/256) sin θ cos θ / π with θ = 60.5 π/256: 24.88.
#[test]
fn a_sun_of_one_texel() {
    let folder = tempfile::tempdir().expect("a folder");
    let value = |x, y| if (x, y) == (200, 60) { 1e6_f32 } else { 1.0 };
    write_rgb_file(folder.path().join("e.exr"), 512, 256, |x, y| {
        (value(x, y), value(x, y), value(x, y))
    })
    .expect("a file");
    let scene = scene(folder.path(), "e.exr", DOWN);
    let [mean, deviation] = statistics(&scene, 256);
    // Three standard deviations of the mean of 256 pixels of .021 each.
    assert!((mean / 24.88 - 1.0).abs() < 4e-3, "{mean}");
    // Twice what Mitsuba 3.9.1 has at 256 spp, .021.
    assert!(deviation / mean < 0.042, "{deviation} of {mean}");
    let turned = nst_render::Environment { rotation: 123.0, ..scene.environment.clone() };
    let [mean, deviation] = statistics(&Scene { environment: turned, ..scene }, 256);
    assert!((mean / 24.88 - 1.0).abs() < 4e-3 && deviation / mean < 0.042, "{mean} {deviation}");
}

/// 3/2 + 9/4 − (6/π) (π/4 − 1/4), the integral of the two rows' interpolation, with caps of 3
/// and 0; 2.45 where rows go on beyond the poles.
#[test]
fn rows_end_at_the_poles() {
    let folder = tempfile::tempdir().expect("a folder");
    let value = |y| if y == 0 { 3.0_f32 } else { 0.0 };
    write_rgb_file(folder.path().join("e.exr"), 1, 2, |_, y| (value(y), value(y), value(y)))
        .expect("a file");
    let [mean, deviation] = statistics(&scene(folder.path(), "e.exr", DOWN), 256);
    let error = deviation / 16.0;
    assert!((mean - 2.7275).abs() < 5.0 * error, "{mean} ± {error}");
    assert!(error < 0.02, "{error}");
}

fn radiance_towards(folder: &Path, image: &str, target: &str) -> (f64, Vec<String>) {
    let camera = format!("position = [50, 50, 50]\ntarget = [{target}]\nvertical_fov = 0.01");
    let scene = scene(folder, image, &camera);
    (statistics(&scene, 16)[0], scene.notes)
}

#[test]
fn files_of_skies() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    // The upper half of a display window: below it is black.
    let pixels = SpecificChannels::rgb(|_: Vec2<usize>| (1.0_f32, 1.0_f32, 1.0_f32));
    let encoding = Encoding::UNCOMPRESSED;
    let layer = Layer::new((64, 16), LayerAttributes::default(), encoding, pixels);
    let window = IntegerBounds::from_dimensions((64, 32));
    Image::new(ImageAttributes::new(window), layer)
        .write()
        .to_file(path("half.exr"))
        .expect("a file");
    assert_eq!(radiance_towards(folder.path(), "half.exr", "50, 60, 52").0, 1.0);
    assert_eq!(radiance_towards(folder.path(), "half.exr", "50, 40, 52").0, 0.0);

    // One infinite texel is as bright as the brightest other one.
    let value = |x, y| if (x, y) == (3, 3) { f32::INFINITY } else { 2.0 };
    write_rgb_file(path("inf.exr"), 64, 32, |x, y| (value(x, y), value(x, y), value(x, y)))
        .expect("a file");
    let (mean, notes) = radiance_towards(folder.path(), "inf.exr", "50, 50, 51");
    assert!(
        mean == 2.0 && notes.iter().any(|note| note.starts_with("infinite texels")),
        "{notes:?}"
    );

    // Radiance's own format: a fifth of the sky is 4, around +z.
    let texel = |column: u8| if (4..6).contains(&column) { [128, 128, 128, 131] } else { [0; 4] };
    let row: Vec<u8> = (0..10).flat_map(texel).collect();
    let file = [b"#?RGBE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 10\n", &row[..]].concat();
    std::fs::write(path("sky.hdr"), file).expect("a file");
    assert_eq!(radiance_towards(folder.path(), "sky.hdr", "50, 50, 51").0, 4.0);
    assert_eq!(radiance_towards(folder.path(), "sky.hdr", "50, 50, 49").0, 0.0);
}

#[test]
fn a_sky_that_is_missing_or_damaged_is_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("cut.hdr"), "#?RGBE\n\n-Y 1 +X 10\n123").expect("a file");
    let one = |_, _| (1.0_f32, 1.0_f32, 1.0_f32);
    write_rgb_file(folder.path().join("e.exr"), 2, 1, one).expect("a file");
    scene(folder.path(), "e.exr", DOWN);
    for name in ["gone.exr", "cut.hdr"] {
        let toml = format!("[environment]\nimage = '{name}'\n");
        std::fs::write(folder.path().join("s.toml"), toml).expect("a file");
        let error = Scene::load(&folder.path().join("s.obj")).expect_err(name).to_string();
        assert!(error.contains(name), "{error}");
    }
}

//! Scenes far from the origin, as maps and scanners have them.

use nst_core::{FurtherPowers, Keep, Side};

use super::*;
use crate::{RenderSettings, SamplerKind, render};

/// A floor, a box on it and a lamp, moved by an offset; and a camera that sees them.
fn room([dx, dy, dz]: [f64; 3], strays: &str) -> Scene {
    let mut obj = "mtllib x.mtl\n".to_owned();
    let quad = |y: f64, side: f64| {
        [[-side, y, -side], [side, y, -side], [side, y, side], [-side, y, side]]
    };
    for [x, y, z] in [quad(0.0, 5.0), quad(0.0, 1.0), quad(2.0, 1.0), quad(6.0, 1.0)].concat() {
        obj += &format!("v {} {} {}\n", x + dx, y + dy, z + dz);
    }
    obj += strays;
    obj += "usemtl g\nf 1 2 3 4\nusemtl r\nf 9 10 11 12\nf 5 6 10 9\nf 6 7 11 10\nf 7 8 12 11\n\
            f 8 5 9 12\nusemtl l\nf 13 14 15 16\n";
    let mtl = "newmtl g\nKd .7\nnewmtl r\nKd .7 .2 .1\nnewmtl l\nKd 0\nKe 20\n";
    let toml = format!(
        "[camera]\nposition = [{dx}, {}, {}]\ntarget = [{dx}, {}, {dz}]\nvertical_fov = 40\n\
         [film]\nsize = [32, 32]\n",
        dy + 4.0,
        dz + 9.0,
        dy + 1.0
    );
    load(&[("x.obj", &obj), ("x.mtl", mtl), ("x.toml", &toml)]).expect("a good scene")
}

/// The mean of the picture's red, and the standard error of it.
fn mean(scene: &Scene, seed: u64) -> [f64; 2] {
    let settings = RenderSettings {
        spp: 400,
        sampler: SamplerKind::Random,
        seed,
        keep: Keep::Window(2),
        features: false,
        powers: FurtherPowers::NONE,
    };
    let batch = render(scene, &settings, &|_| {}).expect("it fits the memory").batch();
    let red = 32 * 32;
    let variance = batch.side(&Side::Variance).expect("more than one sample");
    let sum = |lanes: &[f32]| lanes[..red].iter().map(|&x| f64::from(x)).sum::<f64>();
    let (sum, variance) = (sum(batch.last()), sum(variance));
    [sum / red as f64, variance.sqrt() / red as f64]
}

#[test]
fn far_scenes_give_the_near_picture() {
    let near = room([0.0; 3], "");
    assert!(!near.notes.iter().any(|note| note.contains("far from")), "{:?}", near.notes);
    let [expected, error] = mean(&near, 1);
    for offset in [[0.0, 0.0, 1e6], [4e5, 30.0, 5e6], [-354_821.3, 12.25, 5_678_901.7]] {
        let far = room(offset, "v 0 0 0\nv 1e30 nan 5\n");
        assert!(far.notes[0].contains("is subtracted"), "{:?}", far.notes);
        let [actual, other] = mean(&far, 2);
        // Four standard errors of the difference.
        let tolerance = 4.0 * error.hypot(other);
        assert!(tolerance < 0.02 * expected, "{tolerance} of {expected}");
        assert!((actual - expected).abs() < tolerance, "{offset:?}: {actual}, {expected}");
    }
}

/// Where nothing rounds, the bits agree: offsets that are multiples of what the centre is
/// rounded to, and numbers of few digits.
#[test]
fn far_scenes_have_the_near_triangles() {
    let near = room([0.0, -3.0, 0.0], "");
    for offset in [[0.0, -3.0, 1e6], [4e5, -3.0, 5e6], [-4e5, 1e6 - 3.0, 5e6]] {
        let far = room(offset, "");
        assert_eq!(far.triangles, near.triangles, "{offset:?}");
        assert_eq!(far.camera, near.camera, "{offset:?}");
        assert_eq!(far.fingerprint(), near.fingerprint(), "{offset:?}");
    }
}

/// What no face uses says nothing about where the scene is.
#[test]
fn stray_vertices_do_not_matter() {
    let plain = room([0.0; 3], "");
    for strays in ["v 1e6 1e6 1e6\n", "v -1e38 0 0\nv 1e38 0 0\n", "v nan inf 0\n"] {
        let scene = room([0.0; 3], strays);
        assert_eq!(scene.fingerprint(), plain.fingerprint(), "{strays}");
        assert_eq!(scene.notes, plain.notes, "{strays}");
    }
}

/// A small scene far away is centred, and then scaled; the camera follows.
#[test]
fn small_scenes_far_away() {
    let at = |x: f64| format!("{}", 7e4 + x * 1e-5);
    let obj = format!("v {} 0 0\nv {} 0 0\nv {} 2e-5 0\nf 1 2 3\n", at(0.0), at(4.0), at(0.0));
    let toml = format!(
        "[camera]\nposition = [{}, 0, 1e-4]\ntarget = [{}, 0, 0]\nvertical_fov = 40\n",
        at(2.0),
        at(2.0)
    );
    let scene = load(&[("x.obj", &obj), ("x.toml", &toml)]).expect("a good scene");
    let [a, b, c] = scene.triangles[0].positions;
    let unit = b.distance(a) / 4.0;
    // f64 has 11 digits behind the point of 7e4, which is 1e-6 of the scene.
    assert!((c.distance(a) / unit - 2.0).abs() < 1e-5, "{scene:?}");
    let view = (scene.camera.position - a) / unit;
    assert!(view.distance(Vec3A::new(2.0, 0.0, 10.0)) < 1e-4, "{view}");
}

//! Colours behind the coordinates of vertices.

use nst_core::{FurtherPowers, Keep};

use super::*;
use crate::{RenderSettings, SamplerKind, render};

/// sRGB of 0.5, and 0.75 of it.
const HALF: f32 = 0.735_356_9;

fn quad(colors: [&str; 4], head: &str) -> String {
    let [a, b, c, d] = colors;
    format!("{head}v -1 -1 0 {a}\nv 1 -1 0 {b}\nv 1 1 0 {c}\nv -1 1 0 {d}\nf 1 2 3 4\n")
}

fn colors(obj: &str) -> Vec<[[f32; 3]; 3]> {
    scene(obj).vertex_colors
}

fn is_near(a: [f32; 3], b: [f32; 3]) -> bool {
    // The digits of HALF.
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6)
}

#[test]
fn colors_are_linear_and_by_corner() {
    let half = format!("{HALF} 0 1");
    let quad = colors(&quad([&half, "1 1 1", "0 0 0 1", ""], ""));
    assert_eq!(quad.len(), 2);
    let [a, b, c] = quad[0];
    assert!(is_near(a, [0.5, 0.0, 1.0]) && b == [1.0; 3] && c == [0.0; 3], "{quad:?}");
    // A vertex without a colour, of a face without a material, is grey.
    assert_eq!(quad[1][2], [0.8; 3]);
}

#[test]
fn faces_without_material_are_white() {
    let all = scene(&quad(["0 1 0"; 4], ""));
    assert_eq!(all.materials[0].color, Vec3A::ONE);
    let mtl = ("x.mtl", "newmtl a\nKd .5\n");
    let obj = quad(["0 1 0", "0 1 0", "0 1 0", ""], "mtllib x.mtl\nusemtl a\n");
    let scene = load(&[("x.obj", &obj), mtl]).expect("a good scene");
    assert_eq!(scene.materials[0].color, Vec3A::splat(0.5));
    assert_eq!(scene.vertex_colors[1], [[0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0; 3]]);
    // Without colours, nothing is stored, and the default is grey.
    for none in ["", "1", "1 1"] {
        let plain = self::scene(&quad([none; 4], ""));
        assert!(plain.vertex_colors.is_empty() && plain.materials[0].color == Vec3A::splat(0.8));
    }
}

#[test]
fn values_of_bytes_are_divided_and_others_left_out() {
    let notes =
        |scene: &Scene, words: &str| scene.notes.iter().filter(|n| n.contains(words)).count();
    let bytes = scene(&quad(["255 0 0", "0 255 0", "0 0 1", "188 188 188"], ""));
    assert_eq!(bytes.vertex_colors[0][0], [1.0, 0.0, 0.0]);
    // 188 / 255 is the byte that is nearest to half.
    assert!((bytes.vertex_colors[1][2][0] - 0.5).abs() < 0.005, "{:?}", bytes.vertex_colors);
    assert_eq!(notes(&bytes, "divided by 255"), 1);
    let normals = scene(&quad(["0 0 -1", "0 1 0", "0 1 0", "1 0 0"], ""));
    assert!(normals.vertex_colors.is_empty());
    assert_eq!(notes(&normals, "no colours, left out"), 1);
    // A little too bright, and no number at all.
    let odd = scene(&quad(["1.001 0 -0.0001", "nan 0 0", "0 0 0", "0 0 0"], ""));
    assert_eq!(odd.vertex_colors[0][..2], [[1.0, 0.0, 0.0], [0.8; 3]]);
    assert_eq!(notes(&odd, "divided") + notes(&odd, "no colours"), 0);
}

/// Colours follow their triangles when others are left out.
#[test]
fn colors_of_triangles_without_area_are_left_out_with_them() {
    let obj = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 1 2\nf 1 2 3\nf 2 2 2\nf 3 2 1\n";
    let scene = scene(obj);
    let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    assert_eq!(scene.vertex_colors, [[x, y, z], [z, y, x]]);
}

#[test]
fn colors_enter_the_fingerprint() {
    let of = |color: &str| scene(&quad([color; 4], "")).fingerprint();
    let all = [of("1 0 0"), of("0 1 0"), of("1 1 1"), of("")];
    for (i, one) in all.iter().enumerate() {
        assert!(!all[..i].contains(one), "{i}: {all:?}");
    }
}

/// The means over 64 spp of the pixels of a picture of 8 by 8, in a white environment.
fn picture(files: &[(&str, &str)]) -> Vec<f32> {
    let toml = "[camera]\nposition = [0, 0, 2]\ntarget = [0, 0, 0]\nvertical_fov = 40\n\
                [film]\nsize = [8, 8]\n[environment]\nlight = 'white'\n";
    let scene = load(&[files, &[("x.toml", toml)]].concat()).expect("a good scene");
    let settings = RenderSettings {
        spp: 64,
        sampler: SamplerKind::Random,
        seed: 1,
        keep: Keep::Window(1),
        features: false,
        powers: FurtherPowers::NONE,
    };
    let rendering = render(&scene, &settings, &|_| {}).expect("it fits the memory");
    rendering.last()
}

/// A quad that fills the picture, in a white environment: every path that scatters once
/// brings back the colour where it hit, times the material's.
#[test]
fn pictures_show_the_colors() {
    let red_to_green = ["1 0 0", "0 1 0", "0 1 0", "1 0 0"];
    let obj = quad(red_to_green, "mtllib x.mtl\nusemtl a\n");
    for (mtl, scale) in [("newmtl a\nKd .5\n", 0.5), ("", 1.0)] {
        let last = picture(&[("x.obj", &obj), ("x.mtl", mtl)]);
        // The picture is 2 · 2 · tan 20° wide.
        let width = 4.0 * 20.0_f32.to_radians().tan();
        for x in 0..8 {
            let place = ((x as f32 + 0.5) / 8.0 - 0.5) * width;
            let green = (place + 1.0) / 2.0 * scale;
            for (channel, expected) in [(0, scale - green), (1, green), (2, 0.0)] {
                let row = (0..8).map(|y| last[channel * 64 + y * 8 + x]);
                let mean = row.sum::<f32>() / 8.0;
                // Places within a pixel vary the colour by width / 8 / 2 / √12 = 0.026, and
                // the mean of 512 samples by 0.0012: four of these.
                assert!((mean - expected).abs() < 0.005, "{x}, {channel}: {mean}, {expected}");
            }
        }
    }
}

/// Disney's lobes have the colours, too, and reflect no more than arrives: a closed furnace
/// would show more than 1.
#[test]
fn disney_has_the_colors() {
    let obj = quad(["0 1 0"; 4], "mtllib x.mtl\nusemtl a\n");
    let last = picture(&[("x.obj", &obj), ("x.mtl", "newmtl a\nKd 1\nPm 1\nPr .5\n")]);
    let mean = |channel: usize| last.iter().skip(channel * 64).take(64).sum::<f32>() / 64.0;
    // A metal reflects its own colour, and at this roughness most of the light.
    assert!(mean(1) > 0.8 && mean(1) < 1.01 && mean(0) < 0.1 && mean(2) < 0.1);
}

//! What the materials of a scene are, once its triangles are known.

use super::*;

/// A square with texture coordinates, of a material.
const SQUARE: &str = "mtllib x.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n\
                      vt 0 1\nusemtl a\nf 1/1 2/2 3/3 4/4\n";

fn square(mtl: &str) -> Scene {
    load(&[("x.obj", SQUARE), ("x.mtl", mtl)]).expect("a good scene")
}

fn not_opaque(scene: &Scene) -> Vec<&str> {
    scene.notes.iter().filter_map(|note| note.strip_prefix("not opaque: ")).collect()
}

#[test]
fn a_sheet_of_glass_is_thin() {
    let scene = square("newmtl a\nKd 1 1 1\nd 0.1\nNi 1.5\nillum 4\n");
    assert_eq!(material(&scene, "a").scattering, Scattering::ThinDielectric { ior: 1.5 });
    assert_eq!(not_opaque(&scene), ["a (thin glass)"]);
}

/// Exporters' defaults, and their confusions about transparency.
#[test]
fn what_is_meant_to_be_opaque_is_opaque() {
    let color = "Kd 0.25 0.50 0.75\n";
    for statements in [
        "illum 4\nTf 1.00 1.00 1.00\nNi 1.00\n",
        "Ks 1.0 1.0 1.0\nTr 1.000000\nillum 2\nNs 0.000000\n",
        "d 0\nTr 0\n",
        "d 1\nTr 1\n",
        "illum 7\nNi 1.5\n",
    ] {
        let scene = square(&format!("newmtl a\n{color}{statements}"));
        let a = material(&scene, "a");
        assert_eq!((a.color, a.opacity), (Vec3A::new(0.25, 0.5, 0.75), 1.0), "{statements}");
        assert_eq!(a.scattering, Scattering::Lambert, "{statements}");
        assert!(not_opaque(&scene).is_empty(), "{statements}: {:?}", scene.notes);
    }
}

#[test]
fn materials_that_are_not_opaque_are_named() {
    let obj = format!("{SQUARE}usemtl b\nf 1 2 3\nusemtl c\nf 1/1 2/2 3/3\nusemtl d\nf 1 2 3\n");
    let mtl = "newmtl a\nd .5\nnewmtl b\nd 0\nnewmtl c\nmap_d m.png\nnewmtl d\nnewmtl e\nd .1\n";
    let folder = folder(&[("x.obj", &obj), ("x.mtl", mtl)]);
    ::image::GrayImage::new(1, 1).save(folder.path().join("m.png")).expect("an image");
    let scene = Scene::load(&folder.path().join("x.obj")).expect("a good scene");
    assert_eq!(not_opaque(&scene), ["a (opacity 0.5), b (invisible), c (cut-out)"]);
}

#[test]
fn a_scene_without_anything_to_see_is_opaque() {
    let scene = square("newmtl a\nd 0\n");
    assert_eq!(material(&scene, "a").opacity, 1.0);
    let told = scene.notes.iter().any(|note| note.starts_with("nothing of the scene"));
    assert!(not_opaque(&scene).is_empty() && told, "{:?}", scene.notes);
}

/// Heights are lengths, as coordinates are.
#[test]
fn bumps_grow_with_the_scene() {
    let small =
        SQUARE.replace("v -1 -1 0", "v -1e-9 -1e-9 0").replace("v 1 -1 0", "v 1e-9 -1e-9 0");
    let small = small.replace("v 1 1 0", "v 1e-9 1e-9 0").replace("v -1 1 0", "v -1e-9 1e-9 0");
    let folder = folder(&[("x.obj", &small), ("x.mtl", "newmtl a\nbump -bm 1e-9 m.png\n")]);
    ::image::GrayImage::new(1, 1).save(folder.path().join("m.png")).expect("an image");
    let scene = Scene::load(&folder.path().join("x.obj")).expect("a good scene");
    let Some(crate::Relief::Bumps { scale, .. }) = material(&scene, "a").relief else {
        panic!("{:?}", material(&scene, "a"))
    };
    let size = scene.triangles[0].positions[1].x;
    assert!(size > 0.1 && (scale / size - 1.0).abs() < 1e-6, "{scale} {size}");
}

//! Whole scenes, from files to [`Scene`].

mod materials;
mod told;

use std::sync::Arc;

use glam::Vec2;
use tempfile::TempDir;

use super::*;
use crate::{Disney, Material, Scattering};

const VERTICES: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

/// A folder with files.
fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, content) in files {
        std::fs::write(folder.path().join(name), content).expect("a file");
    }
    folder
}

fn load(files: &[(&str, &str)]) -> Result<Scene, String> {
    let folder = folder(files);
    Scene::load(&folder.path().join("x.obj")).map_err(|error| error.to_string())
}

/// Scene `x.obj` of this content.
fn scene(obj: &str) -> Scene {
    load(&[("x.obj", obj)]).expect("a good scene")
}

fn material<'a>(scene: &'a Scene, name: &str) -> &'a Material {
    scene.materials.iter().find(|m| m.name == name).expect(name)
}

#[test]
fn negative_indices_count_back_from_their_line() {
    let relative = scene(&format!("{VERTICES}f -3 -2 -1\nv 5 5 5\nv 6 5 5\nv 5 6 5\nf -3 -2 -1\n"));
    let absolute = scene(&format!("{VERTICES}v 5 5 5\nv 6 5 5\nv 5 6 5\nf 1 2 3\nf 4 5 6\n"));
    assert_eq!(relative.triangles, absolute.triangles);
}

#[test]
fn faces_keep_the_normals_and_coordinates_that_they_have() {
    let scene = scene(&format!(
        "{VERTICES}vt .5 .25\nvt 1e9 0\nvn 0 0 -7\nvn 0 0 0\nvn 1e30 0 0\n\
         f 1 2 3\nf 1/1 2/1 3/2\nf 1//1 2//1 3//1\nf 1/1/1 2/1/2 3/1/1\nf 1/1/3 2 3/1/1\nf 1//3 2//3 3//3\n"
    ));
    let has: Vec<_> =
        scene.triangles.iter().map(|t| (t.normals.is_some(), t.uvs.is_some())).collect();
    let expected = [
        (false, false),
        (false, true),
        (true, false),
        (false, true),
        (false, false),
        (true, false),
    ];
    assert_eq!(has, expected);
    // A normal that disagrees with the winding stays; a coordinate without fraction is 0.
    assert_eq!(scene.triangles[2].normals, Some([Vec3A::NEG_Z; 3]));
    assert_eq!(scene.triangles[5].normals, Some([Vec3A::X; 3]));
    let uv = Vec2::new(0.5, 0.25);
    assert_eq!(scene.triangles[1].uvs, Some([uv, uv, Vec2::ZERO]));
}

#[test]
fn objects_groups_and_materials_in_the_order_of_the_file() {
    let mtl = "newmtl a b\nKd .1\nnewmtl c\nKd .2\n";
    let obj = format!(
        "mtllib x y.mtl\n{VERTICES}o one\nusemtl a b\nf 1 2 3\ng two three\nusemtl c\nf 3 2 1\n\
         o four\nf 1 2 3\nusemtl gone\nf 1 2 3\nusemtl a b\nf 2 3 1\n"
    );
    let scene = load(&[("x.obj", &obj), ("x y.mtl", mtl)]).expect("a good scene");
    let names: Vec<_> =
        scene.triangles.iter().map(|t| &*scene.materials[t.material as usize].name).collect();
    assert_eq!(names, ["a b", "c", "c", "default", "a b"]);
    assert!(scene.notes[0].contains("grey material (0.8)"), "{:?}", scene.notes);
    assert!(scene.notes[0].contains("'gone'"), "{:?}", scene.notes);
}

#[test]
fn several_libraries_in_one_statement() {
    let obj = format!("mtllib x.mtl y.mtl # two\nmtllib x.mtl\n{VERTICES}usemtl b\nf 1 2 3\n");
    let files = [("x.obj", &*obj), ("x.mtl", "newmtl a\n"), ("y.mtl", "newmtl b\n")];
    let scene = load(&files).expect("a good scene");
    assert_eq!((scene.triangles[0].material, scene.materials.len()), (1, 2));
    let error = load(&[("x.obj", "\nmtllib\n")]).expect_err("no name");
    assert!(error.contains("line 2: mtllib without a name"), "{error}");
    let error = load(&files[..2]).expect_err("y.mtl is not there");
    assert!(error.contains("line 1: mtllib") && error.contains("y.mtl"), "{error}");
}

/// Two quads and an L in one mesh: convex ones are fans, the concave one has its area.
#[test]
fn polygons_become_triangles() {
    let scene = scene(
        "v 0 0 0\nv 3 0 0\nv 3 0 1\nv 1 0 1\nv 1 0 2\nv 0 0 2\nf 1 2 3 4\nf 5 6 1 2 3 4\nf 4 5 6\n",
    );
    let corner = |i: usize| scene.triangles[i].positions;
    assert_eq!(corner(0)[0], corner(1)[0]);
    let l: f32 = scene.triangles[2..6].iter().map(|t| t.area_vector().y.abs() / 2.0).sum();
    assert_eq!((scene.triangles.len(), l), (7, 4.0));
}

/// The same picture in any unit: finite areas, a finite camera, the same proportions.
#[test]
fn units_do_not_matter() {
    let box_of = |unit: &str| {
        let obj = format!("v 0 0 0\nv 4{unit} 0 0\nv 0 2{unit} 1{unit}\nf 1 2 3\n");
        let toml = format!(
            "[camera]\nposition = [1{unit}, 0, 8{unit}]\ntarget = [0, 0, 0]\nvertical_fov = 30\n"
        );
        let own = scene(&obj);
        let framed = load(&[("x.obj", &obj), ("x.toml", &toml)]).expect("a good scene");
        [own, framed]
    };
    for unit in ["e-30", "e-20", "e-10", "e-3", "e0", "e5", "e10", "e20", "e37"] {
        for (scene, plain) in box_of(unit).iter().zip(box_of("")) {
            let area = scene.triangles[0].area_vector();
            assert!(area.length_squared().is_normal(), "{unit}: {area}");
            let shape = |s: &Scene| {
                let size = s.triangles[0].positions[1].x;
                [
                    s.camera.position / size,
                    s.camera.target / size,
                    s.triangles[0].positions[2] / size,
                ]
            };
            for (a, b) in shape(scene).into_iter().zip(shape(&plain)) {
                assert!(a.distance(b) < 1e-5, "{unit}: {a} is not {b}");
            }
            assert_eq!(
                scene.notes.iter().any(|d| d.contains("scaled")),
                !["e-3", "e0", "e5"].contains(&unit)
            );
        }
    }
}

#[test]
fn degenerate_faces_are_left_out_and_counted() {
    let scene =
        scene(&format!("{VERTICES}v 2 0 0\nf 1 2 3\nf 1 1 2\nf 1 2 4\nf 1 2\nl 1 2 3\np 1\n"));
    assert_eq!(scene.triangles.len(), 1);
    let all = scene.notes.join("; ");
    assert!(all.contains("triangles of zero area, left out: 2"), "{all}");
    assert!(all.contains("faces of fewer than three corners, left out: 1"), "{all}");
}

#[test]
fn textures_are_shared_and_lie_right_side_up() {
    let obj = format!("mtllib x.mtl\n{VERTICES}vt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n");
    let mtl = "newmtl a\nKd .5 .5 .5\nmap_Kd -s 1 1 1 my maps\\red top.png\n\
               newmtl b\nmap_Kd my maps/red top.png\n";
    let folder = folder(&[("x.obj", &obj), ("x.mtl", mtl)]);
    std::fs::create_dir(folder.path().join("my maps")).expect("a folder");
    let mut image = ::image::RgbImage::new(1, 2);
    image.put_pixel(0, 0, ::image::Rgb([255, 0, 0]));
    image.save(folder.path().join("my maps/red top.png")).expect("an image");
    let scene = Scene::load(&folder.path().join("x.obj")).expect("a good scene");
    let texture = |name| material(&scene, name).color_texture.clone().expect(name);
    assert!(Arc::ptr_eq(&texture("a").image, &texture("b").image));
    assert_eq!(texture("a").image.sample(Vec2::new(0.5, 0.75)), Vec3A::X);
    assert_eq!(texture("a").image.sample(Vec2::new(0.5, 0.25)), Vec3A::ZERO);
    assert_eq!(scene.triangles[0].uvs, Some([Vec2::ZERO, Vec2::X, Vec2::Y]));
    assert_eq!(material(&scene, "a").color, Vec3A::splat(0.5));
}

fn with_sidecar(toml: &str) -> Result<Scene, String> {
    let obj = format!("mtllib x.mtl\n{VERTICES}usemtl a\nf 1 2 3\n");
    let mtl = "newmtl a\nKd .5\nnewmtl wall\nKd .5\nd .5\nnewmtl shiny\nPr .1\nPm .7\n";
    load(&[("x.obj", &obj), ("x.mtl", mtl), ("x.toml", toml)])
}

#[test]
fn integrators() {
    let scene = |toml: &str| with_sidecar(toml).expect(toml);
    let plain = scene("");
    assert_eq!((plain.max_depth, plain.russian_roulette), (8, true));
    assert_eq!(scene("[integrator]\nkind = 'direct'").max_depth, 2);
    assert_eq!(scene("[integrator]\nkind = 'direct'\nmax_depth = 9").max_depth, 2);
    let steady = scene("[integrator]\nkind = 'path'\nmax_depth = 8\nrussian_roulette = false");
    assert!(!steady.russian_roulette);
    assert_eq!(steady.fingerprint(), plain.fingerprint());
}

#[test]
fn environments() {
    let obj = format!("{VERTICES}f 1 2 3\n");
    let folder = folder(&[("x.obj", &obj)]);
    let load = |toml: &str| {
        std::fs::write(folder.path().join("x.toml"), toml).expect("a file");
        Scene::load(&folder.path().join("x.obj"))
    };
    let sky = folder.path().join("sky.exr");
    exr::prelude::write_rgb_file(&sky, 2, 1, |x, _| (x as f32 * 5.0, 1.0_f32, 0.5_f32))
        .expect("an EXR file");
    let plain = load("[environment]\nimage = 'sky.exr'").expect("a good scene").environment;
    assert_eq!(plain.radiance, Vec3A::ONE);
    let image = plain.image.expect("an image");
    assert_eq!(image.texels(), [[0.0, 1.0, 0.5], [5.0, 1.0, 0.5]]);
    let both = load("[environment]\nimage = 'sky.exr'\nradiance = [1, 2, 3]");
    let both = both.expect("a good scene").environment;
    assert!(both.radiance == Vec3A::new(1.0, 2.0, 3.0) && both.image.is_some());
    let error = load("[environment]\nimage = 'gone.exr'").expect_err("no image").to_string();
    assert!(error.contains("line 2") && error.contains("gone.exr"), "{error}");
}

#[test]
fn overrides_by_name() {
    let scene = with_sidecar(
        "[materials.a]\nbase_color = [0.1, 0.2, 0.3]\nemission = [4, 0, 0]\nroughness = 0.25\n\
         [materials.wall]\nmetallic = 1\n[materials.shiny]\nclearcoat = 0.5\n",
    );
    let scene = scene.expect("a good scene");
    let a = material(&scene, "a");
    assert_eq!((a.color, a.emission), (Vec3A::new(0.1, 0.2, 0.3), Vec3A::X * 4.0));
    let disney = |name| match material(&scene, name).scattering {
        Scattering::Disney(disney) => disney,
        other => panic!("{name}: {other:?}"),
    };
    assert_eq!(disney("a"), Disney { roughness: 0.25, ..Default::default() });
    assert_eq!(disney("wall"), Disney { metallic: 1.0, ..Default::default() });
    let expected = Disney { roughness: 0.1, metallic: 0.7, clearcoat: 0.5, ..Default::default() };
    assert_eq!(disney("shiny"), expected);
    let glass = with_sidecar("[materials.a]\nior = 1.33").expect("a good scene");
    assert_eq!(material(&glass, "a").scattering, Scattering::ThinDielectric { ior: 1.33 });
}

/// Every key that the check of names lets through is one that is read.
#[test]
fn all_keys_together() {
    let scene = with_sidecar(
        "[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\nup = [0, 1, 0]\nvertical_fov = 40\n\
         [film]\nsize = [3, 4]\n[integrator]\nkind = 'path'\nmax_depth = 3\nrussian_roulette = true\n\
         [environment]\nradiance = [0, 0, 0]\n[materials.a]\ncolor = [1, 1, 1]\nemission = [0, 0, 0]\n\
         metallic = 1\nroughness = 1\nspecular = 1\nspecular_tint = 1\nanisotropic = 1\nsheen = 1\n\
         sheen_tint = 1\nclearcoat = 1\nclearcoat_gloss = 0\n[materials.wall]\nior = 1.1\n",
    );
    let scene = scene.expect("a good scene");
    assert_eq!((scene.size, scene.max_depth), ([3, 4], 3));
    assert!(scene.notes.is_empty(), "{:?}", scene.notes);
}

#[test]
fn errors_of_the_sidecar_name_line_and_key() {
    let camera = |rest: &str| format!("[camera]\nposition = [0, 0, 5]\n{rest}");
    let cases = [
        ("[film]\nsize = [0, 4]".to_owned(), "line 2: [film] size must be"),
        ("[film]\nsize = [-1, 4]".into(), "line 2"),
        ("[film]\nsize = 'big'".into(), "line 2"),
        ("[film]\nsize = [1e999, 1]".into(), "line 2"),
        ("\n[integrator]\nmax_depth = 0".into(), "line 3: [integrator] max_depth"),
        ("[integrator]\nkind = 'bidirectional'".into(), "bidirectional"),
        (
            "[integrator]\nrussian_rulette = true".into(),
            "line 2: unknown key 'russian_rulette' in [integrator]; did you mean 'russian_roulette'?",
        ),
        ("[environment]".into(), "line 1: [environment] needs"),
        ("[environment]\nradiance = [1, nan, 0]".into(), "line 2: [environment] radiance"),
        (camera("target = [0, 0, 1]\nup = [0, 0, 0]\nvertical_fov = 40"), "line 4: [camera] up"),
        (camera("target = [0, 0, 5]\nvertical_fov = 40"), "line 3: [camera] target must differ"),
        (
            camera("target = [0, 0, inf]\nvertical_fov = 40"),
            "line 3: [camera] target must be finite",
        ),
        (camera("target = [0, 0, 1e-30]\nvertical_fov = 180"), "line 4: [camera] vertical_fov"),
        (camera("target = [0, 0, 0]\nup = [0, 0, 1]\nvertical_fov = 40"), "line 4: [camera] up"),
        (camera("target = [0, 0, 1e30]\nvertical_fov = 40"), "too far"),
        ("[materials.a]\nroughness = 1.5".into(), "line 2: [materials.a] roughness is 1.5"),
        ("[materials.a]\ncolor = [0, 0, 2]".into(), "line 2: [materials.a] color"),
        ("[materials.a]\nemission = [0, 0, -2]".into(), "line 2: [materials.a] emission"),
        ("[materials.a]\nior = 0".into(), "line 2: [materials.a] ior is 0"),
        ("[materials.a]\nior = 1.5\nroughness = 0".into(), "line 2: [materials.a] ior makes"),
        (
            "[materials.wal]\nroughness = 0".into(),
            "line 1: the scene has no material 'wal'; did you mean 'wall'?",
        ),
        ("size = ".into(), "line 1"),
        ("a = 1\na = 2".into(), "line 2"),
    ];
    for (toml, words) in cases {
        let error = with_sidecar(&toml).expect_err(&toml);
        assert!(error.contains("x.toml") && error.contains(words), "{toml}\n{error}");
    }
}

#[test]
fn files_that_are_no_text() {
    let folder = folder(&[]);
    let obj = folder.path().join("x.obj");
    ::image::RgbImage::new(2, 2).save(folder.path().join("x.png")).expect("an image");
    std::fs::rename(folder.path().join("x.png"), &obj).expect("a file");
    let error = Scene::load(&obj).expect_err("a PNG file").to_string();
    assert!(error.contains("x.obj") && error.contains("no text"), "{error}");
    // A line of four megabytes.
    std::fs::write(&obj, format!("v 0 0 {}\n", "9".repeat(4 << 20))).expect("a file");
    let error = Scene::load(&obj).expect_err("a huge number").to_string();
    assert!(error.contains("line 1") && error.len() < 300, "{error}");
    std::fs::write(&obj, format!("{VERTICES}f 1 2 3\n")).expect("a file");
    std::fs::write(folder.path().join("x.toml"), b"\n\xff").expect("a file");
    let error = Scene::load(&obj).expect_err("no UTF-8").to_string();
    assert!(error.contains("x.toml") && error.contains("line 2"), "{error}");
    std::fs::write(folder.path().join("x.toml"), "\u{feff}[film]\r\nsize = [5, 6]\r\n")
        .expect("a file");
    assert_eq!(Scene::load(&obj).expect("a good scene").size, [5, 6]);
}

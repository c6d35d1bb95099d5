//! What a scene tells of itself: its fingerprint, the files that it was read from, and notes.

use super::*;

/// Networks know the scenes by these names: reading the files must give the same bits
/// for ever, on every machine.
#[test]
fn scenes_keep_their_fingerprints() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    for expected in [
        "cornell:v2:a736c0a254dc9a84",
        "teapot-glossy:v2:c89c9662998c5200",
        "many-lights:v2:6f4ffcf13d204a6e",
    ] {
        let (name, _) = expected.split_once(':').expect("a name");
        let path = folder.join(name).join(name).with_extension("obj");
        let scene = Scene::load(&path).expect("a scene of this repository");
        assert_eq!(scene.fingerprint(), expected);
        assert!(scene.notes.is_empty(), "{:?}", scene.notes);
    }
}

/// A folder with a scene of all kinds of files, below `x`.
fn many_files() -> TempDir {
    let obj = format!("mtllib x.mtl y.mtl\n{VERTICES}vt 0 0\nusemtl a\nf 1/1 2/1 3/1\n");
    let toml = "[environment]\nimage = 'sky.exr'\n";
    let folder = folder(&[
        ("x.obj", &obj),
        ("x.mtl", "newmtl a\nmap_Kd a.png\nmap_Ke a.png\nnewmtl c\nmap_Kd no/b.png\n"),
        ("y.mtl", "newmtl b\nmap_Kd b.png\n"),
        ("x.toml", toml),
    ]);
    for name in ["a.png", "b.png"] {
        ::image::RgbImage::new(1, 2).save(folder.path().join(name)).expect("an image");
    }
    exr::prelude::write_rgb_file(folder.path().join("sky.exr"), 2, 1, |x, _| {
        (x as f32 * 5.0, 1.0_f32, 0.5_f32)
    })
    .expect("an EXR file");
    folder
}

#[test]
fn inputs_are_the_files_that_were_read() {
    let folder = many_files();
    let path = |name: &str| folder.path().join(name);
    let scene = Scene::load(&path("x.obj")).expect("a good scene");
    let all = ["x.obj", "x.mtl", "a.png", "b.png", "y.mtl", "x.toml", "sky.exr"].map(path);
    assert_eq!(scene.inputs, all);
    std::fs::remove_file(path("x.toml")).expect("the file");
    let scene = Scene::load(&path("x.obj")).expect("a good scene");
    assert_eq!(scene.inputs, all[..5]);
}

#[test]
fn fingerprints_follow_the_files() {
    let (folder, copy) = (many_files(), many_files());
    let path = |name: &str| folder.path().join(name);
    let fingerprint = |folder: &TempDir| {
        Scene::load(&folder.path().join("x.obj")).expect("a good scene").fingerprint()
    };
    let plain = fingerprint(&folder);
    assert_eq!(plain, fingerprint(&copy), "the same files elsewhere are the same scene");
    let mut image = ::image::RgbImage::new(1, 2);
    image.put_pixel(0, 1, ::image::Rgb([0, 0, 1]));
    image.save(path("a.png")).expect("an image");
    let texel = fingerprint(&folder);
    let toml = "[environment]\nimage = 'sky.exr'\nradiance = [1, 1, 0.5]\n";
    std::fs::write(path("x.toml"), toml).expect("a file");
    let radiance = fingerprint(&folder);
    let sky = |_, _| (0.0_f32, 1.0_f32, 0.5_f32);
    exr::prelude::write_rgb_file(path("sky.exr"), 2, 1, sky).expect("an EXR file");
    let all = [plain, texel, radiance, fingerprint(&folder)];
    for (i, one) in all.iter().enumerate() {
        assert!(!all[..i].contains(one), "{i}: {all:?}");
    }
}

#[test]
fn notes_say_what_was_left_out() {
    let obj = format!(
        "mtllib /home/me/x.mtl\n{VERTICES}v 1 1.5 0\nvn 0 0 0\nvt 1e8 0\ncurv 0 1 1 2\nusemtl a\n\
         f 1//1 2//1 3//1\nf 1 4 2 3\n"
    );
    let mtl = "newmtl a\nbump a.png\nmap_Kd -s 2 2 1 a.png\nnewmtl b\nmap_Kd -s 2 2 1 a.png\n";
    let toml = "[integrator]\nkind = 'direct'\nmax_depth = 9\n";
    let folder = folder(&[("x.obj", &obj), ("x.mtl", mtl), ("x.toml", toml)]);
    ::image::RgbImage::new(1, 2).save(folder.path().join("a.png")).expect("an image");
    let scene = Scene::load(&folder.path().join("x.obj")).expect("a good scene");
    let expected = [
        "'/home/me/x.mtl' is not there: ",
        "options '-s 2 2 1' of map_Kd left out",
        "bump left out",
        "faces that cross themselves, cut into fans that may overlap: 1",
        "points, lines, curves and surfaces, left out: 1",
        "normals of length zero, where the surface is flat: 1",
        "texture coordinates too large to have a fraction, set to 0: 1",
        "max_depth = 9 left out",
        "no camera is given: ",
        "nothing emits light: ",
    ];
    for words in expected {
        let count = scene.notes.iter().filter(|note| note.starts_with(words)).count();
        assert_eq!(count, 1, "{words}: {:?}", scene.notes);
    }
    assert_eq!(scene.notes.len(), expected.len(), "{:?}", scene.notes);
}

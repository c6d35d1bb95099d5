//! Damaged scene files: the loader returns a scene that can be rendered, or an
//! error; it never panics.
//!
//! `NST_FUZZ_SECONDS=600 cargo test -p nst-render --test fuzz_load` goes on for
//! that long, with other seeds.

use std::{
    path::Path,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

use nst_render::{LoadOptions, Relief, Scene, Texture};
use proptest::{
    prelude::*,
    sample::Index,
    test_runner::{RngSeed, TestRunner},
};

const OBJ: &str = "# a scene\nmtllib x.mtl\n\
    v 0 0 0\nv 3 0 0\nv 3 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nv 1.5 .5 -1e0 1.0\nv 2 2 2 .1 .2 .3\n\
    vt 0 0\nvt 1 0\nvt .5 1\nvn 0 0 1\nvn 0 1 0\n\
    o concave\nusemtl textured\nf 1/1/1 2/2/1 3/3/1 4/1/2 5/2/1 6/3/1\n\
    g other\nusemtl a metal\nf -1 -2 -3\nf 1/1 2/2 7/3 \\\n 8/1\nusemtl light\nf 1//1 2//2 8//-1\n\
    usemtl nowhere\nf 2 3 7\nf 1 1 1\nl 1 2 3\nf 6 7 8\n";

/// The same with faults that are forgiven.
const FAULTY: &str = "# a scene\nmtllib x.mtl # a library\nMTLLIB \"x.mtl\" gone.mtl\n\
    v 0 0 0\nv 3 0 0\nv 3 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nv 1.5 .5 -1e0 1.0\nv 2 2 2 .1 .2 .3\n\
    V 1 1 1 1 0.5 0 1\nv nan 0 0\nvt 0 0\nvt 1 0\nvt .5 1\nvt inf 0\nvn 0 0 1\nvn 0 1 0\nvn 1.#IND 0 0\n\
    o concave\nusemtl textured # a comment\nf 1/1/1 2/2/1 3/3/1 4/1/2 5/2/1 6/3/1\n\
    g other\nusemtl \"a metal\"\nf -3 -4 -5\nf 1/1 2/2 7/3 \\\n 8/1\nusemtl light\nf 1//1 2//2 8//-1\n\
    usemtl nowhere\nfo 2 3 7\nf 1 1 1\nl 1 2 3\nusemtl\nf 6/0/9 7/1/3 8//0 and more\nunknown 1\n";

const MTL: &str = "newmtl textured\nKd 0.5 0.5 0.5\nmap_Kd -s 1 1 1 a.png\nmap_d -mm 0 1 -clamp on e.bmp\n\
    newmtl a metal\nKd 0 0 0\nKs .9 .8 .7\nNs 100\nillum 3\nmap_Kd b.jpg\nbump -bm .5 -o 1 2 a.png\n\
    newmtl light\nKe 5 4 3\nmap_Ke c.exr\nKd .2\n\
    newmtl glass\nd .5\nNi 1.5\nillum 7\nTr 0.5\nmap_Kd d.tga\n\
    newmtl paint\nPr .1\nPm .2\nPs .3\nPc .4\nPcr .5\naniso .6\nmap_Kd e.bmp\nnorm d.tga\nd .5\n\
    newmtl web\nmap_Kd f.webp\nnewmtl old web\nmap_Ke g.gif\nnewmtl scan\nmap_Kd h.tif\n";

const TOML: &str = "[camera]\nposition = [1.0, 2.0, 9.0]\ntarget = [0, 0, 0]\nvertical_fov = 40.0\n\
    [film]\nsize = [64, 48]\n[integrator]\nkind = \"path\"\nmax_depth = 5\nrussian_roulette = false\n\
    [environment]\nradiance = [1, 1, 1]\nimage = \"i.hdr\"\nrotation = 90\n\
    [materials.paint]\ncolor = [0.1, 0.2, 0.3]\nroughness = 0.5\n[materials.glass]\nior = 1.4\n";

/// Numbers and words that have broken readers before.
const EXTREMES: [&str; 36] = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "-9",
    "nan",
    "-inf",
    "1e38",
    "-1e38",
    "1e39",
    "3e-39",
    "1e-45",
    "1e-20",
    "1e20",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551616",
    "6148914691236517206",
    "1/",
    "//",
    "1/1/1/1",
    "\\",
    "#",
    "",
    "é",
    "[",
    "0/0/0",
    "1.#QNAN",
    "5000000.25",
    "255",
    "\"",
    "\u{1a}",
    "\0",
    "\u{a0}",
];

const ENDS: [&[u8]; 4] = [b"\r\n", b"\r", b" \t\n", b"\\\n"];

/// A way to damage a file.
#[derive(Clone, Debug)]
enum Damage {
    Byte(Index, u8),
    Drop(Index),
    Repeat(Index, u8),
    Swap(Index, Index),
    Replace(Index, usize),
    Truncate(Index),
    Insert(Index, Vec<u8>),
    /// All line ends.
    Ends(usize),
    /// Two bytes for each character, in either order.
    Wide(bool),
}

fn damage() -> impl Strategy<Value = Damage> {
    let index = any::<Index>;
    prop_oneof![
        3 => (index(), any::<u8>()).prop_map(|(i, byte)| Damage::Byte(i, byte)),
        1 => index().prop_map(Damage::Drop),
        1 => (index(), any::<u8>()).prop_map(|(i, times)| Damage::Repeat(i, times)),
        1 => (index(), index()).prop_map(|(i, j)| Damage::Swap(i, j)),
        4 => (index(), 0..EXTREMES.len()).prop_map(|(i, extreme)| Damage::Replace(i, extreme)),
        1 => index().prop_map(Damage::Truncate),
        1 => (index(), prop::collection::vec(any::<u8>(), 0..9)).prop_map(|(i, b)| Damage::Insert(i, b)),
        1 => (0..4_usize).prop_map(Damage::Ends),
        1 => any::<bool>().prop_map(Damage::Wide),
    ]
}

/// `count` + 1 places, as insertions may go to the end.
fn place(index: Index, count: usize) -> usize {
    index.index(count + 1)
}

fn apply(damage: &Damage, mut bytes: Vec<u8>) -> Vec<u8> {
    let mut lines: Vec<Vec<u8>> = bytes.split(|&b| b == b'\n').map(<[u8]>::to_vec).collect();
    let count = lines.len();
    match damage {
        Damage::Byte(i, byte) => {
            let at = place(*i, bytes.len());
            if let Some(there) = bytes.get_mut(at) {
                *there = *byte;
            }
            return bytes;
        }
        Damage::Truncate(i) => {
            bytes.truncate(place(*i, bytes.len()));
            return bytes;
        }
        Damage::Insert(i, more) => {
            let at = place(*i, bytes.len());
            bytes.splice(at..at, more.iter().copied());
            return bytes;
        }
        Damage::Replace(i, extreme) => return replace_word(&bytes, *i, EXTREMES[*extreme]),
        Damage::Wide(true) => return bytes.into_iter().flat_map(|byte| [byte, 0]).collect(),
        Damage::Wide(false) => return bytes.into_iter().flat_map(|byte| [0, byte]).collect(),
        Damage::Ends(kind) => return lines.join(ENDS[*kind]),
        Damage::Drop(i) => drop(lines.remove(i.index(count))),
        Damage::Repeat(i, times) => {
            let line = lines[i.index(count)].clone();
            let at = i.index(count);
            lines.splice(at..at, std::iter::repeat_n(line, usize::from(*times)));
        }
        Damage::Swap(i, j) => lines.swap(i.index(count), j.index(count)),
    }
    lines.join(&b'\n')
}

/// Puts `word` in the place of one between white space, brackets, commas and slashes.
fn replace_word(bytes: &[u8], index: Index, word: &str) -> Vec<u8> {
    let is_end = |&byte: &u8| byte.is_ascii_whitespace() || b"[],/".contains(&byte);
    let words: Vec<_> = bytes
        .split_inclusive(is_end)
        .scan(0, |start, part| {
            let place = *start..*start + part.len();
            *start += part.len();
            Some(place)
        })
        .collect();
    let mut result = bytes.to_vec();
    if !words.is_empty() {
        let place = words[index.index(words.len())].clone();
        let end = if is_end(&bytes[place.end - 1]) { place.end - 1 } else { place.end };
        result.splice(place.start..end, word.bytes());
    }
    result
}

/// The whole files, with this OBJ; the images are of three by two pixels.
fn files(obj: &str) -> Vec<(&'static str, Vec<u8>)> {
    let folder = tempfile::tempdir().expect("a folder");
    let pixels =
        image::RgbImage::from_fn(3, 2, |x, y| image::Rgb([x as u8 * 90, y as u8 * 200, 7]));
    let mut files: Vec<_> =
        [("x.obj", obj), ("x.mtl", MTL), ("x.toml", TOML)].map(|(n, t)| (n, t.into())).into();
    let alpha = image::DynamicImage::from(pixels.clone()).into_rgba8();
    for name in ["a.png", "b.jpg", "d.tga", "e.bmp", "f.webp", "g.gif", "h.tif"] {
        let path = folder.path().join(name);
        if name == "g.gif" { alpha.save(&path) } else { pixels.save(&path) }.expect(name);
        files.push((name, std::fs::read(path).expect(name)));
    }
    let path = folder.path().join("c.exr");
    exr::prelude::write_rgb_file(&path, 3, 2, |x, y| (x as f32, y as f32, 0.5_f32)).expect("EXR");
    files.push(("c.exr", std::fs::read(path).expect("EXR")));
    // A flat line of nine texels, and one whose four channels are runs.
    let flat: Vec<u8> = (0..9).flat_map(|i| [i, 7, 9, 128]).collect();
    let runs = [2, 2, 0, 9, 137, 5, 137, 6, 137, 7, 137, 130];
    let hdr = [b"#?RADIANCE\nEXPOSURE=2\n\n-Y 2 +X 9\n", &flat[..], &runs].concat();
    files.push(("i.hdr", hdr));
    files
}

fn write(folder: &Path, files: &[(&str, Vec<u8>)]) {
    for (name, bytes) in files {
        std::fs::write(folder.join(name), bytes).expect(name);
    }
}

/// What every scene promises to those who render it.
fn check(scene: &Scene) -> Result<(), TestCaseError> {
    let texture = |texture: &Texture, most: f32| {
        texture.texels().iter().flatten().all(|x| (0.0..=most).contains(x))
    };
    prop_assert!(!scene.triangles.is_empty());
    for triangle in &scene.triangles {
        prop_assert!(triangle.positions.iter().all(|p| p.is_finite()), "{triangle:?}");
        prop_assert!(triangle.area_vector().length_squared().is_normal(), "{triangle:?}");
        prop_assert!(triangle.uvs.iter().flatten().all(|uv| uv.is_finite()), "{triangle:?}");
        for normal in triangle.normals.iter().flatten() {
            prop_assert!((normal.length() - 1.0).abs() < 1e-5, "{triangle:?}");
        }
        prop_assert!((triangle.material as usize) < scene.materials.len());
    }
    let colors = &scene.vertex_colors;
    prop_assert!(colors.is_empty() || colors.len() <= scene.triangles.len());
    prop_assert!(colors.iter().flatten().flatten().all(|x| (0.0..=1.0).contains(x)));
    for material in &scene.materials {
        let [color, emission] = [material.color, material.emission];
        prop_assert!(color.is_finite() && color.min_element() >= 0.0 && color.max_element() <= 1.0);
        prop_assert!(emission.is_finite() && emission.min_element() >= 0.0);
        prop_assert!(material.color_texture.iter().all(|t| texture(&t.image, 1.0)));
        prop_assert!(material.emission_texture.iter().all(|t| texture(&t.image, f32::MAX)));
        prop_assert!((0.0..=1.0).contains(&material.opacity));
        for map in material.color_texture.iter().chain(&material.opacity_texture) {
            prop_assert!(map.scale.is_finite() && map.offset.is_finite(), "{map:?}");
        }
        if let Some(Relief::Bumps { map, scale }) = &material.relief {
            prop_assert!(
                scale.is_finite() && map.image.texels().iter().flatten().all(|x| x.is_finite())
            );
        }
        prop_assert!(material.opacity_texture.iter().all(|t| texture(&t.image, 1.0)));
    }
    let camera = &scene.camera;
    let forward = camera.target - camera.position;
    prop_assert!(camera.position.is_finite() && camera.target.is_finite() && camera.up.is_finite());
    let right = forward.normalize().cross(camera.up);
    prop_assert!(forward.length_squared().is_normal(), "{camera:?}");
    prop_assert!(right.length_squared().is_normal(), "{camera:?}");
    prop_assert!(camera.vertical_fov > 0.0 && camera.vertical_fov < 180.0);
    prop_assert!(scene.size[0] > 0 && scene.size[1] > 0 && scene.max_depth > 0);
    prop_assert!(scene.environment.radiance.is_finite());
    prop_assert!(scene.fingerprint().starts_with("x:v2:"));
    prop_assert!(scene.inputs[0].ends_with("x.obj"), "{:?}", scene.inputs);
    Ok(())
}

/// One run of proptest; counts the scenes that loaded and those that did not.
fn fuzz(seed: u64, cases: u32, counts: &mut [u64; 2]) {
    let whole = [files(OBJ), files(FAULTY)];
    let folder = tempfile::tempdir().expect("a folder");
    let config = ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(seed),
        failure_persistence: None,
        ..ProptestConfig::default()
    };
    let counts = std::cell::RefCell::new(counts);
    // OBJ, MTL and TOML are damaged more often than the images.
    let file = prop_oneof![3 => 0..3_usize, 2 => 3..whole[0].len()];
    let damages = (0..2_usize, prop::collection::vec((file, damage()), 1..4));
    let result = TestRunner::new(config).run(&damages, |(obj, damages)| {
        let mut files = whole[obj].clone();
        for (file, damage) in &damages {
            let bytes = std::mem::take(&mut files[*file].1);
            files[*file].1 = apply(damage, bytes);
        }
        write(folder.path(), &files);
        let path = folder.path().join("x.obj");
        let strict = Scene::load_with(&path, &LoadOptions { strict: true, ..Default::default() });
        match Scene::load(&path) {
            Ok(scene) => {
                counts.borrow_mut()[0] += 1;
                // What is forgiven is refused, or else it is the same scene.
                let is_same = |strict: Scene| {
                    strict.fingerprint() == scene.fingerprint() && strict.notes == scene.notes
                };
                prop_assert!(strict.map_or(true, is_same));
                check(&scene)
            }
            Err(error) => {
                counts.borrow_mut()[1] += 1;
                prop_assert!(strict.is_err(), "{error}");
                let message = error.to_string();
                // Characters, as a name in UTF-16 may have three bytes for each.
                let length = message.chars().count();
                prop_assert!((1..2000).contains(&length), "{message}");
                Ok(())
            }
        }
    });
    if let Err(error) = result {
        panic!("seed {seed}: {error}");
    }
}

#[test]
fn damaged_files_load_or_fail() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("x.obj");
    for (obj, is_strict) in [(OBJ, true), (FAULTY, false)] {
        write(folder.path(), &files(obj));
        Scene::load(&path).expect("the files are good before they are damaged");
        let strict = Scene::load_with(&path, &LoadOptions { strict: true, ..Default::default() });
        assert_eq!(strict.is_ok(), is_strict);
    }

    let mut counts = [0; 2];
    fuzz(1, 300, &mut counts);
    // Both happen, so that both are tested.
    assert!(counts.iter().all(|&count| count > 30), "{counts:?}");
    let seconds = std::env::var("NST_FUZZ_SECONDS").map(|seconds| seconds.parse());
    let Ok(seconds) = seconds else { return };
    let seconds = seconds.expect("NST_FUZZ_SECONDS is a number of seconds");
    let begin = Instant::now();
    let now = SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970");
    let mut seed = now.as_secs();
    while begin.elapsed() < Duration::from_secs(seconds) {
        fuzz(seed, 300, &mut counts);
        seed += 1;
    }
    println!("seeds {} to {seed}: {} loaded, {} refused", now.as_secs(), counts[0], counts[1]);
}

//! The light of scenes that have none shows the form of convex bodies of any shape, and
//! sets them off from the background.

use std::fmt::Write;

use nst_core::{FurtherPowers, Keep};
use nst_render::{
    Lighting, LoadOptions, PixelFilter, RenderSettings, SamplerKind, Scene, View, render,
};

const SIZE: [u32; 2] = [96, 96];
/// Levels of a PNG file by which two neighbours are told apart at a glance.
const VISIBLE: f64 = 10.0;

/// Corners, and faces of indices into them.
type Body = (Vec<[f64; 3]>, Vec<Vec<usize>>);

fn cuboid(half: [f64; 3]) -> Body {
    let corner = |i: usize| {
        std::array::from_fn(|axis| if i >> axis & 1 == 0 { -half[axis] } else { half[axis] })
    };
    let faces =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    ((0..8).map(corner).collect(), faces.map(Vec::from).to_vec())
}

/// A surface of revolution about y, given by radii and heights.
fn turned(profile: &[[f64; 2]], sides: usize) -> Body {
    let corner = |&[radius, y]: &[f64; 2], side: usize| {
        let angle = side as f64 / sides as f64 * std::f64::consts::TAU;
        [radius * angle.cos(), y, radius * angle.sin()]
    };
    let corners = profile.iter().flat_map(|ring| (0..sides).map(move |side| corner(ring, side)));
    let band = |ring: usize, side: usize| {
        let next = (side + 1) % sides;
        [
            ring * sides + side,
            ring * sides + next,
            (ring + 1) * sides + next,
            (ring + 1) * sides + side,
        ]
    };
    let bands =
        (1..profile.len()).flat_map(|ring| (0..sides).map(move |side| band(ring - 1, side)));
    let last = (profile.len() - 1) * sides;
    let ends = [(0..sides).collect(), (last..last + sides).collect()];
    (corners.collect(), bands.map(Vec::from).chain(ends).collect())
}

fn tetrahedron() -> Body {
    let corners = [[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]];
    let faces = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
    (corners.to_vec(), faces.map(Vec::from).to_vec())
}

fn octahedron() -> Body {
    let corners = (0..6).map(|i| {
        let mut corner = [0.0; 3];
        corner[i / 2] = if i % 2 == 0 { 1.0 } else { -1.0 };
        corner
    });
    let faces = (0..8).map(|i: usize| vec![i & 1, 2 + (i >> 1 & 1), 4 + (i >> 2 & 1)]);
    (corners.collect(), faces.collect())
}

fn bodies() -> Vec<(&'static str, Body)> {
    let ring = |i: i32| {
        let angle = f64::from(i) / 24.0 * std::f64::consts::PI;
        [angle.sin(), -angle.cos()]
    };
    vec![
        ("tetrahedron", tetrahedron()),
        ("octahedron", octahedron()),
        ("cube", cuboid([1.0, 1.0, 1.0])),
        ("brick", cuboid([1.0, 0.4, 0.6])),
        ("pillar", cuboid([0.2, 2.0, 0.2])),
        ("floor", cuboid([1.0, 0.02, 1.0])),
        ("wall", cuboid([1.0, 1.0, 0.02])),
        ("cylinder", turned(&[[1.0, -1.0], [1.0, 1.0]], 48)),
        ("cone", turned(&[[1.0, -1.0], [0.01, 1.0]], 48)),
        ("ball", turned(&(0..=24).map(ring).collect::<Vec<_>>(), 48)),
    ]
}

fn load(body: &Body, albedo: f32, lighting: Option<Lighting>) -> Scene {
    let folder = tempfile::tempdir().expect("a folder");
    let mut obj = "mtllib x.mtl\nusemtl a\n".to_owned();
    for [x, y, z] in &body.0 {
        writeln!(obj, "v {x} {y} {z}").expect("a string takes anything");
    }
    for face in &body.1 {
        let corners: Vec<_> = face.iter().map(|i| (i + 1).to_string()).collect();
        writeln!(obj, "f {}", corners.join(" ")).expect("a string takes anything");
    }
    std::fs::write(folder.path().join("x.obj"), obj).expect("a file");
    std::fs::write(folder.path().join("x.mtl"), format!("newmtl a\nKd {albedo}\n"))
        .expect("a file");
    let options = LoadOptions { lighting, size: Some(SIZE), ..Default::default() };
    let scene = Scene::load_with(&folder.path().join("x.obj"), &options).expect("a good scene");
    Scene { pixel_filter: PixelFilter::Center, ..scene }
}

/// The levels of a PNG file, 0 to 255, of the green channel.
fn levels(scene: &Scene, spp: u32) -> Vec<f64> {
    let settings = RenderSettings {
        spp,
        sampler: SamplerKind::Halton,
        seed: 1,
        keep: Keep::Window(1),
        features: false,
        powers: FurtherPowers::NONE,
    };
    let rendering = render(scene, &settings, &|_| {}).expect("the scene renders");
    let pixels = (SIZE[0] * SIZE[1]) as usize;
    let linear = rendering.last();
    let srgb = |&x: &f32| {
        let x = f64::from(x).clamp(0.0, 1.0);
        255.0 * if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
    };
    linear[pixels..2 * pixels].iter().map(srgb).collect()
}

/// Where the body is: black against a white environment, as only light sources are seen.
fn mask(body: &Body) -> Vec<bool> {
    let scene = Scene { max_depth: 1, ..load(body, 0.8, Some(Lighting::White)) };
    levels(&scene, 1).iter().map(|&level| level < 128.0).collect()
}

/// How many levels the body spans between its 5th and 95th percentile, and which share of
/// its outline is at least [`VISIBLE`] away from the background.
fn judge(levels: &[f64], mask: &[bool]) -> (f64, f64) {
    let mut inside: Vec<f64> =
        levels.iter().zip(mask).filter_map(|(&level, &is_body)| is_body.then_some(level)).collect();
    inside.sort_by(f64::total_cmp);
    let percentile = |share: f64| inside[(share * (inside.len() - 1) as f64) as usize];
    let background = levels[mask.iter().position(|&is_body| !is_body).expect("a background")];
    let width = SIZE[0] as usize;
    let is_body =
        |i: usize, step: isize| i.checked_add_signed(step).and_then(|i| mask.get(i)) == Some(&true);
    let steps = [1, -1, width as isize, -(width as isize)];
    let outline: Vec<f64> = (0..mask.len())
        .filter(|&i| mask[i] && !steps.iter().all(|&step| is_body(i, step)))
        .map(|i| levels[i])
        .collect();
    let visible = outline.iter().filter(|&&level| (level - background).abs() >= VISIBLE).count();
    (percentile(0.95) - percentile(0.05), visible as f64 / outline.len() as f64)
}

#[test]
fn form_and_outline_of_convex_bodies_are_visible() {
    for (name, body) in bodies() {
        let mask = mask(&body);
        let share = mask.iter().filter(|&&is_body| is_body).count() as f64 / mask.len() as f64;
        assert!(share > 0.08, "{name} covers {share} of the picture");
        for albedo in [0.8, 1.0] {
            let (span, outline) = judge(&levels(&load(&body, albedo, None), 64), &mask);
            println!("{name}, {albedo}: {span:.0} levels, {outline:.3} of the outline");
            assert!(span >= 60.0, "{name}, {albedo}: {span}");
            assert!(outline >= 0.95, "{name}, {albedo}: {outline}");
        }
    }
}

/// The judge sees what the studio is there to avoid: in a white environment, a grey body is
/// of one colour, and a white one is the background.
#[test]
fn a_white_environment_shows_neither() {
    let body = tetrahedron();
    let mask = mask(&body);
    let judge = |albedo| judge(&levels(&load(&body, albedo, Some(Lighting::White)), 64), &mask);
    let (span, outline) = judge(0.8);
    assert!(span < 10.0 && outline > 0.95, "{span} {outline}");
    let (_, outline) = judge(1.0);
    assert!(outline < 0.05, "{outline}");
}

/// Dark bodies, too, have a form; no light is the picture of the background alone.
#[test]
fn dark_bodies_have_a_form() {
    let body = octahedron();
    let mask = mask(&body);
    let (span, _) = judge(&levels(&load(&body, 0.1, None), 64), &mask);
    assert!(span >= 30.0, "{span}");
    assert!(levels(&load(&body, 0.1, Some(Lighting::None)), 1).iter().all(|&level| level == 0.0));
}

/// The lamps stand beside the picture, wherever the camera is.
#[test]
fn lamps_are_not_in_the_picture() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("x.obj");
    std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").expect("a file");
    for position in [[0.5, 0.3, 3.0], [20.0, 5.0, 20.0], [-3.0, 0.4, 0.2], [0.3, 30.0, 0.31]] {
        for fov in [20.0, 60.0, 100.0] {
            let view =
                View { position: Some(position), vertical_fov: Some(fov), ..Default::default() };
            let options = LoadOptions { view, size: Some([64, 32]), ..Default::default() };
            let scene = Scene::load_with(&path, &options).expect("a good scene");
            // Light sources alone.
            let scene = Scene { max_depth: 1, ..scene };
            let settings = RenderSettings {
                spp: 16,
                sampler: SamplerKind::Random,
                seed: 1,
                keep: Keep::Window(1),
                features: false,
                powers: FurtherPowers::NONE,
            };
            let rendering = render(&scene, &settings, &|_| {}).expect("the scene renders");
            let background = scene.environment.background.expect("a studio").x;
            let brightest = rendering.last().iter().copied().fold(0.0, f32::max);
            assert!(
                (brightest / background - 1.0).abs() < 1e-5,
                "{position:?}, {fov}: {brightest}"
            );
        }
    }
}

/// What glows is no lamp: the studio lights it. A lamp does without.
#[test]
fn scenes_with_lamps_get_no_studio() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("x.obj");
    let obj = "mtllib x.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n";
    std::fs::write(&path, obj).expect("a file");
    for (emission, has_studio) in
        [("0 0 0", true), ("0 0 .1", true), ("1 1 1", true), ("0 1.5 0", false)]
    {
        std::fs::write(folder.path().join("x.mtl"), format!("newmtl a\nKe {emission}\n"))
            .expect("a file");
        let scene = Scene::load(&path).expect("a good scene");
        assert_eq!(scene.triangles.len() > 1, has_studio, "{emission}");
        let note = scene.notes.iter().find(|note| note.contains("studio"));
        assert_eq!(note.is_some(), has_studio, "{:?}", scene.notes);
        let glows = note.is_some_and(|note| note.starts_with("nothing is a lamp"));
        assert_eq!(glows, has_studio && emission != "0 0 0", "{emission}: {note:?}");
    }
}

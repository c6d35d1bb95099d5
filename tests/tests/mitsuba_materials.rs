//! Cut-outs, normal and bump maps, options of textures, thin glass and colours of vertices
//! against Mitsuba 3. `tests/peers/mitsuba_materials.py` and `mitsuba_vertex_colors.py` wrote
//! the scenes and their references.

use std::path::{Path, PathBuf};

use glam::Vec3A;
use nst_core::{FurtherPowers, Keep, Side};
use nst_files::picture::Picture;
use nst_render::{Relief, RenderSettings, SamplerKind, Scattering, Scene, render};
use nst_tests::image_test::{Comparison, Estimate, compare, sums_z};

fn data(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data").join(path)
}

/// A mean image, and the variance of the mean.
struct Image {
    mean: Vec<f32>,
    variance: Vec<f32>,
}

impl Image {
    fn reference(name: &str) -> Self {
        let path = data(&format!("reference/{name}-32.exr"));
        let layer = |name| {
            let picture = Picture::open(&path, name).expect("a layer");
            assert_eq!(picture.size, [32, 32]);
            picture.read().expect("its pixels")
        };
        Self { mean: layer(None), variance: layer(Some("Variance")) }
    }

    fn render(scene: &Scene, seed: u64) -> Self {
        let settings = RenderSettings {
            spp: 4096,
            sampler: SamplerKind::Random,
            seed,
            keep: Keep::Window(1),
            features: false,
            powers: FurtherPowers::NONE,
        };
        let batch = render(scene, &settings, &|_| {}).expect("the scene renders").batch();
        let variance = batch.side(&Side::Variance).expect("a variance").to_vec();
        Self { mean: batch.last().to_vec(), variance }
    }

    fn estimate(&self) -> Estimate<'_> {
        Estimate { mean: &self.mean, variance: &self.variance }
    }

    fn compare(&self, other: &Self) -> Comparison {
        compare(self.estimate(), other.estimate())
    }
}

fn material<'a>(scene: &'a mut Scene, name: &str) -> &'a mut nst_render::Material {
    scene.materials.iter_mut().find(|material| material.name == name).expect(name)
}

/// What is wrong with a scene, and how to do it.
type Wrong = (&'static str, fn(&mut Scene));

const WRONG: [Wrong; 7] = [
    ("no opacity", |s| material(s, "leaf").opacity_texture = None),
    ("a texture of another size", |s| {
        material(s, "leaf").opacity_texture.as_mut().expect("a texture").scale.x = 1.0;
    }),
    ("no normals", |s| material(s, "normals").relief = None),
    ("normals upside down", |s| {
        let Some(Relief::Normals(map)) = &mut material(s, "normals").relief else { panic!() };
        map.scale.y = -1.0;
    }),
    ("no bumps", |s| material(s, "bumps").relief = None),
    ("dents", |s| {
        let Some(Relief::Bumps { scale, .. }) = &mut material(s, "bumps").relief else { panic!() };
        *scale *= -1.0;
    }),
    ("a pane of the wrong glass", |s| {
        material(s, "pane").scattering = Scattering::ThinDielectric { ior: 2.0 };
    }),
];

/// Applies `change` to the colours at the corners of a material's triangles.
fn recolor(scene: &mut Scene, name: &str, change: impl Fn([[f32; 3]; 3]) -> [[f32; 3]; 3]) {
    let number = scene.materials.iter().position(|material| material.name == name).expect(name);
    for (triangle, colors) in scene.triangles.iter().zip(&mut scene.vertex_colors) {
        if triangle.material as usize == number {
            *colors = change(*colors);
        }
    }
}

/// sRGB of linear light: the colour as the file states it.
fn encoded(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

const WRONG_COLORS: [Wrong; 6] = [
    ("not decoded", |s| {
        for name in ["white", "half", "disney"] {
            recolor(s, name, |colors| colors.map(|rgb| rgb.map(encoded)));
        }
    }),
    ("no colours", |s| s.vertex_colors.clear()),
    ("one colour in a triangle", |s| recolor(s, "white", |[first, ..]| [first; 3])),
    ("corners in another order", |s| recolor(s, "half", |[a, b, c]| [b, c, a])),
    ("colours instead of Kd", |s| material(s, "half").color = Vec3A::ONE),
    ("no colours on Disney's", |s| recolor(s, "disney", |_| [[1.0; 3]; 3])),
];

/// Compares a scene with its reference, and asserts that each of the wrong ones differs.
fn check(name: &str, wrong: &[Wrong]) {
    let scene = Scene::load(&data(&format!("scenes/{name}/{name}.obj"))).expect("a good scene");
    let reference = Image::reference(name);
    let ours = Image::render(&scene, 1);
    let comparison = ours.compare(&reference);
    eprintln!("{comparison:?}");
    assert!(comparison.same(), "{comparison:?}");
    let tested = (comparison.compared + comparison.exact) as f64 / ours.mean.len() as f64;
    // Only where Mitsuba's pictures agree to the last bit are there no variances to compare.
    assert!(tested >= 0.9, "only {tested} of the lanes were compared");
    assert!(sums_z(ours.estimate(), reference.estimate()) < 4.0);
    for (what, wrong) in wrong {
        let mut scene = scene.clone();
        wrong(&mut scene);
        assert!(!Image::render(&scene, 2).compare(&reference).same(), "{what}");
    }
}

#[test]
fn materials() {
    check("materials", &WRONG);
}

#[test]
fn vertex_colors() {
    check("vertex-colors", &WRONG_COLORS);
}

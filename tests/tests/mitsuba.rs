//! The mean image of each scene against Mitsuba 3, by a z-test per lane.
//! `tests/peers/mitsuba_reference.py` made the references.

use std::path::{Path, PathBuf};

use nst_core::{FurtherPowers, Keep, Side};
use nst_files::picture::Picture;
use nst_render::{RenderSettings, SamplerKind, Scene, render};
use nst_tests::image_test::{Comparison, Estimate, compare, sums_z};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a workspace member").to_owned()
}

fn scene(name: &str) -> Scene {
    let path = repository().join(format!("scenes/{name}/{name}.obj"));
    let scene = Scene::load(&path).expect("the scene is part of the repository");
    Scene { size: [64, 64], ..scene }
}

/// A mean image, and the variance of the mean.
struct Image {
    mean: Vec<f32>,
    variance: Vec<f32>,
}

impl Image {
    fn reference(name: &str) -> Self {
        let path = repository().join(format!("tests/data/reference/{name}-64.exr"));
        let layer = |name| {
            let picture = Picture::open(&path, name).expect("a layer");
            assert_eq!(picture.size, [64, 64]);
            picture.read().expect("its pixels")
        };
        let (mean, variance) = (layer(None), layer(Some("Variance")));
        Self { mean, variance }
    }

    fn render(scene: &Scene, spp: u32, sampler: SamplerKind, seed: u64) -> Self {
        let settings = RenderSettings {
            spp,
            sampler,
            seed,
            keep: Keep::Window(1),
            powers: FurtherPowers::NONE,
            features: false,
        };
        let batch = render(scene, &settings, &|_| {}).expect("the scene renders").batch();
        let variance = batch.side(&Side::Variance).expect("a variance").to_vec();
        Self { mean: batch.last().to_vec(), variance }
    }

    fn estimate(&self) -> Estimate<'_> {
        Estimate { mean: &self.mean, variance: &self.variance }
    }

    /// A wrong image, which a test must find.
    fn brighter(&self, factor: f32) -> Self {
        let mean = self.mean.iter().map(|x| factor * x).collect();
        Self { mean, variance: self.variance.clone() }
    }

    fn compare(&self, other: &Self) -> Comparison {
        compare(self.estimate(), other.estimate())
    }
}

/// Renders a scene and compares it with its reference. The test is about at
/// least `share` of the lanes, and must see what is wrong by two per cent.
fn assert_agrees(name: &str, scene: &Scene, spp: u32, share: f64) {
    let reference = Image::reference(name);
    let ours = Image::render(scene, spp, SamplerKind::Random, 1);
    let comparison = ours.compare(&reference);
    eprintln!("{name}: {comparison:?}");
    assert!(comparison.same(), "{name}: {comparison:?}");
    let tested = (comparison.compared + comparison.exact) as f64 / ours.mean.len() as f64;
    assert!(tested >= share, "{name}: only {tested} of the lanes were compared");

    assert!(!ours.brighter(1.02).compare(&reference).same(), "{name}");
}

#[test]
fn cornell_to_depth_8() {
    let scene = scene("cornell");
    assert_agrees("cornell", &scene, 4096, 0.9);
    // A bounce less must be seen, too.
    let fewer = Image::render(&Scene { max_depth: 7, ..scene }, 4096, SamplerKind::Random, 2);
    assert!(!fewer.compare(&Image::reference("cornell")).same());
}

#[test]
fn cornell_direct() {
    let scene = Scene { max_depth: 2, ..scene("cornell") };
    assert_agrees("cornell-direct", &scene, 2048, 0.9);
}

#[test]
fn planes() {
    for name in ["plane-lambert", "plane-ggx"] {
        assert_agrees(name, &scene(name), 2048, 0.9);
    }
}

#[test]
fn teapots() {
    for name in ["teapot-diffuse", "teapot-glossy"] {
        let smooth = scene(name);
        let mut flat = smooth.clone();
        flat.triangles.iter_mut().for_each(|triangle| triangle.normals = None);
        assert_agrees(&format!("{name}-flat"), &flat, 2048, 0.9);

        // Where a smooth normal faces away from the camera, at silhouettes, we
        // shade by the geometric one and Mitsuba by the back of the smooth one.
        let reference = Image::reference(name);
        let ours = Image::render(&smooth, 2048, SamplerKind::Random, 1);
        let comparison = ours.compare(&reference);
        eprintln!("{name}: {comparison:?}");
        assert!(comparison.beyond * 200 < comparison.compared, "{name}: {comparison:?}");
        assert_eq!(comparison.exact_failures, 0, "{name}");
        let flat = Image::reference(&format!("{name}-flat"));
        assert!(ours.compare(&flat).beyond * 200 > comparison.compared, "{name}");
    }
}

/// A weak light nearby, which is rarely chosen, gives some lanes tails so heavy
/// that their means are not normal yet: a lane in a thousand may be off.
#[test]
fn many_lights() {
    let reference = Image::reference("many-lights");
    let ours = Image::render(&scene("many-lights"), 4096, SamplerKind::Random, 1);
    let comparison = ours.compare(&reference);
    eprintln!("many-lights: {comparison:?}");
    assert!(comparison.beyond * 1000 < comparison.compared, "{comparison:?}");
    assert!(comparison.total_z <= 4.0 && comparison.exact_failures == 0, "{comparison:?}");
    assert!(ours.brighter(1.02).compare(&reference).total_z > 4.0);
}

/// Light through the glass finds its source by chance alone: only the sums over
/// the picture are certain enough.
#[test]
fn caustic() {
    let reference = Image::reference("caustic");
    let ours = Image::render(&scene("caustic"), 4096, SamplerKind::Random, 1);
    let z = sums_z(ours.estimate(), reference.estimate());
    eprintln!("caustic: {z}");
    assert!(z < 4.0, "{z}");
    assert!(sums_z(ours.brighter(1.05).estimate(), reference.estimate()) > 4.0);
}

/// The variance of random samples bounds that of Halton's.
#[test]
fn halton_has_the_same_mean() {
    let scene = scene("plane-lambert");
    let random = Image::render(&scene, 512, SamplerKind::Random, 3);
    let halton = Image::render(&scene, 512, SamplerKind::Halton, 4);
    let halton = Image { variance: random.variance.clone(), ..halton };
    let comparison = halton.compare(&random);
    assert!(comparison.same(), "{comparison:?}");
    assert!(!halton.brighter(0.98).compare(&random).same());
}

/// A scene that nothing but an image of a sky lights, with a sun of one texel.
fn skylit() -> Scene {
    let path = repository().join("tests/data/skylit/skylit.obj");
    let scene = Scene::load(&path).expect("the scene is part of the repository");
    Scene { size: [64, 64], ..scene }
}

#[test]
fn lit_by_an_image_of_the_sky() {
    let right = skylit();
    assert_agrees("skylit", &right, 2048, 0.9);
    // A sky that is turned the other way, or a little too far, must be seen.
    for rotation in [-30.0, 31.0] {
        let mut turned = right.clone();
        turned.environment.rotation = rotation;
        let turned = Image::render(&turned, 256, SamplerKind::Random, 1);
        assert!(!turned.compare(&Image::reference("skylit")).same(), "{rotation}");
    }
}

/// The standard deviation of a pixel at equal samples is at most twice Mitsuba's.
#[test]
fn the_noise_of_a_sky_with_a_sun() {
    const SPP: u32 = 256;
    let path = repository().join("tests/data/reference/skylit-64.exr");
    let theirs = Picture::open(&path, None).expect("the reference").samples_per_pixel;
    let samples = f64::from(theirs.expect("a number of samples"));
    let reference = Image::reference("skylit");
    let ours = Image::render(&skylit(), SPP, SamplerKind::Random, 5);
    let pairs = ours.variance.iter().zip(&reference.variance);
    let ratio = |(&ours, &theirs): (&f32, &f32)| {
        (f64::from(ours) * f64::from(SPP) / (f64::from(theirs) * samples)).sqrt()
    };
    let mut ratios: Vec<_> = pairs.map(ratio).filter(|ratio| ratio.is_finite()).collect();
    assert!(ratios.len() > 6000, "{}", ratios.len());
    ratios.sort_by(f64::total_cmp);
    let [middle, high] = [0.5, 0.95].map(|share| ratios[(share * ratios.len() as f64) as usize]);
    eprintln!("standard deviations by Mitsuba's: median {middle}, 95 % below {high}");
    assert!(middle < 2.0 && high < 4.0, "{middle}, {high}");
}

//! Scenes whose radiance has a closed form.

use glam::Vec3A;
use nst_core::{FurtherPowers, Keep, SequenceBatch, Side};
use nst_render::{
    Camera, Environment, Material, RenderSettings, SamplerKind, Scattering, Scene, Triangle, render,
};

/// The cube [−1, 1]³ of one material, seen from `position`.
fn cube(diffuse: Vec3A, emission: Vec3A, environment: Vec3A, position: Vec3A) -> Scene {
    let corner = |i: usize| {
        let side = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        Vec3A::new(side(0), side(1), side(2))
    };
    let quads =
        [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let triangles = quads
        .into_iter()
        .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
        .map(|corners| Triangle {
            positions: corners.map(corner),
            normals: None,
            uvs: None,
            material: 0,
        })
        .collect();
    Scene {
        name: "cube".into(),
        triangles,
        vertex_colors: vec![],
        materials: vec![Material {
            name: "wall".into(),
            color: diffuse,
            emission,
            ..Material::default()
        }],
        camera: Camera { position, target: Vec3A::ZERO, up: Vec3A::Y, vertical_fov: 60.0 },
        size: [16, 16],
        max_depth: 8,
        russian_roulette: true,
        pixel_filter: Default::default(),
        environment: Environment { radiance: environment, ..Default::default() },
        notes: vec![],
        inputs: vec![],
    }
}

fn sequences(scene: &Scene, spp: u32) -> SequenceBatch {
    let settings = RenderSettings {
        spp,
        sampler: SamplerKind::Random,
        seed: 5,
        keep: Keep::Window(8),
        features: false,
        powers: FurtherPowers::NONE,
    };
    render(scene, &settings, &|_| {}).expect("the scene renders").batch()
}

/// How many standard errors the mean of each channel is away from its closed form.
fn z_scores(batch: &SequenceBatch, expected: Vec3A) -> [f64; 3] {
    let variance = batch.side(&Side::Variance).expect("a variance");
    let pixels = batch.lanes() / 3;
    std::array::from_fn(|channel| {
        let lanes = channel * pixels..(channel + 1) * pixels;
        let sum = |values: &[f32]| values[lanes.clone()].iter().map(|&x| f64::from(x)).sum::<f64>();
        let error = sum(batch.last()) - pixels as f64 * f64::from(expected[channel]);
        error / sum(variance).sqrt()
    })
}

/// Inside a closed box whose walls emit E and reflect ρ, every ray sees the same
/// radiance, and each further bounce adds ρ times the last: with k vertices,
/// L = E (1 + ρ + … + ρ^(k−1)) = E (1 − ρ^k) / (1 − ρ).
#[test]
fn closed_box() {
    let diffuse = Vec3A::new(0.2, 0.5, 0.8);
    let emission = Vec3A::new(1.0, 0.5, 2.0);
    let position = Vec3A::new(0.3, -0.2, 0.6);
    for depth in [1, 2, 3, 8, 30] {
        let mut scene = cube(diffuse, emission, Vec3A::ZERO, position);
        scene.max_depth = depth;
        let closed_form =
            |depth| emission * (Vec3A::ONE - diffuse.powf(depth)) / (Vec3A::ONE - diffuse);
        let batch = sequences(&scene, 256);
        if depth == 1 {
            // Nothing is random.
            assert_eq!(batch.last()[0], emission.x);
            continue;
        }
        for (channel, z) in z_scores(&batch, closed_form(depth as f32)).into_iter().enumerate() {
            assert!(z.abs() < 4.0, "depth {depth}, channel {channel}: {z:.1} standard errors");
        }
        // The test must see an error of two per cent.
        let off = z_scores(&batch, closed_form(depth as f32) * 1.02);
        assert!(off.iter().all(|z| z.abs() > 4.0), "depth {depth}: {off:?}");
    }
}

/// From outside a convex body, each path leaves it after one bounce: L = ρ L_env,
/// without any noise.
#[test]
fn convex_body_in_a_uniform_environment() {
    let diffuse = Vec3A::new(0.2, 0.5, 1.0);
    let mut scene = cube(diffuse, Vec3A::ZERO, Vec3A::splat(2.0), Vec3A::new(3.0, 4.0, 5.0));
    // Narrow enough that every pixel sees the cube.
    scene.camera.vertical_fov = 8.0;
    let batch = sequences(&scene, 16);
    for (lane, value) in batch.last().iter().enumerate() {
        let expected = 2.0 * diffuse[lane / 256];
        // Sixteen equal f32 samples are averaged in f64.
        assert!((value - expected).abs() < 1e-6, "lane {lane}: {value}");
    }
}

/// Clear glass in a uniform environment cannot be seen: it changes the radiance
/// of no ray, once that has come out.
#[test]
fn glass_in_a_uniform_environment() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenes/caustic/caustic.obj");
    let mut scene = Scene::load(path.as_ref()).expect("the scene is part of the repository");
    let glass = |t: &Triangle| {
        matches!(scene.materials[t.material as usize].scattering, Scattering::Dielectric { .. })
    };
    // The sphere alone, and without smooth normals, which would bend energy away.
    scene.triangles = scene.triangles.iter().copied().filter(glass).collect();
    scene.triangles.iter_mut().for_each(|triangle| triangle.normals = None);
    let (low, high) = scene.bounds();
    scene.camera.target = (low + high) / 2.0;
    scene.camera.vertical_fov = 8.0;
    scene.size = [16, 16];
    scene.environment = Environment { radiance: Vec3A::splat(2.0), ..Default::default() };
    // Facets hold some rays for long.
    scene.russian_roulette = false;
    scene.max_depth = 100;
    let batch = sequences(&scene, 64);
    let mean = batch.last().iter().map(|&x| f64::from(x)).sum::<f64>() / batch.lanes() as f64;
    assert!((1.9..=2.0 + 1e-5).contains(&mean), "{mean}");
    // The median lane has lost nothing but to rounding.
    let mut values = batch.last().to_vec();
    values.sort_by(f32::total_cmp);
    assert!((values[values.len() / 2] - 2.0).abs() < 1e-4, "{}", values[values.len() / 2]);
    assert!(values[values.len() - 1] < 2.0 + 1e-4);
}

/// The mean of the estimated variances of S_N is the variance of S_N over seeds.
#[test]
fn variance_is_estimated_without_bias() {
    let scene = cube(Vec3A::splat(0.5), Vec3A::ONE, Vec3A::ZERO, Vec3A::new(0.3, -0.2, 0.6));
    let runs: Vec<_> = (0..64)
        .map(|seed| {
            let settings = RenderSettings {
                spp: 8,
                sampler: SamplerKind::Random,
                seed,
                keep: Keep::Window(1),
                features: false,
                powers: FurtherPowers::NONE,
            };
            render(&scene, &settings, &|_| {}).expect("the scene renders").batch()
        })
        .collect();
    let (mut estimated, mut observed) = (0.0, 0.0);
    for lane in 0..runs[0].lanes() {
        let values = runs.iter().map(|run| f64::from(run.last()[lane]));
        let mean = values.clone().sum::<f64>() / 64.0;
        observed += values.map(|x| (x - mean).powi(2)).sum::<f64>() / 63.0;
        let variances =
            runs.iter().map(|run| f64::from(run.side(&Side::Variance).expect("a variance")[lane]));
        estimated += variances.sum::<f64>() / 64.0;
    }
    // 768 lanes, of which three share their paths, × 63 degrees of freedom:
    // a standard error of about √(2/16128) = 1.1 % if samples were normal.
    let ratio = estimated / observed;
    assert!((ratio - 1.0).abs() < 0.1, "estimated / observed = {ratio}");
}

/// The folds are a partition: their means, weighted by size, give S_N.
#[test]
fn folds_partition_the_samples() {
    let scene = cube(Vec3A::splat(0.5), Vec3A::ONE, Vec3A::ZERO, Vec3A::new(0.3, -0.2, 0.6));
    let batch = sequences(&scene, 10);
    for lane in 0..batch.lanes() {
        let fold = |k: usize| f64::from(batch.side(&Side::ALL_FOLDS[k]).expect("a fold")[lane]);
        // Ten samples in four folds: three, three, two, two.
        let mean = (3.0 * fold(0) + 3.0 * fold(1) + 2.0 * fold(2) + 2.0 * fold(3)) / 10.0;
        let last = f64::from(batch.last()[lane]);
        assert!((mean - last).abs() < 1e-6 * last, "lane {lane}: {mean} is not {last}");
    }
}

//! What a rendering that is continued has in memory, by the high-water mark of this process. It
//! is the only test of its binary, so that nothing else moves the mark.
#![cfg(target_os = "linux")]

mod common;

use std::path::Path;

use common::peak;
use ndarray::Array2;
use nst_core::{
    FOLDS, FeatureSums, FurtherPowers, Grid, Keep, LaneSums, PowerSums, SampleSums, SequenceBatch,
};
use nst_render::{Control, RenderSettings, SamplerKind, Scene, Start, render_from};

/// A rendering of so many samples, of numbers that are not zero: zeros may take no memory.
fn start(settings: &RenderSettings, samples: u32, [width, height]: [u32; 2]) -> Start {
    let grid = Grid::new(width, height, 3, 0).expect("a grid");
    let counts = settings.keep.sample_counts(samples);
    let terms = Array2::from_elem((counts.len(), grid.lanes()), 0.5);
    let mut batch = SequenceBatch::new(terms, counts).expect("terms");
    batch.set_grid(grid).expect("as many lanes");
    let folds = [f64::from(samples) / 8.0; FOLDS];
    let lane = LaneSums { folds, roots: folds, squares: folds };
    let [albedo, normal, emission] = [[folds; 3]; 3];
    let pixel = FeatureSums { albedo, normal, depth: 1.0, emission };
    let features = settings.features.then(|| vec![pixel; grid.pixels()]);
    let sums =
        SampleSums { lanes: vec![lane; grid.lanes()], features, powers: PowerSums::default() };
    Start { batch, sums }
}

/// What a rendering is continued from becomes a part of it: in memory are, per lane, the terms in
/// f32 and twelve sums in f64, and per pixel 37 sums of features; once.
#[test]
fn nothing_is_in_memory_twice() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/cornell/cornell.obj");
    let mut scene = Scene { max_depth: 1, ..Scene::load(&path).expect("the scene") };
    // For the code itself, rows of tiles on their way, and for each thread its paths.
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    let more = (24 + 2 * threads as u64) << 20;
    let before = peak();
    // The mark never falls: the second takes more than the first.
    for (size, samples, keep, features) in
        [([512, 512], 32, Keep::All, false), ([1024, 512], 8, Keep::Window(8), true)]
    {
        let spp = samples + 1;
        let settings = RenderSettings {
            spp,
            sampler: SamplerKind::Random,
            seed: 1,
            keep,
            powers: FurtherPowers::NONE,
            features,
        };
        scene.size = size;
        let start = start(&settings, samples, size);
        let control = Control { progress: &|_| {}, stop: &|| false };
        let rendering = render_from(Some(start), &scene, &settings, control).expect("it goes on");
        assert_eq!(rendering.samples(), spp);
        let terms = rendering.sample_counts().len();
        let of_pixel = 3 * (4 * terms + 8 * 3 * FOLDS) + if features { 8 * 37 } else { 0 };
        let (peak, held) = (peak() - before, (of_pixel * (size[0] * size[1]) as usize) as u64);
        println!("{} MiB, of which {} are held", peak >> 20, held >> 20);
        assert!((held..held + more).contains(&peak), "{peak} bytes, not {held} and {more} more");
    }
}

//! What a rendering keeps in memory, by the high-water mark of this process. It
//! is the only test of its binary, so that nothing else moves the mark.
#![cfg(target_os = "linux")]

mod common;

use std::path::Path;

use common::peak;
use nst_core::{FOLDS, FurtherPowers, Keep};
use nst_files::{
    ColorModel,
    output::OutputFile,
    sequence_file::{ResumeInfo, SequenceInfo, SequenceWriter},
};
use nst_render::{RenderSettings, SamplerKind, Scene, render};

const SIZE: [u32; 2] = [1024, 1024];

/// Renders, and writes the sequence to a file.
fn render_and_store(scene: &Scene, spp: u32, keep: Keep) {
    let settings = RenderSettings {
        spp,
        sampler: SamplerKind::Random,
        seed: 1,
        keep,
        powers: FurtherPowers::NONE,
        features: false,
    };
    let rendering = render(scene, &settings, &|_| {}).expect("the scene renders");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut output = OutputFile::create(&folder.path().join("x.exr")).expect("a file");
    let info = SequenceInfo {
        size: SIZE,
        model: ColorModel::Rgb,
        sample_counts: rendering.sample_counts(),
        sides: rendering.sides(),
        scene: scene.fingerprint(),
        sampler: "random".into(),
        seeds: vec![1],
        render_seconds: 0.0,
        resume: Some(ResumeInfo {
            keep,
            pixel_filter: scene.pixel_filter.to_string(),
            max_depth: scene.max_depth,
            russian_roulette: scene.russian_roulette,
            powers: FurtherPowers::NONE,
        }),
    };
    let mut writer = SequenceWriter::create(&mut output, &info).expect("the header");
    let mut strips = rendering.strips();
    let mut rows = 0..0;
    while let Some(strip) = strips.next_rows() {
        rows = rows.end..rows.end + strip.grid().expect("a picture").rows() as u32;
        let sums = rendering.sums(rows.clone());
        writer.push(&strip, Some(&sums)).expect("it can be written");
    }
    writer.finish().expect("it can be written");
}

/// Per lane: one term in f32, or eight, and the sums of the folds, of roots and of squares in
/// f64. At 3840×2160 that is 2.5 GB or 3.2, whatever the number of samples.
#[test]
fn a_window_takes_what_it_holds_and_little_more() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/cornell/cornell.obj");
    let scene = Scene { size: SIZE, max_depth: 2, ..Scene::load(&path).expect("the scene") };
    let lanes = 3 * u64::from(SIZE[0]) * u64::from(SIZE[1]);
    let sums = 3 * FOLDS as u64;
    let held = |terms: u64| (4 * terms + 8 * sums) * lanes;
    // For the code itself and what each tile refers to; and for each thread two strips of
    // sixteen rows (each 4.4 MiB and 4.5 MiB of sums) and their state, compressed or about to
    // be.
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
    let more = (24 + 40 * threads) << 20;

    let before = peak();
    for window in [1, 8] {
        render_and_store(&scene, 8, Keep::Window(window));
        let (peak, held) = (peak() - before, held(window.into()));
        assert!((held..held + more).contains(&peak), "{peak} bytes, not {held} and {more} more");
    }
    // The mark must see what is kept beyond the window.
    let allowed = held(8) + more;
    let more = 8 + allowed.div_ceil(4 * 3 * u64::from(SIZE[0]) * u64::from(SIZE[1])) as u32;
    render_and_store(&Scene { max_depth: 1, ..scene }, more, Keep::All);
    assert!(peak() - before > allowed);
}

//! Comparing, describing, packing and merging files, from the command line.

mod common;

use std::path::Path;

use common::{Bench, cornell, read_layer};
use ndarray::Array2;
use nst_core::{Extent, Grid, SequenceBatch, Side, metrics};
use nst_files::{
    ColorModel,
    output::OutputFile,
    sequence_file::{SequenceFile, SequenceInfo},
};
use serde_json::Value;

fn json(text: &str) -> Value {
    serde_json::from_str(text).expect("one JSON object")
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn sequence(path: &Path) -> SequenceFile {
    SequenceFile::read(path).expect("a sequence")
}

/// Renders the Cornell box with several seeds: `s1.exr` and so on, pictures `r1.exr`.
fn render(bench: &Bench, seeds: impl IntoIterator<Item = u64>, options: &str) {
    for seed in seeds {
        bench.succeed(&format!(
            "render --scene {} --seed {seed} --sequence s{seed}.exr -o r{seed}.exr --quiet \
             --transform none {options}",
            cornell()
        ));
    }
}

#[test]
fn compare_takes_errors_apart() {
    let bench = Bench::new();
    render(&bench, 1..=4, "--spp 8 --size 20x20");
    let said = bench.succeed("compare r1.exr r2.exr r3.exr r4.exr --json --error-map map.png");
    let report = json(&said);
    let picture = |name: &str| read_layer(&bench.path(name), "").1;
    let reference = picture("r4.exr");
    let errors = ["r1.exr", "r2.exr", "r3.exr"]
        .map(|name| metrics::error(&picture(name), &reference).expect("one length"));
    let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-9, "{a} is not {b}");
    let mean = |of: fn(&metrics::ErrorSummary) -> f64| errors.iter().map(of).sum::<f64>() / 3.0;
    close(number(&report["mse"]["error"]), mean(|e| e.mse));
    close(number(&report["relmse"]["error"]), mean(|e| e.relmse));
    close(number(&report["smape"]["error"]), mean(|e| e.smape));
    for metric in ["mse", "relmse"] {
        let row = &report[metric];
        close(number(&row["bias_squared"]) + number(&row["variance"]), number(&row["error"]));
        assert!(number(&row["standard_error"]) > 0.0);
    }
    assert!(report["smape"]["bias_squared"].is_null());
    assert_eq!((&report["runs"], &report["nonfinite_pixels"]), (&3.into(), &0.into()));
    assert!(bench.files().contains(&"map.png".to_owned()));
    let png = std::fs::read(bench.path("map.png")).expect("the map");
    assert!(png.starts_with(b"\x89PNG"));

    let said = bench.succeed("compare r1.exr --layer Variance r1.exr --reference-layer=");
    for word in ["(x − I)² / (I² + 0.01)", "trimmed", "not finite: 0 pixels"] {
        assert!(said.contains(word), "'{word}' is not in:\n{said}");
    }
    // Itself, and the wrong picture.
    let same = json(&bench.succeed("compare r1.exr r1.exr --json"));
    assert_eq!((number(&same["mse"]["error"]), &same["mse"]["variance"]), (0.0, &Value::Null));
    assert!(number(&json(&bench.succeed("compare r1.exr r2.exr --json"))["mse"]["error"]) > 0.0);
}

#[test]
fn info_knows_each_kind_of_file() {
    let bench = Bench::new();
    let scene = cornell();
    render(&bench, [7], "--spp 9 --size 12x10");
    bench.succeed(&format!(
        "render --scene {scene} --spp 3 --size 5x4 --runs 2 -o d.safetensors -q"
    ));
    let weights = nst_core::Network::builtins().next().expect("there are networks").file();
    bench.write("w.safetensors", weights);
    let info = |file: &str| {
        let said = bench.succeed(&format!("info {file}"));
        assert!(said.starts_with(&format!("{file}: ")), "{said}");
        json(&bench.succeed(&format!("info {file} --json")))
    };
    let sequence = info("s7.exr");
    assert_eq!((&sequence["kind"], &sequence["seeds"]), (&"sequence".into(), &[7].into()));
    assert_eq!(sequence["sample_counts"], Value::from((2..=9).collect::<Vec<u32>>()));
    assert_eq!((&sequence["width"], &sequence["height"]), (&12.into(), &10.into()));
    let picture = info("r7.exr");
    assert_eq!(picture["kind"], "picture");
    assert_eq!(picture["parts"][0]["layers"], Value::from(vec!["", "S", "Variance"]));
    let dataset = info("d.safetensors");
    assert_eq!((&dataset["kind"], &dataset["runs"]), (&"dataset".into(), &2.into()));
    assert_eq!(dataset["sample_counts"], Value::from(vec![1, 2, 3]));
    let weights = info("w.safetensors");
    assert_eq!((&weights["kind"], &weights["window"]), (&"weights".into(), &8.into()));
    let of_samples =
        include_bytes!("../../../tests/data/sample-fixtures/samples-pixels.safetensors");
    bench.write("w-samples.safetensors", of_samples);
    let weights = info("w-samples.safetensors");
    assert_eq!((&weights["kind"], &weights["window"]), (&"weights".into(), &Value::Null));
    assert_eq!(weights["powers"], Value::from(vec![0.5, 1.0, 2.0]));
    let said = bench.succeed("info w-samples.safetensors");
    assert!(said.contains("samples to the power 0.5, 1, 2"), "{said}");
    let png = info("r7.png");
    assert_eq!((&png["kind"], &png["width"]), (&"png".into(), &12.into()));
    let system = json(&bench.succeed("info --system --json"));
    assert_eq!(system["version"], env!("CARGO_PKG_VERSION"));
    assert!(system["threads"].as_u64() > Some(0) && system["adapters"].is_array(), "{system}");
    assert!(bench.succeed("info --system").contains("processor"));
    // What would be loaded is named, and not loaded: it is no library.
    std::fs::create_dir(bench.path("oidn")).expect("a folder");
    bench.write("oidn/mine.so", "no library");
    bench.write("oidn/libOpenImageDenoise_core.so.2.4.1", "");
    let denoiser = |file: &str, option: &str| {
        let output = bench.nst_with(&format!("info --system {option}"), &[("OIDN_LIBRARY", file)]);
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    let found = &json(&denoiser("oidn/mine.so", "--json"))["denoiser"];
    assert_eq!(found["file"], "oidn/mine.so (named by OIDN_LIBRARY)");
    assert_eq!((&found["version"], &found["error"]), (&"2.4.1".into(), &Value::Null));
    let said = denoiser("oidn/mine.so", "");
    assert!(said.contains("denoiser     Open Image Denoise 2.4.1, oidn/mine.so"), "{said}");
    let said = denoiser("oidn/gone", "");
    assert!(said.contains("denoiser     none: OIDN_LIBRARY: 'oidn/gone' is neither"), "{said}");
    let scene = info(&scene);
    assert_eq!((&scene["kind"], &scene["triangles"]), (&"scene".into(), &38.into()));
    assert_eq!(scene["networks"], Value::from(vec!["cornell"]));
    assert_eq!(scene["fingerprint"], sequence["scene"]);
}

#[test]
fn renderings_become_a_sequence_that_can_be_transformed() {
    let bench = Bench::new();
    render(&bench, 1..=9, "--spp 2 --size 14x40");
    let files: String = (1..=9).map(|seed| format!(" r{seed}.exr")).collect();
    let said = bench.succeed(&format!("pack{files} --as samples --spp 2 --scene box -o seq.exr"));
    for word in ["9 of 14x40 pixels", "R, G, B", "--spp", "r1.exr, r2.exr"] {
        assert!(said.contains(word), "'{word}' is not in:\n{said}");
    }
    let packed = sequence(&bench.path("seq.exr"));
    assert_eq!(packed.info.sample_counts, [2, 4, 6, 8, 10, 12, 14, 16, 18]);
    assert_eq!((packed.info.scene.as_str(), packed.info.seeds.len()), ("box", 0));
    let first = read_layer(&bench.path("r1.exr"), "").1;
    assert_eq!(packed.batch.term(0), first);
    let said = bench.succeed("transform seq.exr --transform families --backend cpu --json");
    assert_eq!(json(&said)["lanes"], 14 * 40 * 3);

    // A single channel is a monochrome sequence.
    bench.succeed(&format!("pack{files} --as samples --spp 2 --layer S.G -o mono.exr -q"));
    let mono = sequence(&bench.path("mono.exr"));
    assert_eq!(mono.batch.lanes(), 14 * 40);
    assert_eq!(mono.batch.last(), &packed.batch.last()[14 * 40..2 * 14 * 40]);

    // Snapshots are sorted by their samples, which sequence files have as an attribute.
    render(&bench, [20], "--spp 5 --size 14x40");
    render(&bench, [21], "--spp 3 --size 14x40");
    let said = bench.succeed("pack s20.exr s21.exr --as estimates -o e.exr");
    assert!(said.contains("of 3, 5 samples per pixel (attribute samplesPerPixel)"), "{said}");
    let estimates = sequence(&bench.path("e.exr"));
    assert_eq!(estimates.info.sample_counts, [3, 5]);
    assert_eq!(estimates.batch.term(0), sequence(&bench.path("s21.exr")).batch.last());
    assert_eq!(estimates.batch.sides().count(), 0);
    bench.succeed("pack s20.exr s21.exr --as estimates --spp-list 7,9 -o e.exr -q");
    assert_eq!(sequence(&bench.path("e.exr")).info.sample_counts, [7, 9]);
}

#[test]
fn sequences_of_runs_become_the_dataset_that_render_writes() {
    let bench = Bench::new();
    let size = "--spp 4 --size 6x5";
    render(&bench, 5..=7, &format!("{size} --keep all"));
    bench.succeed("pack s5.exr s6.exr s7.exr --as runs -o packed.safetensors -q");
    let scene = cornell();
    bench.succeed(&format!(
        "render --scene {scene} {size} --seed 5 --runs 3 -o rendered.safetensors -q"
    ));
    let bytes = |name: &str| std::fs::read(bench.path(name)).expect("a dataset");
    assert_eq!(bytes("packed.safetensors"), bytes("rendered.safetensors"));
    bench.succeed("pack s5.exr s7.exr s6.exr --as runs -o packed.safetensors -q");
    let info = json(&bench.succeed("info packed.safetensors --json"));
    assert!(info["first_seed"].is_null(), "{info}");
}

#[test]
fn merged_sequences_are_means() {
    let bench = Bench::new();
    render(&bench, 1..=3, "--spp 10 --size 9x33");
    bench.succeed("merge s1.exr s2.exr -o m.exr -q");
    let said = bench.succeed("merge m.exr s3.exr -o all.exr");
    for word in ["2 of 9x33 pixels", "1, 2, 3", "9, 12, 15, 18, 21, 24, 27, 30"] {
        assert!(said.contains(word), "'{word}' is not in:\n{said}");
    }
    let parts = [1, 2, 3].map(|seed| sequence(&bench.path(&format!("s{seed}.exr"))).batch);
    let merged = sequence(&bench.path("all.exr"));
    assert_eq!((merged.info.seeds.as_slice(), merged.info.resume), (&[1, 2, 3][..], None));
    let mean = |of: &dyn Fn(usize) -> f32| (0..3).map(|i| f64::from(of(i))).sum::<f64>() / 3.0;
    // Rounded to f32 once more than necessary, in m.exr.
    let close = |a: f32, b: f64| assert!((f64::from(a) - b).abs() <= 2e-7 * b, "{a} is not {b}");
    for lane in 0..merged.batch.lanes() {
        for k in 0..8 {
            close(merged.batch.term(k)[lane], mean(&|i| parts[i].term(k)[lane]));
        }
        for (name, values) in merged.batch.sides() {
            let divisor = if *name == Side::Variance { 3.0 } else { 1.0 };
            let expected = mean(&|i| parts[i].side(name).expect("a side channel")[lane]);
            close(values[lane], expected / divisor);
        }
    }
    let said = json(&bench.succeed("transform all.exr --json"));
    assert!(number(&said["predicted_ratio"]) > 0.0, "{said}");
}

/// The variance that merged files state is that of their difference; the wrong
/// weights would be wrong by the number of files.
#[test]
fn merged_variances_are_true() {
    let bench = Bench::new();
    render(&bench, 0..6, "--spp 64 --size 48x48 --integrator direct");
    bench.succeed("merge s0.exr s1.exr s2.exr -o a.exr -q");
    bench.succeed("merge s3.exr s4.exr s5.exr -o b.exr -q");
    let [a, b] = ["a.exr", "b.exr"].map(|name| sequence(&bench.path(name)).batch);
    let (mut squares, mut variances) = (0.0, 0.0);
    for lane in 0..a.lanes() {
        squares += f64::from(a.last()[lane] - b.last()[lane]).powi(2);
        for batch in [&a, &b] {
            variances += f64::from(batch.side(&Side::Variance).expect("a variance")[lane]);
        }
    }
    // Thousands of lanes; the few at the light's edge weigh most.
    let ratio = squares / variances;
    assert!((0.8..1.25).contains(&ratio), "{ratio}");
}

/// A sequence of one sample of 4×3 pixels with some side channels; sides of pixels are
/// numbers that count up from the seed.
fn write_sequence(path: &Path, seed: u64, sides: &[Side]) {
    let grid = Grid::new(4, 3, 3, 0).expect("a grid");
    let terms = Array2::from_shape_fn((1, grid.lanes()), |(_, lane)| lane as f32 + seed as f32);
    let mut batch = SequenceBatch::new(terms, vec![1]).expect("a batch");
    batch.set_grid(grid).expect("its lanes");
    for side in sides {
        let length = if side.extent() == Extent::Pixel { grid.pixels() } else { grid.lanes() };
        let values = (0..length).map(|i| (seed + i as u64) as f32).collect();
        batch.set_side(side.clone(), values).expect("its values");
    }
    let info = SequenceInfo {
        size: [4, 3],
        model: ColorModel::Rgb,
        sample_counts: vec![1],
        sides: batch.sides().map(|(side, _)| side.clone()).collect(),
        scene: "x".into(),
        sampler: "random".into(),
        seeds: vec![seed],
        render_seconds: 0.0,
        resume: None,
    };
    let mut output = OutputFile::create(path).expect("a file");
    SequenceFile { info, batch, sums: None }.write(&mut output).expect("it can be written");
    output.commit().expect("it can be renamed");
}

/// Samples that were left out are counted, and none is not told: 0 in the other files.
#[test]
fn merged_files_have_the_sum_of_what_was_skipped() {
    let bench = Bench::new();
    for (name, seed, sides) in [
        ("a.exr", 1, &[][..]),
        ("b.exr", 2, &[Side::Skipped]),
        ("c.exr", 3, &[Side::Skipped]),
        ("other.exr", 4, &[Side::Other("depth".into())]),
    ] {
        write_sequence(&bench.path(name), seed, sides);
    }
    let skipped = |files: &str| -> Vec<f32> {
        bench.succeed(&format!("merge {files} -o m.exr -q"));
        let merged = sequence(&bench.path("m.exr")).batch;
        assert_eq!(merged.sides().count(), 1, "{files}");
        merged.side(&Side::Skipped).expect("a number per pixel").to_vec()
    };
    let of_pixels =
        |value: fn(u16) -> u16| (0..12).map(|i| f32::from(value(i))).collect::<Vec<_>>();
    assert_eq!(skipped("a.exr b.exr"), of_pixels(|i| 2 + i));
    assert_eq!(skipped("b.exr a.exr"), of_pixels(|i| 2 + i));
    assert_eq!(skipped("b.exr a.exr c.exr"), of_pixels(|i| 5 + 2 * i));
    // Nothing says how to merge what is not known, be it in all files or in one.
    for files in ["a.exr other.exr", "other.exr b.exr"] {
        let output = bench.nst(&format!("merge {files} -o new.exr"));
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(1), "{stderr}");
        for word in ["'other.exr'", "'depth'", "does not know how to merge"] {
            assert!(stderr.contains(word), "{files}: '{word}' is not in: {stderr}");
        }
        assert!(!bench.path("new.exr").exists());
    }
}

/// Renderings of a farm may be many more than the files that a process may open.
#[cfg(unix)]
#[test]
fn more_sequences_are_merged_than_files_may_be_open() {
    const FILES: u64 = 300;
    let bench = Bench::new();
    let names: Vec<String> = (0..FILES).map(|seed| format!("s{seed:03}.exr")).collect();
    (0..).zip(&names).for_each(|(seed, name)| write_sequence(&bench.path(name), seed, &[]));
    let limited = |script: &str| {
        let script = format!("ulimit -n 64; {script}");
        let mut command = std::process::Command::new("sh");
        command.args(["-c", &script, env!("CARGO_BIN_EXE_nst")]).current_dir(bench.path(""));
        command.output().expect("sh runs")
    };
    for job in [
        "merge s*.exr -o m.exr",
        "pack s*.exr --as samples --spp 1 -o p.exr",
        "pack s*.exr --as runs -o d.safetensors",
        "compare s*.exr s000.exr",
    ] {
        let output = limited(&format!("exec \"$0\" {job} --quiet"));
        assert!(output.status.success(), "{job}: {}", String::from_utf8_lossy(&output.stderr));
    }
    let merged = sequence(&bench.path("m.exr"));
    assert_eq!(merged.info.seeds, Vec::from_iter(0..FILES));
    assert_eq!(merged.info.sample_counts, [FILES as u32]);
    // The mean of 0 … 299, and the lane.
    assert_eq!(merged.batch.last()[..3], [149.5, 150.5, 151.5]);
    assert_eq!(limited("ulimit -n").stdout, b"64\n", "no limit: this test is blind");
}

/// A picture of 20x12 pixels whose value at (x, y) is 100 y + x, or a part of it, with the
/// channels and attributes that `change` gives it.
fn write_part(
    path: &Path,
    columns: std::ops::Range<i32>,
    prefix: &str,
    change: impl Fn(&mut exr::prelude::ImageAttributes, &mut exr::prelude::LayerAttributes),
) {
    use exr::prelude::*;
    let size = Vec2(columns.len(), 12);
    let value =
        |i: usize| (100 * (i / size.0)) as f32 + (columns.start + (i % size.0) as i32) as f32;
    let channel = |name: &str, factor: f32| {
        let values = (0..size.area()).map(|i| factor * value(i)).collect();
        AnyChannel::new(format!("{prefix}{name}").as_str(), FlatSamples::F32(values))
    };
    let mut channels = vec![channel("R", 1.0), channel("G", 2.0), channel("B", 3.0)];
    if !prefix.is_empty() {
        channels
            .push(AnyChannel::new("View Layer.Depth.Z", FlatSamples::F32(vec![0.5; size.area()])));
    }
    let mut own = LayerAttributes::default().with_position(Vec2(columns.start, 0));
    let mut frame = ImageAttributes::new(IntegerBounds::from_dimensions((20, 12)));
    change(&mut frame, &mut own);
    let layer = Layer::new(size, own, Encoding::FAST_LOSSLESS, AnyChannels::sort(channels.into()));
    let image = Image { attributes: frame, layer_data: Layers::from_elem(layer, 1) };
    image.write().to_file(path).expect("a file");
}

#[test]
fn parts_of_a_frame_are_compared_where_they_are() {
    let bench = Bench::new();
    let write = |name: &str, columns| write_part(&bench.path(name), columns, "", |_, _| {});
    write("full.exr", 0..20);
    write("left.exr", 0..16);
    write("right.exr", 4..20);
    write("end.exr", 18..20);
    for (files, size, position) in [
        ("left.exr right.exr", [12, 12], [4, 0]),
        ("left.exr full.exr", [16, 12], [0, 0]),
        ("left.exr right.exr full.exr", [12, 12], [4, 0]),
        ("full.exr full.exr", [20, 12], [0, 0]),
    ] {
        let report = json(&bench.succeed(&format!("compare {files} --json --error-map map.png")));
        assert_eq!(number(&report["mse"]["error"]), 0.0, "{files}");
        assert_eq!(report["width"], size[0]);
        assert_eq!(report["position"][0], position[0]);
        let notes = report["notes"].as_array().expect("a list").len();
        assert_eq!(notes, usize::from(files != "full.exr full.exr"), "{files}");
    }
    // The values depend on the place: a comparison by rows and columns would see it.
    let fails = |args: &str, word: &str| {
        let output = bench.nst(&format!("compare {args}"));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && said.contains(word), "{args}: {said}");
    };
    fails("left.exr end.exr", "in common");
    write_part(&bench.path("other.exr"), 4..20, "", |frame, _| {
        frame.display_window = exr::prelude::IntegerBounds::from_dimensions((16, 12));
    });
    fails("other.exr full.exr", "parts of one frame");
}

#[test]
fn layers_of_pictures_and_of_the_reference_are_chosen_apart() {
    let bench = Bench::new();
    write_part(&bench.path("plain.exr"), 0..20, "", |_, _| {});
    let blender = |name: &str, samples: &str| {
        write_part(&bench.path(name), 0..20, "View Layer.Combined.", |_, own| {
            let name = exr::prelude::Text::from("cycles.View Layer.samples");
            own.other.insert(name, exr::prelude::AttributeValue::Text(samples.into()));
        });
    };
    blender("blender.exr", "16");
    blender("more.exr", "32");
    let compare = |args: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_nst"));
        command.args(["compare", "--json"]).args(args).current_dir(bench.path(""));
        json(&String::from_utf8_lossy(&command.output().expect("the binary runs").stdout))
    };
    let reference = ["plain.exr", "blender.exr"];
    let chosen = ["plain.exr", "blender.exr", "--reference-layer", "View Layer.Combined"];
    for args in [&reference[..], &["blender.exr", "plain.exr"], &chosen] {
        assert_eq!(number(&compare(args)["mse"]["error"]), 0.0, "{args:?}");
    }
    assert_eq!(compare(&reference)["reference_layer"], "View Layer.Combined");
    let depth =
        ["--layer", "R", "plain.exr", "blender.exr", "--reference-layer", "View Layer.Depth"];
    assert!(number(&compare(&depth)["mse"]["error"]) > 1.0);
    // Its samples, too, are found without an option.
    bench.succeed("pack blender.exr -o seq.exr --quiet");
    assert_eq!(sequence(&bench.path("seq.exr")).info.sample_counts, [16]);
    let output = bench.nst("pack blender.exr more.exr -o other.exr");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && said.contains("16") && said.contains("32"), "{said}");
}

#[test]
fn other_primaries_are_told() {
    let bench = Bench::new();
    write_part(&bench.path("plain.exr"), 0..20, "", |_, _| {});
    write_part(&bench.path("aces.exr"), 0..20, "", |frame, _| {
        use exr::prelude::Vec2;
        frame.chromaticities = Some(exr::meta::attribute::Chromaticities {
            red: Vec2(0.713, 0.293),
            green: Vec2(0.165, 0.83),
            blue: Vec2(0.128, 0.044),
            white: Vec2(0.32168, 0.33767),
        });
    });
    for command in
        ["compare aces.exr plain.exr", "info aces.exr", "pack aces.exr --spp 4 -o seq.exr"]
    {
        let said = bench.succeed(command);
        assert!(said.contains("ACEScg (AP1)"), "{command}:\n{said}");
        assert!(!bench.succeed(&command.replace("aces.exr", "plain.exr")).contains("AP1"));
    }
    let output = bench.nst("pack aces.exr plain.exr --spp 4 -o other.exr");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && said.contains("other primaries"), "{said}");
}

/// What is wrong with a mean of pictures that were blended is the same in all of them.
#[test]
fn blended_pictures_are_told_from_plain_ones() {
    let bench = Bench::new();
    for (seed, method) in [(1, "auto"), (2, "auto"), (3, "none"), (4, "none")] {
        let scene = format!("render --scene {} --size 40x32 --spp 16", common::cornell());
        let picture = format!("--seed {seed} --transform {method} -o p{seed}.exr -q");
        bench.succeed(&format!("{scene} {picture}"));
    }
    for (command, is_told) in [
        ("pack p1.exr p2.exr -o seq.exr", true),
        ("pack p1.exr p2.exr --layer S -o seq.exr", false),
        ("pack p3.exr p4.exr -o seq.exr", false),
    ] {
        let said = bench.succeed(command);
        let told = said.contains("'p1.exr' is denoised in the main picture")
            && said.contains("--layer 'S' takes them as they were before");
        assert_eq!(told, is_told, "{command}: {said}");
    }
}

#[test]
fn sequences_are_not_packed_as_pictures() {
    let bench = Bench::new();
    render(&bench, 1..=2, "--spp 8 --size 8x8");
    let output = bench.nst("pack s1.exr s2.exr --spp 8 -o seq.exr");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && said.contains("nst merge"), "{said}");
    bench.succeed("pack r1.exr r2.exr --spp 8 -o seq.exr --quiet");
}

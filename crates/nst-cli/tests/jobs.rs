//! What users do, from files to files.

mod common;

use std::path::Path;

use common::{Bench, cornell, read_layer};
use nst_core::{Strips, methods::METHODS};
use nst_files::sequence_file::{SequenceFile, SequenceReader};
use safetensors::SafeTensors;

/// A model without materials, lights or a camera.
const PYRAMID: &str = "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv 0 1.5 0\nf 1 2 3 4\nf 1 5 2\nf 2 5 3\nf 3 5 4\nf 4 5 -5\n";

fn picture(path: &Path) -> Vec<f32> {
    read_layer(path, "").1
}

#[test]
fn render_writes_pictures_and_a_summary() {
    let bench = Bench::new();
    let scene = cornell();
    let said = bench.succeed(&format!("render --scene {scene} --spp 16 --size 64x48"));
    assert_eq!(bench.files(), ["cornell.exr", "cornell.png"]);
    for word in
        ["38 triangles", "64x48", "million paths per second", "transform  auto", "cornell.exr"]
    {
        assert!(said.contains(word), "'{word}' is not in:\n{said}");
    }
    let path = bench.path("cornell.exr");
    let (size, transformed) = read_layer(&path, "");
    assert_eq!(size, [64, 48]);
    let (_, plain) = read_layer(&path, "S");
    let (_, variance) = read_layer(&path, "Variance");
    assert!(transformed.iter().chain(&plain).chain(&variance).all(|x| x.is_finite()));
    assert_ne!(transformed, plain);
    let png = std::fs::read(bench.path("cornell.png")).expect("the PNG");
    assert!(png.starts_with(b"\x89PNG"));
}

#[test]
fn a_png_can_be_all_that_is_written() {
    let bench = Bench::new();
    let scene = format!("render --scene {} --spp 8 --size 9x7", cornell());
    bench.succeed(&format!("{scene} -o x.exr --sequence seq.exr"));
    bench.succeed(&format!("{scene} -o y.png"));
    bench.succeed("transform seq.exr -o z.PNG");
    assert_eq!(bench.files(), ["seq.exr", "x.exr", "x.png", "y.png", "z.PNG"]);
    let bytes = ["x.png", "y.png", "z.PNG"].map(|file| std::fs::read(bench.path(file)));
    let [x, y, z] = bytes.map(|bytes| bytes.expect("a file"));
    assert!(x == y && y == z);
    // It is a name that was given: files of another program are replaced, as if it were .exr.
    bench.write("w.png", &x);
    bench.succeed("transform seq.exr --transform none -o w.png");
}

#[test]
fn json_has_the_names_that_programs_read() {
    let bench = Bench::new();
    let scene = cornell();
    let said = bench.succeed(&format!(
        "render --scene {scene} --spp 8 --size 8x8 --backend cpu --json --sequence seq.exr"
    ));
    let json: serde_json::Value = serde_json::from_str(&said).expect("one JSON object");
    let names = [
        "samples_per_pixel",
        "render_seconds",
        "transform_seconds",
        "io_seconds",
        "total_seconds",
        "paths_per_second",
        "backend",
        "adapter",
        "transform",
        "lanes",
        "lanes_skipped",
        "lanes_fallen_back",
    ];
    for name in names {
        assert!(json.get(name).is_some(), "{name} is not in {said}");
    }
    assert_eq!(json["lanes"], 8 * 8 * 3);
    assert_eq!(json["samples_per_pixel"], 8);
    assert_eq!(json["transform"], "auto");
    let said = bench.succeed("transform seq.exr --json --backend cpu");
    let json: serde_json::Value = serde_json::from_str(&said).expect("one JSON object");
    assert!(names.iter().all(|name| json.get(*name).is_some()), "{said}");
    assert!(json["render_seconds"].is_null());
}

/// The stored sequence gives, bit for bit, the picture of its rendering.
fn transform_repeats_render(backend: &str) {
    let bench = Bench::new();
    let scene = cornell();
    for method in ["", "--transform cornell", "--transform families", "--transform none"] {
        let options = format!("{method} --backend {backend} --quiet");
        bench.succeed(&format!(
            "render --scene {scene} --spp 16 --size 40x30 --sequence seq.exr -o direct.exr {options}"
        ));
        let said = bench.succeed(&format!("transform seq.exr {options}"));
        assert_eq!(said, "", "--quiet");
        let direct = picture(&bench.path("direct.exr"));
        let stored = picture(&bench.path("seq.nst.exr"));
        assert!(
            direct.iter().map(|x| x.to_bits()).eq(stored.iter().map(|x| x.to_bits())),
            "{method}"
        );
        let plain = read_layer(&bench.path("direct.exr"), "S").1;
        assert_eq!(direct == plain, method.ends_with("none"), "'{method}' changes the picture");
    }
}

#[test]
fn transform_repeats_render_on_the_cpu() {
    transform_repeats_render("cpu");
}

#[test]
fn transform_repeats_render_on_the_gpu() {
    let bench = Bench::new();
    if bench.has_gpu() {
        transform_repeats_render("gpu");
    }
}

#[test]
fn the_main_job_needs_no_vulkan_driver() {
    let bench = Bench::new();
    let args =
        format!("render --scene {} --spp 8 --size 8x8 --transform cornell --json", cornell());
    let output = bench.nst_with(
        &args,
        &[("VK_DRIVER_FILES", "/nonexistent"), ("VK_ICD_FILENAMES", "/nonexistent")],
    );
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!((&json["backend"], &json["adapter"]), (&"cpu".into(), &serde_json::Value::Null));
}

#[test]
fn a_stored_sequence_holds_what_was_asked_for() {
    let bench = Bench::new();
    let scene = cornell();
    let args =
        format!("render --scene {scene} --spp 12 --size 9x7 --seed 5 --sequence seq.exr --quiet");
    bench.succeed(&args);
    let window = SequenceFile::read(&bench.path("seq.exr")).expect("a sequence");
    assert_eq!(window.batch.sample_counts(), [5, 6, 7, 8, 9, 10, 11, 12]);
    assert_eq!((window.info.size, window.batch.lanes()), ([9, 7], 9 * 7 * 3));
    assert_eq!(window.info.seeds, [5]);
    assert!(window.info.scene.starts_with("cornell:"));
    bench.succeed(&format!("{args} --keep all"));
    let all = SequenceFile::read(&bench.path("seq.exr")).expect("a sequence");
    assert_eq!(all.batch.sample_counts().len(), 12);
    // The same samples, whatever is kept of them.
    assert_eq!(all.batch.window(8), window.batch.window(8));
    assert!(all.batch.sides().eq(window.batch.sides()));
    // Of these, 16 are features.
    assert_eq!(all.batch.sides().count(), 29);
}

/// These methods learn from the whole picture, or look at neighbours; `nst transform` reads it
/// strip by strip.
#[test]
fn a_sequence_of_several_strips_gives_the_picture_of_its_rendering() {
    let bench = Bench::new();
    bench.write("pyramid.obj", PYRAMID);
    let render = "render --scene pyramid.obj --spp 8 --size 800x720 --max-depth 2 --quiet";
    let stores = "--sequence seq.exr --threads 1";
    for (method, options) in
        [("auto", "--sequence seq.exr"), ("ridge", ""), ("prior-mean", ""), ("filter", stores)]
    {
        bench.succeed(&format!("{render} --transform {method} -o direct.exr {options}"));
        bench.succeed(&format!(
            "transform seq.exr --transform {method} -o stored.exr --threads 3 --quiet"
        ));
        let [direct, stored] = ["direct.exr", "stored.exr"].map(|name| picture(&bench.path(name)));
        assert!(direct.iter().map(|x| x.to_bits()).eq(stored.iter().map(|x| x.to_bits())));
        assert!(direct != read_layer(&bench.path("direct.exr"), "S").1, "{method} does nothing");
    }
    // Smaller pictures are one strip.
    let mut reader = SequenceReader::open(&bench.path("seq.exr")).expect("a sequence");
    let strip = reader.next_strip().expect("it is sound").expect("a strip").into_owned();
    assert!(strip.grid().expect("a picture").rows() < 720, "one strip: this test is blind");
}

#[test]
fn any_obj_renders_without_sidecar_material_or_light() {
    let bench = Bench::new();
    bench.write("pyramid.obj", PYRAMID);
    let said = bench.succeed("render --scene pyramid.obj --spp 8 --size 32x32");
    for word in ["frames the scene", "grey material", "a studio", "transform  auto"] {
        assert!(said.contains(word), "'{word}' is not in:\n{said}");
    }
    // The corner sees the background, the middle sees faces.
    let corner_and_middle = |options: &str| {
        let render = "render --scene pyramid.obj --spp 8 --size 32x32 --quiet";
        bench.succeed(&format!("{render} {options}"));
        let picture = picture(&bench.path("pyramid.exr"));
        [picture[0], picture[16 * 32 + 16]]
    };
    let [corner, middle] = corner_and_middle("");
    assert!((0.05..0.2).contains(&corner) && (0.2..1.0).contains(&middle), "{corner} {middle}");
    let [corner, middle] = corner_and_middle("--light white");
    assert!(corner == 1.0 && (0.5..0.9).contains(&middle), "{middle}");
    assert_eq!(corner_and_middle("--light none"), [0.0; 2]);
    let [corner, middle] = corner_and_middle("--light sky");
    assert!(corner > 0.1 && middle > 0.1 && corner != middle, "{corner} {middle}");
    // From very near, all is pyramid.
    let near = "--camera-position 0.1,0.2,1 --camera-target 0,0.2,0 --camera-fov 10 --light white";
    assert!(corner_and_middle(near)[0] < 0.9);
    // The sidecar says the same, and the command line more.
    bench.write("pyramid.toml", "[environment]\nlight = 'white'\n");
    assert_eq!(corner_and_middle("")[0], 1.0);
    assert_eq!(corner_and_middle("--light none"), [0.0; 2]);
    // What is in no picture is told.
    let said = bench.succeed("render --scene pyramid.obj --spp 1 --size 8x8 --light none");
    assert!(said.contains("the picture is black"), "{said}");
    bench.write("pyramid.toml", "");
    let away = "--camera-position 0,0,9 --camera-target 0,0,19";
    let said = bench.succeed(&format!("render --scene pyramid.obj --spp 1 --size 8x8 {away}"));
    assert!(said.contains("background alone"), "{said}");
    let says = |option: &str, word: &str| {
        let output = bench.nst(&format!("render --scene pyramid.obj {option}"));
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && error.contains(word), "{option}: {error}");
    };
    says("--camera-position 1,2", "three numbers");
    says("--camera-fov 190", "camera's vertical_fov must lie between");
    says("--camera-position 1,2,3 --camera-target 1,2,3", "camera's target must differ");
    says("--camera-position 0,0.75,0", "camera's target must differ");
    bench.write("pyramid.toml", "\n[environment]\nlight = 'bright'\n");
    says(
        "",
        "line 3: [environment] light 'bright' is no light; there are studio, sky, white, none",
    );
}

#[test]
fn bench_stability_writes_a_row_per_method_regime_and_count() {
    let bench = Bench::new();
    let said = bench.succeed("bench stability --short -o out.csv --markdown out.md");
    assert!(said.contains("0 results not finite"), "{said}");
    let csv = std::fs::read_to_string(bench.path("out.csv")).expect("the CSV");
    let mut lines = csv.lines();
    let header = lines.next().expect("a header");
    assert!(
        header.starts_with("method,regime,n,mse_ratio,fallback_share,worst_ratio,nonfinite,"),
        "{header}"
    );
    let rows: Vec<_> = lines.collect();
    assert!(rows.iter().any(|row| row.starts_with("levin-u,logarithmic,8,")));
    assert!(rows.iter().any(|row| row.starts_with("families,firefly-last,64,")));
    let page = std::fs::read_to_string(bench.path("out.md")).expect("the page");
    assert!(page.contains("### halton-random") && page.contains("| ridge |"), "{page}");
    // The same numbers again, but for the times in the last two columns.
    let numbers = |csv: &str| -> Vec<String> {
        csv.lines().map(|line| line.rsplitn(3, ',').last().unwrap_or_default().to_owned()).collect()
    };
    bench.succeed("bench stability --short -o again.csv --threads 1 --quiet");
    let again = std::fs::read_to_string(bench.path("again.csv")).expect("the CSV");
    assert_eq!(numbers(&csv), numbers(&again));
}

#[test]
fn methods_without_weights_transform_stored_sequences() {
    let bench = Bench::new();
    bench.succeed(&format!(
        "render --scene {} --spp 16 --size 16x16 --transform none --sequence seq.exr --quiet -o x.exr",
        cornell()
    ));
    let plain = picture(&bench.path("x.exr"));
    for (method, _) in METHODS {
        let said =
            bench.succeed(&format!("transform seq.exr --json --transform {method} -o t.exr"));
        let json: serde_json::Value = serde_json::from_str(&said).expect("JSON");
        assert_eq!((&json["transform"], &json["backend"]), (&(*method).into(), &"cpu".into()));
        let transformed = picture(&bench.path("t.exr"));
        assert!(transformed.iter().all(|x| x.is_finite()), "{method}");
        assert_ne!(transformed, plain, "{method}");
    }
}

#[test]
fn the_filter_runs_on_a_gpu_if_asked() {
    let bench = Bench::new();
    if !bench.has_gpu() {
        return;
    }
    let options = "--spp 16 --size 40x30 --transform filter --sequence seq.exr --json -o cpu.exr";
    let backend = |said: &str| {
        let json: serde_json::Value = serde_json::from_str(said).expect("JSON");
        json["backend"].as_str().map(str::to_owned)
    };
    let on_cpu = bench.succeed(&format!("render --scene {} {options}", cornell()));
    assert_eq!(backend(&on_cpu).as_deref(), Some("cpu"));
    let on_gpu =
        bench.succeed("transform seq.exr --transform filter --backend gpu --json -o gpu.exr");
    assert_eq!(backend(&on_gpu).as_deref(), Some("gpu"));
    let [cpu, gpu] = ["cpu.exr", "gpu.exr"].map(|name| picture(&bench.path(name)));
    let near = |(cpu, gpu): &(&f32, &f32)| (*cpu - *gpu).abs() <= 1e-4 * cpu.abs();
    // Where a test is very close to its threshold, rounding decides whether a pixel counts.
    assert!(cpu.iter().zip(&gpu).filter(near).count() * 100 >= 99 * cpu.len());
    let plain = read_layer(&bench.path("cpu.exr"), "S").1;
    assert!(plain.iter().zip(&gpu).filter(near).count() * 2 < cpu.len());
}

#[test]
fn runs_become_one_dataset() {
    let bench = Bench::new();
    let scene = format!("render --scene {} --spp 9 --size 5x4 --quiet", cornell());
    bench.succeed(&format!("{scene} --seed 40 --runs 3 -o runs.safetensors"));
    assert_eq!(bench.files(), ["runs.safetensors"]);
    let bytes = std::fs::read(bench.path("runs.safetensors")).expect("the dataset");
    let (_, header) = SafeTensors::read_metadata(&bytes).expect("a header");
    let metadata = header.metadata().clone().expect("metadata");
    assert_eq!((metadata["width"].as_str(), metadata["height"].as_str()), ("5", "4"));
    assert_eq!((metadata["first_seed"].as_str(), metadata["sampler"].as_str()), ("40", "random"));
    assert!(metadata["scene"].starts_with("cornell:"));
    let tensors = SafeTensors::deserialize(&bytes).expect("a safetensors file");
    let sequences = tensors.tensor("sequences").expect("the tensor");
    assert_eq!(sequences.shape(), [3, 9, 60]);

    // Run 2 is the rendering with the third seed, bit for bit.
    bench.succeed(&format!("{scene} --seed 42 --keep all --sequence seq.exr -o x.exr"));
    let stored = SequenceFile::read(&bench.path("seq.exr")).expect("a sequence");
    let (numbers, _) = sequences.data().as_chunks();
    let run: Vec<f32> = numbers[2 * 9 * 60..].iter().map(|&b| f32::from_le_bytes(b)).collect();
    assert!(stored.batch.terms().iter().eq(&run));

    // A reference needs no more than the last terms.
    bench.succeed(&format!("{scene} --seed 42 --runs 1 --keep window -o last.safetensors"));
    let bytes = std::fs::read(bench.path("last.safetensors")).expect("the dataset");
    let (_, header) = SafeTensors::read_metadata(&bytes).expect("a header");
    let metadata = header.metadata().clone().expect("metadata");
    assert_eq!(metadata["sample_counts"], "2,3,4,5,6,7,8,9");
    let tensors = SafeTensors::deserialize(&bytes).expect("a safetensors file");
    let (last, _) = tensors.tensor("sequences").expect("the tensor").data().as_chunks();
    assert!(last.iter().map(|&b| f32::from_le_bytes(b)).eq(run[60..].iter().copied()));
}

#[test]
fn samplers_and_integrators_differ_in_what_they_say_they_do() {
    let bench = Bench::new();
    let scene =
        format!("render --scene {} --spp 16 --size 16x16 --quiet --transform none", cornell());
    let render = |options: &str| {
        bench.succeed(&format!("{scene} {options} --sequence seq.exr -o x.exr"));
        SequenceFile::read(&bench.path("seq.exr")).expect("a sequence")
    };
    let (random, halton) = (render(""), render("--sampler halton"));
    assert_eq!((&*random.info.sampler, &*halton.info.sampler), ("random", "halton"));
    assert_ne!(random.batch, halton.batch);
    // The same integrals, whichever numbers they are sampled with.
    assert_eq!(random.info.scene, halton.info.scene);
    let direct = render("--integrator direct");
    assert_eq!(direct.batch, render("--max-depth 2").batch);
    let sum = |file: &SequenceFile| file.batch.last().iter().map(|&x| f64::from(x)).sum::<f64>();
    assert!(sum(&direct) < 0.95 * sum(&random));
}

/// The same picture for the screen, however it was made, and from strips.
#[test]
fn transform_writes_the_png_of_its_rendering() {
    let bench = Bench::new();
    bench.write("pyramid.obj", PYRAMID);
    let render = "render --scene pyramid.obj --spp 8 --size 300x900 --max-depth 2 --quiet";
    bench.succeed(&format!("{render} --transform ridge --sequence seq.exr -o direct.exr"));
    bench.succeed("transform seq.exr --transform ridge -o stored.exr --quiet");
    let [direct, stored] =
        ["direct.png", "stored.png"].map(|name| std::fs::read(bench.path(name)).expect(name));
    assert!(direct == stored && direct.starts_with(b"\x89PNG"));
    // One channel is grey.
    bench.succeed("pack direct.exr --layer S.R --spp 8 -o mono.exr -q");
    bench.succeed("transform mono.exr --quiet");
    assert!(bench.files().contains(&"mono.nst.png".to_owned()));
}

#[test]
fn counts_and_seeds_that_are_no_numbers_get_help() {
    let bench = Bench::new();
    bench.write("pyramid.obj", PYRAMID);
    for (option, words) in [
        ("--spp 1e6", "write it in full: 1000000"),
        ("--spp -3", "whole number from 1 on"),
        ("--runs many", "whole number from 1 on"),
        ("--seed -1", "whole number from 0 to 18446744073709551615"),
        ("--max-depth 0", "whole number from 1 on"),
    ] {
        let output = bench.nst(&format!("render --scene pyramid.obj {option}"));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(words), "{option}: {said}");
    }
}

#[test]
fn shells_and_manuals_know_all_commands() {
    let bench = Bench::new();
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let said = bench.succeed(&format!("completions {shell}"));
        assert!(said.contains("transform") && said.contains("camera-position"), "{shell}");
    }
    let manual = bench.succeed("man");
    assert!(manual.contains(".TH nst") && manual.contains("transform"), "{manual}");
    let manual = bench.succeed("man render");
    assert!(manual.contains("camera\\-position") && manual.contains("nst\\-render"), "{manual}");
    let output = bench.nst("man paint");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        output.status.code() == Some(2) && said.contains("there are render, transform"),
        "{said}"
    );
}

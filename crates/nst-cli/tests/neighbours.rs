//! Experts that look at neighbours, from the command line.

mod common;

use common::{Bench, cornell, read_layer};
use nst_core::Side;
use nst_files::{header::ExrHeader, sequence_file::SequenceFile};
use serde_json::Value;

fn report(bench: &Bench, args: &str) -> Value {
    serde_json::from_str(&bench.succeed(&format!("{args} --json"))).expect("JSON")
}

fn render(args: &str) -> String {
    format!("render --scene {} --size 48x32 {args}", cornell())
}

fn lanes(bench: &Bench, picture: &str, layer: &str) -> Vec<f32> {
    read_layer(&bench.path(picture), layer).1
}

/// The channels of a picture whose names begin so.
fn channels(bench: &Bench, picture: &str, begin: &str) -> Vec<String> {
    let header = ExrHeader::read(&bench.path(picture)).expect("a header");
    let names = header.parts[0].channels.iter().map(|channel| channel.name.to_string());
    names.filter(|name| name.starts_with(begin)).collect()
}

fn has_features(bench: &Bench, picture: &str) -> bool {
    !channels(bench, picture, "albedo").is_empty()
}

/// The same of a rendering in memory, with any number of threads, and of its stored sequence.
#[test]
fn the_filter_under_the_guard() {
    let bench = Bench::new();
    let said = report(&bench, &render("--spp 16 --sequence s.exr -o x.exr --experts lane,filter"));
    let names = said["experts"].as_array().expect("a list").iter().map(|it| it["name"].as_str());
    assert!(names.eq([Some("lane"), Some("filter")]), "{said}");
    assert!(said["predicted_ratio"].as_f64().is_some_and(|ratio| ratio < 1.0), "{said}");
    assert!(!said["notes"].to_string().contains("no features"), "{said}");
    // Features are for the experts, and not in the picture; the sequence has them.
    assert!(!has_features(&bench, "x.exr"));
    let stored = SequenceFile::read(&bench.path("s.exr")).expect("a sequence");
    assert!(stored.batch.side(&Side::AlbedoFold(3)).is_some());
    for threads in [1, 2] {
        let again = format!("transform s.exr -o y.exr --experts lane,filter --threads {threads}");
        assert_eq!(report(&bench, &again)["experts"], said["experts"]);
        for layer in ["", "S", "StdError"] {
            assert!(lanes(&bench, "x.exr", layer) == lanes(&bench, "y.exr", layer), "{layer}");
        }
        for picture in ["x.exr", "y.exr"] {
            let weights = channels(&bench, picture, "weight.");
            assert_eq!(weights, ["weight.filter", "weight.lane"], "{picture}");
            let info = bench.succeed(&format!("info {picture}"));
            assert!(info.contains("weight.filter, weight.lane\n"), "{info}");
        }
    }
    // S has the bits that it has without; the estimates have not.
    bench.succeed(&render("--spp 16 -o z.exr --transform none -q"));
    assert!(lanes(&bench, "x.exr", "S") == lanes(&bench, "z.exr", ""));
    assert!(lanes(&bench, "x.exr", "") != lanes(&bench, "z.exr", ""));
    bench.succeed(&render("--spp 16 -o w.exr --experts filter --features -q"));
    assert!(has_features(&bench, "w.exr"));
    assert!(lanes(&bench, "w.exr", "") != lanes(&bench, "x.exr", ""), "without lane");
}

#[test]
fn without_features_radiance_is_all_there_is() {
    let bench = Bench::new();
    bench.succeed(&render("--spp 8 --sequence s.exr -o x.exr --transform none -q"));
    let said = report(&bench, "transform s.exr -o y.exr --experts lane,filter");
    assert!(said["notes"].to_string().contains("sees radiance alone"), "{said}");
    let resumed = render("--spp 12 --resume s.exr -o z.exr --experts lane,filter");
    assert!(report(&bench, &resumed)["notes"].to_string().contains("sees radiance alone"));
    // Where nothing can be held out, nothing looks at all.
    bench.succeed(&render("--spp 3 --sequence three.exr -o x.exr --transform none -q"));
    let said = report(&bench, "transform three.exr -o y.exr --experts lane,filter");
    assert!(said["reason"].to_string().contains("fewer than four samples"), "{said}");
    assert!(!said["notes"].to_string().contains("sees radiance alone"), "{said}");
    // Parts of one sequence cannot be held out, whoever asks.
    let nested = render("--spp 8 --sampler halton -o n.exr --experts lane,filter");
    let said = report(&bench, &nested);
    assert!(said["reason"].to_string().contains("depend on each other"), "{said}");
    assert!(lanes(&bench, "n.exr", "") == lanes(&bench, "n.exr", "S"));
}

#[test]
fn a_feature_that_lacks_a_fold_takes_no_part() {
    let bench = Bench::new();
    bench.succeed(&render("--spp 8 --features --sequence s.exr -o x.exr --transform none -q"));
    let mut file = std::fs::read(bench.path("s.exr")).expect("a file");
    // Other names of the same length, which sort alike; the rendering's state has no 0 before its own.
    // Without `nst.keep` that is not read.
    for (name, other, count) in [("\0albedo3.", "\0albedo9.", 3), ("nst.keep", "nst.kept", 1)] {
        let is_there = |at: &usize| file[*at..].starts_with(name.as_bytes());
        let places: Vec<usize> = (0..file.len() - name.len()).filter(is_there).collect();
        assert_eq!(places.len(), count, "{name}");
        places.iter().for_each(|at| file[*at..][..name.len()].copy_from_slice(other.as_bytes()));
    }
    std::fs::write(bench.path("t.exr"), file).expect("a file");
    let note = "no albedo3: a feature takes part if all of its folds are there";
    for (sequence, is_told) in [("s.exr", false), ("t.exr", true)] {
        let said = report(&bench, &format!("transform {sequence} -o y.exr --experts filter"));
        assert_eq!(said["notes"].to_string().contains(note), is_told, "{said}");
        // Lanes are blended without.
        let said = report(&bench, &format!("transform {sequence} -o y.exr --experts lane"));
        assert!(!said["notes"].to_string().contains(note), "{said}");
    }
}

/// A file that is no library is named, and so is one that is not there. Which file is loaded is
/// said before, but not where programs listen.
#[test]
fn a_denoiser_that_is_not_there() {
    let bench = Bench::new();
    bench.succeed(&render("--spp 8 --sequence s.exr -o x.exr --transform none -q"));
    bench.write("text.so", "not a library");
    for (file, is_loaded) in [("gone.so", false), ("text.so", true)] {
        for (option, says) in [("", is_loaded), ("--quiet", false), ("--json", false)] {
            let command = format!("transform s.exr --experts lane,oidn -o y.exr {option}");
            let output = bench.nst_with(&command, &[("OIDN_LIBRARY", file)]);
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{said}");
            assert!(said.contains("--experts oidn") && said.contains(file), "{said}");
            assert_eq!(said.contains("loading  "), says, "{option}: {said}");
            assert!(!bench.path("y.exr").exists());
        }
    }
}

/// A library in C that stands for Open Image Denoise: compiled as the tests of `nst-oidn` do.
#[cfg(unix)]
fn fake(bench: &Bench, name: &str, macros: &[&str]) -> String {
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/../nst-oidn/tests/oidn/fake.c");
    let path = bench.path(name).display().to_string();
    let mut compiler = std::process::Command::new("cc");
    compiler.args(["-std=c11", "-shared", "-fPIC", source, "-o", &path]);
    compiler.arg(format!("-DLOG=\"{path}.log\""));
    compiler.args(macros.iter().map(|text| format!("-D{text}")));
    assert!(compiler.status().expect("a C compiler, cc").success(), "{compiler:?}");
    path
}

/// One that works is an expert; one that fails while it denoises is left out, with a note. Its
/// device is its own choice.
#[cfg(unix)]
#[test]
fn a_denoiser_that_fails_is_left_out() {
    let bench = Bench::new();
    bench.succeed(&render("--spp 8 --sequence s.exr -o x.exr --transform none -q"));
    let said = |library: &str, options: &str| -> Value {
        let command = format!("transform s.exr -o y.exr --json --guard closed {options}");
        let output = bench.nst_with(&command, &[("OIDN_LIBRARY", library)]);
        assert!(output.status.success(), "{output:?}");
        serde_json::from_slice(&output.stdout).expect("JSON")
    };
    let names = |said: &Value| -> Vec<String> {
        let experts = said["experts"].as_array().expect("a list").iter();
        experts.map(|it| it["name"].as_str().expect("a name").to_owned()).collect()
    };
    let works = fake(&bench, "works.so", &[]);
    let with = said(&works, "--experts lane,filter,oidn --backend gpu");
    assert_eq!(names(&with), ["lane", "filter", "oidn"]);
    let notes = with["notes"].to_string();
    for words in ["'oidn' chooses its device itself", "'filter' stays on the CPU"] {
        assert!(notes.contains(words) && !notes.contains("left out"), "{notes}");
    }
    let fails = fake(&bench, "fails.so", &["FAIL=\"oidnExecuteFilter\""]);
    let without = said(&fails, "--experts lane,filter,oidn");
    assert_eq!(names(&without), ["lane", "filter"]);
    assert!(without["notes"].to_string().contains("'oidn' is left out"), "{without}");
    let picture = lanes(&bench, "y.exr", "");
    said("", "--experts lane,filter");
    assert!(picture == lanes(&bench, "y.exr", ""), "as if it had not been named");
    let none = said("", "--experts lane,filter --backend gpu");
    assert!(none["notes"].to_string().contains("nothing of 'auto' runs on a GPU"), "{none}");
}

/// Strips are as tall as the library needs: it says the same of each row, whether all are in one
/// strip, as of a small file, or not, as of a rendering.
#[cfg(unix)]
#[test]
fn a_denoiser_gets_what_it_depends_on() {
    let bench = Bench::new();
    let same = |library: &str| {
        let run = |args: &str| {
            let output = bench.nst_with(&format!("{args} -q"), &[("OIDN_LIBRARY", library)]);
            assert!(output.status.success(), "{output:?}");
        };
        let scene = format!("render --scene {} --size 6x500 --spp 8", cornell());
        run(&format!("{scene} --threads 1 --experts oidn --sequence s.exr -o x.exr"));
        run("transform s.exr --threads 1 --experts oidn -o y.exr");
        let [x, y] = ["x.exr", "y.exr"].map(|name| lanes(&bench, name, ""));
        assert!(x != lanes(&bench, "x.exr", "S"), "it is trusted");
        x == y
    };
    for (overlap, reach) in [(96, 96), (40, 48), (0, 0)] {
        let macros = [format!("TILE_OVERLAP={overlap}"), format!("REACH={reach}")];
        let library = fake(&bench, "fits.so", &[&macros[0], &macros[1]]);
        assert!(same(&library), "{overlap}");
    }
    // One that looks farther than it says.
    assert!(!same(&fake(&bench, "far.so", &["TILE_OVERLAP=48", "REACH=96"])));
}

/// All experts are those that can run.
#[cfg(unix)]
#[test]
fn all_experts() {
    let bench = Bench::new();
    bench.succeed(&render("--spp 8 --sequence s.exr -o x.exr --features --transform none -q"));
    bench.write("text.so", "not a library");
    let works = fake(&bench, "works.so", &[]);
    let said = |library: &str, options: &str| -> Value {
        let command = format!("transform s.exr --guard closed --experts {options} -o y.exr --json");
        let output = bench.nst_with(&command, &[("OIDN_LIBRARY", library)]);
        assert!(output.status.success(), "{output:?}");
        serde_json::from_slice(&output.stdout).expect("JSON")
    };
    let all = said(&works, "all");
    assert_eq!(all["experts"], said(&works, "lane,filter,oidn")["experts"]);
    assert_eq!(all["notes"], serde_json::json!([]));
    let gpu = said(&works, "all --backend gpu")["notes"].to_string();
    assert!(gpu.contains("'oidn' chooses its device itself; the expert 'filter' stays"), "{gpu}");
    for file in ["text.so", "gone.so"] {
        let without = said(file, "all");
        assert_eq!(without["experts"], said("", "lane,filter")["experts"]);
        let notes = without["notes"].to_string();
        assert!(notes.contains("'oidn' takes no part") && notes.contains(file), "{notes}");
        let gpu = said(file, "all --backend gpu")["notes"].to_string();
        assert!(
            gpu.contains("nothing of 'auto' runs on a GPU") && !gpu.contains("chooses"),
            "{gpu}"
        );
    }
    bench.refuses("transform s.exr --experts all,filter", &["'filter'", "twice"]);
}

/// Pictures of one pixel, of one row, and of one column.
#[test]
fn small_pictures() {
    let bench = Bench::new();
    for size in ["1x1", "9x1", "1x9"] {
        let options = format!("--size {size} --spp 16 --experts lane,filter");
        let scene = cornell();
        bench.succeed(&format!("render --scene {scene} {options} --sequence s.exr -o a.exr"));
        bench.succeed("transform s.exr --experts lane,filter -o b.exr");
        let [a, b] = ["a.exr", "b.exr"].map(|name| lanes(&bench, name, ""));
        assert!(a == b && a.iter().all(|x| x.is_finite()), "{size}");
    }
}

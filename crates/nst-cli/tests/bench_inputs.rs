//! `nst bench scene`: what may go on with which table, and which pictures and references count.

mod common;

use common::{
    Bench, cornell, read_layer,
    tables::{Table, errors, nst, number, start, succeed, table, terminate},
};
use nst_files::{
    ColorModel,
    output::OutputFile,
    picture_writer::{PictureInfo, write_exr},
};

/// A bench of the Cornell box on 8 by 8 pixels.
fn scene() -> String {
    format!("bench scene --scene {} --size 8x8 --backend cpu", cornell())
}

/// Runs a bench, which must fail with all of the words, and leave its table as it was.
fn fails(bench: &Bench, args: &str, code: i32, words: &[&str]) {
    let before = std::fs::read(bench.path("t.csv")).ok();
    let (found, _, complained) = nst(bench, args);
    assert_eq!(found, Some(code), "{args}: {complained}");
    for word in words {
        assert!(complained.contains(word), "{args}: '{word}' is not in: {complained}");
    }
    assert!(std::fs::read(bench.path("t.csv")).ok() == before, "{args}: the table has changed");
}

/// Renders pictures x1.exr, … and sequences s1.exr, … of these seeds.
fn render(bench: &Bench, seeds: std::ops::RangeInclusive<u32>, spp: u32) {
    let scene = format!("render --scene {} --size 8x8 --transform none --quiet", cornell());
    for seed in seeds {
        let files = format!("--sequence s{seed}.exr -o x{seed}.exr");
        succeed(bench, &format!("{scene} --spp {spp} --seed {seed} {files}"));
    }
}

/// Writes a picture of planar R, G, B on 8 by 8 pixels.
fn picture(bench: &Bench, name: &str, lanes: &[f32]) {
    let info = PictureInfo { samples_per_pixel: Some(8), ..PictureInfo::default() };
    let mut output = OutputFile::create(&bench.path(name)).expect("a new file");
    write_exr(&mut output, [8, 8], ColorModel::Rgb, &[("", lanes)], &info).expect("a picture");
    output.commit().expect("a disk with room");
}

fn runs(table: &Table, method: &str, spp: u32) -> usize {
    table.keys().filter(|key| (&*key.0, key.1) == (method, spp)).count()
}

#[test]
fn two_processes_write_one_table() {
    let bench = Bench::new();
    let args = |rest: &str| format!("{} --runs 40 --reference-spp 32 {rest} -o t.csv", scene());
    let first = start(&bench, &args("--spp 8 9 --transform gmon"));
    let second = start(&bench, &args("--spp 8 --transform ridge"));
    for child in [first, second] {
        let output = child.wait_with_output().expect("it ends");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    let both = table(&bench, "t.csv");
    for (method, spp) in [("none", 8), ("gmon", 8), ("ridge", 8), ("none", 9), ("gmon", 9)] {
        assert_eq!(runs(&both, method, spp), 40, "{method} at {spp} spp");
    }
    assert_eq!(both.len(), 5 * 40);
    // Each of them has measured what it would have measured alone.
    let alone = args("--spp 8 --transform gmon ridge").replace("t.csv", "alone.csv");
    succeed(&bench, &alone);
    let both = errors(&both);
    assert!(errors(&table(&bench, "alone.csv")).iter().all(|row| both.contains(row)));
}

#[test]
fn a_table_has_one_reference() {
    let bench = Bench::new();
    render(&bench, 1..=3, 64);
    let args =
        format!("{} --spp 8 --runs 2 --transform gmon --quiet", scene().replace(" --size 8x8", ""));
    succeed(&bench, &format!("{args} --reference x1.exr -o t.csv"));
    succeed(&bench, &format!("{args} --reference x1.exr -o t.csv"));
    // A single picture does not know its own error, by which it would be told apart.
    let words = ["another reference", "files of --reference"];
    fails(&bench, &format!("{args} --reference x2.exr -o t.csv"), 1, &words);
    fails(&bench, &format!("{args} --reference x1.exr x2.exr -o t.csv"), 1, &words);
    fails(&bench, &format!("{args} --size 8x8 -o t.csv"), 1, &words);
}

/// A table with more samples is measured with the reference that it has.
#[test]
fn tables_are_extended_to_more_samples() {
    let bench = Bench::new();
    let args = format!("{} --runs 2 --transform gmon --quiet -o t.csv", scene());
    succeed(&bench, &format!("{args} --spp 8"));
    succeed(&bench, &format!("{args} --spp 8 16"));
    let rows = table(&bench, "t.csv");
    assert_eq!((rows.len(), runs(&rows, "gmon", 16)), (2 * 2 * 2, 2));
    assert!(rows.values().all(|row| row["reference_spp"] == "128"), "16 for each of 8");
    let words = ["another reference", "use --reference-spp 128", "name another file"];
    fails(&bench, &format!("{args} --spp 8 16 --reference-spp 256"), 1, &words);
}

#[test]
fn rows_of_other_sequences_do_not_count() {
    let bench = Bench::new();
    render(&bench, 1..=5, 16);
    render(&bench, 9..=9, 500);
    let args = "bench scene --reference x9.exr --transform gmon --quiet -o t.csv --sequence";
    succeed(&bench, &format!("{args} s1.exr"));
    let old = table(&bench, "t.csv");
    let words = ["run 0 at 16 spp", "seed 1", "seed 2", "another file"];
    fails(&bench, &format!("{args} s2.exr"), 1, &words);
    succeed(&bench, &format!("{args} s1.exr s2.exr"));
    let rows = table(&bench, "t.csv");
    assert_eq!(rows.len(), 4);
    assert!(old.iter().all(|(key, row)| rows[key]["mse"] == row["mse"]), "{old:?} {rows:?}");

    // Packed sequences do not say their seeds: they are measured anew.
    let args = args.replace("t.csv", "packed.csv");
    let mse = |files: &str| {
        succeed(&bench, &format!("pack {files} --as samples -o p.exr --quiet"));
        succeed(&bench, &format!("{args} p.exr"));
        let rows = table(&bench, "packed.csv");
        assert_eq!(rows.len(), 2);
        rows[&("none".to_owned(), 64, 0)]["mse"].clone()
    };
    let first = mse("x1.exr x2.exr x3.exr x4.exr");
    assert_ne!(mse("x5.exr x2.exr x3.exr x4.exr"), first);
    assert_eq!(mse("x1.exr x2.exr x3.exr x4.exr"), first);
}

#[test]
fn a_run_counts_once_and_never_as_its_own_reference() {
    let bench = Bench::new();
    render(&bench, 1..=2, 16);
    render(&bench, 9..=9, 64);
    std::fs::copy(bench.path("s1.exr"), bench.path("copy.exr")).expect("a copy");
    std::fs::copy(bench.path("x1.exr"), bench.path("y1.exr")).expect("a copy");
    succeed(&bench, "pack s1.exr s2.exr --as samples -o p.exr --quiet");
    let bench_of = "bench scene --transform gmon --quiet -o t.csv";
    for (rest, code, words) in [
        ("--reference x9.exr --sequence s1.exr s1.exr", 2, ["s1.exr", "named twice"]),
        ("--reference x9.exr --sequence s1.exr copy.exr", 2, ["copy.exr", "same seed"]),
        ("--reference s1.exr --sequence s2.exr s1.exr", 2, ["s1.exr", "named twice"]),
        ("--reference x1.exr --sequence s1.exr", 1, ["very pixels", "reference"]),
        ("--reference x1.exr --sequence copy.exr", 1, ["very pixels", "reference"]),
        (
            "--reference x9.exr --sequence s1.exr --picture a=x2.exr --picture a=x2.exr",
            1,
            ["x2.exr", "another picture 'a'"],
        ),
        (
            "--reference x9.exr --sequence s1.exr --picture a=x1.exr --picture a=y1.exr",
            1,
            ["y1.exr", "another picture 'a'"],
        ),
        (
            "--reference x9.exr --sequence s1.exr --picture a=s9.exr",
            1,
            ["s9.exr", "very pixels of the reference"],
        ),
    ] {
        fails(&bench, &format!("{bench_of} {rest}"), code, &words);
    }
    // Two methods may leave a picture as it is.
    let both = "--picture a=x2.exr --picture b=x2.exr";
    succeed(&bench, &format!("{bench_of} --reference x9.exr --sequence s1.exr {both}"));
}

#[test]
fn pixels_that_are_not_finite() {
    let bench = Bench::new();
    render(&bench, 1..=1, 16);
    let mut lanes = read_layer(&bench.path("x1.exr"), "").1;
    lanes.iter_mut().for_each(|lane| *lane += 0.5);
    picture(&bench, "whole.exr", &lanes);
    // In one channel, in two of one pixel, and in a third.
    (lanes[3], lanes[64 + 3], lanes[2 * 64 + 9]) = (f32::NAN, f32::INFINITY, f32::NEG_INFINITY);
    picture(&bench, "broken.exr", &lanes);
    picture(&bench, "none.exr", &[f32::NAN; 3 * 64]);
    let args = "bench scene --sequence s1.exr --transform gmon -o t.csv --reference";
    let said = succeed(&bench, &format!("{args} whole.exr --picture a=broken.exr"));
    assert!(said.contains("failed     a at 8 spp: 2 pixels of it are not finite"), "{said}");
    let row = table(&bench, "t.csv")[&("a".to_owned(), 8, 0)].clone();
    assert_eq!((&*row["mse"], &*row["relmse"]), ("", ""), "{row:?}");
    let args = args.replace("t.csv", "u.csv");
    let said = succeed(&bench, &format!("{args} broken.exr"));
    let note = "note       2 pixels of the reference are not finite, and left out of all errors";
    assert!(said.contains(note), "{said}");
    // The plain estimate is 0.5 darker everywhere.
    let mse = number(&table(&bench, "u.csv")[&("none".to_owned(), 16, 0)], "mse");
    assert!((mse - 0.25).abs() < 1e-6, "{mse}");
    let (code, _, complained) = nst(&bench, &format!("{args} none.exr").replace("u.csv", "v.csv"));
    assert_eq!(code, Some(1));
    assert!(complained.contains("'none.exr' has no pixel that is finite"), "{complained}");
}

#[test]
fn pictures_of_other_sizes_and_names() {
    let bench = Bench::new();
    render(&bench, 1..=3, 16);
    succeed(
        &bench,
        &format!("render --scene {} --size 9x8 --spp 8 -o wide.exr --quiet", cornell()),
    );
    let args = format!("{} --spp 8 --runs 2 --transform gmon -o t.csv", scene());
    let words = ["'wide.exr' has 9x8 pixels", "8x8"];
    fails(&bench, &format!("{args} --picture a=wide.exr"), 1, &words);
    // The longest names, and letters that are not Latin.
    let long = "x".repeat(100);
    let names = [&*long, "日本語", "Größe"];
    let pictures: Vec<_> =
        names.iter().zip(1..).map(|(name, seed)| format!("--picture {name}=x{seed}.exr")).collect();
    succeed(&bench, &format!("{args} {}", pictures.join(" ")));
    for (name, seed) in names.into_iter().zip(1..) {
        let found = read_layer(&bench.path("t.exr"), &format!("{name}.16")).1;
        assert_eq!(found, read_layer(&bench.path(&format!("x{seed}.exr")), "").1, "{name}");
    }
    let said = succeed(&bench, "report t.csv");
    assert!(said.contains("6 pictures"), "{said}");
    let network = concat!(env!("CARGO_MANIFEST_DIR"), "/../nst-core/weights/families.safetensors");
    let name = format!("{}.safetensors", "n".repeat(101));
    std::fs::copy(network, bench.path(&name)).expect("a network");
    fails(&bench, &format!("{args} --weights {name}"), 2, &["more than 100 characters", "rename"]);
}

/// Pictures of methods that are not measured this time stay, or are made again.
#[test]
fn pictures_stay_when_a_bench_goes_on() {
    let bench = Bench::new();
    render(&bench, 1..=2, 8);
    render(&bench, 9..=9, 500);
    let network = concat!(env!("CARGO_MANIFEST_DIR"), "/../nst-core/weights/families.safetensors");
    std::fs::copy(network, bench.path("mine.safetensors")).expect("a network");
    let args = format!("{} --spp 8 --runs 2 --quiet -o t.csv --transform", scene());
    succeed(&bench, &format!("{args} gmon --weights mine.safetensors --picture oidn=x1.exr"));
    let layers = |names: &[&str]| -> Vec<Vec<f32>> {
        names.iter().map(|name| read_layer(&bench.path("t.exr"), name).1).collect()
    };
    let names = ["", "none.8", "gmon.8", "mine.8", "oidn.8"];
    let before = layers(&names);
    std::fs::remove_file(bench.path("mine.safetensors")).expect("the network");
    succeed(&bench, &format!("{args} ridge"));
    assert!(layers(&names) == before);
    assert_ne!(layers(&["ridge.8"])[0], before[2]);
    // One that is given again is another one.
    succeed(&bench, &format!("{args} ridge --picture oidn=x2.exr"));
    assert_eq!(layers(&["oidn.8"])[0], read_layer(&bench.path("x2.exr"), "").1);
    // Pictures of another reference do not stay.
    std::fs::copy(bench.path("t.exr"), bench.path("u.exr")).expect("a copy");
    succeed(&bench, &format!("{args} gmon --reference-spp 32").replace("t.csv", "u.csv"));
    succeed(&bench, "report u.csv");
    std::fs::copy(bench.path("t.exr"), bench.path("u.exr")).expect("a copy");
    let (code, _, complained) = nst(&bench, "report u.csv");
    assert_eq!(code, Some(1));
    assert!(complained.contains("'u.exr' has the pictures of another table"), "{complained}");
    // Sequences of other sample counts, of which the first are not at hand.
    let args = "bench scene --reference x9.exr --transform gmon --quiet -o t2.csv --sequence";
    succeed(&bench, &format!("{args} s1.exr"));
    let first = read_layer(&bench.path("t2.exr"), "gmon.8").1;
    render(&bench, 3..=3, 16);
    succeed(&bench, &format!("{args} s3.exr"));
    assert_eq!(read_layer(&bench.path("t2.exr"), "gmon.8").1, first);
    assert_ne!(read_layer(&bench.path("t2.exr"), "gmon.16").1, first);
}

/// Folds of one Halton sequence depend on each other: the plain estimates stay, and their errors.
/// A list of experts has rows of its own, which are measured by the same guard.
#[test]
fn a_bench_of_the_guard() {
    let bench = Bench::new();
    let args = format!("bench scene --scene {} --size 40x30 --spp 8 9 --runs 2", cornell());
    let halton = format!("{args} --transform auto --sampler halton -o h.csv");
    let said = succeed(&bench, &halton);
    let note = "note       'auto' kept the plain estimates at 8, 9 spp: the folds of --sampler \
                halton depend on each other";
    assert!(said.contains(note), "{said}");
    let cell = |table: &Table, method: &str, column: &str| {
        table[&(method.to_owned(), 8, 1)][column].clone()
    };
    let rows = table(&bench, "h.csv");
    assert_eq!(cell(&rows, "auto", "mse"), cell(&rows, "none", "mse"));
    assert_eq!(cell(&rows, "auto", "predicted_ratio"), "1.0");

    let random = format!("{args} --transform auto -o t.csv");
    let said = succeed(&bench, &format!("{random} --json"));
    let said: serde_json::Value = serde_json::from_str(&said).expect("JSON");
    assert_eq!(said["notes"], serde_json::json!([]));
    succeed(&bench, &format!("{random} --experts lane --quiet"));
    let rows = table(&bench, "t.csv");
    assert_ne!(cell(&rows, "auto", "mse"), cell(&rows, "none", "mse"));
    assert_ne!(cell(&rows, "auto: lane", "mse"), cell(&rows, "auto", "mse"));
    fails(
        &bench,
        &format!("{random} --experts lane,cornell"),
        2,
        &["'cornell'", "window of terms"],
    );
    fails(&bench, &format!("{random} --experts mine"), 2, &["'mine'", "there are lane"]);
    fails(&bench, &format!("{random} --experts all"), 2, &["--experts all", "name them"]);

    // Experts that read features get them, as in a rendering.
    succeed(&bench, &format!("{random} --experts lane,filter --quiet"));
    let rows = table(&bench, "t.csv");
    for column in ["mse", "predicted_ratio", "predicted_low", "predicted_high"] {
        let named = cell(&rows, "auto: lane + filter", column);
        assert_eq!(named, cell(&rows, "auto", column), "{column}: these are the default");
    }
    // So has what weighs them.
    let closed = format!("{random} --experts lane,filter --guard closed --quiet");
    succeed(&bench, &closed);
    let rows = table(&bench, "t.csv");
    let name = "auto: lane + filter (closed)";
    assert_ne!(cell(&rows, name, "mse"), cell(&rows, "auto", "mse"));
    let predicted = cell(&rows, "auto: lane + filter", "predicted_ratio");
    let seed = cell(&rows, "none", "seed");
    let render = format!("render --scene {} --size 40x30 --spp 8 --seed {seed}", cornell());
    // As it is written: a number in JSON is read with an error of one unit in the last place.
    let ratio = |args: &str| {
        let said = succeed(&bench, &format!("{args} --json"));
        let (_, value) = said.split_once("\"predicted_ratio\":").expect("the guard says it");
        value.split(',').next().expect("a value").trim().to_owned()
    };
    assert_eq!(predicted, ratio(&format!("{render} --experts lane,filter -o x.exr")));
    succeed(&bench, &format!("{render} --transform none --sequence s.exr -o x.exr -q"));
    assert_ne!(predicted, ratio("transform s.exr --experts lane,filter -o y.exr"), "without");
}

/// What a signal leaves of a reference is said.
#[cfg(unix)]
#[test]
fn a_reference_that_is_cut_off() {
    common::heed_signals();
    let bench = Bench::new();
    let args = format!("{} --spp 8 --runs 1 --reference-spp 4000000000 -o t.csv", scene());
    let child = start(&bench, &args.replace("8x8", "64x64"));
    while !bench.path("caches/nst/references").is_dir() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let (code, _, complained) = terminate(child);
    assert_eq!(code, Some(143), "{complained}");
    for words in ["first half of the reference was not finished", "the same command"] {
        assert!(complained.contains(words), "{complained}");
    }
    assert!(!bench.path("t.csv").exists());
}

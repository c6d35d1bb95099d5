//! A GPU that fails, each way in turn: `--backend auto` goes on with the CPU and gives
//! its result, `--backend gpu` ends with an error. What was traced before is not lost.

mod common;

use common::{Bench, cornell, read_layer};
use nst_files::sequence_file::SequenceFile;

/// Faults of `nst-core`'s feature `fault-injection`, and what is said of them: those that
/// come up when a GPU is opened.
const FAULTS_AT_START: [(&str, &str); 3] =
    [("open", "does not open"), ("limits", "workgroup memory"), ("shader", "parsing error")];

/// Those that come up when it is used.
const FAULTS_IN_USE: [(&str, &str); 3] = [
    ("memory", "out of memory"),
    ("lost", "the device was lost"),
    // Panics also say where, before anything else.
    ("panic", "the driver panics"),
];

fn job(backend: &str) -> String {
    let network = format!("--transform cornell --backend {backend}");
    format!("render --scene {} --spp 16 --size 40x30 --json {network}", cornell())
}

/// The bits of T in `cornell.exr`.
fn picture(bench: &Bench) -> Vec<u32> {
    let (_, t) = read_layer(&bench.path("cornell.exr"), "");
    t.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn auto_goes_on_with_the_cpu() {
    let bench = Bench::new();
    if !bench.has_gpu() {
        return;
    }
    bench.succeed(&job("cpu"));
    let expected = picture(&bench);
    let run = |fault| {
        let output = bench.nst_with(&job("auto"), &[("NST_FAULT", fault)]);
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert!(output.status.success(), "{fault}: {stderr}");
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        (stderr, json["backend"].as_str().expect("a name").to_owned())
    };

    // Without a fault the same job is the GPU's.
    let (stderr, backend) = run("none");
    assert_eq!((stderr.as_str(), backend.as_str()), ("", "gpu"));
    assert_ne!(picture(&bench), expected, "the GPU rounds as the CPU does: this test is blind");

    for (fault, words) in FAULTS_AT_START.into_iter().chain(FAULTS_IN_USE) {
        let (stderr, backend) = run(fault);
        assert_eq!(stderr.matches("warning:").count(), 1, "{fault}: {stderr}");
        assert!(stderr.contains(words), "{fault}: {stderr}");
        assert!(stderr.ends_with("going on with the CPU\n"), "{fault}: {stderr}");
        assert_eq!(backend, "cpu", "{fault}");
        assert_eq!(picture(&bench), expected, "{fault}");
    }
}

#[test]
fn a_gpu_that_does_not_start_leaves_no_file() {
    let bench = Bench::new();
    if !bench.has_gpu() {
        return;
    }
    let before = bench.snapshot();
    for (fault, words) in FAULTS_AT_START {
        let args = job("gpu") + " --sequence seq.exr";
        let output = bench.nst_with(&args, &[("NST_FAULT", fault)]);
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(1), "{fault}: {stderr}");
        assert!(stderr.starts_with("error: ") && stderr.contains(words), "{fault}: {stderr}");
        assert!(!stderr.contains("panicked") && output.stdout.is_empty(), "{fault}: {stderr}");
        assert!(bench.snapshot() == before, "{fault}");
    }
}

/// The samples, which may have taken hours, are in the sequence and in the pictures.
#[test]
fn a_gpu_that_fails_after_tracing_loses_no_sample() {
    let bench = Bench::new();
    if !bench.has_gpu() {
        return;
    }
    bench.succeed(&(job("cpu") + " --sequence whole.exr"));
    let whole = SequenceFile::read(&bench.path("whole.exr")).expect("a sequence");
    let expected = picture(&bench);
    let outputs = ["seq.exr", "cornell.exr", "cornell.png"];
    for (fault, words) in FAULTS_IN_USE {
        for name in bench.files().iter().filter(|name| outputs.contains(&name.as_str())) {
            std::fs::remove_file(bench.path(name)).expect("an earlier output");
        }
        let args = job("gpu") + " --sequence seq.exr";
        let output = bench.nst_with(&args, &[("NST_FAULT", fault)]);
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(1), "{fault}: {stderr}");
        assert!(output.stdout.is_empty(), "{fault}");
        let said = stderr.lines().last().expect("an error");
        assert!(said.starts_with("error: the transformation failed"), "{fault}: {stderr}");
        for word in outputs.into_iter().chain([words, "plain estimates"]) {
            assert!(said.contains(word), "{fault}: '{word}' is not in: {said}");
        }

        let stored = SequenceFile::read(&bench.path("seq.exr")).expect("a sequence");
        assert!(stored.batch == whole.batch && stored.sums == whole.sums, "{fault}");
        for layer in ["", "S"] {
            let (_, shown) = read_layer(&bench.path("cornell.exr"), layer);
            assert!(shown == whole.batch.last(), "{fault}: layer '{layer}'");
        }
        let png = std::fs::read(bench.path("cornell.png")).expect("the PNG");
        assert!(png.starts_with(b"\x89PNG"), "{fault}");
        // What is missing can be had without tracing anew.
        bench.succeed("transform seq.exr --transform cornell --backend cpu -o cornell.exr --quiet");
        assert_eq!(picture(&bench), expected, "{fault}");
    }
}

#[test]
fn a_stored_sequence_outlives_a_gpu_that_fails() {
    let bench = Bench::new();
    if !bench.has_gpu() {
        return;
    }
    bench.succeed(&(job("cpu") + " --sequence seq.exr"));
    let expected = picture(&bench);
    let before = bench.snapshot();
    for (fault, words) in FAULTS_AT_START.into_iter().chain(FAULTS_IN_USE) {
        let args = "transform seq.exr --transform cornell --backend gpu";
        let output = bench.nst_with(args, &[("NST_FAULT", fault)]);
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(1), "{fault}: {stderr}");
        assert_eq!(stderr.matches("error: --backend gpu").count(), 1, "{fault}: {stderr}");
        assert!(stderr.contains(words), "{fault}: {stderr}");
        assert!(bench.snapshot() == before, "{fault}");
    }
    for (fault, _) in FAULTS_IN_USE {
        let args = "transform seq.exr --transform cornell --backend auto --quiet -o cornell.exr";
        let output = bench.nst_with(args, &[("NST_FAULT", fault)]);
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert!(output.status.success(), "{fault}: {stderr}");
        assert_eq!(stderr.matches("warning:").count(), 1, "{fault}: {stderr}");
        assert_eq!(picture(&bench), expected, "{fault}");
    }
}

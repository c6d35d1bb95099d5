//! A GPU that fails, each way in turn: `--backend auto` goes on with the CPU and gives
//! its result, `--backend gpu` ends with an error.

mod common;

use common::{Bench, cornell, read_layer};

/// Faults of `nst-core`'s feature `fault-injection`, and what is said of them.
const FAULTS: [(&str, &str); 5] = [
    ("open", "does not open"),
    ("limits", "workgroup memory"),
    ("shader", "parsing error"),
    ("memory", "out of memory"),
    ("lost", "the device was lost"),
];

fn job(backend: &str) -> String {
    format!("render --scene {} --spp 16 --size 40x30 --json --backend {backend}", cornell())
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

    for (fault, words) in FAULTS {
        let (stderr, backend) = run(fault);
        assert_eq!(stderr.matches("warning:").count(), 1, "{fault}: {stderr}");
        assert!(stderr.contains(words), "{fault}: {stderr}");
        assert!(stderr.ends_with("going on with the CPU\n"), "{fault}: {stderr}");
        assert_eq!(backend, "cpu", "{fault}");
        assert_eq!(picture(&bench), expected, "{fault}");
    }
}

#[test]
fn gpu_ends_with_an_error() {
    let bench = Bench::new();
    if !bench.has_gpu() {
        return;
    }
    let before = bench.files();
    for (fault, words) in FAULTS {
        let output = bench.nst_with(&job("gpu"), &[("NST_FAULT", fault)]);
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(1), "{fault}: {stderr}");
        assert!(stderr.starts_with("error: ") && stderr.contains(words), "{fault}: {stderr}");
        assert!(!stderr.contains("panicked") && output.stdout.is_empty(), "{fault}: {stderr}");
        assert_eq!(bench.files(), before, "{fault}");
    }
}

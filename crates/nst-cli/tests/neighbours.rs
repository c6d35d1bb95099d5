//! `--experts lane,filter` and `oidn`: experts that look at neighbours, from the command line.

mod common;

use common::{Bench, cornell, read_layer};
use nst_files::{header::ExrHeader, sequence_file::SequenceFile};

const EXPERTS: &str = "--experts lane,filter";

fn render(options: &str) -> String {
    format!("render --scene {} --size 40x30 {options}", cornell())
}

fn bits(bench: &Bench, name: &str, layer: &str) -> Vec<u32> {
    read_layer(&bench.path(name), layer).1.into_iter().map(f32::to_bits).collect()
}

fn has_features(bench: &Bench, name: &str) -> bool {
    let header = ExrHeader::read(&bench.path(name)).expect("a picture");
    header.layers().iter().any(|layer| layer.name == "albedo")
}

/// Features are recorded for the filter, but shown only where they are asked for; S keeps its
/// bits, and the stored sequence gives the same picture with any number of threads.
#[test]
fn rendering_and_stored_sequence_agree() {
    let bench = Bench::new();
    let said = bench.succeed(&render(&format!("--spp 16 {EXPERTS} --sequence s.exr -o a.exr")));
    assert!(!said.contains("features"), "{said}");
    bench.succeed(&render("--spp 16 -o plain.exr"));
    bench.succeed(&render(&format!("--spp 16 {EXPERTS} --features -o f.exr")));
    assert_eq!(bits(&bench, "a.exr", "S"), bits(&bench, "plain.exr", "S"));
    assert_ne!(bits(&bench, "a.exr", ""), bits(&bench, "plain.exr", ""));
    let stored = SequenceFile::read(&bench.path("s.exr")).expect("a sequence");
    assert!(stored.info.has_features());
    assert!(!has_features(&bench, "a.exr") && has_features(&bench, "f.exr"));
    for threads in [1, 2] {
        let said =
            bench.succeed(&format!("transform s.exr {EXPERTS} --threads {threads} -o b.exr"));
        assert!(!said.contains("no features"), "{said}");
        for layer in ["", "S", "StdError"] {
            assert_eq!(bits(&bench, "a.exr", layer), bits(&bench, "b.exr", layer), "{layer}");
        }
        assert_eq!(bits(&bench, "a.exr", ""), bits(&bench, "f.exr", ""));
    }
}

/// Sequences without features are transformed, and continued, and a note says what is lacking.
#[test]
fn features_are_optional() {
    let bench = Bench::new();
    bench.succeed(&render("--spp 8 --sequence s.exr -o a.exr"));
    let said = bench.succeed(&format!("transform s.exr {EXPERTS} -o b.exr"));
    for words in ["radiance alone", "nst render --features --sequence", "nst pack"] {
        assert!(said.contains(words), "'{words}' is not in: {said}");
    }
    let said = bench.succeed("transform s.exr -o b.exr");
    assert!(!said.contains("radiance alone"), "{said}");
    let resume = format!("render --scene {} --spp 16 {EXPERTS} --resume s.exr -o c.exr", cornell());
    let said = bench.succeed(&resume);
    assert!(said.contains("radiance alone") && said.contains("from its first sample"), "{said}");
    assert!(!has_features(&bench, "c.exr"));
}

/// What `OIDN_LIBRARY` names must be a library; the error names it.
#[test]
fn oidn_without_a_library() {
    let bench = Bench::new();
    bench.succeed(&render("--spp 8 --sequence s.exr -o a.exr"));
    bench.write("text.so", "no library\n");
    for (library, loads) in [("missing.so", false), ("text.so", true)] {
        for (option, says) in [("", loads), ("-q", false), ("--json", false)] {
            let path = bench.path(library).display().to_string();
            let command = format!("transform s.exr --experts lane,oidn -o b.exr {option}");
            let output = bench.nst_with(&command, &[("OIDN_LIBRARY", &path)]);
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{stderr}");
            assert!(stderr.contains(library) && stderr.contains("OIDN_LIBRARY"), "{stderr}");
            assert_eq!(stderr.contains("loading "), says, "{option}: {stderr}");
            assert!(!bench.path("b.exr").exists());
        }
    }
}

/// Pictures of one pixel and of one row.
#[test]
fn small_pictures() {
    let bench = Bench::new();
    for size in ["1x1", "9x1", "1x9"] {
        let scene = cornell();
        let options = format!("--size {size} --spp 16 {EXPERTS} --sequence s.exr -o a.exr");
        bench.succeed(&format!("render --scene {scene} {options}"));
        bench.succeed(&format!("transform s.exr {EXPERTS} -o b.exr"));
        assert_eq!(bits(&bench, "a.exr", ""), bits(&bench, "b.exr", ""), "{size}");
        let picture = read_layer(&bench.path("b.exr"), "").1;
        assert!(picture.iter().all(|value| value.is_finite()), "{size}");
    }
}

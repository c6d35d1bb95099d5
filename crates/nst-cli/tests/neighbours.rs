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

fn has_features(bench: &Bench, picture: &str) -> bool {
    let header = ExrHeader::read(&bench.path(picture)).expect("a header");
    header.parts[0].channels.iter().any(|channel| channel.name.starts_with("albedo"))
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
    // Parts of one sequence cannot be held out, whoever asks.
    let nested = render("--spp 8 --sampler halton -o n.exr --experts lane,filter");
    let said = report(&bench, &nested);
    assert!(said["reason"].to_string().contains("depend on each other"), "{said}");
    assert!(lanes(&bench, "n.exr", "") == lanes(&bench, "n.exr", "S"));
}

/// A file that is no library is named, and so is one that is not there.
#[test]
fn a_denoiser_that_is_not_there() {
    let bench = Bench::new();
    bench.succeed(&render("--spp 8 --sequence s.exr -o x.exr --transform none -q"));
    bench.write("text.so", "not a library");
    for file in ["gone.so", "text.so"] {
        let output =
            bench.nst_with("transform s.exr --experts lane,oidn", &[("OIDN_LIBRARY", file)]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("--experts oidn") && said.contains(file), "{said}");
    }
}

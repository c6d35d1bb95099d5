//! The method `guard`: what it says, and when it keeps the plain estimates.

mod common;

use common::{Bench, cornell, read_layer};
use serde_json::Value;

fn report(bench: &Bench, args: &str) -> Value {
    serde_json::from_str(&bench.succeed(&format!("{args} --json"))).expect("JSON")
}

fn render(args: &str) -> String {
    format!("render --scene {} --size 64x48 --transform guard {args}", cornell())
}

/// A rendering says how far it trusts which expert, and what that gains; the stored sequence
/// gives the same picture.
#[test]
fn it_says_what_it_gains() {
    let bench = Bench::new();
    let said = report(&bench, &render("--spp 16 --sequence s.exr -o x.exr"));
    let names: Vec<_> = said["experts"].as_array().expect("a list").iter().collect();
    let names: Vec<_> = names.iter().map(|it| it["name"].as_str().expect("a name")).collect();
    assert_eq!(names, ["relative regression", "regression", "table"]);
    let number = |key: &str| said[key].as_f64().expect("a number");
    let [low, ratio, high] = ["predicted_low", "predicted_ratio", "predicted_high"].map(number);
    assert!(low <= ratio && ratio <= high && low < 1.0, "{low} {ratio} {high}");
    let (_, plain) = read_layer(&bench.path("x.exr"), "S");
    let (_, better) = read_layer(&bench.path("x.exr"), "");
    assert_ne!(plain, better);
    let again = report(&bench, "transform s.exr --transform guard -o y.exr");
    assert_eq!(read_layer(&bench.path("y.exr"), "").1, better);
    assert_eq!(again["predicted_ratio"], said["predicted_ratio"]);
    let text = bench.succeed("transform s.exr --transform guard -o z.exr");
    assert!(text.contains("           predicts ") && text.contains(" MSE (95 %: "), "{text}");
    // Other methods say nothing of the kind.
    let none = report(&bench, "transform s.exr --transform gmon -o y.exr");
    assert_eq!((&none["predicted_ratio"], &none["experts"]), (&Value::Null, &Value::Array(vec![])));
}

/// Folds of one Halton sequence depend on each other; those of four do not.
#[test]
fn folds_must_be_independent() {
    let bench = Bench::new();
    for (sampler, kept) in [("halton", true), ("halton-folds", false)] {
        let said =
            report(&bench, &render(&format!("--spp 16 --sampler {sampler} -o {sampler}.exr")));
        let picture = bench.path(&format!("{sampler}.exr"));
        assert_eq!(read_layer(&picture, "S").1 == read_layer(&picture, "").1, kept, "{sampler}");
        let reason = said["reason"].as_str().expect("a reason");
        assert_eq!(reason.contains("depend on each other"), kept, "{reason}");
        assert_eq!(said["transform"], "guard");
    }
}

/// Without folds, or with too few samples, the plain estimates stay, and the report says why.
#[test]
fn nothing_to_hold_out() {
    let bench = Bench::new();
    let said = report(&bench, &render("--spp 3 -o x.exr"));
    assert_eq!(said["notes"][0].as_str().map(|it| it.contains("held out")), Some(true), "{said}");
    assert_eq!(said["predicted_ratio"], 1.0);
    assert_eq!(read_layer(&bench.path("x.exr"), "S").1, read_layer(&bench.path("x.exr"), "").1);
}

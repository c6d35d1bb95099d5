//! `--transform auto`, the guard: what it says, and when it keeps the plain estimates.

mod common;

use common::{Bench, cornell, read_layer};
use nst_files::{
    ColorModel,
    header::ExrHeader,
    output::OutputFile,
    picture_writer::{PictureInfo, write_exr},
};
use serde_json::Value;

fn report(bench: &Bench, args: &str) -> Value {
    serde_json::from_str(&bench.succeed(&format!("{args} --json"))).expect("JSON")
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn render(args: &str) -> String {
    format!("render --scene {} --size 64x48 {args}", cornell())
}

/// Whether a picture shows the plain estimates, to the bit; all of it is finite.
fn is_plain(bench: &Bench, name: &str) -> bool {
    let bits = |layer| -> Vec<u32> {
        let lanes = read_layer(&bench.path(name), layer).1;
        assert!(lanes.iter().all(|x| x.is_finite()), "{name}");
        lanes.into_iter().map(f32::to_bits).collect()
    };
    bits("") == bits("S")
}

fn attribute(bench: &Bench, name: &str, attribute: &str) -> Option<String> {
    let header = ExrHeader::read(&bench.path(name)).expect("a picture");
    header.parts[0].attributes.get(attribute).cloned()
}

/// A job says why it keeps the plain estimates, and predicts no gain; so does its picture.
fn keeps_plain(bench: &Bench, args: &str, picture: &str, words: &[&str]) {
    let said = report(bench, args);
    let reason = said["reason"].as_str().expect("a reason");
    for word in ["the plain estimates stay"].iter().chain(words) {
        assert!(reason.contains(word), "{args}: '{word}' is not in: {reason}");
    }
    assert!(is_plain(bench, picture), "{args}");
    assert_eq!(said["transform"], "auto");
    for (key, name) in [
        ("predicted_ratio", "nst.predictedRatio"),
        ("predicted_low", "nst.predictedLow"),
        ("predicted_high", "nst.predictedHigh"),
    ] {
        assert_eq!(said[key], 1.0, "{args}");
        assert_eq!(attribute(bench, picture, name).as_deref(), Some("1"), "{args}");
    }
    let text = bench.succeed(args);
    assert!(text.contains(&format!("transform  auto ({reason})")), "{text}");
    assert!(!text.contains("predicts") && !text.contains("breaks down"), "{text}");
}

/// Pictures have the estimates' errors, the same from a stored sequence; those of other methods
/// have none.
#[test]
fn pictures_have_standard_errors() {
    let bench = Bench::new();
    bench.succeed(&render("--spp 16 --sequence s.exr -o x.exr --experts lane"));
    bench.succeed("transform s.exr -o y.exr --experts lane");
    bench.succeed("transform s.exr --transform none -o z.exr");
    let layer = |name, layer| read_layer(&bench.path(name), layer).1;
    let (errors, variance) = (layer("x.exr", "StdError"), layer("x.exr", "Variance"));
    assert_eq!(errors, layer("y.exr", "StdError"));
    // Of each lane, from a fifth of the plain estimate's to little more than that: at most √1.2 by
    // the guard's bound on the MSE ratio, and 10 % for what four folds say of small strata.
    let close = |(error, variance): (&f32, &f32)| {
        let plain = variance.sqrt();
        (0.2 * plain..=1.2 * plain + 1e-6).contains(error)
    };
    let all = errors.iter().zip(&variance).all(close);
    assert!(all && errors.iter().any(|&error| error > 0.0));
    assert!(!errors.iter().map(|error| 2.0 * error).zip(&variance).all(|(e, v)| close((&e, v))));
    let header = ExrHeader::read(&bench.path("z.exr")).expect("a picture");
    assert!(header.layers().iter().all(|layer| layer.name != "StdError"));
}

/// A rendering says how far it trusts which expert, and what that gains; its picture says the
/// same, and so does that of the stored sequence.
#[test]
fn it_says_what_it_gains() {
    let bench = Bench::new();
    let said = report(&bench, &render("--spp 16 --sequence s.exr -o x.exr"));
    assert_eq!(said["transform"], "auto");
    let experts = said["experts"].as_array().expect("a list");
    let names: Vec<_> = experts.iter().map(|it| it["name"].as_str().expect("a name")).collect();
    assert_eq!(names, ["lane", "filter"]);
    let weights: Vec<f64> = experts.iter().map(|it| number(&it["weight"])).collect();
    assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)) && weights.iter().sum::<f64>() <= 1.0);
    let [low, ratio, high] =
        ["predicted_low", "predicted_ratio", "predicted_high"].map(|key| number(&said[key]));
    assert!(low <= ratio && ratio <= high && low < 1.0, "{low} {ratio} {high}");
    assert!(!is_plain(&bench, "x.exr"));

    let again = report(&bench, "transform s.exr -o y.exr");
    let main = |name| read_layer(&bench.path(name), "").1;
    assert_eq!(main("x.exr"), main("y.exr"));
    for key in ["experts", "predicted_ratio", "predicted_low", "predicted_high", "reason"] {
        assert_eq!(again[key], said[key], "{key}");
    }
    let shown: Vec<_> =
        names.iter().zip(&weights).map(|(name, w)| format!("{name} {w:.4}")).collect();
    for picture in ["x.exr", "y.exr"] {
        assert_eq!(attribute(&bench, picture, "nst.expert"), Some(shown.join(", ")));
        for (name, expected) in
            [("nst.predictedLow", low), ("nst.predictedRatio", ratio), ("nst.predictedHigh", high)]
        {
            let found = attribute(&bench, picture, name).expect(name);
            assert_eq!(found.parse(), Ok(expected as f32), "{picture}, {name}");
        }
        let info = bench.succeed(&format!("info {picture}"));
        assert!(info.contains("nst.expert = lane 0."), "{info}");
    }
    let text = bench.succeed("transform s.exr -o z.exr");
    for words in [
        "transform  auto (a blend of the plain estimates with experts",
        "           trusts ",
        &format!("           predicts {ratio:.2} of the plain estimates' MSE (95 %: {low:.2} to "),
    ] {
        assert!(text.contains(words), "'{words}' is not in: {text}");
    }
    // These experts can be named.
    report(&bench, "transform s.exr --transform auto --experts lane,filter -o z.exr");
    assert_eq!(main("x.exr"), main("z.exr"));
    // Other methods say nothing of the kind.
    let other = report(&bench, "transform s.exr --transform gmon -o y.exr");
    assert_eq!(
        (&other["predicted_ratio"], &other["experts"]),
        (&Value::Null, &Value::Array(vec![]))
    );
    assert_eq!(attribute(&bench, "y.exr", "nst.expert"), None);
    assert_eq!(attribute(&bench, "y.exr", "nst.predictedRatio"), None);
}

/// Folds of one Halton sequence depend on each other; those of four do not.
#[test]
fn folds_must_be_independent() {
    let bench = Bench::new();
    let words = ["--sampler halton depend on each other", "--sampler halton-folds"];
    let halton = |seed: u32| render(&format!("--spp 16 --sampler halton --seed {seed} -o x.exr"));
    for seed in [1, 2] {
        keeps_plain(&bench, &format!("{} --sequence s{seed}.exr", halton(seed)), "x.exr", &words);
    }
    keeps_plain(&bench, "transform s1.exr -o y.exr", "y.exr", &words);
    bench.succeed("merge s1.exr s2.exr -o both.exr");
    keeps_plain(&bench, "transform both.exr -o y.exr", "y.exr", &words);
    let said = report(&bench, &render("--spp 16 --sampler halton-folds -o x.exr"));
    assert!(!is_plain(&bench, "x.exr"), "{said}");
    assert!(number(&said["predicted_low"]) < 1.0, "{said}");
}

/// Without folds, with too few samples, or without light, the plain estimates stay.
#[test]
fn nothing_to_hold_out() {
    let bench = Bench::new();
    let words = ["fewer than four samples", "held out"];
    keeps_plain(&bench, &render("--spp 3 -o x.exr --sequence s.exr"), "x.exr", &words);
    keeps_plain(&bench, "transform s.exr -o y.exr", "y.exr", &words);
    // Snapshots of a progressive rendering.
    for spp in [8, 9] {
        bench.succeed(&render(&format!("--spp {spp} -o p{spp}.exr --transform none")));
    }
    bench.succeed("pack p8.exr p9.exr --as estimates --spp-list 8,9 -o packed.exr");
    keeps_plain(&bench, "transform packed.exr -o y.exr", "y.exr", &["no statistics of four folds"]);
    bench.write("dark.obj", "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nf 1 2 3\n");
    let dark = "render --scene dark.obj --light none --size 20x10 --spp 8 -o x.exr";
    keeps_plain(&bench, dark, "x.exr", &["all estimates are 0"]);
}

/// A random number from 0 to 1.
fn uniform(seed: u32, lane: u32) -> f32 {
    let mut bits = seed.wrapping_mul(0x9E37_79B9) ^ lane.wrapping_mul(0x85EB_CA6B);
    for _ in 0..3 {
        bits = (bits ^ (bits >> 15)).wrapping_mul(0x2C1B_3C6D);
    }
    (bits >> 8) as f32 / (1 << 24) as f32
}

/// Packs pictures whose pixels are functions of the picture and the lane.
fn pack(
    bench: &Bench,
    size: [u32; 2],
    model: ColorModel,
    count: u32,
    value: impl Fn(u32, u32) -> f32,
) {
    let mut names = String::new();
    for picture in 0..count {
        let lanes = size[0] * size[1] * model.channels().len() as u32;
        let lanes: Vec<f32> = (0..lanes).map(|lane| value(picture, lane)).collect();
        let name = format!("p{picture}.exr");
        let mut output = OutputFile::create(&bench.path(&name)).expect("a new file");
        let info = PictureInfo::default();
        write_exr(&mut output, size, model, &[("", &lanes)], &info).expect("a picture");
        output.commit().expect("a disk with room");
        names += &format!(" {name}");
    }
    bench.succeed(&format!("pack{names} --spp 1 -o packed.exr -q"));
}

/// A light that covers a part of a pixel, which varies from pixel to pixel: 0 or 1.
fn visible(picture: u32, lane: u32) -> f32 {
    let share = 0.1 + 0.5 * uniform(1, lane);
    f32::from(uniform(100 + picture, lane) < share)
}

/// Packed files, of colours or not, are no exception.
#[test]
fn packed_files_gain() {
    let bench = Bench::new();
    for model in [ColorModel::Rgb, ColorModel::Mono] {
        pack(&bench, [80, 50], model, 8, visible);
        let said = report(&bench, "transform packed.exr -o y.exr");
        assert!(number(&said["predicted_high"]) < 1.0, "{model:?}: {said}");
        assert!(!is_plain(&bench, "y.exr"));
        // Of the true values, too.
        let error = |layer| {
            let lanes = read_layer(&bench.path("y.exr"), layer).1;
            let errors = (0..).zip(&lanes).map(|(lane, x)| x - (0.1 + 0.5 * uniform(1, lane)));
            errors.map(|error| f64::from(error * error)).sum::<f64>()
        };
        let ratio = error("") / error("S");
        assert!(ratio < 0.8, "{model:?}: {ratio}");
    }
}

/// Where there are too few lanes to learn from, the plain estimates stay.
#[test]
fn one_lane_and_ten() {
    let bench = Bench::new();
    let words = ["no expert gains what is beyond chance"];
    pack(&bench, [1, 1], ColorModel::Mono, 8, visible);
    keeps_plain(&bench, "transform packed.exr -o y.exr", "y.exr", &words);
    pack(&bench, [10, 1], ColorModel::Mono, 8, visible);
    let said = report(&bench, "transform packed.exr -o y.exr");
    let plain = is_plain(&bench, "y.exr");
    let experts = said["experts"].as_array().expect("a list");
    let trust: f64 = experts.iter().map(|it| number(&it["weight"])).sum();
    assert!(plain || trust < 0.2, "{said}");
}

/// A sample that is not finite, and values of any size beside each other, spoil no other lane.
#[test]
fn odd_values_spoil_nothing() {
    let bench = Bench::new();
    let size = [80, 50];
    let good = |bench: &Bench| -> f64 {
        let said = report(bench, "transform packed.exr -o y.exr");
        assert!(!is_plain(bench, "y.exr"), "{said}");
        number(&said["predicted_ratio"])
    };
    pack(&bench, size, ColorModel::Mono, 8, visible);
    let clean = good(&bench);
    for odd in [f32::NAN, f32::INFINITY] {
        let value =
            |picture, lane| if (picture, lane) == (3, 99) { odd } else { visible(picture, lane) };
        pack(&bench, size, ColorModel::Mono, 8, value);
        // One of 4000 lanes lacks a sample.
        assert!((good(&bench) - clean).abs() < 0.01, "{odd}");
    }
    // Half of the pixels are a million times brighter.
    let value = |picture, lane: u32| visible(picture, lane) * if lane < 2000 { 1e6 } else { 1.0 };
    pack(&bench, size, ColorModel::Mono, 8, value);
    assert!(good(&bench) < 1.0);
    let mse = |layer| {
        let lanes = read_layer(&bench.path("y.exr"), layer).1;
        let dark = (2000..).zip(&lanes[2000..]).map(|(lane, x)| x - (0.1 + 0.5 * uniform(1, lane)));
        dark.map(|error| f64::from(error * error)).sum::<f64>()
    };
    assert!(mse("") < 1.02 * mse("S"), "{}", mse("") / mse("S"));
    // Nor does the closed form alone.
    bench.succeed("transform packed.exr --guard closed -o y.exr");
    assert!(!is_plain(&bench, "y.exr"));
    assert!(mse("") < 1.02 * mse("S"), "{}", mse("") / mse("S"));
}

/// What cannot be an expert is refused, with the reason and what to do.
#[test]
fn experts_that_cannot_run() {
    let bench = Bench::new();
    let network = nst_core::Network::builtins().next().expect("there are networks");
    bench.write("mine.safetensors", network.file());
    bench.succeed(&render("--spp 8 --sequence s.exr -o x.exr -q"));
    let window = "reads a window of terms, and no term but the last is known without a fold";
    for command in ["transform s.exr".to_owned(), render("--spp 8")] {
        for (options, words) in [
            (
                "--experts cornell",
                ["'cornell' cannot be an expert", "--transform cornell applies it"],
            ),
            ("--experts lane,families", ["'families' cannot be an expert", window]),
            ("--experts lane,mine.safetensors", [window, "--weights mine.safetensors applies it"]),
            ("--experts guess", ["no expert 'guess'", "there are lane"]),
            ("--experts lane,gmon", ["no expert 'gmon'", "there are lane"]),
            ("--experts lane,lane", ["'lane'", "twice"]),
            ("--experts=", ["no expert ''", "there are lane"]),
            ("--experts lane --transform gmon", ["--transform auto", "'gmon'"]),
            ("--experts lane --transform none", ["--transform auto", "leave out one"]),
            ("--experts lane --weights mine.safetensors", ["--experts", "--weights"]),
            ("--transform guard", ["'guard'", "auto"]),
        ] {
            bench.refuses(&format!("{command} {options}"), &words);
        }
    }
    let output = bench.nst("transform s.exr --experts lane,gone.safetensors");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("'gone.safetensors'"), "{said}");
}

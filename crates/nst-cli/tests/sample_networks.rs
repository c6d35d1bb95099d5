//! Networks that see the samples: alone, as experts of the guard, and where the samples lack what
//! they need.

mod common;

use common::{Bench, cornell, read_layer};
use nst_files::{
    ColorModel,
    output::OutputFile,
    picture_writer::{PictureInfo, write_exr},
    sequence_file::SequenceReader,
};
use serde_json::Value;

fn report(bench: &Bench, args: &str) -> Value {
    serde_json::from_str(&bench.succeed(&format!("{args} --json"))).expect("JSON")
}

fn render(args: &str) -> String {
    format!("render --scene {} --size 48x32 {args}", cornell())
}

fn lanes(bench: &Bench, picture: &str, layer: &str) -> Vec<f32> {
    let lanes = read_layer(&bench.path(picture), layer).1;
    assert!(lanes.iter().all(|x| x.is_finite()), "{picture}");
    lanes
}

fn experts(said: &Value) -> Vec<&str> {
    let experts = said["experts"].as_array().expect("a list");
    experts.iter().map(|it| it["name"].as_str().expect("a name")).collect()
}

fn notes(said: &Value) -> String {
    said["notes"].to_string()
}

const OWN: [&str; 3] = ["relative regression", "regression", "table"];

/// The file of a built-in network.
fn network_file(name: &str) -> Vec<u8> {
    let weights = concat!(env!("CARGO_MANIFEST_DIR"), "/../nst-core/weights");
    std::fs::read(format!("{weights}/{name}.safetensors")).expect("a network's file")
}

/// As itself and fitted again, and the same of a stored sequence, by its name and by its file.
#[test]
fn as_experts() {
    let bench = Bench::new();
    bench.write("mine.safetensors", network_file("small"));
    let said = report(&bench, &render("--spp 16 --sequence s.exr -o x.exr --experts lane,small"));
    assert_eq!(experts(&said), [&OWN[..], &["small", "small, refitted"]].concat());
    let again = report(&bench, "transform s.exr -o y.exr --experts lane,small");
    assert_eq!(lanes(&bench, "x.exr", ""), lanes(&bench, "y.exr", ""));
    assert_eq!(again["experts"], said["experts"]);
    let own = report(&bench, "transform s.exr -o z.exr --experts lane,mine.safetensors");
    assert_eq!(lanes(&bench, "x.exr", ""), lanes(&bench, "z.exr", ""));
    assert_eq!(experts(&own)[3], "mine.safetensors");
    // Where there is no room for all of them, the first ones are fitted again.
    let three = report(&bench, "transform s.exr -o y.exr --experts lane,small,nano,base");
    let names = ["small", "nano", "base", "small, refitted", "nano, refitted"];
    assert_eq!(experts(&three)[3..], names);
}

/// Without the guard S is replaced, by the same numbers however the network is named.
#[test]
fn alone() {
    let bench = Bench::new();
    bench.write("mine.safetensors", network_file("small"));
    let said = report(&bench, &render("--spp 16 --sequence s.exr -o x.exr --transform small"));
    assert_eq!((&said["transform"], &said["predicted_ratio"]), (&"small".into(), &Value::Null));
    let plain = lanes(&bench, "x.exr", "S");
    let network = lanes(&bench, "x.exr", "");
    let differing = network.iter().zip(&plain).filter(|(t, s)| t != s).count();
    assert!(2 * differing > plain.len(), "{differing} of {}", plain.len());
    for option in ["--transform small", "--weights mine.safetensors"] {
        report(&bench, &format!("transform s.exr -o y.exr {option}"));
        assert_eq!(lanes(&bench, "y.exr", ""), network, "{option}");
    }
    report(&bench, "transform s.exr -o y.exr --transform nano");
    assert_ne!(lanes(&bench, "y.exr", ""), network);
}

/// A rendering keeps what its networks need; other files lack it.
#[test]
fn further_powers() {
    let bench = Bench::new();
    bench.succeed(&render("--spp 16 --sequence usual.exr -o x.exr --experts lane"));
    let said = report(
        &bench,
        &render("--spp 16 --sequence s.exr -o x.exr --experts lane,gaussian-samples"),
    );
    assert_eq!(experts(&said)[3..], ["gaussian-samples", "gaussian-samples, refitted"]);
    let sides = |name: &str| {
        SequenceReader::open(&bench.path(name)).expect("a sequence").info().sides.len()
    };
    // Five further powers, four folds.
    assert_eq!(sides("s.exr"), sides("usual.exr") + 20);
    let again = report(&bench, "transform s.exr -o y.exr --experts lane,gaussian-samples");
    assert_eq!(again["experts"], said["experts"]);
    assert_eq!(lanes(&bench, "x.exr", ""), lanes(&bench, "y.exr", ""));
    bench.succeed("transform s.exr -o y.exr --transform gaussian-samples");
    bench.succeed(&render("--spp 16 -o z.exr --transform gaussian-samples"));
    assert_eq!(lanes(&bench, "y.exr", ""), lanes(&bench, "z.exr", ""));

    // The guard goes on without the network, and says how to have it.
    let said = report(&bench, "transform usual.exr -o y.exr --experts lane,gaussian-samples");
    assert_eq!(experts(&said), OWN);
    for words in
        ["'gaussian-samples' is left out", "'nst render --sequence' stores them", "--experts"]
    {
        assert!(notes(&said).contains(words), "'{words}' is not in: {}", notes(&said));
    }
    bench.succeed("transform usual.exr -o z.exr");
    assert_eq!(lanes(&bench, "y.exr", ""), lanes(&bench, "z.exr", ""));
    let words = ["to the power 0.125, ", "'nst render --sequence'", "--transform gaussian-samples"];
    bench.refuses("transform usual.exr --transform gaussian-samples", &words);
    bench.write("mine.safetensors", network_file("gaussian-samples"));
    bench
        .refuses("transform usual.exr --weights mine.safetensors", &["--weights mine.safetensors"]);

    // Their sums are not stored, so that a rendering that goes on has none.
    let resume = |options: &str| render(&format!("--spp 20 --resume s.exr -o y.exr {options}"));
    bench.refuses(&resume("--transform gaussian-samples"), &["'gaussian-samples'", "to the power"]);
    let said = report(&bench, &resume("--experts lane,gaussian-samples"));
    assert!(notes(&said).contains("'gaussian-samples' is left out"), "{said}");
    assert_eq!(sides("s.exr"), sides("usual.exr"));
}

/// Packed pictures of one colour have folds, and so have what `small` needs.
#[test]
fn of_one_colour() {
    let bench = Bench::new();
    let mut names = String::new();
    for picture in 0..8_u32 {
        let of_lane = |lane: u32| ((lane * 37 + picture * lane * 11) % 101) as f32 / 101.0;
        let lanes: Vec<f32> = (0..40 * 30).map(of_lane).collect();
        let name = format!("p{picture}.exr");
        let mut output = OutputFile::create(&bench.path(&name)).expect("a new file");
        let info = PictureInfo::default();
        write_exr(&mut output, [40, 30], ColorModel::Mono, &[("", &lanes)], &info)
            .expect("a picture");
        output.commit().expect("a disk with room");
        names += &format!(" {name}");
    }
    bench.succeed(&format!("pack{names} --spp 1 -o packed.exr -q"));
    let said = report(&bench, "transform packed.exr -o y.exr --experts lane,small");
    assert_eq!(experts(&said).len(), 5);
    bench.succeed("transform packed.exr -o y.exr --transform small");
    assert_ne!(lanes(&bench, "y.exr", ""), lanes(&bench, "y.exr", "S"));
    // Snapshots have no folds.
    bench.succeed("pack p0.exr p1.exr --as estimates --spp-list 8,9 -o snapshots.exr");
    let words = ["'small' sees the samples", "means of the samples in folds"];
    bench.refuses("transform snapshots.exr --transform small", &words);
}

#[test]
fn bad_input() {
    let bench = Bench::new();
    let file = network_file("small");
    bench.write("half.safetensors", &file[..file.len() / 2]);
    bench.succeed(&render("--spp 8 --sequence s.exr -o x.exr"));
    for (options, words) in [
        ("--experts lane,small,small", ["'small'", "twice"]),
        ("--experts small", ["'lane'", "add it to the list"]),
        ("--experts lane,tiny", ["no expert 'tiny'", "nano, small, base"]),
        (
            "--experts lane,nano,small,base,step-samples,families-samples,gaussian-samples",
            ["6 experts", "at most 5"],
        ),
        (
            "--transform small --experts lane,small",
            ["--experts is for --transform auto", "'small'"],
        ),
    ] {
        bench.refuses(&format!("transform s.exr {options}"), &words);
        bench.refuses(&render(&format!("--spp 8 {options}")), &words);
    }
    let words = ["'small' sees the samples", "fewer than 4 samples"];
    bench.refuses(&render("--spp 3 --transform small"), &words);
    for options in ["--experts lane,half.safetensors", "--weights half.safetensors"] {
        let output = bench.nst(&format!("transform s.exr {options}"));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains("'half.safetensors'"), "{said}");
    }
}

/// What runs on no GPU says so where one is asked for.
#[test]
fn a_backend_without_effect() {
    let bench = Bench::new();
    let words = "--backend gpu: nothing of 'auto' runs on a GPU";
    let said = report(&bench, &render("--spp 8 --sequence s.exr -o x.exr --backend gpu"));
    assert!(notes(&said).contains(words), "{said}");
    let said = report(&bench, "transform s.exr --transform gmon --backend gpu -o y.exr");
    assert!(notes(&said).contains("nothing of 'gmon'"), "{said}");
    for options in ["--backend cpu", "--backend auto --experts lane,small"] {
        let said = report(&bench, &format!("transform s.exr {options} -o y.exr"));
        assert!(!notes(&said).contains("GPU"), "{said}");
        assert_eq!(said["backend"], "cpu");
    }
}

#[test]
fn info_of_a_built_in_network() {
    let bench = Bench::new();
    let text = bench.succeed("info --network small");
    for words in ["small: weights of a network", "5, 32, 32, 1 wide", "to the power 0.5, 1, 2"] {
        assert!(text.contains(words), "'{words}' is not in: {text}");
    }
    assert!(bench.succeed("info --network cornell").contains("the last 8 terms"));
    bench.refuses("info --network tiny", &["tiny"]);
    bench.refuses("info --network small --system", &["--system"]);
}

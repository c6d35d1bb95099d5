//! Networks that see the samples: alone, as experts of the guard, and where the samples lack what
//! they need.

mod common;

use common::{Bench, cornell, read_layer};
use nst_core::{FurtherPowers, PowerSums, Side};
use nst_files::{
    ColorModel,
    output::OutputFile,
    picture_writer::{PictureInfo, write_exr},
    sequence_file::SequenceFile,
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

fn sequence(bench: &Bench, name: &str) -> SequenceFile {
    SequenceFile::read(&bench.path(name)).expect("a sequence")
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

/// Without the guard, nothing keeps a network from harm that sees what it was not trained on.
#[test]
fn what_a_network_was_not_trained_on_is_told() {
    let bench = Bench::new();
    bench.write("mine.safetensors", network_file("plane-ggx"));
    let note = |samples: &str, method: &str| {
        let job = format!("--sequence s.exr -o x.exr {samples} {method}");
        let rendered = notes(&report(&bench, &render(&job)));
        // Of the stored sequence, it is told the same.
        let stored = notes(&report(&bench, &format!("transform s.exr -o y.exr {method}")));
        assert_eq!(rendered, stored);
        rendered
    };
    let plane = "--transform plane-ggx";
    assert_eq!(note("--spp 32 --sampler random", plane), "[]");
    let few = note("--spp 64 --sampler random", "--weights mine.safetensors");
    let said =
        "'mine.safetensors' was trained on 8 to 32 samples, and there are 64: it may be worse";
    assert!(few.contains(said), "{few}");
    let other = note("--spp 32 --sampler halton", plane);
    let said =
        "'plane-ggx' was trained on samples of the sampler 'random', and these are of 'halton'";
    assert!(other.contains(said), "{other}");
    // Below the guard, samples that are held out tell.
    assert_eq!(note("--spp 512 --sampler random", "--experts lane,small"), "[]");
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
    let sides = |name: &str| sequence(&bench, name).info.sides.len();
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
    bench.succeed("transform usual.exr -o z.exr --experts lane");
    assert_eq!(lanes(&bench, "y.exr", ""), lanes(&bench, "z.exr", ""));
    let words = ["to the power 0.125, ", "'nst render --sequence'", "--transform gaussian-samples"];
    bench.refuses("transform usual.exr --transform gaussian-samples", &words);
    bench.write("mine.safetensors", network_file("gaussian-samples"));
    bench
        .refuses("transform usual.exr --weights mine.safetensors", &["--weights mine.safetensors"]);
}

/// A rendering that goes on has the very bits of one without a break, whether or not it needs the
/// powers meanwhile.
#[test]
fn further_powers_go_on_where_they_stopped() {
    let bench = Bench::new();
    let (with, without) = ("--experts lane,gaussian-samples", "--experts lane,small");
    for (few, more, first, then, powers) in [
        (16, 64, with, with, 5),
        (16, 64, with, without, 5),
        (9, 22, "--transform gaussian-samples", with, 5),
        // Below four samples there are no means of folds, but sums.
        (3, 21, with, "--transform gaussian-samples --features", 5),
        (16, 64, without, without, 0),
    ] {
        let features = if then.contains("--features") { "--features" } else { "" };
        let render = |args: &str| bench.succeed(&render(&format!("{args} {features} --quiet")));
        render(&format!("--spp {more} --sequence whole.exr -o a.exr {first}"));
        render(&format!("--spp {few} --sequence part.exr -o b.exr {first}"));
        let part = sequence(&bench, "part.exr");
        let resume = then.replace("--features", "");
        render(&format!("--spp {more} --resume part.exr -o b.exr {resume}"));
        let (whole, longer) = (sequence(&bench, "whole.exr"), sequence(&bench, "part.exr"));
        assert!(longer.batch == whole.batch && longer.sums == whole.sums, "{few}, {first}, {then}");
        assert_eq!(longer.info.further_powers().count(), powers);
        assert_eq!(longer.info.resume, whole.info.resume);
        assert!(part.sums != whole.sums);
        bench.succeed(&format!("transform whole.exr -o a.exr {resume} --quiet"));
        assert_eq!(lanes(&bench, "a.exr", ""), lanes(&bench, "b.exr", ""), "{few}, {then}");
        // Once more, from the file that went on.
        render(&format!("--spp 70 --resume whole.exr -o a.exr {resume}"));
        render(&format!("--spp 70 --resume part.exr -o b.exr {resume}"));
        assert!(sequence(&bench, "whole.exr").sums == sequence(&bench, "part.exr").sums);
    }
}

/// A sequence without their sums goes on without them, and says what to do.
#[test]
fn further_powers_without_their_sums() {
    let bench = Bench::new();
    let with = "--experts lane,gaussian-samples";
    bench.succeed(&render("--spp 16 --sequence usual.exr -o x.exr --experts lane --quiet"));
    bench.succeed(&render(&format!("--spp 16 --sequence s.exr -o x.exr {with} --quiet")));
    // As early versions wrote it: with means alone.
    let mut early = sequence(&bench, "s.exr");
    early.info.resume.as_mut().expect("it can be continued").powers = FurtherPowers::NONE;
    early.sums.as_mut().expect("its sums").powers = PowerSums::default();
    let mut output = OutputFile::create(&bench.path("early.exr")).expect("a new file");
    early.write(&mut output).expect("it can be written");
    output.commit().expect("a disk with room");

    let sides = |name: &str| sequence(&bench, name).info.sides.len();
    assert_eq!(sides("early.exr"), sides("usual.exr") + 20);
    let lost = "the longer sequence has no means of the samples to the power 0.125, 0.25, 4, 8, 16";
    for (name, is_early) in [("early.exr", true), ("usual.exr", false)] {
        let before = std::fs::read(bench.path(name)).expect("the sequence");
        let resume = |options: &str| {
            render(&format!("--spp 20 --resume {name} --sequence longer.exr -o y.exr {options}"))
        };
        let words = [
            "'gaussian-samples'",
            "to the power 0.125, ",
            "given --transform gaussian-samples, too, from its first sample on",
        ];
        bench.refuses(&resume("--transform gaussian-samples"), &words);
        let said = report(&bench, &resume(with));
        assert_eq!(experts(&said), OWN);
        for words in ["'gaussian-samples' is left out", "from its first sample on"] {
            assert!(notes(&said).contains(words), "'{words}' is not in: {said}");
        }
        assert_eq!(notes(&said).contains(lost), is_early, "{said}");
        assert_eq!(sides("longer.exr"), sides("usual.exr"));
        assert_eq!(std::fs::read(bench.path(name)).expect("the sequence"), before);
    }
    let said = report(&bench, &render(&format!("--spp 20 --resume s.exr -o y.exr {with}")));
    assert!(!notes(&said).contains("the longer sequence has no"), "{said}");
}

/// What all files have is merged, as often as needed; the result has no sums, as all merged ones.
#[test]
fn further_powers_are_merged() {
    let bench = Bench::new();
    let with = "--experts lane,gaussian-samples";
    for seed in 1..=3 {
        let args = format!("--spp 16 --seed {seed} --sequence s{seed}.exr -o x.exr --quiet");
        bench.succeed(&render(&format!("{args} {with}")));
    }
    bench.succeed(&render("--spp 16 --seed 4 --sequence usual.exr -o x.exr --quiet"));
    bench.succeed("merge s1.exr s2.exr -o two.exr -q");
    bench.succeed("merge two.exr s3.exr -o all.exr -q");
    let parts = [1, 2, 3].map(|seed| sequence(&bench, &format!("s{seed}.exr")));
    let merged = sequence(&bench, "all.exr");
    assert!(merged.sums.is_none() && merged.info.sides == parts[0].info.sides);
    for side in parts[0].info.further_powers().sides() {
        let Side::PowerMean(power, _) = side else { panic!("{side}") };
        let of = |file: &SequenceFile| file.batch.side(&side).expect("a mean").to_vec();
        let (values, parts) = (of(&merged), parts.each_ref().map(of));
        for (lane, &value) in values.iter().enumerate() {
            let mean = |weights: [f64; 3]| {
                let powers = parts.iter().zip(weights).map(|(it, w)| w * power.of(it[lane].into()));
                power.mean_of(powers.sum::<f64>())
            };
            // Rounded to f32 twice.
            let close = |mean: f64| (f64::from(value) - mean).abs() <= 2e-7 * mean;
            assert!(close(mean([1.0 / 3.0; 3])), "{side}");
            let wrong = mean([0.25, 0.25, 0.5]);
            assert!(!close(wrong) || parts.iter().all(|it| it[lane] == parts[0][lane]), "{side}");
        }
    }
    let said = report(&bench, &format!("transform all.exr -o y.exr {with}"));
    assert_eq!(experts(&said)[3..], ["gaussian-samples", "gaussian-samples, refitted"]);
    let resume = render(&format!("--spp 99 --resume all.exr -o y.exr {with}"));
    bench.refuses(&resume, &["all.exr", "merged sequences", "cannot be continued"]);
    let output = bench.nst("merge s1.exr usual.exr -o new.exr");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("usual.exr") && said.contains("power16fold3"), "{said}");
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
        ("--experts filter,small", ["'lane'", "add it to the list"]),
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
    let said =
        report(&bench, &render("--spp 8 --sequence s.exr -o x.exr --backend gpu --experts lane"));
    assert!(notes(&said).contains(words), "{said}");
    // By default, what weighs the filter runs there, and the filter does not.
    let said = report(&bench, "transform s.exr --backend gpu -o y.exr");
    assert!(notes(&said).contains("--backend gpu: the expert 'filter' stays on the CPU"), "{said}");
    assert_eq!(said["backend"], "gpu");
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

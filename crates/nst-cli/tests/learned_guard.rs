//! A network that weighs the guard's experts, from the command line.

mod common;

use common::{Bench, cornell, read_layer};
use nst_files::header::ExrHeader;
use safetensors::SafeTensors;
use serde_json::Value;

fn report(bench: &Bench, args: &str) -> Value {
    serde_json::from_str(&bench.succeed(&format!("{args} --json"))).expect("JSON")
}

/// A bench with a stored sequence, `s.exr`.
fn bench() -> Bench {
    let bench = Bench::new();
    let scene = cornell();
    bench.succeed(&format!(
        "render --scene {scene} --size 64x48 --spp 16 --sequence s.exr -o r.exr -q"
    ));
    bench
}

fn attribute(bench: &Bench, picture: &str, name: &str) -> Option<String> {
    let header = ExrHeader::read(&bench.path(picture)).expect("a header");
    header.parts[0].attributes.get(name).cloned()
}

#[test]
fn a_network_weighs_experts() {
    let bench = bench();
    let main = |picture: &str| read_layer(&bench.path(picture), "").1;
    let closed = report(&bench, "transform s.exr -o c.exr --guard closed");
    let learned = report(&bench, "transform s.exr -o l.exr");
    assert_eq!((&closed["guard"], &learned["guard"]), (&"closed".into(), &"learned".into()));
    for (picture, guard) in [("c.exr", "closed"), ("l.exr", "learned"), ("r.exr", "learned")] {
        assert_eq!(attribute(&bench, picture, "nst.guard").as_deref(), Some(guard), "{picture}");
    }
    // A rendering has the same bits as its stored sequence.
    assert!(main("l.exr") == main("r.exr") && main("c.exr") != main("l.exr"));
    let text = bench.succeed("transform s.exr -o m.exr --guard learned");
    assert!(text.contains("on average over the lanes, as a network says"), "{text}");
    assert!(main("m.exr") == main("l.exr"));
    let info = bench.succeed("info --network guard");
    for words in ["18, 16, 16, 3 wide", "weighs      the guard's experts lane, filter, oidn"] {
        assert!(info.contains(words), "{info}");
    }
}

/// Where the network knows nothing of so many samples, the closed form stands in for it.
#[test]
fn outside_of_what_it_knows() {
    let bench = Bench::new();
    let scene = cornell();
    let said = report(&bench, &format!("render --scene {scene} --size 64x48 --spp 4 -o x.exr"));
    assert_eq!(said["guard"], "closed");
    let notes = said["notes"].to_string();
    let why = "left out: the network that weighs experts: it knows 8 to 1024 samples per pixel";
    assert!(notes.contains(why), "{notes}");
}

/// A weights file of the crate, from where the binary runs.
fn weights(name: &str) -> String {
    format!("{}/../nst-core/weights/{name}.safetensors", env!("CARGO_MANIFEST_DIR"))
}

/// Fails with this exit code, and says these words.
fn fails(bench: &Bench, args: &str, code: i32, words: &str) {
    let output = bench.nst(args);
    let said = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!(output.status.code(), Some(code), "{args}: {said}");
    assert!(said.contains(words), "{args}: '{words}' is not in: {said}");
}

#[test]
fn options_that_do_not_fit() {
    let bench = bench();
    bench.write("damaged.safetensors", b"no tensors");
    let [small, guard] = ["small", "guard"].map(weights);
    for (args, code, words) in [
        ("--guard open".to_owned(), 2, "it is closed, learned, or FILE.safetensors"),
        ("--guard learned --experts lane".to_owned(), 2, "add 'filter' or 'oidn' to --experts"),
        ("--guard learned --transform none".to_owned(), 2, "for --transform auto, not for 'none'"),
        ("--guard damaged.safetensors".to_owned(), 1, "damaged.safetensors"),
        ("--guard absent.safetensors".to_owned(), 1, "absent.safetensors"),
        (format!("--guard {small}"), 1, "it sees samples"),
        (format!("--experts lane,{guard}"), 2, "weighs experts, and is none; --guard takes it"),
        (format!("--weights {guard}"), 2, "is no transformation; --guard takes it"),
    ] {
        fails(&bench, &format!("transform s.exr -o x.exr {args}"), code, words);
        assert!(!bench.path("x.exr").exists(), "{args}");
    }
    // That of a file is used as the one of that name.
    let said = report(&bench, &format!("transform s.exr -o x.exr --guard {guard}"));
    bench.succeed("transform s.exr -o l.exr --guard learned");
    assert_eq!(said["guard"], "learned");
    let main = |picture: &str| read_layer(&bench.path(picture), "").1;
    assert!(main("x.exr") == main("l.exr"));
}

/// Tables for training have what the network reads, and replace nothing else.
#[test]
fn a_table_for_training() {
    let bench = bench();
    let text = bench.succeed("guard-table s.exr --experts lane,filter -o t.safetensors");
    assert!(text.contains("lane, filter") && text.contains("8x8"), "{text}");
    let bytes = std::fs::read(bench.path("t.safetensors")).expect("a table");
    let table = SafeTensors::deserialize(&bytes).expect("tensors");
    let shape = |name: &str| table.tensor(name).expect(name).shape().to_vec();
    assert_eq!(shape("inputs"), [6, 8, 20, 2, 18]);
    assert_eq!(shape("closed"), [6, 8, 20, 2, 2]);
    assert_eq!((shape("changes"), shape("rest")), (vec![2, 3, 48, 64], vec![3, 48, 64]));
    assert_eq!(shape("places"), [48, 64]);
    // It may be written again, but not over others.
    bench.succeed("guard-table s.exr --experts filter -o t.safetensors");
    bench.write("other.safetensors", b"something else");
    for (args, code, words) in [
        ("s.exr --experts lane -o u.safetensors", 2, "add 'filter' or 'oidn'"),
        ("s.exr --experts filter -o other.safetensors", 2, "give another name"),
        ("s.exr --experts filter -o s.exr", 2, "safetensors"),
        ("r.exr --experts filter -o u.safetensors", 1, "r.exr"),
    ] {
        fails(&bench, &format!("guard-table {args}"), code, words);
    }
    fails(&bench, "info t.safetensors", 1, "a table for training the guard");
}

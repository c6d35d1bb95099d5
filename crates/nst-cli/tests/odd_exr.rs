//! EXR files that no program should write: without pixels, with a million channels, with
//! attributes of a wrong type. Each gets one clear error from every command that reads EXR
//! files, or is read all the same.

mod common;

use std::time::{Duration, Instant};

use common::{Bench, cornell};

/// An attribute: its name, its type, and the bytes of its value.
type Attribute<'a> = (&'a str, &'a str, Vec<u8>);

fn numbers(values: &[i32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// An uncompressed file of one part in scan lines, in which all samples are one half; these
/// attributes replace the usual ones of their names.
fn exr(names: &[String], size: [i32; 2], others: &[Attribute<'_>]) -> Vec<u8> {
    let [width, height] = size;
    let channels = names.iter().flat_map(|name| {
        // A float at each pixel.
        [name.as_bytes(), &[0], &numbers(&[2, 0, 1, 1])].concat()
    });
    let window = numbers(&[0, 0, width - 1, height - 1]);
    let mut attributes = vec![
        ("channels", "chlist", channels.chain([0]).collect()),
        ("compression", "compression", vec![0]),
        ("dataWindow", "box2i", window.clone()),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", vec![0]),
        ("pixelAspectRatio", "float", floats(&[1.0])),
        ("screenWindowCenter", "v2f", floats(&[0.0, 0.0])),
        ("screenWindowWidth", "float", floats(&[1.0])),
    ];
    attributes.retain(|(name, ..)| others.iter().all(|(other, ..)| other != name));
    attributes.extend(others.iter().cloned());
    let mut file = numbers(&[20_000_630, 2]);
    for (name, kind, value) in attributes {
        file.extend([name.as_bytes(), &[0], kind.as_bytes(), &[0]].concat());
        file.extend(numbers(&[value.len() as i32]));
        file.extend(value);
    }
    file.push(0);
    let row = 4 * width as usize * names.len();
    let table = file.len() + 8 * height as usize;
    for y in 0..height as usize {
        file.extend(((table + y * (8 + row)) as u64).to_le_bytes());
    }
    for y in 0..height {
        file.extend(numbers(&[y, row as i32]));
        file.extend(floats(&[0.5]).repeat(row / 4));
    }
    file
}

fn rgb() -> Vec<String> {
    ["B", "G", "R"].map(str::to_owned).into()
}

/// The channels of a sequence of two terms.
fn terms() -> Vec<String> {
    let layers = ["S0001.", "S0002."];
    let layered =
        layers.iter().flat_map(|layer| rgb().into_iter().map(move |c| format!("{layer}{c}")));
    rgb().into_iter().chain(layered).collect()
}

/// What a sequence of two terms says about itself, but for one attribute.
fn sequence(other: Attribute<'_>) -> Vec<u8> {
    let text = |name, value: &str| (name, "string", value.as_bytes().to_vec());
    let mut attributes =
        vec![text("nst.version", "1"), text("nst.terms", "1,2"), text("nst.folds", "0")];
    attributes.push(text("nst.seed", "3"));
    attributes.retain(|(name, ..)| *name != other.0);
    attributes.push(other);
    exr(&terms(), [4, 4], &attributes)
}

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("good.exr", exr(&rgb(), [4, 4], &[]));
    bench.write("seq.exr", sequence(("nst.sampler", "string", b"random".to_vec())));
    bench
}

/// The commands that read pictures, then those that read sequences; `x.exr` is the file.
fn commands() -> [Vec<String>; 2] {
    let render = format!("render --scene {} --spp 4 --size 4x4 -o new.exr", cornell());
    let scene = format!("bench scene --scene {} --spp 1 --runs 1 -o new.csv", cornell());
    let pictures = [
        "info x.exr",
        "info x.exr --json",
        "compare x.exr good.exr",
        "compare good.exr x.exr",
        "pack x.exr good.exr --as samples --spp 2 -o new.exr",
        "pack x.exr good.exr --as estimates --spp-list 1,2 -o new.exr",
    ];
    let sequences = [
        "transform x.exr -o new.exr",
        "merge x.exr seq.exr -o new.exr",
        "pack x.exr seq.exr --as runs -o new.safetensors",
    ];
    [
        pictures
            .into_iter()
            .map(str::to_owned)
            .chain([format!("{scene} --reference x.exr")])
            .collect(),
        sequences
            .into_iter()
            .map(str::to_owned)
            .chain([format!("{render} --resume x.exr")])
            .collect(),
    ]
}

/// Each command must fail with one error that names the file and contains `words`, soon, and
/// without a new file.
fn refused(bench: &Bench, commands: &[String], words: &[&str]) {
    for args in commands {
        let before = bench.files();
        let begin = Instant::now();
        let output = bench.nst(args);
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert!(matches!(output.status.code(), Some(1 | 2)), "nst {args}\n{stderr}");
        assert_eq!(stderr.matches("error:").count(), 1, "nst {args}\n{stderr}");
        for word in ["x.exr"].iter().chain(words) {
            assert!(stderr.contains(word), "nst {args}\n'{word}' is not in: {stderr}");
        }
        assert!(stderr.len() < 5000, "nst {args}: a message of {} bytes", stderr.len());
        // Other tests run at the same time.
        assert!(begin.elapsed() < Duration::from_secs(20), "nst {args}");
        assert_eq!(bench.files(), before, "nst {args}");
    }
}

#[test]
fn files_without_pixels() {
    let bench = bench();
    let windows = [[0, 0, -1, -1], [0, 0, -1, 3], [0, 0, 3, -1], [5, 5, 0, 0]];
    for window in windows {
        for name in ["dataWindow", "displayWindow"] {
            let attribute = (name, "box2i", numbers(&window));
            bench.write("x.exr", exr(&rgb(), [4, 4], &[attribute]));
            refused(&bench, &commands().concat(), &[name, "no pixels"]);
        }
    }
}

#[test]
fn a_million_channels() {
    let bench = bench();
    let names = |count: usize| (0..count).map(|i| format!("c{i:06}.X")).collect::<Vec<_>>();
    bench.write("x.exr", exr(&names(1_000_000), [1, 1], &[]));
    let [pictures, sequences] = commands();
    refused(&bench, &sequences, &["no sequence"]);
    // `info` lists the first and the last.
    refused(&bench, &pictures[2..], &["c000000", "c999999", "1000000 in all"]);
    let said = bench.succeed("info x.exr");
    assert!(said.contains("1000000") && said.len() < 5000, "{said}");
    // Few are listed in full.
    bench.write("x.exr", exr(&names(30), [1, 1], &[]));
    refused(&bench, &pictures[2..], &["c000010", "c000029"]);
}

#[test]
fn attributes_of_exr_with_wrong_types() {
    let bench = bench();
    let text = |name| (name, "string", b"0 0 3 3".to_vec());
    for (attribute, words) in [
        (text("dataWindow"), "data window"),
        (("dataWindow", "box2f", floats(&[0.0, 0.0, 3.0, 3.0])), "data window"),
        (text("displayWindow"), "display window"),
        (text("channels"), "channels"),
        (text("compression"), "compression"),
        (("compression", "compression", vec![99]), "compression"),
        (("chunkCount", "int", numbers(&[-1])), "chunk count"),
    ] {
        bench.write("x.exr", exr(&rgb(), [4, 4], &[attribute]));
        refused(&bench, &commands().concat(), &[words]);
    }
    // Of pictures, the number of blocks must be right; of sequences, it is not looked at.
    let [pictures, _] = commands();
    for count in [0, 1, 5, i32::MAX] {
        let attribute = ("chunkCount", "int", numbers(&[count]));
        bench.write("x.exr", exr(&rgb(), [4, 4], std::slice::from_ref(&attribute)));
        refused(&bench, &pictures, &["chunk count"]);
        bench.write("x.exr", sequence(attribute));
        bench.succeed("transform x.exr --transform none -o new.exr");
        for name in ["new.exr", "new.png"] {
            std::fs::remove_file(bench.path(name)).expect("an output");
        }
    }
    // What is not needed is not looked at.
    for attribute in [text("chromaticities"), text("chunkCount"), text("lineOrder")] {
        bench.write("x.exr", exr(&rgb(), [4, 4], std::slice::from_ref(&attribute)));
        bench.succeed("info x.exr");
        let said = bench.succeed("compare x.exr good.exr --json");
        assert!(said.contains("\"mse\":{\"error\":0.0,"), "{attribute:?}: {said}");
    }
}

#[test]
fn numbers_of_samples_that_are_none() {
    let bench = bench();
    let pack = |kind: &str| vec![format!("pack x.exr good.exr --as {kind} -o new.exr")];
    let single = "samplesPerPixel";
    for (name, kind, value) in [
        (single, "string", b"many".to_vec()),
        (single, "string", vec![]),
        (single, "float", floats(&[8.5])),
        (single, "float", floats(&[f32::NAN])),
        (single, "int", numbers(&[-3])),
        (single, "int", numbers(&[0])),
        ("cycles.View.samples", "string", b"many".to_vec()),
    ] {
        let channels = rgb().iter().map(|c| format!("View.Combined.{c}")).collect::<Vec<_>>();
        let names = if name == single { rgb() } else { channels };
        bench.write("x.exr", exr(&names, [4, 4], &[(name, kind, value)]));
        bench.succeed("info x.exr");
        refused(&bench, &pack("samples"), &[name, "no whole number above 0", "--spp"]);
        refused(&bench, &pack("estimates"), &[name, "no whole number above 0", "--spp-list"]);
    }
    bench.write("x.exr", exr(&rgb(), [4, 4], &[(single, "box2i", numbers(&[1; 4]))]));
    refused(&bench, &pack("samples"), &[single, "--spp"]);
    // A whole number may be text.
    bench.write("x.exr", exr(&rgb(), [4, 4], &[(single, "string", b"8".to_vec())]));
    bench.succeed("pack x.exr --as samples -o new.exr");
}

#[test]
fn attributes_of_sequences_with_wrong_types() {
    let bench = bench();
    let [_, sequences] = commands();
    for name in ["nst.version", "nst.terms", "nst.folds", "nst.scene", "nst.sampler", "nst.seed"] {
        for attribute in [(name, "int", numbers(&[1])), (name, "float", floats(&[1.0]))] {
            bench.write("x.exr", sequence(attribute));
            refused(&bench, &sequences, &[name, "not text"]);
            refused(&bench, &["info x.exr".to_owned()], &[name, "not text"]);
        }
    }
    for (name, value) in
        [("nst.terms", "2,2"), ("nst.terms", "1,-2"), ("nst.folds", "-1"), ("nst.seed", "-3")]
    {
        bench.write("x.exr", sequence((name, "string", value.as_bytes().to_vec())));
        refused(&bench, &sequences, &[name]);
    }
    bench.write("x.exr", sequence(("nst.terms", "box2i", numbers(&[1; 4]))));
    refused(&bench, &sequences, &["nst.terms"]);
    // How long it took is told, and nothing depends on it.
    bench.write("x.exr", sequence(("renderTimeSeconds", "string", b"long".to_vec())));
    bench.succeed("transform x.exr --transform none -o new.exr");
}

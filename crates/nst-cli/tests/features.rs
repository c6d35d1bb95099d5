//! What the camera sees beside radiance, from the command line: in pictures, in sequences that
//! are continued and merged, and in what is made of them.

mod common;

use std::path::Path;

use common::{Bench, cornell, read_layer};
use nst_core::Side;
use nst_files::{header::ExrHeader, output::OutputFile, sequence_file::SequenceFile};

fn sequence(path: &Path) -> SequenceFile {
    SequenceFile::read(path).expect("a sequence")
}

/// Renders the Cornell box with some options.
fn render(bench: &Bench, options: &str) -> String {
    let options = format!("--size 21x40 --transform none --quiet {options}");
    bench.succeed(&format!("render --scene {} {options}", cornell()))
}

/// The names of all channels of a picture that belong to features.
fn channels(path: &Path) -> Vec<String> {
    let header = ExrHeader::read(path).expect("a header");
    let names = header.parts[0].channels.iter().map(|channel| channel.name.clone());
    let of = ["albedo", "normal", "depth", "emission"];
    names.filter(|name| of.iter().any(|feature| name.starts_with(feature))).collect()
}

const ALL: [&str; 10] = [
    "albedo.B",
    "albedo.G",
    "albedo.R",
    "depth.Z",
    "emission.B",
    "emission.G",
    "emission.R",
    "normal.X",
    "normal.Y",
    "normal.Z",
];

/// The box's walls are known: white is .73 or about, all surfaces are flat along the axes, and the
/// lamp shines downwards from where the camera sees it.
#[test]
fn pictures_have_what_the_camera_sees() {
    let bench = Bench::new();
    render(&bench, "--spp 6 -o with.exr --features --sequence s.exr");
    render(&bench, "--spp 6 -o without.exr");
    assert_eq!(channels(&bench.path("with.exr")), ALL);
    assert_eq!(channels(&bench.path("without.exr")), [""; 0]);
    for layer in ["", "S", "Variance"] {
        let of = |name: &str| read_layer(&bench.path(name), layer);
        assert!(of("with.exr") == of("without.exr"), "'{layer}' depends on features");
    }
    let pixels = 21 * 40;
    let stored = sequence(&bench.path("s.exr")).batch;
    let of = |layer: &str| read_layer(&bench.path("with.exr"), layer).1;
    for (layer, side) in [("albedo", Side::Albedo), ("emission", Side::Emission)] {
        assert_eq!(Some(&of(layer)[..]), stored.side(&side), "{layer}");
    }
    for (i, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
        let normals = stored.side(&Side::Normal).expect("normals");
        assert_eq!(of(&format!("normal.{axis}")), normals[i * pixels..(i + 1) * pixels]);
    }
    // A corner of the picture shows the left wall, red, which faces to the right.
    let at = |layer: &str| of(layer)[20 * 21];
    let [red, green] = [0, 1].map(|channel| of("albedo")[channel * pixels + 20 * 21]);
    assert!(red > 3.0 * green && at("normal.X") > 0.9, "{red} {green} {}", at("normal.X"));
    assert!(at("depth.Z") > 0.0 && of("emission")[20 * 21] == 0.0);
    let brightest = of("emission").into_iter().fold(0.0, f32::max);
    assert!(brightest > 1.0, "the lamp is in view: {brightest}");

    // What is made of the sequence has them, too.
    bench.succeed("transform s.exr -o again.exr -q");
    assert_eq!(channels(&bench.path("again.exr")), ALL);
    for layer in ["albedo", "normal.X", "depth.Z", "emission"] {
        assert_eq!(read_layer(&bench.path("again.exr"), layer).1, of(layer), "{layer}");
    }
    let said = bench.succeed("info s.exr");
    for name in ["albedo", "normal", "depth", "emission", "emission3"] {
        assert!(said.contains(name), "{name} is not in {said}");
    }
}

#[test]
fn features_go_on_where_they_stopped() {
    let bench = Bench::new();
    for (few, more) in [(3, 7), (9, 22)] {
        render(&bench, &format!("--spp {more} -o a.exr --features --sequence whole.exr"));
        render(&bench, &format!("--spp {few} -o b.exr --features --sequence part.exr"));
        let part = sequence(&bench.path("part.exr"));
        bench.succeed(&format!(
            "render --scene {} --spp {more} --resume part.exr -o b.exr --transform none --quiet",
            cornell()
        ));
        let whole = sequence(&bench.path("whole.exr"));
        let longer = sequence(&bench.path("part.exr"));
        assert_eq!(longer.batch, whole.batch);
        assert!(longer.features.is_some() && longer.features == whole.features);
        assert_ne!(part.features, whole.features);
        let pictures = ["a.exr", "b.exr"].map(|name| bench.path(name));
        for layer in ["albedo", "depth.Z", "normal.Y"] {
            let [a, b] = pictures.each_ref().map(|path| read_layer(path, layer));
            assert!(a == b, "{layer}");
        }
    }
}

/// The mean of two renderings, weighted by their samples; a third is refused without features.
#[test]
fn merged_features_are_means() {
    let bench = Bench::new();
    for seed in 1..=3 {
        render(&bench, &format!("--spp 8 --seed {seed} --features --sequence s{seed}.exr"));
    }
    render(&bench, "--spp 8 --seed 4 --sequence plain.exr");
    bench.succeed("merge s1.exr s2.exr -o two.exr -q");
    bench.succeed("merge two.exr s3.exr -o all.exr -q");
    let parts = [1, 2, 3].map(|seed| sequence(&bench.path(&format!("s{seed}.exr"))).batch);
    let merged = sequence(&bench.path("all.exr")).batch;
    for side in Side::FEATURES {
        let values = |batch: &nst_core::SequenceBatch| batch.side(side).expect("it").to_vec();
        let parts = parts.each_ref().map(values);
        // Rounded to f32 twice; normals may cancel.
        let differs = |weights: [f64; 3]| {
            values(&merged).iter().enumerate().any(|(i, &value)| {
                let mean: f64 = (0..3).map(|k| weights[k] * f64::from(parts[k][i])).sum();
                let scale = (0..3).map(|k| parts[k][i].abs()).fold(0.0, f32::max);
                (f64::from(value) - mean).abs() > 3e-7 * f64::from(scale)
            })
        };
        assert!(!differs([1.0 / 3.0; 3]), "{side}");
        assert!(differs([0.25, 0.25, 0.5]), "{side}: these are not the files' weights");
    }
    let output = bench.nst("merge s1.exr plain.exr -o new.exr");
    let stderr = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("plain.exr") && stderr.contains("side channels"), "{stderr}");
}

#[test]
fn what_has_no_place_for_features_is_refused() {
    let bench = Bench::new();
    let scene = format!("render --scene {} --spp 9", cornell());
    bench.refuses(&format!("{scene} --features -o x.png"), &["--features", "x.png", ".exr"]);
    bench.refuses(&format!("{scene} --features --runs 2"), &["--features", "--runs"]);
    render(&bench, "--spp 8 -o a.exr --sequence plain.exr");
    render(&bench, "--spp 8 -o a.exr --features --sequence s.exr");
    let resume = format!("{scene} --transform none -o b.exr --resume");
    bench.refuses(&format!("{resume} plain.exr --features"), &["plain.exr", "no features"]);
    // A sum that contradicts the mean beside it.
    let mut file = sequence(&bench.path("s.exr"));
    file.features.as_mut().expect("its sums")[7].normal[1] += 1.0;
    let mut output = OutputFile::create(&bench.path("wrong.exr")).expect("a file");
    file.write(&mut output).expect("it can be written");
    output.commit().expect("it can be renamed");
    let output = bench.nst(&format!("{resume} wrong.exr"));
    let stderr = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    for word in ["wrong.exr", "column 7, row 0", "damaged"] {
        assert!(stderr.contains(word), "'{word}' is not in {stderr}");
    }
    bench.succeed(&format!("{resume} s.exr --features --quiet"));
    render(&bench, "--spp 1 -o x.png --features --sequence one.exr");
    let one = sequence(&bench.path("one.exr"));
    assert_eq!(one.batch.sides().count(), 4, "no variance, no folds");
}

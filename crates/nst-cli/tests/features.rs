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
    let options = format!("--size 40x40 --transform none --quiet {options}");
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

/// The box's walls are known, and the lamp is in view.
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
    let pixels = 40 * 40;
    let stored = sequence(&bench.path("s.exr")).batch;
    let of = |layer: &str| read_layer(&bench.path("with.exr"), layer).1;
    for (layer, side) in [("albedo", Side::Albedo), ("emission", Side::Emission)] {
        assert_eq!(Some(&of(layer)[..]), stored.side(&side), "{layer}");
    }
    for (i, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
        let normals = stored.side(&Side::Normal).expect("normals");
        assert_eq!(of(&format!("normal.{axis}")), normals[i * pixels..(i + 1) * pixels]);
    }
    // At the left of the picture is the left wall: red, and seen along x.
    let left = 20 * 40 + 1;
    let at = |layer: &str| of(layer)[left];
    let [red, green] = [0, 1].map(|channel| of("albedo")[channel * pixels + left]);
    assert!(red > 3.0 * green && at("normal.X") < -0.9, "{red} {green} {}", at("normal.X"));
    assert!(at("depth.Z") > 0.0 && at("emission") == 0.0);
    let brightest = of("emission").into_iter().fold(0.0, f32::max);
    assert!(brightest > 1.0, "the lamp is in view: {brightest}");

    // What is made of the sequence has them, too.
    bench.succeed("transform s.exr -o again.exr -q");
    assert_eq!(channels(&bench.path("again.exr")), ALL);
    for layer in ["albedo", "normal.X", "depth.Z", "emission"] {
        assert_eq!(read_layer(&bench.path("again.exr"), layer).1, of(layer), "{layer}");
    }
    let said = bench.succeed("info s.exr");
    // The list names its first and its last.
    for name in ["normal3", "emission3"] {
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
        let features = |file: &SequenceFile| {
            let sums = file.sums.as_ref().expect("a rendering can be continued");
            sums.features.clone().expect("they were asked for")
        };
        assert_eq!(longer.sums, whole.sums);
        assert_ne!(features(&part), features(&whole));
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
    for (files, verb) in [("s1.exr plain.exr", "lacks"), ("plain.exr s1.exr", "has")] {
        let output = bench.nst(&format!("merge {files} -o new.exr"));
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(1), "{stderr}");
        let second = files.split_once(' ').expect("two files").1;
        let said = format!("'{second}': it {verb} the side channels 'albedo, normal");
        assert!(stderr.contains(&said) && stderr.contains("--features"), "{stderr}");
    }
}

/// Writes a picture of 6×5 pixels with these channels, each of one value everywhere but where the
/// picture itself differs from pixel to pixel.
fn picture(path: &Path, seed: f32, channels: &[(&str, f32)]) {
    use exr::prelude::*;
    let flat = |&(name, value): &(&str, f32)| (name.to_owned(), vec![value; 30]);
    let main = ["R", "G", "B"].map(|name| {
        let values = (0..30_u8).map(|i| 1.0 + seed + f32::from(i)).collect();
        (name.to_owned(), values)
    });
    let all = main.into_iter().chain(channels.iter().map(flat));
    let all = all.map(|(name, values)| AnyChannel::new(&*name, FlatSamples::F32(values)));
    let channels = AnyChannels::sort(all.collect());
    Image::from_channels((6, 5), channels).write().to_file(path).expect("a file");
}

/// Packs four pictures whose features are `value` + their number; returns the sequence and what
/// was said.
fn packed(bench: &Bench, names: &[(&str, f32)], options: &str) -> (SequenceFile, String) {
    for i in 0..4_u8 {
        let of = |&(name, value): &(_, f32)| (name, value + f32::from(i) / 8.0);
        let channels: Vec<_> = names.iter().map(of).collect();
        picture(&bench.path(&format!("p{i}.exr")), f32::from(i), &channels);
    }
    let files = "p0.exr p1.exr p2.exr p3.exr";
    let said = bench.succeed(&format!("pack {files} --spp 4 -o packed.exr {options}"));
    (sequence(&bench.path("packed.exr")), said)
}

/// The value of a side channel that is the same for all pixels, channel by channel.
fn flat(file: &SequenceFile, side: &Side) -> Option<Vec<f32>> {
    let values = file.batch.side(side)?;
    let channels: Vec<f32> = values.chunks(30).map(|channel| channel[0]).collect();
    assert!(values.chunks(30).all(|channel| channel.iter().all(|x| *x == channel[0])), "{side}");
    Some(channels)
}

/// Means over the files, by the names of four renderers' layers.
#[test]
fn packed_pictures_bring_features() {
    let bench = Bench::new();
    // 3 / 16 is the mean of 0, 1/8, 2/8, 3/8.
    let mean = |values: &[f32]| Some(values.iter().map(|x| x + 0.1875).collect::<Vec<_>>());
    let gbuffer = [
        ("Albedo.R", 0.1),
        ("Albedo.G", 0.2),
        ("Albedo.B", 0.3),
        ("N.X", 0.5),
        ("N.Y", 0.5),
        ("N.Z", 0.5),
        ("Ns.X", 0.25),
        ("Ns.Y", 0.0),
        ("Ns.Z", -0.5),
    ];
    let (file, said) = packed(&bench, &gbuffer, "");
    assert_eq!(flat(&file, &Side::Normal), mean(&[0.25, 0.0, -0.5]));
    let albedo = flat(&file, &Side::Albedo).expect("pbrt's layer");
    assert!((albedo[2] - 0.4875).abs() < 1e-6 && (albedo[0] - 0.4875).abs() > 0.1);
    assert!(said.contains("albedo from Albedo") && said.contains("normal from Ns"), "{said}");
    assert_eq!(flat(&file, &Side::Emission), None);

    let mitsuba = [("nn.X", 0.0), ("nn.Y", 0.0), ("nn.Z", 0.5), ("dd.y.T", 3.0)];
    let (file, said) = packed(&bench, &mitsuba, "");
    assert_eq!(flat(&file, &Side::Normal), mean(&[0.0, 0.0, 0.5]));
    assert_eq!(flat(&file, &Side::Depth), mean(&[3.0]), "{said}");

    let passes = [
        ("V.Denoising Albedo.R", 0.5),
        ("V.Denoising Albedo.G", 0.5),
        ("V.Denoising Albedo.B", 0.5),
        ("V.Emit.R", 1.0),
        ("V.Emit.G", 2.0),
        ("V.Emit.B", 3.0),
        ("V.Env.R", 0.0),
        ("V.Env.G", 0.5),
        ("V.Env.B", 0.0),
        ("V.Depth.Z", 1e10),
    ];
    let (file, said) = packed(&bench, &passes, "");
    assert_eq!(flat(&file, &Side::Emission), Some(vec![1.375, 2.875, 3.375]));
    // Each picture is a fold.
    assert_eq!(flat(&file, &Side::EmissionFold(2)), Some(vec![1.5, 3.0, 3.5]));
    assert_eq!(flat(&file, &Side::Albedo), mean(&[0.5; 3]));
    assert_eq!(flat(&file, &Side::Depth), Some(vec![0.0]), "nothing is there");
    assert!(said.contains("emission from V.Emit + V.Env"), "{said}");
    assert!(said.contains("depth (V.Depth): zero everywhere"), "{said}");

    let own = [("a.R", 0.9), ("a.G", 0.0), ("a.B", 1.5), ("b.X", 3.0), ("b.Y", 0.0), ("b.Z", 0.0)];
    let (file, _) = packed(&bench, &own, "");
    assert!(!file.info.has_features(), "nobody knows these names");
    let (file, said) = packed(&bench, &own, "--albedo a --normal b");
    assert_eq!(flat(&file, &Side::Albedo), Some(vec![1.0, 0.1875, 1.0]));
    let length = flat(&file, &Side::Normal).expect("it is named");
    assert!((length[0].hypot(length[1]).hypot(length[2]) - 1.0).abs() < 1e-6, "{length:?}");
    for words in ["60 below 0 or above 1", "30 longer than 1"] {
        assert!(said.contains(words), "'{words}' is not in {said}");
    }
    bench.succeed("transform packed.exr --transform none -o t.exr -q");
    assert_eq!(channels(&bench.path("t.exr")).len(), 6);
}

#[test]
fn features_that_do_not_fit_are_told() {
    let bench = Bench::new();
    let nan = [("albedo.R", f32::NAN), ("albedo.G", 0.5), ("albedo.B", 0.5)];
    let (file, said) = packed(&bench, &nan, "");
    assert_eq!(flat(&file, &Side::Albedo), Some(vec![0.0, 0.6875, 0.6875]));
    assert!(said.contains("120 not finite"), "{said}");
    // One of two files lacks it.
    picture(&bench.path("q.exr"), 9.0, &[]);
    let said = bench.succeed("pack p0.exr q.exr --spp 1 -o x.exr");
    assert!(said.contains("albedo is left out") && said.contains("q.exr"), "{said}");
    assert!(!sequence(&bench.path("x.exr")).info.has_features());
    let fails = |options: &str, words: &[&str]| {
        let output = bench.nst(&format!("pack p0.exr q.exr --spp 1 -o y.exr {options}"));
        let stderr = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(1), "{stderr}");
        for word in words {
            assert!(stderr.contains(word), "'{word}' is not in {stderr}");
        }
        assert!(!bench.path("y.exr").exists());
    };
    fails("--albedo albedo", &["q.exr", "no layer 'albedo'", "R, G, B"]);
    fails("--normal albedo", &["p0.exr", "no layer 'albedo'", "X, Y, Z"]);
    fails("--layer R --albedo albedo", &["albedo"]);
    let runs = "pack packed.exr --as runs -o r.safetensors --albedo a";
    bench.refuses(runs, &["--albedo", "--as runs"]);
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
    let sums = file.sums.as_mut().expect("its sums");
    sums.features.as_mut().expect("those of its features")[7].normal[1][2] += 1.0;
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

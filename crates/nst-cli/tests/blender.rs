//! Files that Blender's renderer Cycles wrote (`tests/peers/cycles_files.py`), packed and
//! compared without an option.

mod common;

use std::path::Path;

use common::{Bench, read_layer};
use nst_files::{header::ExrHeader, picture::Picture, sequence_file::SequenceFile};

const SEEDS: usize = 16;
const PIXELS: usize = 12 * 8;

/// A folder with Blender's files.
fn bench() -> Bench {
    let bench = Bench::new();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/cycles");
    for entry in std::fs::read_dir(folder).expect("the files are part of the repository") {
        let path = entry.expect("a readable folder").path();
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        if name.ends_with(".exr") {
            bench.write(&name, std::fs::read(path).expect("a file"));
        }
    }
    bench
}

fn seeds() -> String {
    (0..SEEDS).map(|seed| format!("seed-{seed:02}.exr ")).collect()
}

/// Packs files without another option; returns the sequence, and what was said.
fn pack(bench: &Bench, files: &str) -> (SequenceFile, String) {
    let said = bench.succeed(&format!("pack {files} -o seq.exr"));
    let sequence = SequenceFile::read(&bench.path("seq.exr")).expect("a sequence");
    std::fs::remove_file(bench.path("seq.exr")).expect("the sequence");
    (sequence, said)
}

/// Packs files, which must fail.
fn fails(bench: &Bench, arguments: &str) -> String {
    let output = bench.nst(&format!("pack {arguments} -o seq.exr"));
    assert!(!output.status.success() && !bench.path("seq.exr").exists(), "{arguments}");
    String::from_utf8(output.stderr).expect("UTF-8")
}

/// The pixels of a picture without its name or any of its layer's: three channels, each by
/// the whole name that OpenEXR has for it.
fn channels(bench: &Bench, file: &str, layer: &str) -> Vec<f32> {
    let read = |channel: &&str| read_layer(&bench.path(file), &format!("{layer}{channel}")).1;
    ["R", "G", "B"].iter().flat_map(read).collect()
}

fn means(lanes: &[f32]) -> [f64; 3] {
    let mean = |plane: &[f32]| plane.iter().map(|&x| f64::from(x)).sum::<f64>() / PIXELS as f64;
    [0, 1, 2].map(|channel| mean(&lanes[channel * PIXELS..][..PIXELS]))
}

/// Whether means agree but for rounding: each value is rounded to f32 once, by 2⁻²⁴ of
/// itself at most.
fn close(found: [f64; 3], expected: [f64; 3]) -> bool {
    found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 1e-7 * b)
}

#[test]
fn sixteen_seeds_become_a_sequence() {
    let bench = bench();
    let (sequence, said) = pack(&bench, &seeds());
    let expected: Vec<u32> = (1..=16).map(|k| 16 * k).collect();
    assert_eq!(sequence.info.sample_counts, expected);
    for words in ["16 of 12x8 pixels", "ViewLayer.Combined.R", "attribute cycles.ViewLayer.samples"]
    {
        assert!(said.contains(words), "'{words}' is not in:\n{said}");
    }
    // Linear sRGB, and not denoised.
    assert!(!said.contains("note"), "{said}");

    // The means of `ViewLayer.Combined.R`, G and B, computed with numpy from what OpenEXR's
    // Python module 3.5.3 and OpenImageIO 3.2.2 read.
    let first = [0.460263981546935, 0.32164513736400596, 0.3838860466348706];
    let all = [0.4601170740232495, 0.32122581479643486, 0.38195735187999463];
    assert!(close(means(sequence.batch.term(0)), first));
    assert!(close(means(sequence.batch.last()), all));
    assert!(!close(means(sequence.batch.term(0)), all), "the comparison sees no difference");
    let pixel = [1.018_982_5, 0.267_841_1, 0.148_806_59];
    assert_eq!([0, 1, 2].map(|c| sequence.batch.term(0)[c * PIXELS + 4 * 12 + 5]), pixel);

    // Each lane is the mean of the channels of these names.
    let files: Vec<Vec<f32>> = (0..SEEDS)
        .map(|seed| channels(&bench, &format!("seed-{seed:02}.exr"), "ViewLayer.Combined."))
        .collect();
    for (lane, &value) in sequence.batch.last().iter().enumerate() {
        let mean = files.iter().map(|file| f64::from(file[lane])).sum::<f64>() / 16.0;
        assert_eq!(value, mean as f32, "lane {lane}");
    }
}

#[test]
fn what_is_packed_can_be_used() {
    let bench = bench();
    bench.succeed(&format!("pack {} -o seq.exr --seed 1 -q", seeds()));
    let error = |file: &str| {
        let said = bench.succeed(&format!("compare {file} reference.exr --json"));
        let report: serde_json::Value = serde_json::from_str(&said).expect("JSON");
        assert_eq!(report["reference_layer"], "ViewLayer.Combined");
        report["mse"]["error"].as_f64().expect("a number")
    };
    // Sixteen times the samples: a sixteenth of the variance, and what Cycles' first sample,
    // which goes through the middle of each pixel, errs in all of them.
    let (one, all) = (error("seed-00.exr"), error("seq.exr"));
    assert!(all < one / 6.0, "{one} and {all}");
    for method in ["ridge", "gmon"] {
        bench.succeed(&format!("transform seq.exr --transform {method} -o {method}.exr -q"));
        let transformed = error(&format!("{method}.exr"));
        assert!(transformed < one / 6.0, "{method}: {transformed}");
    }
    let halves = seeds();
    let (a, b) = halves.split_at(halves.len() / 2);
    bench.succeed(&format!("pack {a} -o a.exr --seed 1 -q"));
    bench.succeed(&format!("pack {b} -o b.exr --seed 2 -q"));
    bench.succeed("merge a.exr b.exr -o merged.exr -q");
    let merged = SequenceFile::read(&bench.path("merged.exr")).expect("a sequence").batch;
    let packed = SequenceFile::read(&bench.path("seq.exr")).expect("a sequence").batch;
    assert_eq!(merged.sample_counts().last(), Some(&256));
    for (a, b) in merged.last().iter().zip(packed.last()) {
        // Rounded to f32 once more.
        assert!((a - b).abs() <= 2e-7 * b, "{a} is not {b}");
    }
}

#[test]
fn wrong_files_are_refused() {
    let bench = bench();
    for (files, words) in [
        ("seed-00.exr reference.exr", ["4096", "16"]),
        ("seed-00.exr seed-01.exr seed-00.exr", ["same pixels", "seeds"]),
        ("seed-00.exr gray-0.exr", ["in V", "all must agree"]),
        ("seed-00.exr acescg-0.exr", ["acescg-0.exr", "other primaries"]),
    ] {
        let said = fails(&bench, files);
        for word in words {
            assert!(said.contains(word), "{files}: '{word}' is not in: {said}");
        }
    }
}

/// The files of seed 0 have the same pixels, however they are stored.
#[test]
fn the_picture_and_its_samples_are_found_in_each_kind_of_file() {
    let bench = bench();
    let picture = channels(&bench, "seed-00.exr", "ViewLayer.Combined.");
    for (file, attribute) in [
        ("plain-0.exr", "cycles.ViewLayer.samples"),
        ("interleaved-0.exr", "cycles.ViewLayer.samples"),
        // Not the layer of the compositor, which inverts it.
        ("composited-0.exr", "cycles.ViewLayer.samples"),
        ("named-layer-0.exr", "cycles.Key light v1.2 (ü).samples"),
    ] {
        let (sequence, said) = pack(&bench, file);
        assert_eq!(sequence.info.sample_counts, [16], "{file}");
        assert_eq!(sequence.batch.last(), picture, "{file}");
        assert!(said.contains(attribute), "{file}: {said}");
        assert!(!said.contains("note"), "{file}: {said}");
    }
    let (half, _) = pack(&bench, "half-float-alone-0.exr");
    assert_eq!(half.info.sample_counts, [16]);
    for (a, b) in half.batch.last().iter().zip(&picture) {
        // f16 has 11 bits.
        assert!((a - b).abs() <= 2_f32.powi(-11) * b, "{a} is not {b}");
    }
    let (gray, _) = pack(&bench, "gray-0.exr");
    assert_eq!(gray.info.sample_counts, [16]);
    for (pixel, &y) in gray.batch.last().iter().enumerate() {
        let [r, g, b] = [0, 1, 2].map(|channel| picture[channel * PIXELS + pixel]);
        // The weights of Rec. 709; three products and two sums, each rounded to f32.
        let luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
        assert!((y - luminance).abs() <= 1e-6 * luminance, "{y} is not {luminance}");
    }
}

#[test]
fn layers_are_named_where_several_are_the_picture() {
    let bench = bench();
    let picture = channels(&bench, "seed-00.exr", "ViewLayer.Combined.");
    for (file, names) in [
        ("layer-samples-0.exr", "ViewLayer.Combined, Second Layer.Combined\n"),
        ("stereo-0.exr", "ViewLayer.Combined-left, ViewLayer.Combined-right\n"),
    ] {
        let said = fails(&bench, file);
        assert!(said.contains(&format!("name one of them: {names}")), "{file}: {said}");
    }
    let open = |file: &str, layer: &str| {
        let picture = Picture::open(&bench.path(file), Some(layer)).expect("this layer");
        (picture.samples_per_pixel, picture.read().expect("its pixels"))
    };
    // Each view layer has its own number of samples, and the second is also seed-00.exr.
    let (samples, pixels) = open("layer-samples-0.exr", "Second Layer.Combined");
    assert!(samples == Some(16) && pixels == picture);
    let (samples, pixels) = open("layer-samples-0.exr", "ViewLayer.Combined");
    assert!(samples == Some(32) && pixels != picture);
    let (samples, pixels) = open("stereo-0.exr", "ViewLayer.Combined-left");
    assert!(samples == Some(16) && pixels == picture);
    let (samples, pixels) = open("stereo-0.exr", "ViewLayer.Combined-right");
    assert!(samples == Some(16) && pixels != picture);
    let green = open("stereo-0.exr", "ViewLayer.Combined-left.G").1;
    assert_eq!(green, picture[PIXELS..2 * PIXELS]);
    let (samples, pixels) = open("named-layer-0.exr", "Key light v1.2 (ü).Combined");
    assert!(samples == Some(16) && pixels == picture);
}

#[test]
fn denoised_pictures_and_other_colours_are_told() {
    let bench = bench();
    let picture = channels(&bench, "seed-00.exr", "ViewLayer.Combined.");
    let (denoised, said) = pack(&bench, "denoised-0.exr");
    assert!(
        said.contains("denoised") && said.contains("--layer 'ViewLayer.Noisy Image'"),
        "{said}"
    );
    assert_ne!(denoised.batch.last(), picture);
    let noisy = read_layer(&bench.path("denoised-0.exr"), "ViewLayer.Noisy Image").1;
    assert_eq!(noisy, picture);

    for command in ["pack acescg-0.exr -o seq.exr", "info acescg-0.exr"] {
        let said = bench.succeed(command);
        assert!(said.contains("lin_ap1_scene: taken as they are"), "{command}: {said}");
    }
    assert_ne!(channels(&bench, "acescg-0.exr", "ViewLayer.Combined."), picture);
}

/// What the files consist of is what the tests above take for granted.
#[test]
fn passes_are_parts_or_channels_of_one() {
    let bench = bench();
    let parts = |file: &str| ExrHeader::read(&bench.path(file)).expect("headers").parts;
    let names = |file: &str| -> Vec<_> {
        parts(file).into_iter().map(|part| part.name.unwrap_or_default()).collect()
    };
    assert_eq!(names("seed-00.exr"), ["ViewLayer.Combined", "ViewLayer.Depth"]);
    assert_eq!(names("plain-0.exr"), [""]);
    assert_eq!(names("stereo-0.exr"), ["ViewLayer.Combined-left", "ViewLayer.Combined-right"]);
    assert_eq!(parts("interleaved-0.exr").len(), 1);
    assert_eq!(parts("half-float-alone-0.exr")[0].channels[0].kind, "f16");
    // Cycles' attributes are in the first part, which is the compositor's.
    let composited = parts("composited-0.exr");
    assert_eq!(composited[0].name.as_deref(), Some("Composite.Combined"));
    assert!(!composited[1].attributes.contains_key("cycles.ViewLayer.samples"));
}

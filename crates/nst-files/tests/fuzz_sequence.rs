//! Damaged sequence files: the reader returns an error or what the file says; it
//! never panics, and never asks for memory that the file's length does not justify.
//!
//! It is the only test of its binary, so that nothing else moves the peak.
//! `NST_FUZZ_CASES=200000 cargo test -p nst-files --test fuzz_sequence` tries more.

mod fuzz;

use std::{
    panic::catch_unwind,
    path::Path,
    sync::{Mutex, PoisonError},
};

use exr::prelude::{Compression, ReadChannels, ReadLayers, WritableImage};
use ndarray::Array2;
use nst_core::{
    Estimates, FOLDS, FeatureSums, Grid, Identity, Keep, LaneSums, Power, PowerSums, SampleSums,
    SequenceBatch, Side, Strips, Transform, fold_count, random::SplitMix64,
};
use nst_files::{
    ColorModel,
    output::OutputFile,
    sequence_file::{ResumeInfo, SequenceFile, SequenceInfo, SequenceReader},
};

use fuzz::{NUMBERS, damage_blindly, peak_of, pick, put_number};

/// Cases for each of five files, unless the environment asks for others.
const CASES_PER_FILE: u64 = 2_400;

/// What reading a file of `bytes` bytes may allocate at once. Deflate makes 1032
/// bytes out of one; a block is there decompressed, in the decompressor's other
/// buffer, in a batch, and in the estimates.
fn allowed(bytes: usize) -> usize {
    (1 << 20) + 4 * 1032 * bytes
}

/// A smooth picture of two blocks of rows, so that all blocks are compressed.
fn sequence(model: ColorModel, resume: bool) -> SequenceFile {
    let size = [13, 21];
    let lanes = model.channels().len() * 13 * 21;
    let counts = vec![1, 2, 4, 7, 8];
    // Samples and their sums after each of the counted ones, `[term][lane]`.
    let sums_of = |n: u32| -> Vec<LaneSums> {
        let lane = |lane: usize| {
            let mut sums = LaneSums::default();
            (0..n).for_each(|i| sums.add(i, (lane / 40) as f64 + f64::from(i % 3)));
            sums
        };
        (0..lanes).map(lane).collect()
    };
    let means =
        |&n: &u32| sums_of(n).into_iter().map(move |sums| (sums.total() / f64::from(n)) as f32);
    let terms = Array2::from_shape_vec((5, lanes), counts.iter().flat_map(means).collect());
    let mut batch = SequenceBatch::new(terms.expect("the shape"), counts.clone()).expect("a batch");
    let channels = model.channels().len() as u32;
    batch.set_grid(Grid::new(13, 21, channels, 0).expect("a grid")).expect("its lanes");
    let sums = sums_of(8);
    for fold in 0..FOLDS {
        for (kind, sides) in Side::OF_FOLDS.into_iter().enumerate() {
            let mean = |sums: &LaneSums| (sums.of_folds()[kind][fold] / fold_count(fold, 8)) as f32;
            let values = sums.iter().map(mean).collect();
            batch.set_side(sides[fold].clone(), values).expect("a mean per lane");
        }
    }
    let variance = sums.iter().map(|sums| sums.variance(8)).collect();
    batch.set_side(Side::Variance, variance).expect("the variance");
    let skipped = (0..13 * 21).map(|pixel| (pixel / 40) as f32).collect();
    batch.set_side(Side::Skipped, skipped).expect("a number per pixel");
    let features = (model == ColorModel::Rgb).then(|| features(&mut batch));
    let powers = power_sums(lanes);
    batch.set_power_sums(&powers, 8).expect("sums of each lane");
    let resume = resume.then_some(ResumeInfo {
        keep: Keep::Pow2(2),
        pixel_filter: "box".into(),
        max_depth: 8,
        russian_roulette: true,
        powers: powers.powers(),
    });
    let info = SequenceInfo {
        size,
        model,
        sample_counts: counts,
        sides: batch.sides().map(|(side, _)| side.clone()).collect(),
        scene: "s:0".into(),
        sampler: "random".into(),
        seeds: vec![3],
        render_seconds: 1.0,
        resume,
    };
    let sums = SampleSums { lanes: sums, features, powers };
    SequenceFile { sums: info.resume.is_some().then_some(sums), info, batch }
}

/// Sums of two powers of eight samples.
fn power_sums(lanes: usize) -> PowerSums {
    let powers = [0.0625, 8.0].map(|p| Power::of_value(p).expect("a power of two"));
    let mut sums = PowerSums::new(&powers, lanes);
    for lane in 0..lanes {
        (0..8).for_each(|i| sums.add(lane, i, (lane / 40) as f64 + f64::from(i % 3)));
    }
    sums
}

/// Gives the picture features of eight samples; returns their sums.
fn features(batch: &mut SequenceBatch) -> Vec<FeatureSums> {
    let of_pixel = |pixel: usize| {
        let value = (pixel / 40) as f64;
        FeatureSums {
            albedo: [[0.1; FOLDS], [0.3, 0.0, 0.1, 0.2], [0.1 * value; FOLDS]],
            normal: [[0.7; FOLDS], [-value, 0.1, 0.0, 0.3], [0.1; FOLDS]],
            depth: 3.3 * value,
            emission: [[0.0; FOLDS], [value, 1.0 / 3.0, 0.0, value], [1.0; FOLDS]],
        }
    };
    let pixels: Vec<_> = (0..13 * 21).map(of_pixel).collect();
    for side in Side::FEATURES {
        let channels = if *side == Side::Depth { 1 } else { 3 };
        let mean = |pixel: &FeatureSums, channel: usize| {
            let sum = pixel.sum(side, channel).expect("a feature");
            (sum / FeatureSums::count(side, 8)) as f32
        };
        let means = (0..channels).flat_map(|i| pixels.iter().map(move |pixel| mean(pixel, i)));
        let means = means.collect();
        batch.set_side(side.clone(), means).expect("a value for each channel of each pixel");
    }
    pixels
}

/// The file, stored by the exr crate with another compression.
fn with_compression(path: &Path, compression: Compression) -> Vec<u8> {
    let read = exr::prelude::read().no_deep_data().largest_resolution_level();
    let read = read.all_channels().first_valid_layer().all_attributes();
    let mut image = read.from_file(path).expect("a sound file");
    image.layer_data.encoding.compression = compression;
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).expect("it can be written");
    bytes.into_inner()
}

/// Reads a file as `nst transform` and `nst render --resume` do. `Err` is an error
/// of the reader; what it returns otherwise must be sound.
fn read(path: &Path) -> Result<SequenceFile, String> {
    let mut reader = SequenceReader::open(path).map_err(|error| error.to_string())?;
    let info = reader.info().clone();
    let mut lanes = 0;
    while let Some(batch) = reader.next_strip().map_err(|error| error.to_string())? {
        let mut estimates = Estimates::default();
        Identity.transform(&batch, &mut estimates).expect("the identity does not fail");
        assert_eq!(estimates.values().len(), batch.lanes());
        assert_eq!(batch.sample_counts(), info.sample_counts);
        assert!(batch.sides().map(|(side, _)| side).eq(&info.sides));
        lanes += batch.lanes();
    }
    let pixels = info.size[0] as usize * info.size[1] as usize;
    assert_eq!(lanes, pixels * info.model.channels().len());
    let whole = SequenceFile::read(path).map_err(|error| error.to_string())?;
    assert_eq!(whole.info, info);
    Ok(whole)
}

const NAMES: [&str; 16] = [
    "channels",
    "compression",
    "dataWindow",
    "displayWindow",
    "lineOrder",
    "chunkCount",
    "type",
    "pixelAspectRatio",
    "screenWindowWidth",
    "nst.terms",
    "nst.seed",
    "nst.folds",
    "nst.keep",
    "nst.maxDepth",
    "samplesPerPixel",
    "software",
];

fn find(bytes: &[u8], name: &str) -> Option<usize> {
    let name = [b"\0", name.as_bytes(), b"\0"].concat();
    bytes.windows(name.len()).position(|part| part == name).map(|i| i + name.len())
}

/// Damages a file in one to three ways. `header` is where its header and its table
/// of blocks end.
fn damage(bytes: &mut Vec<u8>, header: usize, random: &mut SplitMix64) {
    for _ in 0..1 + random.below(3) {
        if bytes.is_empty() {
            return;
        }
        // Most of a file is pixels, most of what can go wrong is not.
        let end = if random.below(3) == 0 { bytes.len() } else { header.min(bytes.len()) };
        match random.below(10) {
            0..=5 => damage_blindly(bytes, end, random),
            6 | 7 => put_number(bytes, random.below(end), random),
            // An attribute: its type's name, the size of its value, its value.
            8 => {
                if let Some(place) = find(bytes, pick(random, &NAMES)) {
                    let at = (place + random.below(32)).min(bytes.len() - 1);
                    if random.below(2) == 0 {
                        bytes[at] = pick(random, &NUMBERS) as u8;
                    } else {
                        put_number(bytes, at, random);
                    }
                }
            }
            // A channel: type, a flag, sampling in x and y.
            _ => {
                let names = ["R", "S0004.G", "fold1.R", "Variance.B", "Skipped.Y", "Y", "S0008.Y"];
                if let Some(place) = find(bytes, pick(random, &names)) {
                    put_number(bytes, place + 4 * random.below(4), random);
                }
            }
        }
    }
}

#[test]
fn damaged_sequences_are_refused_or_read() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("x.exr");
    let write = |file: &SequenceFile| {
        let mut output = OutputFile::create(&path).expect("a file");
        file.write(&mut output).expect("it can be written");
        output.commit().expect("it can be renamed");
        std::fs::read(&path).expect("the file")
    };
    let mono = sequence(ColorModel::Mono, false);
    let color = sequence(ColorModel::Rgb, true);
    let mut corpus = vec![(write(&mono), &mono, true), (write(&color), &color, true)];
    // Without compression, a flipped bit is another number, and goes unnoticed.
    for (compression, checked) in
        [(Compression::ZIP1, true), (Compression::RLE, false), (Compression::Uncompressed, false)]
    {
        corpus.push((with_compression(&path, compression), &color, checked));
    }
    // The measurement must see what it is to forbid.
    let (_, peak) = peak_of(|| drop(std::hint::black_box(vec![1_u8; 2 * allowed(10_000)])));
    assert!(peak > allowed(10_000));

    static PANIC: Mutex<String> = Mutex::new(String::new());
    let message = || PANIC.lock().unwrap_or_else(PoisonError::into_inner);
    std::panic::set_hook(Box::new(move |info| *message() = info.to_string()));
    let asked = std::env::var("NST_FUZZ_CASES").ok();
    let count = asked.map_or(CASES_PER_FILE, |n| n.parse().expect("NST_FUZZ_CASES is a number"));
    let mut failures = Vec::new();
    let (mut refused, mut read_well, mut unnoticed, mut cases) = (0, 0, 0, 0);
    for (seed, (sound, original, checked)) in corpus.iter().enumerate() {
        std::fs::write(&path, sound).expect("the file");
        assert_eq!(read(&path).as_ref(), Ok(*original), "file {seed}");
        let blocks = original.info.size[1].div_ceil(if seed < 2 { 16 } else { 1 }) as usize;
        // The table of blocks ends where the first block begins, which it tells.
        let header = (0..sound.len() - 8 * blocks)
            .find(|&i| sound[i..i + 8] == ((i + 8 * blocks) as u64).to_le_bytes())
            .expect("a table")
            + 8 * blocks;
        for case in 0..count {
            let mut random = SplitMix64((seed as u64) << 32 | case);
            let mut bytes = sound.clone();
            damage(&mut bytes, header, &mut random);
            let untouched = bytes.get(..header) == Some(&sound[..header]);
            std::fs::write(&path, &bytes).expect("the file");
            let (result, peak) = peak_of(|| catch_unwind(|| read(&path)));
            cases += 1;
            let name = || format!("file {seed}, case {case}");
            match result {
                Err(_) => failures.push(format!("{}: {}", name(), message())),
                Ok(Err(_)) => refused += 1,
                Ok(Ok(read)) if untouched && *checked && read != **original => unnoticed += 1,
                Ok(Ok(_)) => read_well += 1,
            }
            if peak > allowed(bytes.len()) {
                failures.push(format!("{}: {peak} bytes for {}", name(), bytes.len()));
            }
        }
    }
    drop(std::panic::take_hook());
    println!("{cases} cases: {refused} refused, {read_well} read, {unnoticed} wrongly");
    assert!(
        failures.is_empty(),
        "{} failures: {:#?}",
        failures.len(),
        &failures[..failures.len().min(20)]
    );
    assert!(cases >= 10_000 && refused > cases / 4 && read_well > cases / 100);
    // zlib's checksum (Adler-32) tells damaged pixels, unless it is the same for both: one of
    // 100 000 cases, in which four bytes are off by 63, -63, -63 and 63.
    assert!(unnoticed <= cases / 10_000, "{unnoticed} damaged pictures were read");
}

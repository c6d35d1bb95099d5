//! Damaged EXR pictures of other programs: reading them gives an error or a picture;
//! it never panics, and never asks for memory that the file's length does not justify.
//!
//! It is the only test of its binary, so that nothing else moves the peak.
//! `NST_FUZZ_CASES=20000 cargo test -p nst-files --test fuzz_picture` tries more.

mod fuzz;

use std::{
    panic::catch_unwind,
    path::Path,
    sync::{Mutex, PoisonError},
};

use exr::prelude::*;
use nst_core::random::SplitMix64;
use nst_files::{header::ExrHeader, picture::Picture};

use fuzz::{damage_blindly, peak_of, pick, put_number};

/// Cases for each file, unless the environment asks for others.
const CASES_PER_FILE: u64 = 750;

/// What reading a file of `bytes` bytes may allocate at once. Deflate makes 1032 bytes
/// out of one; they are there decompressed, in the decompressor's other buffers, and as
/// lanes, and 16 bits become 32.
fn allowed(bytes: usize) -> usize {
    (4 << 20) + 8 * 1032 * bytes
}

/// Damages a file in one to three ways, mostly within its first `header` bytes.
fn damage(bytes: &mut Vec<u8>, header: usize, random: &mut SplitMix64) {
    const NAMES: [&[u8]; 6] =
        [b"channels\0", b"compression\0", b"dataWindow\0", b"tiles\0", b"chunkCount\0", b"type\0"];
    for _ in 0..1 + random.below(3) {
        if bytes.is_empty() {
            return;
        }
        let end = if random.below(2) == 0 { bytes.len() } else { header.min(bytes.len()) };
        match random.below(8) {
            0..=5 => damage_blindly(bytes, end, random),
            n => {
                let name = pick(random, &NAMES);
                let place = bytes.windows(name.len()).position(|part| part == name);
                let at = match place {
                    Some(place) if n == 7 => place + name.len() + random.below(32),
                    _ => random.below(end),
                };
                put_number(bytes, at, random);
            }
        }
    }
}

/// A smooth picture in three types, with some noise that costs the compressors effort.
fn layer(name: &str, compression: Compression, blocks: Blocks) -> Layer<AnyChannels<FlatSamples>> {
    let size = Vec2(21, 40);
    let mut random = SplitMix64(1);
    let mut values =
        || (0..size.area()).map(|i| (i / 40) as f32 + random.below(4) as f32).collect::<Vec<f32>>();
    let half = |values: Vec<f32>| FlatSamples::F16(values.into_iter().map(f16::from_f32).collect());
    let whole = |values: Vec<f32>| FlatSamples::U32(values.into_iter().map(|x| x as u32).collect());
    let channels = [
        AnyChannel::new("R", half(values())),
        AnyChannel::new("G", FlatSamples::F32(values())),
        AnyChannel::new("B", half(values())),
        AnyChannel::new("id", whole(values())),
    ];
    let line_order = match blocks {
        Blocks::ScanLines => LineOrder::Increasing,
        Blocks::Tiles(_) => LineOrder::Unspecified,
    };
    let encoding = Encoding { compression, blocks, line_order };
    let channels = AnyChannels::sort(channels.into_iter().collect());
    Layer::new(size, LayerAttributes::named(name), encoding, channels)
}

fn corpus() -> Vec<Vec<u8>> {
    let bytes = |layers: Vec<Layer<AnyChannels<FlatSamples>>>| {
        let size = layers[0].size;
        let image = Image::from_layers(ImageAttributes::with_size(size), layers);
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write().to_buffered(&mut bytes).expect("it can be written");
        bytes.into_inner()
    };
    use Compression::{B44, B44A, DWAA, DWAB, PIZ, PXR24, RLE, Uncompressed, ZIP1, ZIP16};
    let tiles = Blocks::Tiles(Vec2(16, 16));
    let compressions =
        [Uncompressed, RLE, ZIP1, ZIP16, PIZ, PXR24, B44, B44A, DWAA(None), DWAB(None)];
    let mut corpus: Vec<_> =
        compressions.into_iter().map(|c| bytes(vec![layer("x", c, Blocks::ScanLines)])).collect();
    for compression in [Uncompressed, ZIP16, PIZ] {
        corpus.push(bytes(vec![layer("x", compression, tiles)]));
    }
    corpus.push(bytes(vec![layer("x", ZIP16, Blocks::ScanLines), layer("y", PIZ, tiles)]));
    corpus
}

/// Reads every layer of a file, in two strips.
fn read(path: &Path) -> std::result::Result<usize, nst_files::Error> {
    let header = ExrHeader::read(path)?;
    let mut lanes = 0;
    for layer in header.layers() {
        let picture = Picture::open(path, Some(&layer.name))?;
        let [width, height] = picture.size;
        let middle = height / 3;
        let read = picture.read_rows(0..middle)?.len() + picture.read_rows(middle..height)?.len();
        assert_eq!(read, picture.channel_names.len() * width as usize * height as usize);
        lanes += read;
    }
    Ok(lanes)
}

#[test]
fn damaged_pictures_are_refused_or_read() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("x.exr");
    // The measurement must see what it is to forbid.
    let (_, peak) = peak_of(|| drop(std::hint::black_box(vec![1_u8; 2 * allowed(10_000)])));
    assert!(peak > allowed(10_000));

    let corpus = corpus();
    for (seed, sound) in corpus.iter().enumerate() {
        std::fs::write(&path, sound).expect("the file");
        assert!(read(&path).expect("a sound file") > 0, "file {seed}");
    }

    static PANIC: Mutex<String> = Mutex::new(String::new());
    let message = || PANIC.lock().unwrap_or_else(PoisonError::into_inner);
    std::panic::set_hook(Box::new(move |info| *message() = info.to_string()));
    let asked = std::env::var("NST_FUZZ_CASES").ok();
    let count = asked.map_or(CASES_PER_FILE, |n| n.parse().expect("NST_FUZZ_CASES is a number"));
    let mut failures = Vec::new();
    let (mut refused, mut accepted) = (0, 0);
    for (seed, sound) in corpus.iter().enumerate() {
        for case in 0..count {
            let mut random = SplitMix64((seed as u64) << 32 | case);
            let mut bytes = sound.clone();
            damage(&mut bytes, 700, &mut random);
            std::fs::write(&path, &bytes).expect("the file");
            let (result, peak) = peak_of(|| catch_unwind(|| read(&path)));
            match result {
                Err(_) => failures.push(format!("file {seed}, case {case}: {}", message())),
                Ok(Err(_)) => refused += 1,
                Ok(Ok(_)) => accepted += 1,
            }
            if peak > allowed(bytes.len()) {
                let what = format!("file {seed}, case {case}: {peak} bytes for {}", bytes.len());
                failures.push(what);
            }
        }
    }
    drop(std::panic::take_hook());
    println!("{refused} refused, {accepted} read");
    let some = &failures[..failures.len().min(20)];
    assert!(failures.is_empty(), "{} failures: {some:#?}", failures.len());
    assert!(refused > accepted / 4 && accepted > refused / 100);
}

//! Side channels of sequence files: those that are known must be as they should be, and
//! others are handed on or left aside.

use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, FlatSamples, ReadChannels, ReadLayers, WritableImage, f16,
};
use ndarray::Array2;
use nst_core::{FOLDS, Grid, Keep, LaneSums, Power, PowerSums, SampleSums, SequenceBatch, Side};
use nst_files::{
    ColorModel, Error,
    merge::Merge,
    output::OutputFile,
    sequence_file::{ResumeInfo, SequenceFile, SequenceInfo},
};

const SIZE: [u32; 2] = [3, 2];
const PIXELS: usize = 6;

/// A sequence of one term, with all side channels that are known.
fn write(path: &Path) {
    let grid = Grid::new(SIZE[0], SIZE[1], 3, 0).expect("a grid");
    let terms = Array2::from_shape_fn((1, grid.lanes()), |(_, lane)| lane as f32);
    let mut batch = SequenceBatch::new(terms, vec![8]).expect("a batch");
    batch.set_grid(grid).expect("its lanes");
    for side in Side::ALL_FOLDS.iter().chain([&Side::Variance]) {
        batch.set_side(side.clone(), vec![1.0; grid.lanes()]).expect("a number per lane");
    }
    batch.set_side(Side::Skipped, vec![0.0; PIXELS]).expect("a number per pixel");
    let info = SequenceInfo {
        size: SIZE,
        model: ColorModel::Rgb,
        sample_counts: vec![8],
        sides: batch.sides().map(|(side, _)| side.clone()).collect(),
        scene: String::new(),
        sampler: String::new(),
        seeds: Vec::new(),
        render_seconds: 0.0,
        resume: None,
    };
    let mut output = OutputFile::create(path).expect("a file");
    SequenceFile { info, batch, sums: None }.write(&mut output).expect("it can be written");
    output.commit().expect("it can be renamed");
}

/// The layers and channels of a file, by name.
struct Channels(Vec<AnyChannel<FlatSamples>>);

impl Channels {
    fn remove(&mut self, wanted: impl Fn(&str) -> bool) {
        let before = self.0.len();
        self.0.retain(|channel| !wanted(&channel.name.to_string()));
        assert!(self.0.len() < before, "there is no such channel");
    }

    fn put(&mut self, name: &str, samples: FlatSamples) {
        self.0.retain(|channel| channel.name.to_string() != name);
        self.0.push(AnyChannel::new(name, samples));
    }

    fn put_layer(&mut self, layer: &str) {
        for channel in ["R", "G", "B"] {
            self.put(&format!("{layer}.{channel}"), FlatSamples::F32(vec![2.0; PIXELS]));
        }
    }
}

/// Reads the sequence after the exr crate has written it with other channels.
fn read_changed(change: impl FnOnce(&mut Channels)) -> Result<SequenceFile, Error> {
    read_changed_of(write, change)
}

/// The same of a file that is written so.
fn read_changed_of(
    write: impl FnOnce(&Path),
    change: impl FnOnce(&mut Channels),
) -> Result<SequenceFile, Error> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("seq.exr");
    write(&path);
    let read = exr::prelude::read().no_deep_data().largest_resolution_level();
    let read = read.all_channels().first_valid_layer().all_attributes();
    let mut image = read.from_file(&path).expect("a sound file");
    let list = std::mem::take(&mut image.layer_data.channel_data.list);
    let mut channels = Channels(list.into_iter().collect());
    change(&mut channels);
    image.layer_data.channel_data = AnyChannels::sort(channels.0.into_iter().collect());
    image.write().to_file(&path).expect("it can be written");
    SequenceFile::read(&path)
}

#[test]
fn a_known_side_channel_that_is_broken_is_named() {
    type Change = fn(&mut Channels);
    let cases: [(&str, Change); 7] = [
        ("'fold1.G' is missing", |it| it.remove(|name| name == "fold1.G")),
        ("'Variance.R' is missing", |it| it.remove(|name| name == "Variance.R")),
        ("'Variance.B' is not of type F32", |it| {
            it.put("Variance.B", FlatSamples::U32(vec![1; PIXELS]));
        }),
        ("'fold0.R' is subsampled or of 16 bits", |it| {
            it.put("fold0.R", FlatSamples::F16(vec![f16::ONE; PIXELS]));
        }),
        // It has one number per pixel.
        ("'Skipped.Y' is missing", |it| {
            it.remove(|name| name == "Skipped.Y");
            it.put_layer("Skipped");
        }),
        ("'Skipped.Y' is not of type F32", |it| {
            it.put("Skipped.Y", FlatSamples::U32(vec![1; PIXELS]));
        }),
        // A whole fold less than the header says.
        ("'nst.folds' must be the number of its folds (3)", |it| {
            it.remove(|name| name.starts_with("fold3."));
        }),
    ];
    for (words, change) in cases {
        let error = read_changed(change).expect_err(words).to_string();
        assert!(error.contains("seq.exr'") && error.contains(words), "'{words}': {error}");
    }
    assert!(read_changed(|_| {}).is_ok(), "the file itself is sound");
}

#[test]
fn layers_with_names_like_folds_are_no_folds() {
    for name in ["foldout", "fold4", "fold01", "fold", "variance"] {
        let file = read_changed(|it| it.put_layer(name)).expect(name);
        let folds = file.info.sides.iter().filter(|side| matches!(side, Side::Fold(_)));
        assert_eq!(folds.count(), FOLDS, "{name}");
        let side = Side::Other(name.to_owned());
        assert_eq!(file.batch.side(&side), Some(&[2.0; 3 * PIXELS][..]), "{name}");
    }
}

#[test]
fn layers_that_are_not_known_may_be_of_any_kind() {
    let sides = read_changed(|_| {}).expect("a sound file").info.sides;
    let file = read_changed(|it| {
        it.put("foldout.R", FlatSamples::F32(vec![1.0; PIXELS]));
        it.put("distance.Z", FlatSamples::F32(vec![1.0; PIXELS]));
        it.put_layer("id");
        it.put("id.G", FlatSamples::U32(vec![1; PIXELS]));
        it.put("A", FlatSamples::F32(vec![1.0; PIXELS]));
    });
    assert_eq!(file.expect("a sequence").info.sides, sides);
}

/// A rendering of n samples that can be continued, with the sums of some further powers.
fn resumable(n: u32, powers: &[Power]) -> SequenceFile {
    let grid = Grid::new(SIZE[0], SIZE[1], 3, 0).expect("a grid");
    let sample = |lane: usize, index: u32| f64::from(index * 7919 % 7) + 0.3 * lane as f64;
    let mut lanes = vec![LaneSums::default(); grid.lanes()];
    let mut further = PowerSums::new(powers, grid.lanes());
    for (lane, sums) in lanes.iter_mut().enumerate() {
        for index in 0..n {
            sums.add(index, sample(lane, index));
            further.add(lane, index, sample(lane, index));
        }
    }
    let last: Vec<f32> = lanes.iter().map(|sums| (sums.total() / f64::from(n)) as f32).collect();
    let mut batch = SequenceBatch::from_last(&last, n).expect("a mean of each lane");
    batch.set_grid(grid).expect("its lanes");
    batch.set_sums(&lanes, n).expect("sums of each lane");
    batch.set_power_sums(&further, n).expect("sums of each lane");
    let info = SequenceInfo {
        size: SIZE,
        model: ColorModel::Rgb,
        sample_counts: vec![n],
        sides: batch.sides().map(|(side, _)| side.clone()).collect(),
        scene: "x".into(),
        sampler: "random".into(),
        seeds: vec![0],
        render_seconds: 1.0,
        resume: Some(ResumeInfo {
            keep: Keep::Window(1),
            pixel_filter: "box".into(),
            max_depth: 8,
            russian_roulette: true,
            powers: further.powers(),
        }),
    };
    SequenceFile { info, batch, sums: Some(SampleSums { lanes, features: None, powers: further }) }
}

fn try_write(file: &SequenceFile, path: &Path) -> Result<(), Error> {
    let mut output = OutputFile::create(path).expect("a file");
    file.write(&mut output)?;
    output.commit()
}

fn powers(values: &[f64]) -> Vec<Power> {
    values.iter().map(|&p| Power::of_value(p).expect("a power of two")).collect()
}

/// Below four samples there are no power means, and still sums.
#[test]
fn sums_of_further_powers_are_stored_without_loss() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("seq.exr");
    for n in [1, 3, 4, 13] {
        for values in [&[][..], &[4.0], &[0.0625, 0.125, 0.25, 4.0, 8.0, 16.0]] {
            let file = resumable(n, &powers(values));
            try_write(&file, &path).expect("it can be written");
            assert!(SequenceFile::read(&path).expect("a sequence") == file, "{n}, {values:?}");
            let sums = SequenceFile::read_to_resume(&path).expect("a sequence").sums;
            assert!(sums == file.sums, "{n}, {values:?}");
        }
    }
}

#[test]
fn sums_of_other_powers_or_lanes_are_not_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("seq.exr");
    let two = powers(&[0.125, 16.0]);
    for other in [
        PowerSums::default(),
        PowerSums::new(&two[..1], 3 * PIXELS),
        PowerSums::new(&powers(&[0.125, 4.0]), 3 * PIXELS),
        PowerSums::new(&two, 3 * PIXELS - 1),
        PowerSums::new(&two, 3 * PIXELS + 1),
    ] {
        let mut file = resumable(8, &two);
        file.sums.as_mut().expect("its sums").powers = other;
        assert!(matches!(try_write(&file, &path), Err(Error::Mismatch(_))));
    }
    assert!(try_write(&resumable(8, &two), &path).is_ok());
}

#[test]
fn a_state_of_further_powers_that_is_broken_is_named() {
    let two = powers(&[0.125, 16.0]);
    let read = |n: u32, change: fn(&mut Channels)| {
        let write = |path: &Path| try_write(&resumable(n, &two), path).expect("it can be written");
        read_changed_of(write, change)
    };
    type Change = fn(&mut Channels);
    let cases: [(&str, Change); 5] = [
        ("'state.power16fold2.lo.G' is missing", |it| {
            it.remove(|name| name == "state.power16fold2.lo.G");
        }),
        ("'state.root8fold0.hi.R' is missing", |it| {
            it.remove(|name| name.starts_with("state.root8fold0"));
        }),
        ("'state.root8fold1.hi.B' is not of type U32", |it| {
            it.put("state.root8fold1.hi.B", FlatSamples::F32(vec![1.0; PIXELS]));
        }),
        ("layer 'root8fold1' is missing, without which its state", |it| {
            it.remove(|name| name.starts_with("root8fold1"));
        }),
        ("column 2, row 1: its sums ('state.…') contradict its means", |it| {
            let words = FlatSamples::U32(vec![0, 0, 0, 0, 0, 1 << 20]);
            it.put("state.power16fold3.hi.R", words);
        }),
    ];
    for (words, change) in cases {
        let error = read(8, change).expect_err(words).to_string();
        assert!(error.contains("seq.exr'") && error.contains(words), "'{words}': {error}");
    }
    assert!(read(8, |_| {}).is_ok_and(|file| file == resumable(8, &two)));
    // Without all sums of a power, a rendering goes on with the others.
    for n in [3, 8] {
        let file = read(n, |it| it.remove(|name| name.starts_with("state.power16")));
        let file = file.expect("a sequence");
        let sums = file.sums.expect("its sums").powers;
        let wanted = resumable(n, &two[..1]).sums.expect("its sums").powers;
        assert!(sums == wanted, "{n}");
        assert_eq!(file.info.further_powers(), wanted.powers());
    }
}

/// The power means of merged files are those of all their samples.
#[test]
fn power_means_are_merged() {
    let folder = tempfile::tempdir().expect("a folder");
    let grid = Grid::new(SIZE[0], SIZE[1], 3, 0).expect("a grid");
    let powers = powers(&[0.125, 16.0]);
    // Samples from 10⁻³ to 10³, whose powers f32 could not contain.
    let sample = |i: usize| 10.0_f32.powi((i * 7919 % 7) as i32 - 3) * (1 + i % 3) as f32;
    let samples: Vec<f32> = (0..16 * grid.lanes()).map(sample).collect();
    let batch = |samples: &[f32]| {
        let batch = SequenceBatch::from_samples_with(grid.lanes(), samples, &powers);
        let mut batch = batch.expect("samples of all lanes");
        batch.set_grid(grid).expect("its lanes");
        batch
    };
    let paths = [0, 1].map(|seed| folder.path().join(format!("{seed}.exr")));
    for ((path, samples), seed) in paths.iter().zip(samples.chunks(8 * grid.lanes())).zip(0..) {
        let batch = batch(samples);
        let info = SequenceInfo {
            size: SIZE,
            model: ColorModel::Rgb,
            sample_counts: (1..=8).collect(),
            sides: batch.sides().map(|(side, _)| side.clone()).collect(),
            scene: String::new(),
            sampler: String::new(),
            seeds: vec![seed],
            render_seconds: 0.0,
            resume: None,
        };
        let mut output = OutputFile::create(path).expect("a file");
        SequenceFile { info, batch, sums: None }.write(&mut output).expect("it can be written");
        output.commit().expect("it can be renamed");
    }
    let merged = folder.path().join("merged.exr");
    let mut output = OutputFile::create(&merged).expect("a file");
    Merge::open(&paths).expect("alike").write(&mut output).expect("it can be written");
    output.commit().expect("it can be renamed");
    let merged = SequenceFile::read(&merged).expect("a sequence").batch;
    let all = batch(&samples);
    for side in powers.iter().flat_map(|&power| Side::power_means(power)) {
        let [found, wanted] = [&merged, &all].map(|batch| batch.side(&side).expect("a mean"));
        for (found, wanted) in found.iter().zip(wanted) {
            // Each file's means are rounded to f32, and so is the merged one.
            assert!((found / wanted - 1.0).abs() < 3e-7, "{side}: {found}, not {wanted}");
        }
    }
}

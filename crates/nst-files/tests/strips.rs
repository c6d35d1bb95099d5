//! Strip by strip, every method gives the bits that it gives in memory.

use std::{ops::Range, path::Path};

use exr::prelude::{Compression, ReadChannels, ReadLayers, WritableImage};
use ndarray::Array2;
use nst_core::{
    Error as CoreError, Estimates, Fitted, Grid, MlpCpu, Network, Requirements, SequenceBatch,
    Status, Strips, Support, Transform, methods, random::SplitMix64,
};
use nst_files::{
    ColorModel,
    output::OutputFile,
    sequence_file::{SequenceFile, SequenceInfo, SequenceReader},
};

type Checked = Result<(), Box<dyn std::error::Error>>;

/// Four strips of 32 rows, and then one of 9.
const SIZE: [u32; 2] = [31, 137];

const TERMS: usize = 16;

/// Heights of strips: the least, some, all but nine rows, and the whole picture.
const STRIP_ROWS: [u32; 5] = [16, 32, 64, 128, 137];

/// Noisy sequences that fall towards limits of all magnitudes: what is summed over them
/// depends on the order in which it is summed.
fn sequence() -> SequenceFile {
    let model = ColorModel::Rgb;
    let [width, height] = SIZE;
    let grid = Grid::new(width, height, 3, 0).expect("a grid");
    let mut random = SplitMix64(7);
    let limits: Vec<f64> =
        (0..grid.lanes()).map(|_| (8.0 * random.uniform() - 4.0).exp2()).collect();
    // Half of the samples are black.
    let mut sample = |limit: &f64| {
        let light = if random.uniform() < 0.5 { 2.0 } else { 0.0 };
        (limit * light * (0.5 + random.uniform())) as f32
    };
    let samples: Vec<f32> =
        (0..TERMS).flat_map(|_| limits.iter().map(&mut sample).collect::<Vec<_>>()).collect();
    let mut batch = SequenceBatch::from_samples(grid.lanes(), &samples).expect("a batch");
    batch.set_grid(grid).expect("its lanes");
    let counts = batch.sample_counts().to_vec();
    let info = SequenceInfo {
        size: SIZE,
        model,
        sample_counts: counts,
        sides: batch.sides().map(|(side, _)| side.clone()).collect(),
        scene: String::new(),
        sampler: String::new(),
        seeds: Vec::new(),
        render_seconds: 0.0,
        resume: None,
    };
    SequenceFile { info, batch, sums: None }
}

fn write(file: &SequenceFile, path: &Path) -> Checked {
    let mut output = OutputFile::create(path)?;
    file.write(&mut output)?;
    Ok(output.commit()?)
}

/// The bits of all estimates, planar, their statuses, and the number of strips.
type Whole = (Vec<u32>, Vec<Status>, usize);

/// Fits and applies a method as `nst transform` does.
fn by_strips(method: &dyn Transform, mut reader: SequenceReader) -> Result<Whole, CoreError> {
    let [width, height] = SIZE.map(|length| length as usize);
    let fitted = method.fit(&mut reader)?;
    reader.rewind(method.requires().halo())?;
    let mut bits = vec![0; 3 * width * height];
    let mut status = vec![Status::Ok; bits.len()];
    let (mut row, mut strips) = (0, 0);
    let mut out = Estimates::default();
    while let Some(strip) = reader.next_strip()? {
        fitted.apply(&strip, &mut out)?;
        let inner = strip.grid().expect("strips of a file have one").inner_rows().len() * width;
        assert_eq!(out.values().len(), 3 * inner, "without the halo");
        for channel in 0..3 {
            let to = channel * width * height + row * width;
            for i in 0..inner {
                bits[to + i] = out.values()[channel * inner + i].to_bits();
                status[to + i] = out.status()[channel * inner + i];
            }
        }
        (row, strips) = (row + inner / width, strips + 1);
    }
    assert_eq!(row, height);
    Ok((bits, status, strips))
}

/// Compares strips of every height with the batch in memory, which `method` must not leave
/// as it is.
fn check(name: &str, method: &dyn Transform) -> Checked {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("seq.exr");
    let file = sequence();
    write(&file, &path)?;
    let mut whole = Estimates::default();
    method.transform(&file.batch, &mut whole)?;
    assert!(whole.values() != file.batch.last(), "{name} leaves all as it is");
    let expected: Vec<u32> = whole.values().iter().map(|x| x.to_bits()).collect();
    for rows in STRIP_ROWS {
        let reader = SequenceReader::open(&path)?.with_strip_rows(rows);
        let (bits, status, strips) = by_strips(method, reader)?;
        assert_eq!(strips, SIZE[1].div_ceil(rows) as usize);
        assert!(bits == expected, "{name}: other estimates in strips of {rows} rows");
        assert!(status == whole.status(), "{name}: other statuses in strips of {rows} rows");
    }
    Ok(())
}

#[test]
fn every_method_gives_the_bits_that_it_gives_in_memory() -> Checked {
    for &(name, _) in methods::METHODS {
        let method = methods::method(name).expect("it is listed");
        check(name, &*method)?;
    }
    let network = Network::builtin("families").expect("it is in the crate")?;
    check("families", &MlpCpu::new(network))
}

/// The mean over the pixels around a pixel, in the same channel: the simplest method that
/// looks at neighbours.
struct Blur;

/// The same, but for a halo that it forgets to ask for.
struct WithoutHalo;

impl Fitted for Blur {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), CoreError> {
        let grid = strip.grid().expect("strips of a picture have one");
        let (width, rows) = (grid.width(), grid.rows());
        let mut values = Vec::new();
        for channel in 0..grid.channels() {
            for y in grid.inner_rows() {
                for x in 0..width {
                    let (mut sum, mut count) = (0.0, 0);
                    for y in y.saturating_sub(1)..rows.min(y + 2) {
                        let row = &strip.last()[grid.lanes_of(channel, y..y + 1)];
                        for &value in &row[x.saturating_sub(1)..width.min(x + 2)] {
                            (sum, count) = (sum + value, count + 1);
                        }
                    }
                    values.push(sum / count as f32);
                }
            }
        }
        *out = estimates(values)?;
        Ok(())
    }
}

/// Estimates of other crates than nst-core are what the identity makes of a batch.
fn estimates(values: Vec<f32>) -> Result<Estimates, CoreError> {
    let terms = Array2::from_shape_vec((1, values.len()), values).expect("one row");
    let mut out = Estimates::default();
    nst_core::Identity.transform(&SequenceBatch::new(terms, vec![1])?, &mut out)?;
    Ok(out)
}

impl Transform for Blur {
    fn requires(&self) -> Requirements {
        Requirements { support: Support::Radius(1), ..Requirements::of_lane(1) }
    }

    fn fit<'a>(&'a self, _: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, CoreError> {
        Ok(Box::new(self))
    }
}

impl Transform for WithoutHalo {
    fn requires(&self) -> Requirements {
        Requirements::of_lane(1)
    }

    fn fit<'a>(&'a self, _: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, CoreError> {
        Ok(Box::new(Blur))
    }
}

#[test]
fn a_method_that_looks_at_neighbours_sees_them_beyond_its_strip() -> Checked {
    check("blur", &Blur)
}

#[test]
#[should_panic(expected = "other estimates in strips of 16 rows")]
fn neighbours_that_are_missing_are_noticed() {
    check("without a halo", &WithoutHalo).expect("it runs");
}

/// What a file says of some rows, as bits: all terms, then all side channels, `[channel][pixel]`.
fn rows_of(batch: &SequenceBatch, rows: Range<usize>) -> Vec<u32> {
    let width = SIZE[0] as usize;
    let pixels = batch.grid().expect("it has one").pixels();
    let terms = (0..batch.sample_counts().len()).map(|k| batch.term(k));
    let layers = terms.chain(batch.sides().map(|(_, values)| values));
    let images = layers.flat_map(|values| values.chunks_exact(pixels));
    let images = images.flat_map(|image| &image[rows.start * width..rows.end * width]);
    images.map(|value| value.to_bits()).collect()
}

/// Compares the next strip with the same rows in memory; the row that it ends before, without
/// its halo, or `None` after the last.
fn next_row(
    reader: &mut SequenceReader,
    [rows, halo]: [u32; 2],
    start: u32,
    whole: &SequenceBatch,
) -> Result<Option<u32>, CoreError> {
    let Some(strip) = reader.next_strip()? else { return Ok(None) };
    let grid = *strip.grid().expect("strips of a file have one");
    let end = SIZE[1].min(start + rows.next_multiple_of(16));
    let outer = start.saturating_sub(halo)..SIZE[1].min(end + halo);
    assert_eq!(grid.first_row(), outer.start);
    assert_eq!(grid.rows(), outer.len());
    let inner = (start - outer.start) as usize..(end - outer.start) as usize;
    assert_eq!(grid.inner_rows(), inner);
    let expected = rows_of(whole, outer.start as usize..outer.end as usize);
    assert!(rows_of(&strip, 0..grid.rows()) == expected, "{rows} {halo} {start}");
    Ok(Some(end))
}

/// Stores a file again as other programs may.
fn store_again(path: &Path, compression: Compression) -> Checked {
    let read = exr::prelude::read().no_deep_data().largest_resolution_level();
    let mut image = read.all_channels().first_valid_layer().all_attributes().from_file(path)?;
    image.layer_data.encoding.compression = compression;
    Ok(image.write().to_file(path)?)
}

/// Halos of nothing, within a block, of a block, of more than a strip, and of nothing again.
const HALOS: [u32; 8] = [0, 1, 12, 16, 17, 40, 200, 0];

#[test]
fn strips_and_their_halos_are_the_rows_of_the_file() -> Checked {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("seq.exr");
    let whole = sequence();
    write(&whole, &path)?;
    for stored in [None, Some(Compression::ZIP1), Some(Compression::RLE)] {
        stored.map_or(Ok(()), |compression| store_again(&path, compression))?;
        for rows in STRIP_ROWS {
            let mut reader = SequenceReader::open(&path)?.with_strip_rows(rows);
            for (i, halo) in HALOS.into_iter().enumerate() {
                // What a pass that ends early has read is not what the next begins with.
                reader.rewind(halo)?;
                let (mut start, mut left) = (0, if i % 2 == 0 { 2 } else { usize::MAX });
                while left > 0
                    && let Some(end) = next_row(&mut reader, [rows, halo], start, &whole.batch)?
                {
                    (start, left) = (end, left - 1);
                }
                assert!(left == 0 || start == SIZE[1]);
            }
        }
    }
    Ok(())
}

/// Reads all strips until one cannot be read; the rows that were read, and the error's message.
fn read_until_damage(path: &Path, whole: &SequenceBatch, [rows, halo]: [u32; 2]) -> (u32, String) {
    let reader = SequenceReader::open(path).expect("the header is sound");
    let mut reader = reader.with_strip_rows(rows);
    reader.rewind(halo).expect("it can");
    let mut start = 0;
    loop {
        match next_row(&mut reader, [rows, halo], start, whole) {
            Ok(end) => start = end.expect("the damage is noticed"),
            Err(error) => {
                // Whoever goes on gets a strip, an error or the end, and all is as before from the
                // first strip on.
                while let Ok(Some(_)) = reader.next_strip() {}
                reader.rewind(halo).expect("it can");
                let again = next_row(&mut reader, [rows, halo], 0, whole);
                assert_eq!(again.is_ok(), start > 0);
                return (start, error.to_string());
            }
        }
    }
}

#[test]
fn damage_in_the_middle_is_an_error_that_says_where() -> Checked {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("seq.exr");
    let whole = sequence();
    write(&whole, &path)?;
    let sound = std::fs::read(&path)?;
    // Nine blocks; the table of where they begin ends where the first does.
    let blocks = SIZE[1].div_ceil(16) as usize;
    let number = |place: usize| u64::from_le_bytes(*sound[place..].first_chunk().expect("8 bytes"));
    let table = (0..sound.len() - 8 * blocks).find(|&i| number(i) == (i + 8 * blocks) as u64);
    let table = table.expect("a table of blocks");
    let block = |i: usize| number(table + 8 * i) as usize;
    let flipped = |place: usize| {
        let mut bytes = sound.clone();
        bytes[place] ^= 0x55;
        bytes
    };
    let cases = [
        ("bytes of block 5", flipped((block(5) + block(6)) / 2)),
        ("checksum of block 5", flipped(block(6) - 1)),
        ("row of block 5", flipped(block(5))),
        ("size of block 5", flipped(block(5) + 5)),
        ("end within block 5", sound[..(block(5) + block(6)) / 2].to_vec()),
        ("end before block 5", sound[..block(5)].to_vec()),
    ];
    for (what, bytes) in cases {
        std::fs::write(&path, &bytes)?;
        for rows in STRIP_ROWS {
            for halo in HALOS {
                let (start, message) = read_until_damage(&path, &whole.batch, [rows, halo]);
                let name = format!("{what}, {rows} rows, halo {halo}: {message}");
                assert!(message.contains("seq.exr': rows from 80: "), "{name}");
                assert!(message.ends_with("the file is cut off or damaged"), "{name}");
                // All strips that do not reach rows 80 to 95 were read.
                let end = SIZE[1].min(start + rows.next_multiple_of(16)) + halo;
                assert!((start == 0 || start + halo <= 80) && end > 80, "{name}");
            }
        }
    }
    Ok(())
}

//! ZIP compression of blocks of 32-bit samples, as OpenEXR defines it (`ImfZip.cpp` of
//! OpenEXR): all even bytes, then all odd ones; of these the differences between neighbours,
//! plus 128; of these a zlib stream.

use miniz_oxide::deflate::core::{
    CompressionStrategy, CompressorOxide, TDEFLFlush, TDEFLStatus, compress as deflate,
    create_comp_flags_from_zip_params,
};

use super::parts::SAMPLE;

/// The effort of Deflate, from 0 to 10. The lower bytes of noisy floats are random, so that
/// searching longer for what repeats is in vain: of a noisy rendering, level 1 leaves 92.6 %, and
/// the file is there in a quarter of the time in which the exr crate, with level 4, leaves 91.3 %
/// (docs/writing.csv).
const LEVEL: i32 = 1;

/// Asks for the header of a zlib stream.
const ZLIB: i32 = 1;

/// Compresses a block: its rows, channel by channel, each the native bytes of its samples.
/// A block that would not become smaller is returned as it is, in little-endian order, as
/// OpenEXR stores it.
pub(super) fn compress(rows: &[&[u8]]) -> Vec<u8> {
    let differences = differences(rows);
    let flags = create_comp_flags_from_zip_params(LEVEL, ZLIB, CompressionStrategy::Default as i32);
    let mut compressor = CompressorOxide::new(flags);
    let mut compressed = vec![0; differences.len().saturating_sub(1)];
    let (status, _, length) =
        deflate(&mut compressor, &differences, &mut compressed, TDEFLFlush::Finish);
    if status == TDEFLStatus::Done {
        compressed.truncate(length);
        return compressed;
    }
    rows.iter().flat_map(|row| row.as_chunks().0).flat_map(|&sample| bytes(sample)).collect()
}

/// The bytes of a sample in little-endian order.
fn bytes(sample: [u8; SAMPLE]) -> [u8; SAMPLE] {
    u32::from_ne_bytes(sample).to_le_bytes()
}

/// The differences that are to be compressed.
fn differences(rows: &[&[u8]]) -> Vec<u8> {
    let difference = |byte: u8, before: u8| byte.wrapping_sub(before).wrapping_add(128);
    let length: usize = rows.iter().map(|row| row.len()).sum();
    let mut differences = vec![0; length];
    let (mut even, mut odd) = differences.split_at_mut(length / 2);
    let mut before = [0; SAMPLE];
    for row in rows {
        let (row_even, rest_even) = even.split_at_mut(row.len() / 2);
        let (row_odd, rest_odd) = odd.split_at_mut(row.len() / 2);
        let places = row_even.as_chunks_mut().0.iter_mut().zip(row_odd.as_chunks_mut().0);
        for (&sample, (even, odd)) in row.as_chunks().0.iter().zip(places) {
            let sample = bytes(sample);
            let [a, b, c, d] = sample;
            *even = [difference(a, before[2]), difference(c, a)];
            *odd = [difference(b, before[3]), difference(d, b)];
            before = sample;
        }
        (even, odd) = (rest_even, rest_odd);
    }
    // The first byte has none before it; before the first odd one comes the last even one.
    let first = rows.iter().find_map(|row| row.first_chunk());
    if let Some(&first) = first {
        let [a, b, ..] = bytes(first);
        differences[0] = a;
        differences[length / 2] = difference(b, before[2]);
    }
    differences
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The slow and obvious way.
    fn slow_differences(rows: &[&[u8]]) -> Vec<u8> {
        let samples = rows.iter().flat_map(|row| row.as_chunks().0);
        let all: Vec<u8> = samples.flat_map(|&sample| bytes(sample)).collect();
        let parts = [0, 1].map(|part| all.iter().copied().skip(part).step_by(2));
        let sorted: Vec<u8> = parts.into_iter().flatten().collect();
        let difference = |i: usize| match i {
            0 => sorted[0],
            _ => (i16::from(sorted[i]) - i16::from(sorted[i - 1]) + 128) as u8,
        };
        (0..sorted.len()).map(difference).collect()
    }

    fn noise(length: usize) -> Vec<u8> {
        let mut x = 1_u32;
        let mut byte = || {
            // Numerical Recipes' generator; its upper bits are good enough.
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (x >> 24) as u8
        };
        (0..length).map(|_| byte()).collect()
    }

    #[test]
    fn differences_are_those_of_the_slow_way() {
        for lengths in [&[4][..], &[8, 8], &[52, 52, 52], &[400], &[0, 4]] {
            let rows: Vec<Vec<u8>> = lengths.iter().map(|&length| noise(length)).collect();
            let rows: Vec<&[u8]> = rows.iter().map(|row| &row[..]).collect();
            assert_eq!(differences(&rows), slow_differences(&rows), "{lengths:?}");
        }
    }

    #[test]
    fn noise_is_stored_as_it_is_and_the_rest_is_smaller() {
        let row = noise(4000);
        let stored: Vec<u8> = row.as_chunks().0.iter().flat_map(|&sample| bytes(sample)).collect();
        assert_eq!(compress(&[&row]), stored);
        let flat = 0.5_f32.to_ne_bytes().repeat(1000);
        assert!(compress(&[&flat, &flat]).len() < 200);
        assert!(compress(&[]).is_empty());
    }
}

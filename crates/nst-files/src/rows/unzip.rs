//! Decompression of ZIP blocks of 32-bit samples, of which only some channels are wanted: the
//! inverse of [`zip`](super::zip).
//!
//! A block of a sequence may have tens of megabytes. It is decompressed some hundred kilobytes
//! at a time, which stay in the processor's cache until the samples are where they are wanted.

use flate2::{Decompress, FlushDecompress, Status};

/// Bytes that are decompressed at a time, unless a row has more: several times Deflate's window
/// of 32 KiB, and little enough for the cache.
const AT_ONCE: usize = 1 << 18;

/// Of the bytes of each sample, the first and the third, which a block has first, or the second and
/// the fourth.
#[derive(Clone, Copy)]
enum Half {
    Even,
    Odd,
}

/// Decompresses a block whose rows have `width` samples of each channel. `rows` is `[row][channel]`:
/// where the samples go, or nothing for those that are not wanted. Fails if the block is damaged, or
/// has another number of samples.
pub(super) fn decompress(
    block: &[u8],
    width: usize,
    rows: &mut [Option<&mut [u32]>],
) -> Result<(), &'static str> {
    let mut stream = Stream { inflate: Decompress::new(true), rest: block, ended: false };
    let length = 2 * width;
    let at_once = (AT_ONCE / length).clamp(1, rows.len());
    let mut bytes = vec![0; at_once * length];
    // Before the first byte there is none: it is stored as it is, without 128.
    let mut before = 128;
    for half in [Half::Even, Half::Odd] {
        for rows in rows.chunks_mut(at_once) {
            let bytes = &mut bytes[..rows.len() * length];
            stream.fill(bytes)?;
            for (row, bytes) in rows.iter_mut().zip(bytes.chunks_exact_mut(length)) {
                let Some(row) = row else {
                    // As many bytes are even, 128 for each of them is 0.
                    before = bytes.iter().fold(before, |sum: u8, &byte| sum.wrapping_add(byte));
                    continue;
                };
                before = sums(bytes, before);
                put(row, bytes, half);
            }
        }
    }
    stream.finish()
}

/// A zlib stream.
struct Stream<'a> {
    inflate: Decompress,
    rest: &'a [u8],
    ended: bool,
}

impl Stream<'_> {
    /// Decompresses the next bytes.
    fn fill(&mut self, mut out: &mut [u8]) -> Result<(), &'static str> {
        while !out.is_empty() {
            let written = if self.ended { 0 } else { self.advance(out)? };
            if written == 0 {
                return Err("they end too early");
            }
            out = &mut out[written..];
        }
        Ok(())
    }

    /// Decompresses some bytes, and says how many; none at the end, or where what follows is
    /// missing.
    fn advance(&mut self, out: &mut [u8]) -> Result<usize, &'static str> {
        let [read, written] = [self.inflate.total_in(), self.inflate.total_out()];
        let status = self.inflate.decompress(self.rest, out, FlushDecompress::None);
        self.ended = status.map_err(|_| "their compressed bytes are wrong")? == Status::StreamEnd;
        self.rest = &self.rest[(self.inflate.total_in() - read) as usize..];
        Ok((self.inflate.total_out() - written) as usize)
    }

    /// Fails unless this is the end of the stream, and its checksum is right.
    fn finish(mut self) -> Result<(), &'static str> {
        if !self.ended && self.advance(&mut [0])? > 0 {
            return Err("they are too many");
        }
        if self.ended { Ok(()) } else { Err("they end too early") }
    }
}

/// Turns differences plus 128 between neighbours into their sums, after the byte `before`, and
/// returns the last.
///
/// Eight bytes at a time, as four numbers of 16 bits each: in 64 bits, multiplying by
/// [`ONES`] sums such numbers.
fn sums(bytes: &mut [u8], before: u8) -> u8 {
    /// 1, four times.
    const ONES: u64 = 0x0001_0001_0001_0001;
    const LOW: u64 = 0xff * ONES;
    let mut before = u64::from(before);
    let (eights, rest) = bytes.as_chunks_mut();
    for eight in eights {
        let word = u64::from_le_bytes(*eight);
        let (first, second) = (word & LOW, (word >> 8) & LOW);
        // At most 4 · 510: nothing is carried from one number to the next.
        let pairs = (first + second).wrapping_mul(ONES);
        let start = before * ONES;
        before = (before + (pairs >> 48)) & 0xff;
        // Of every two 128, the second makes up for the first.
        let second = (pairs + start) & LOW;
        let first = (pairs - ((word >> 8) & LOW) + start + 128 * ONES) & LOW;
        *eight = (first | (second << 8)).to_le_bytes();
    }
    let mut before = before as u8;
    for byte in rest {
        before = before.wrapping_add(*byte).wrapping_sub(128);
        *byte = before;
    }
    before
}

/// Puts half of the bytes of each sample where they belong.
fn put(samples: &mut [u32], bytes: &[u8], half: Half) {
    let (pairs, _) = bytes.as_chunks();
    let parts = pairs.iter().map(|&pair: &[u8; 2]| {
        let pair = u32::from(u16::from_le_bytes(pair));
        (pair & 0xff) | ((pair & 0xff00) << 8)
    });
    let samples = samples.iter_mut().zip(parts);
    match half {
        Half::Even => samples.for_each(|(sample, part)| *sample = part),
        Half::Odd => samples.for_each(|(sample, part)| *sample |= part << 8),
    }
}

#[cfg(test)]
mod tests {
    use super::{super::zip, *};

    /// Bytes of which some repeat.
    fn samples(count: usize) -> Vec<u32> {
        let mut x = 1_u32;
        let mut sample = |i: usize| {
            // Numerical Recipes' generator.
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            if i % 7 < 6 { (i / 8) as u32 } else { x }
        };
        (0..count).map(&mut sample).collect()
    }

    /// What [`zip::compress`] makes of rows `[row][channel]` of some samples.
    fn compressed(samples: &[u32], width: usize) -> Vec<u8> {
        let rows: Vec<&[u8]> = samples.chunks_exact(width).map(bytemuck::cast_slice).collect();
        zip::compress(&rows)
    }

    /// Decompresses the rows `[row][channel]` for which `wanted` is true; others stay 0.
    fn decompressed(
        block: &[u8],
        [width, rows]: [usize; 2],
        wanted: impl Fn(usize) -> bool,
    ) -> Result<Vec<u32>, &'static str> {
        let mut out = vec![0; width * rows];
        let rows = out.chunks_exact_mut(width).enumerate();
        let mut rows: Vec<_> = rows.map(|(i, row)| wanted(i).then_some(row)).collect();
        decompress(block, width, &mut rows)?;
        Ok(out)
    }

    #[test]
    fn wanted_rows_come_back() {
        // The last one has rows of more bytes than are decompressed at a time.
        for [width, rows] in [[1, 60], [3, 20], [4, 20], [37, 31], [500, 700], [150_000, 3]] {
            let all = samples(width * rows);
            let block = compressed(&all, width);
            assert!(block.len() < 4 * all.len(), "it is compressed");
            let wants: [fn(usize) -> bool; 4] = [|_| true, |i| i % 3 == 1, |i| i > 1, |_| false];
            for wanted in wants {
                let row_of = |i: usize| i / width;
                let expected = all.iter().enumerate();
                let expected: Vec<u32> =
                    expected.map(|(i, &x)| if wanted(row_of(i)) { x } else { 0 }).collect();
                assert!(decompressed(&block, [width, rows], wanted) == Ok(expected), "{width}");
            }
        }
    }

    #[test]
    fn sums_are_those_of_the_slow_way() {
        let random: Vec<u8> = samples(50).into_iter().flat_map(u32::to_le_bytes).collect();
        for bytes in [&random[..], &[255; 40], &[0; 40], &random[..7], &random[..8], &[]] {
            for before in [0, 1, 128, 255] {
                let (mut sum, mut slow) = (before, Vec::new());
                for &byte in bytes {
                    sum = (i16::from(sum) + i16::from(byte) - 128) as u8;
                    slow.push(sum);
                }
                let mut fast = bytes.to_vec();
                assert_eq!(sums(&mut fast, before), sum);
                assert_eq!(fast, slow);
            }
        }
    }

    #[test]
    fn damaged_blocks_are_refused() {
        let (width, rows) = (50, 40);
        let block = compressed(&samples(width * rows), width);
        let read = |block: &[u8], rows: usize| decompressed(block, [width, rows], |i| i % 2 == 0);
        let good = read(&block, rows);
        assert!(good.is_ok());
        assert!(read(&block, rows - 1).is_err(), "samples that are too many");
        assert!(read(&block, rows + 1).is_err(), "samples that are missing");
        for length in 0..block.len() {
            assert!(read(&block[..length], rows).is_err(), "{length} bytes of {}", block.len());
        }
        for place in 0..block.len() {
            let mut damaged = block.clone();
            damaged[place] ^= 0x80 >> (place % 8);
            // Some bits mean nothing, as those after the last symbol; the checksum has none of them.
            let means_nothing = place + 4 < block.len() && read(&damaged, rows) == good;
            assert!(read(&damaged, rows).is_err() || means_nothing, "byte {place}");
        }
    }
}

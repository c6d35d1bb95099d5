//! Images from Radiance's files, `.hdr` and `.pic`: three mantissas and a common exponent in
//! four bytes, flat or run-length encoded, in any order of rows and columns.
//!
//! Greg Ward, *Real Pixels*, Graphics Gems II; the format: Radiance's `filefmts.pdf`.

use std::path::Path;

use super::Pixels;
use crate::{Error, load::report::Report};

/// What the first line of every such file starts with.
const MAGIC: &[u8] = b"#?";
/// The lengths of lines that may be encoded channel by channel.
const LENGTHS_BY_CHANNEL: std::ops::Range<usize> = 8..1 << 15;

/// Whether a file starts as Radiance's do.
pub(super) fn is_radiance(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Linear RGB, as it is.
pub(super) fn read(
    path: &Path,
    bytes: &[u8],
    most_bytes: u64,
    report: &mut Report,
) -> Result<Pixels, Error> {
    let malformed = |message: String| Error::image(path, message);
    let mut rest = Bytes(bytes);
    header(&mut rest, path, report).map_err(malformed)?;
    let order = Order::parse(rest.line().map_err(malformed)?).map_err(malformed)?;
    let [width, height] = order.size();
    if width as u64 * height as u64 * size_of::<[f32; 3]>() as u64 > most_bytes {
        return Err(malformed(format!(
            "{width} by {height} pixels are too many, for this program or for the file's length"
        )));
    }
    let mut texels = vec![[0.0; 3]; width * height];
    let mut line = vec![[0; 4]; order.lengths[1]];
    for number in 0..order.lengths[0] {
        decode(&mut rest, &mut line)
            .map_err(|message| malformed(format!("damaged: line {number} of pixels {message}")))?;
        for (i, &pixel) in line.iter().enumerate() {
            texels[order.index([number, i])] = radiance(pixel);
        }
    }
    Ok(Pixels { size: [width as u32, height as u32], texels, alpha: None, is_linear: true })
}

/// What is still to be read of a file.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (taken, rest) = self.0.split_first_chunk().ok_or("is cut off")?;
        self.0 = rest;
        Ok(*taken)
    }

    /// The text up to the end of a line, without spaces around it.
    fn line(&mut self) -> Result<&'a str, String> {
        let end = self.0.iter().position(|&byte| byte == b'\n').ok_or("its header is cut off")?;
        let line = &self.0[..end];
        self.0 = &self.0[end + 1..];
        // Other bytes than text are in comments alone.
        Ok(str::from_utf8(line).unwrap_or("#").trim())
    }
}

/// Reads the lines up to an empty one.
fn header(rest: &mut Bytes<'_>, path: &Path, report: &mut Report) -> Result<(), String> {
    loop {
        let line = rest.line()?;
        if line.is_empty() {
            return Ok(());
        }
        match line.split_once('=').map(|(key, value)| (key.trim(), value.trim())) {
            Some(("FORMAT", format)) if format != "32-bit_rle_rgbe" => {
                return Err(format!(
                    "its format is {format:.32}, but 32-bit_rle_rgbe is what can be read"
                ));
            }
            Some(("EXPOSURE", value)) if value.parse() != Ok(1.0) => {
                report.note(format!("EXPOSURE of '{}' left out: {value:.32}", path.display()));
            }
            _ => {}
        }
    }
}

/// How the pixels follow each other: lines along one axis, pixels along the other one.
struct Order {
    /// How many lines, and how many pixels in each.
    lengths: [usize; 2],
    /// Whether lines are columns.
    by_columns: bool,
    /// Whether lines, and the pixels in them, go from the bottom or the right.
    backwards: [bool; 2],
}

impl Order {
    /// The line after the header, as `-Y 512 +X 1024`: y grows upwards.
    fn parse(line: &str) -> Result<Self, String> {
        let unknown = || format!("'{line:.64}' is no size, as '-Y 512 +X 1024' is");
        let words: Vec<_> = line.split_whitespace().collect();
        let &[first, lines, second, pixels] = words.as_slice() else { return Err(unknown()) };
        let length = |word: &str| word.parse::<u32>().ok().filter(|&n| n > 0).map(|n| n as usize);
        let (Some(lines), Some(pixels)) = (length(lines), length(pixels)) else {
            return Err(unknown());
        };
        let by_columns = match (first, second) {
            ("-Y" | "+Y", "-X" | "+X") => false,
            ("-X" | "+X", "-Y" | "+Y") => true,
            _ => return Err(unknown()),
        };
        let backwards = [first, second].map(|axis| matches!(axis, "+Y" | "-X"));
        Ok(Self { lengths: [lines, pixels], by_columns, backwards })
    }

    /// Width and height.
    fn size(&self) -> [usize; 2] {
        let [lines, pixels] = self.lengths;
        if self.by_columns { [lines, pixels] } else { [pixels, lines] }
    }

    /// Where the pixel of a line lies in an image of rows from the top.
    fn index(&self, place: [usize; 2]) -> usize {
        let [line, pixel] = [0, 1].map(|axis| {
            let forwards = place[axis];
            if self.backwards[axis] { self.lengths[axis] - 1 - forwards } else { forwards }
        });
        if self.by_columns {
            pixel * self.lengths[0] + line
        } else {
            line * self.lengths[1] + pixel
        }
    }
}

/// Reads a line of pixels; an error says what it does.
fn decode(rest: &mut Bytes<'_>, line: &mut [[u8; 4]]) -> Result<(), String> {
    let length = line.len();
    let by_channel = match rest.0 {
        [2, 2, high, low, ..] => usize::from(u16::from_be_bytes([*high, *low])) == length,
        _ => false,
    };
    if !(by_channel && LENGTHS_BY_CHANNEL.contains(&length)) {
        return decode_pixels(rest, line);
    }
    rest.take::<4>()?;
    for channel in 0..4 {
        let mut at = 0;
        while at < length {
            let [count] = rest.take()?;
            // Above 128, a value that is repeated; else, values.
            let run = count > 128;
            let count = usize::from(if run { count - 128 } else { count });
            if count == 0 || at + count > length {
                return Err("does not have its length".to_owned());
            }
            let mut value = if run { rest.take::<1>()? } else { [0] };
            for pixel in &mut line[at..][..count] {
                if !run {
                    value = rest.take()?;
                }
                pixel[channel] = value[0];
            }
            at += count;
        }
    }
    Ok(())
}

/// A line of whole pixels; 1, 1, 1, n repeats the last one n times. Such counts in a row are
/// the bytes of one number, the lowest first.
fn decode_pixels(rest: &mut Bytes<'_>, line: &mut [[u8; 4]]) -> Result<(), String> {
    let (mut at, mut shift) = (0, 0);
    while at < line.len() {
        let pixel = rest.take()?;
        let [1, 1, 1, count] = pixel else {
            line[at] = pixel;
            (at, shift) = (at + 1, 0);
            continue;
        };
        let count = usize::from(count) << shift;
        if at == 0 || shift > 24 || at + count > line.len() {
            return Err("does not have its length".to_owned());
        }
        let last = line[at - 1];
        line[at..][..count].fill(last);
        (at, shift) = (at + count, shift + 8);
    }
    Ok(())
}

/// The mantissas are 256ths.
fn radiance([r, g, b, exponent]: [u8; 4]) -> [f32; 3] {
    // 2^(exponent − 128 − 8) by its bits in f64, which has all of these powers.
    let power = f64::from_bits((u64::from(exponent) + 1023 - 136) << 52);
    let power = if exponent == 0 { 0.0 } else { power };
    [r, g, b].map(|mantissa| (f64::from(mantissa) * power) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(bytes: &[u8]) -> Result<Pixels, Error> {
        read(Path::new("x.hdr"), bytes, 1 << 20, &mut Report::default())
    }

    fn file(size: &str, pixels: &[u8]) -> Vec<u8> {
        let header = format!("#?RGBE\n# made by hand\nFORMAT=32-bit_rle_rgbe\n\n{size}\n");
        [header.as_bytes(), pixels].concat()
    }

    /// Red is 1, 2, … in the order of the file.
    fn numbered(count: u8) -> Vec<u8> {
        (1..=count).flat_map(|i| [i, 0, 0, 136]).collect()
    }

    fn red(bytes: &[u8]) -> ([u32; 2], Vec<f32>) {
        let pixels = decoded(bytes).expect("an image");
        (pixels.size, pixels.texels.iter().map(|texel| texel[0]).collect())
    }

    #[test]
    fn mantissas_and_exponents() {
        let values = [[128, 64, 0, 129], [255, 1, 2, 0], [1, 2, 255, 1], [255, 0, 128, 255]];
        let texels = decoded(&file("-Y 2 +X 2", &values.concat())).expect("an image").texels;
        assert_eq!(texels[..2], [[1.0, 0.5, 0.0], [0.0; 3]]);
        assert_eq!(texels[2][2], 255.0 * 2.0_f32.powi(-120) * 2.0_f32.powi(-15));
        assert_eq!(texels[3], [255.0 * 2.0_f32.powi(119), 0.0, 2.0_f32.powi(126)]);
    }

    #[test]
    fn any_order_of_rows_and_columns() {
        for (size, expected) in [
            ("-Y 2 +X 3", [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            ("+Y 2 +X 3", [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]),
            ("-Y 2 -X 3", [3.0, 2.0, 1.0, 6.0, 5.0, 4.0]),
            ("+X 3 -Y 2", [1.0, 3.0, 5.0, 2.0, 4.0, 6.0]),
            ("-X 3 +Y 2", [6.0, 4.0, 2.0, 5.0, 3.0, 1.0]),
        ] {
            assert_eq!(red(&file(size, &numbered(6))), ([3, 2], expected.to_vec()), "{size}");
        }
    }

    #[test]
    fn encoded_lines() {
        // Red: a run of 9 and the values 7, 8, 9; green, blue and exponent: runs of 12.
        let line = [&[2, 2, 0, 12, 137, 5, 3, 7, 8, 9][..], &[140, 0, 140, 0, 140, 136]].concat();
        let two = [&line[..], &line].concat();
        let row = [[5.0; 9].as_slice(), &[7.0, 8.0, 9.0]].concat();
        assert_eq!(red(&file("-Y 2 +X 12", &two)), ([12, 2], [row.clone(), row].concat()));
        // A pixel, its repetitions 3 and 1 · 256 + 2, and a pixel.
        let line = [4, 0, 0, 136, 1, 1, 1, 3, 9, 0, 0, 136, 1, 1, 1, 2, 1, 1, 1, 1, 6, 0, 0, 136];
        let (size, values) = red(&file("-Y 1 +X 264", &line));
        assert_eq!((size, &values[..5]), ([264, 1], &[4.0, 4.0, 4.0, 4.0, 9.0][..]));
        assert_eq!((values[262], values[263]), (9.0, 6.0));
        // Not a length but a pixel.
        let pixels = [&[2, 2, 0, 136][..], &numbered(8)].concat();
        assert_eq!(red(&file("-Y 1 +X 9", &pixels)).1[..2], [2.0, 1.0]);
    }

    #[test]
    fn malformed_files_are_refused() {
        let message = |bytes: &[u8]| {
            let message = decoded(bytes).err().expect("it is malformed").to_string();
            assert!(message.contains("x.hdr"), "{message}");
            message
        };
        let whole = file("-Y 2 +X 12", &numbered(24));
        assert!(decoded(&whole).is_ok());
        assert!(message(&whole[..whole.len() - 1]).contains("line 1 of pixels is cut off"));
        assert!(message(&whole[..30]).contains("header is cut off"));
        assert!(message(b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n1234").contains("xyze"));
        for size in ["-Y 0 +X 1", "-Y 1 +Y 1", "-Y 1", "-Y -1 +X 1", "-Y 99999999999 +X 1", ""] {
            assert!(message(&file(size, &numbered(4))).contains("is no size"), "{size}");
        }
        assert!(message(&file("-Y 60000 +X 60000", b"")).contains("too many"));
        for line in [
            &[2, 2, 0, 12, 0][..],
            &[2, 2, 0, 12, 141, 1],
            &[2, 2, 0, 12, 13],
            &[1, 1, 1, 4],
            &[4, 0, 0, 136, 1, 1, 1, 12],
        ] {
            let message = message(&file("-Y 1 +X 12", line));
            assert!(message.contains("line 0 of pixels does not have its length"), "{message}");
        }
    }

    #[test]
    fn the_exposure_is_noted() {
        let mut report = Report::default();
        let bytes =
            b"#?RADIANCE\r\nEXPOSURE= 1.0\r\nEXPOSURE=2.5\r\n\r\n-Y 1 +X 1\n\x02\x00\x00\x88";
        let pixels = read(Path::new("x.hdr"), bytes, 1 << 20, &mut report).expect("an image");
        assert_eq!(pixels.texels, [[2.0, 0.0, 0.0]]);
        assert_eq!(report.notes(), ["EXPOSURE of 'x.hdr' left out: 2.5"]);
    }
}

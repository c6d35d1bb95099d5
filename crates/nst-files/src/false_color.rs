//! Numbers as colours: a logarithmic scale on the colour map *inferno*.

use crate::{Error, output_file::OutputFile, png::write_rgb8};

/// Inferno by Nathaniel Smith and Stéfan van der Walt (matplotlib 3.11.2, CC0), in
/// which equal steps look equally large: 33 of its colours in sRGB, linear between
/// them. No channel is farther than 1.5 of 255 from the 256 colours of the original.
pub const INFERNO: [[u8; 3]; 33] = [
    [0, 0, 4],
    [4, 3, 18],
    [11, 7, 36],
    [21, 11, 55],
    [33, 12, 74],
    [46, 10, 90],
    [60, 9, 101],
    [74, 12, 107],
    [87, 16, 109],
    [99, 20, 110],
    [112, 25, 110],
    [125, 30, 109],
    [137, 34, 106],
    [150, 39, 102],
    [163, 43, 97],
    [175, 49, 92],
    [187, 55, 85],
    [198, 62, 77],
    [209, 70, 68],
    [219, 79, 59],
    [227, 89, 50],
    [235, 101, 40],
    [241, 113, 30],
    [246, 127, 20],
    [249, 141, 10],
    [251, 156, 6],
    [252, 171, 15],
    [251, 186, 31],
    [249, 202, 50],
    [245, 217, 73],
    [242, 232, 101],
    [243, 245, 134],
    [252, 255, 164],
];

/// Cyan, which the map does not contain: the colour of a NaN.
const NOT_A_NUMBER: [u8; 3] = [0, 255, 255];

/// Writes a PNG of values `[y][x]`: black at `low` or below, yellow at `high` or
/// above, logarithmic between; NaN is cyan.
///
/// # Errors
/// [`Error::Io`] or [`Error::Malformed`] if it cannot be written.
pub fn write_png(
    output: &mut OutputFile,
    size: [u32; 2],
    values: impl Iterator<Item = f64>,
    [low, high]: [f64; 2],
) -> Result<(), Error> {
    let bytes: Vec<u8> =
        values.flat_map(|value| color((value / low).ln() / (high / low).ln())).collect();
    write_rgb8(output, size, &bytes)
}

/// The colour at a position from 0 to 1; positions outside are clamped.
fn color(position: f64) -> [u8; 3] {
    if position.is_nan() {
        return NOT_A_NUMBER;
    }
    let knots = INFERNO.len() - 1;
    let at = position.clamp(0.0, 1.0) * knots as f64;
    let before = (at as usize).min(knots - 1);
    let share = at - before as f64;
    std::array::from_fn(|channel| {
        let [from, to] = [before, before + 1].map(|knot| f64::from(INFERNO[knot][channel]));
        (from + share * (to - from)).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_the_middle_and_what_is_no_number() {
        assert_eq!(color(0.0), [0, 0, 4]);
        assert_eq!(color(f64::NEG_INFINITY), [0, 0, 4]);
        assert_eq!(color(0.5), [187, 55, 85]);
        assert_eq!(color(1.5 / 32.0), [8, 5, 27]);
        assert_eq!(color(1.0), [252, 255, 164]);
        assert_eq!(color(f64::INFINITY), [252, 255, 164]);
        assert_eq!(color(f64::NAN), NOT_A_NUMBER);
    }

    #[test]
    fn a_png_with_a_logarithmic_scale() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("x.png");
        let mut output = OutputFile::create(&path)?;
        let values = [1e-4, 1e-2, 1.0, 0.0, f64::NAN, 9.0];
        write_png(&mut output, [3, 2], values.into_iter(), [1e-4, 1.0])?;
        output.commit()?;
        let file = std::io::BufReader::new(std::fs::File::open(&path)?);
        let mut reader = ::png::Decoder::new(file).read_info()?;
        let mut bytes = [0; 18];
        reader.next_frame(&mut bytes)?;
        let (pixels, _) = bytes.as_chunks::<3>();
        let (black, yellow) = ([0, 0, 4], [252, 255, 164]);
        assert_eq!(pixels, [black, [187, 55, 85], yellow, black, NOT_A_NUMBER, yellow]);
        Ok(())
    }
}

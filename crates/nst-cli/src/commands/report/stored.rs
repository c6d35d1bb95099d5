//! Pictures as the page stores them; `page/codec.js` reads them.
//!
//! A pixel has a byte for the magnitude of each channel, and an exponent that they share, as in
//! Ward's RGBE (Graphics Gems II, 1991), and a byte for the signs. The bytes of a kind are one
//! plane, R, G, B, exponents, signs; each is the difference from its left neighbour, and all of
//! them become a zlib stream in base64.

use std::io::Write;

use base64::{Engine, engine::general_purpose::STANDARD};
use flate2::{Compression, write::ZlibEncoder};

/// Bytes of a pixel.
const PLANES: usize = 5;

/// The exponent of pixels that are not finite.
const NOT_FINITE: u8 = 255;

/// A magnitude m with exponent e counts m · 2^(e − BIAS).
const BIAS: i32 = 136;

/// R, G and B of a pixel in five bytes. The channel of the largest magnitude is off by at most
/// 1/256 of itself, the others by as much as that. Values below 2⁻¹²⁸ are 0, and those from 2¹²⁶
/// on become as large as can be said.
fn pixel(rgb: [f32; 3]) -> [u8; PLANES] {
    if !rgb.iter().all(|x| x.is_finite()) {
        return [0, 0, 0, NOT_FINITE, 0];
    }
    let largest = rgb.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
    let largest = f64::from(largest);
    if largest < 2_f64.powi(-128) {
        return [0; PLANES];
    }
    // The largest magnitude becomes 128 to 255; where it would be rounded to 256, half of that.
    let power = largest.log2().floor() as i32 - 7;
    let power = if (largest / 2_f64.powi(power)).round() > 255.0 { power + 1 } else { power };
    let exponent = (power + BIAS).clamp(1, i32::from(NOT_FINITE) - 1);
    let unit = 2_f64.powi(exponent - BIAS);
    let [r, g, b] = rgb.map(|x| (f64::from(x).abs() / unit).round().min(255.0) as u8);
    let signs = rgb.iter().zip(0..).map(|(x, channel)| u8::from(*x < 0.0) << channel).sum();
    [r, g, b, exponent as u8, signs]
}

/// Encodes planar lanes R, G and B, or one that is grey.
pub(super) fn encode(lanes: &[f32], width: usize, channels: usize) -> String {
    let pixels = lanes.len() / channels;
    let mut planes = vec![0; PLANES * pixels];
    for i in 0..pixels {
        let rgb = [0, 1, 2].map(|channel: usize| lanes[channel.min(channels - 1) * pixels + i]);
        for (plane, byte) in pixel(rgb).into_iter().enumerate() {
            planes[plane * pixels + i] = byte;
        }
    }
    for row in planes.chunks_exact_mut(width) {
        for x in (1..width).rev() {
            row[x] = row[x].wrapping_sub(row[x - 1]);
        }
    }
    let mut stream = ZlibEncoder::new(Vec::new(), Compression::best());
    stream.write_all(&planes).expect("memory can be written to");
    STANDARD.encode(stream.finish().expect("memory can be written to"))
}

/// The means over boxes of `factor` by `factor` pixels, fewer at the right and lower edges, of
/// planar lanes; and the new size. A box is not finite if one of its pixels is not.
pub(super) fn reduce(
    lanes: &[f32],
    [width, height]: [usize; 2],
    factor: usize,
) -> (Vec<f32>, [usize; 2]) {
    let size = [width.div_ceil(factor), height.div_ceil(factor)];
    let channels = lanes.chunks_exact(width * height);
    let means = channels.flat_map(|lane| {
        let places = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| [x, y]));
        places.map(|[x, y]| {
            let columns = x * factor..width.min((x + 1) * factor);
            let rows = y * factor..height.min((y + 1) * factor);
            let count = columns.len() * rows.len();
            let sum: f64 = rows
                .flat_map(|y| &lane[y * width..][columns.clone()])
                .map(|&value| f64::from(value))
                .sum();
            (sum / count as f64) as f32
        })
    });
    (means.collect(), size)
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    /// What `codec.js` makes of five bytes.
    fn value([r, g, b, exponent, signs]: [u8; PLANES]) -> [f64; 3] {
        let unit = if exponent == 0 { 0.0 } else { 2_f64.powi(i32::from(exponent) - BIAS) };
        let sign = |channel: u8| if signs >> channel & 1 == 1 { -1.0 } else { 1.0 };
        [(r, 0), (g, 1), (b, 2)].map(|(size, channel)| sign(channel) * f64::from(size) * unit)
    }

    #[test]
    fn values_are_off_by_at_most_a_256th_of_the_largest() {
        let mut worst = 0.0_f64;
        for step in 0..4000 {
            let large = 1.0127_f32.powi(step - 2000) * if step % 2 == 0 { -1.0 } else { 1.0 };
            let rgb = [0.3 * large, large, -0.001 * large];
            for (found, wanted) in value(pixel(rgb)).into_iter().zip(rgb) {
                worst = worst.max((found - f64::from(wanted)).abs() / f64::from(large.abs()));
            }
        }
        // Both bounds: the test would not see an encoder that loses nothing, say of zeros.
        assert!(worst <= 1.0 / 256.0 && worst > 1.0 / 300.0, "{worst}");
    }

    #[test]
    fn exact_and_odd_values() {
        for (rgb, bytes) in [
            ([0.0, 0.0, 0.0], [0, 0, 0, 0, 0]),
            ([1.0, 0.5, -0.25], [128, 64, 32, 129, 4]),
            ([255.9, 0.0, 0.0], [128, 0, 0, 137, 0]),
            ([f32::MIN_POSITIVE, 0.0, -0.0], [128, 0, 0, 3, 0]),
            ([1e-45, 0.0, 0.0], [0, 0, 0, 0, 0]),
            ([f32::MAX, 1.0, f32::MIN], [255, 0, 255, 254, 4]),
            ([f32::NAN, 1.0, 1.0], [0, 0, 0, 255, 0]),
            ([1.0, f32::INFINITY, 1.0], [0, 0, 0, 255, 0]),
        ] {
            assert_eq!(pixel(rgb), bytes, "{rgb:?}");
        }
    }

    #[test]
    fn planes_are_differences_in_a_zlib_stream() -> Result<(), Box<dyn std::error::Error>> {
        let bytes = STANDARD.decode(encode(&[1.0, 1.0, 2.0, 0.5], 2, 1))?;
        let mut planes = Vec::new();
        flate2::read::ZlibDecoder::new(&bytes[..]).read_to_end(&mut planes)?;
        let grey = [128, 0, 128, 0];
        // 129, then the same; 130, then 2 less.
        let expected = [grey, grey, grey, [129, 0, 130, 254], [0; 4]].concat();
        assert_eq!(planes, expected);
        Ok(())
    }

    #[test]
    fn boxes_have_means() {
        let lanes: Vec<f32> = (0..30).map(|i| i as f32).collect();
        let (means, size) = reduce(&lanes, [5, 3], 2);
        assert_eq!(size, [3, 2]);
        assert_eq!(means[..6], [3.0, 5.0, 6.5, 10.5, 12.5, 14.0]);
        assert_eq!(means[6], 18.0);
        let mut lanes = vec![1.0; 4];
        lanes[3] = f32::NAN;
        assert!(reduce(&lanes, [2, 2], 2).0[0].is_nan());
    }
}

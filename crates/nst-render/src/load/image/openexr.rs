//! Images from EXR files.

use std::path::Path;

use nst_files::{header::Window, picture::Picture};

use super::{Pixels, Purpose};
use crate::{Error, load::report::Report};

/// The channels R, G and B, or Y, as they are, in the display window: black where the file
/// has no data. Data outside of it are left out.
pub(super) fn read(
    path: &Path,
    most_bytes: u64,
    purpose: Purpose,
    report: &mut Report,
) -> Result<Pixels, Error> {
    let picture = Picture::open(path, None)?;
    if let Some(note) = picture.primaries_note() {
        report.note(note);
    }
    let channels = picture.channel_names.len();
    for ([width, height], channels) in [(picture.size, channels), (picture.display.size, 3)] {
        let bytes = u64::from(width) * u64::from(height) * (size_of::<f32>() * channels) as u64;
        if bytes > most_bytes {
            let message = format!(
                "{width} by {height} pixels are too many, for this program or for the file's length"
            );
            return Err(Error::image(path, message));
        }
    }
    let lanes = picture.read()?;
    let pixels = lanes.len() / channels;
    let channel = |channel: usize| &lanes[channel * pixels..][..pixels];
    // One channel is grey.
    let [r, g, b] = if channels == 1 { [0; 3] } else { [0, 1, 2] }.map(channel);
    let texels = r.iter().zip(g).zip(b).map(|((&r, &g), &b)| [r, g, b]).collect();
    let alpha = match (purpose, picture.layer.as_str()) {
        (Purpose::Numbers, "") => Picture::open(path, Some("A")).ok(),
        (Purpose::Numbers, layer) => Picture::open(path, Some(&format!("{layer}.A"))).ok(),
        _ => None,
    };
    let alpha = alpha.map(|alpha| alpha.read()).transpose()?;
    let window = |alpha| display(&picture, alpha, 0.0);
    Ok(Pixels {
        size: picture.display.size,
        texels: display(&picture, texels, [0.0; 3])?,
        alpha: alpha.map(window).transpose()?,
        is_linear: true,
    })
}

/// The display window of a picture whose data window contains `data`.
fn display<T: Copy>(picture: &Picture, data: Vec<T>, outside: T) -> Result<Vec<T>, Error> {
    let (from, to) = (picture.window(), picture.display);
    if from == to {
        return Ok(data);
    }
    let Some(part) = from.intersection(&to) else {
        let message = "its data window has no pixel of its display window";
        return Err(Error::image(picture.path(), message));
    };
    let [width, height] = to.size.map(|n| n as usize);
    let mut all = vec![outside; width * height];
    // Where a row of the part begins in a window.
    let start = |window: &Window, row: u32| {
        let [x, y] = [0, 1].map(|axis| (part.position[axis] - window.position[axis]) as usize);
        (y + row as usize) * window.size[0] as usize + x
    };
    let columns = part.size[0] as usize;
    for row in 0..part.size[1] {
        let data = &data[start(&from, row)..][..columns];
        all[start(&to, row)..][..columns].copy_from_slice(data);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use exr::prelude::*;

    use super::*;

    /// Writes R and A, with the number of a pixel's column and row in tens.
    fn write(path: &Path, at: [i32; 2], size: [usize; 2], display: ([i32; 2], [usize; 2])) {
        let size = Vec2(size[0], size[1]);
        let value = |p: Vec2<usize>| (p.0 as i32 + at[0] + 10 * (p.1 as i32 + at[1])) as f32;
        let channels = SpecificChannels::rgba(|p| (value(p), 1.0_f32, 2.0_f32, value(p) / 100.0));
        let attributes = LayerAttributes::named("main").with_position(Vec2(at[0], at[1]));
        let layer = Layer::new(size, attributes, Encoding::UNCOMPRESSED, channels);
        let (at, size) = display;
        let window = IntegerBounds::new(Vec2(at[0], at[1]), Vec2(size[0], size[1]));
        Image::new(ImageAttributes::new(window), layer).write().to_file(path).expect("a file");
    }

    #[test]
    fn the_display_window_is_the_picture() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.exr");
        let image_for = |purpose| super::read(&path, 1 << 20, purpose, &mut Report::default());
        // A part of the window, in its middle.
        write(&path, [1, 1], [2, 1], ([0, 0], [4, 3]));
        let part = image_for(Purpose::Numbers).expect("an image");
        assert_eq!(part.size, [4, 3]);
        let mut expected = vec![[0.0; 3]; 12];
        (expected[5], expected[6]) = ([11.0, 1.0, 2.0], [12.0, 1.0, 2.0]);
        assert_eq!(part.texels, expected);
        let alpha: Vec<_> = expected.iter().map(|texel| texel[0] / 100.0).collect();
        assert_eq!(part.alpha, Some(alpha));
        // Larger than the window, which does not begin at 0.
        write(&path, [1, 2], [5, 5], ([3, 4], [2, 2]));
        let larger = image_for(Purpose::Colors).expect("an image");
        let red: Vec<_> = larger.texels.iter().map(|texel| texel[0]).collect();
        assert_eq!((larger.size, red), ([2, 2], vec![43.0, 44.0, 53.0, 54.0]));
        assert_eq!(larger.alpha, None);
        // Over a corner, from outside.
        write(&path, [-1, -1], [2, 2], ([0, 0], [2, 2]));
        let corner = image_for(Purpose::Colors).expect("an image");
        assert_eq!(corner.texels, [[0.0, 1.0, 2.0], [0.0; 3], [0.0; 3], [0.0; 3]]);
        write(&path, [5, 0], [2, 2], ([0, 0], [2, 2]));
        let error = image_for(Purpose::Colors).err().expect("no overlap").to_string();
        assert!(error.contains("x.exr") && error.contains("display window"), "{error}");
        write(&path, [0, 0], [2, 2], ([0, 0], [1 << 15, 1 << 15]));
        let error = image_for(Purpose::Colors).err().expect("too large").to_string();
        assert!(error.contains("32768 by 32768"), "{error}");
    }

    #[test]
    fn layers_and_single_channels() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.exr");
        let write = |names: &[&str]| {
            let channel = |(i, &name): (usize, &&str)| {
                AnyChannel::new(name, FlatSamples::F32(vec![i as f32 + 1.0]))
            };
            let channels = AnyChannels::sort(names.iter().enumerate().map(channel).collect());
            let attributes = LayerAttributes::default();
            let layer = Layer::new(Vec2(1, 1), attributes, Encoding::UNCOMPRESSED, channels);
            Image::from_layer(layer).write().to_file(&path).expect("a file");
            super::read(&path, 1 << 20, Purpose::Numbers, &mut Report::default())
        };
        let names = ["V.Combined.R", "V.Combined.G", "V.Combined.B", "V.Combined.A", "V.Depth.Z"];
        let pixels = write(&names).expect("an image");
        assert_eq!((pixels.texels, pixels.alpha), (vec![[1.0, 2.0, 3.0]], Some(vec![4.0])));
        assert_eq!(write(&["mask"]).expect("an image").texels, [[1.0; 3]]);
        assert_eq!(write(&["Y", "A"]).expect("an image").alpha, Some(vec![2.0]));
        let error = write(&["Y", "RY", "BY"]).err().expect("chroma").to_string();
        assert!(error.contains("x.exr") && error.contains("luminance and chroma"), "{error}");
    }
}

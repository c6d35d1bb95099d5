//! Single-part scanline EXR files, read and written some rows at a time, so that a picture
//! with hundreds of channels need not fit into memory.
//!
//! The exr crate parses headers. This module compresses blocks and decompresses those with ZIP
//! compression, reads where they are in a file, and compares every size with the file's length
//! before it allocates memory.

mod parts;
mod reader;
mod unzip;
mod writer;
mod zip;

pub(crate) use parts::{Attribute, Attributes, Channel, text};
pub(crate) use reader::RowReader;
pub(crate) use writer::RowWriter;

/// The rows of images that are `width` samples wide, as [`RowReader::read`] wants them: for each
/// row, that of each image.
pub(crate) fn slices_of_rows(
    images: Vec<&mut [u32]>,
    width: usize,
) -> impl Iterator<Item = Vec<&mut [u32]>> {
    let mut images: Vec<_> =
        images.into_iter().map(|image| image.chunks_exact_mut(width)).collect();
    let rows = images.first().map_or(0, ExactSizeIterator::len);
    (0..rows).map(move |_| images.iter_mut().filter_map(Iterator::next).collect())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use exr::meta::attribute::{SampleType, Text};

    use super::*;
    use crate::{Error, output_file::OutputFile};

    /// Writes f32 channels of some rows at a time.
    fn write(path: &Path, size: [u32; 2], planes: &[Vec<f32>], rows: usize) -> Result<(), Error> {
        let names = ["b", "a", "c"];
        let channels = names.map(|name| (name.to_owned(), SampleType::F32));
        let attributes = [("x".to_owned(), Attribute::Text("µ, β".into()))].into();
        let mut output = OutputFile::create(path)?;
        let mut writer = RowWriter::create(&mut output, size, &channels, attributes)?;
        let step = size[0] as usize * rows;
        for first in (0..planes[0].len()).step_by(step) {
            let part = |plane: &Vec<f32>| plane[first..plane.len().min(first + step)].to_vec();
            let part: Vec<Vec<f32>> = planes.iter().map(part).collect();
            let bytes: Vec<&[u8]> = part.iter().map(|plane| bytemuck::cast_slice(plane)).collect();
            writer.push(&bytes)?;
        }
        writer.finish()?;
        output.commit()
    }

    #[test]
    fn rows_come_back_however_they_are_cut() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("x.exr");
        for size in [[7, 50], [1, 1], [5, 16], [33, 17]] {
            let pixels = size[0] as usize * size[1] as usize;
            let plane = |c: usize| (0..pixels).map(|i| (i * i + c) as f32 / 7.0).collect();
            let planes: Vec<Vec<f32>> = (0..3).map(plane).collect();
            for (written, read) in [(16, 32), (1 << 20, 16), (32, 1 << 20), (16, 5)] {
                write(&path, size, &planes, written).expect("it can be written");
                let reader = RowReader::open(&path).expect("it can be read");
                assert_eq!(reader.size(), size);
                assert_eq!(reader.attribute("x"), Some(Attribute::Text("µ, β".into())));
                let names: Vec<String> = reader.channels().map(|(name, _)| name).collect();
                assert_eq!(names, ["a", "b", "c"]);
                let mut found = vec![Vec::new(); 3];
                for first in (0..size[1]).step_by(read) {
                    let rows = first..size[1].min(first + read as u32);
                    let mut part = vec![vec![0.0_f32; size[0] as usize * rows.len()]; 3];
                    let images =
                        part.iter_mut().map(|image| bytemuck::cast_slice_mut(image)).collect();
                    let out = slices_of_rows(images, size[0] as usize);
                    reader.read(rows, &[1, 0, 2], out).expect("rows");
                    found.iter_mut().zip(part).for_each(|(all, part)| all.extend(part));
                }
                assert_eq!(found, planes);
            }
        }
    }

    #[test]
    fn text_is_read_as_utf_8_or_latin_1() {
        for (bytes, expected) in [(&b"\xc2\xb5"[..], "µ"), (b"\xb5", "µ"), (b"", "")] {
            assert_eq!(text(&Text::from_slice_unchecked(bytes)), expected);
        }
    }

    #[test]
    fn rows_that_do_not_fit_are_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("x.exr");
        let planes = |rows: usize| vec![vec![1.0; 7 * rows]; 3];
        assert!(write(&path, [7, 40], &planes(40), 16).is_ok());
        for (rows, step) in [(40, 10), (48, 16), (32, 16), (41, 1 << 20)] {
            assert!(write(&path, [7, 40], &planes(rows), step).is_err(), "{rows} {step}");
        }
    }
}

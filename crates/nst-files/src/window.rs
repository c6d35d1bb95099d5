//! Windows: which pixels of a frame a picture has.

use std::{
    fs::File,
    io::{BufRead, BufReader, Read},
    path::Path,
};

use crate::Error;

/// A rectangle of pixels, in coordinates that the windows of a file have in common; y points
/// down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// The left upper corner.
    pub position: [i32; 2],
    /// Width and height, in pixels.
    pub size: [u32; 2],
}

impl Window {
    /// What two windows have in common; `None` if that is nothing.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Option<Self> {
        let span = |axis: usize| {
            let ends = [self, other]
                .map(|window| i64::from(window.position[axis]) + i64::from(window.size[axis]));
            let start = self.position[axis].max(other.position[axis]);
            let length = ends[0].min(ends[1]) - i64::from(start);
            (length > 0).then_some((start, length as u32))
        };
        let ((x, width), (y, height)) = (span(0)?, span(1)?);
        Some(Self { position: [x, y], size: [width, height] })
    }
}

/// Fails if a window of an EXR file has no pixels. The exr crate would take its corners the
/// other way round, and look for pixels that are not there. What else is wrong with the file,
/// others say.
pub(crate) fn check_not_empty(path: &Path) -> Result<(), Error> {
    let file = File::open(path).map_err(|error| Error::io("read", path, error))?;
    match empty_window(&mut BufReader::new(file)) {
        Ok(Some((name, [left, top, right, bottom]))) => {
            let message = format!(
                "its {name}, ({left}, {top}) to ({right}, {bottom}), has no pixels; save a picture \
                 with some"
            );
            Err(Error::malformed(path, message))
        }
        _ => Ok(()),
    }
}

/// The first window without pixels in the headers of a file: the attribute's name and the
/// corners, both of which belong to it.
fn empty_window(file: &mut BufReader<File>) -> std::io::Result<Option<(&'static str, [i32; 4])>> {
    let mut start = [0; 8];
    file.read_exact(&mut start)?;
    // Bit 12 of the second number; the headers of several parts end with an empty one.
    let has_parts = start[5] & 0x10 != 0;
    let mut is_empty = true;
    loop {
        let name = text(file)?;
        if name.is_empty() {
            if is_empty || !has_parts {
                return Ok(None);
            }
            is_empty = true;
            continue;
        }
        is_empty = false;
        let kind = text(file)?;
        let mut size = [0; 4];
        file.read_exact(&mut size)?;
        let size = u32::from_le_bytes(size);
        let known = ["dataWindow", "displayWindow"].into_iter().find(|it| it.as_bytes() == name);
        let Some(known) = known.filter(|_| kind == b"box2i" && size == 16) else {
            file.seek_relative(size.into())?;
            continue;
        };
        let mut bytes = [0; 16];
        file.read_exact(&mut bytes)?;
        let (numbers, _) = bytes.as_chunks();
        let corners = std::array::from_fn(|i| i32::from_le_bytes(numbers[i]));
        let [left, top, right, bottom] = corners;
        if right < left || bottom < top {
            return Ok(Some((known, corners)));
        }
    }
}

/// A name, which ends with a zero byte; EXR's have at most 255.
fn text(file: &mut impl BufRead) -> std::io::Result<Vec<u8>> {
    let mut text = Vec::new();
    file.take(256).read_until(0, &mut text)?;
    match text.pop() {
        Some(0) => Ok(text),
        _ => Err(std::io::ErrorKind::InvalidData.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_have_pixels_in_common() {
        let window = |position, size| Window { position, size };
        let a = window([0, 0], [16, 12]);
        assert_eq!(a.intersection(&window([4, 2], [16, 12])), Some(window([4, 2], [12, 10])));
        assert_eq!(a.intersection(&window([-5, -5], [99, 99])), Some(a));
        assert_eq!(a.intersection(&window([16, 0], [1, 12])), None);
        let far = window([i32::MAX - 1, 0], [u32::MAX, 1]);
        assert_eq!(far.intersection(&far), Some(far));
    }
}

//! Windows: which pixels of a frame a picture has.

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

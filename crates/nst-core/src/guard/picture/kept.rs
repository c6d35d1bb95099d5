//! What experts say of a picture with all folds: known once they are measured, and wanted again
//! where their blend is applied.

use std::ops::Range;

use super::cells::Held;
use crate::guard::hats::Place;

/// The most bytes that are kept, three times as much as 1920 × 1080 pixels take with three experts.
/// Of strips beyond, experts are asked again.
const MOST_BYTES: usize = 512 << 20;

/// What is kept of strips.
#[derive(Default)]
pub(super) struct Kept {
    /// By the rows of the picture; then by layer.
    strips: Vec<(Range<usize>, Vec<Held>)>,
    bytes: usize,
}

impl Kept {
    /// Keeps what is said of rows, if there is room. A `whole` picture is in memory anyway, with much
    /// more that belongs to it.
    pub(super) fn keep(&mut self, rows: Range<usize>, layers: Vec<Held>, whole: bool) {
        let of_layer = |Held { changes, missing, places }: &Held| {
            let numbers = changes.iter().chain([missing]).map(Vec::len).sum::<usize>();
            numbers * size_of::<f32>() + places.len() * size_of::<Place>()
        };
        let bytes = layers.iter().map(of_layer).sum::<usize>();
        if whole || self.bytes + bytes <= MOST_BYTES {
            self.bytes += bytes;
            self.strips.push((rows, layers));
        }
    }

    /// What is known of rows.
    pub(super) fn of(&self, rows: &Range<usize>) -> Option<&[Held]> {
        let of_rows = self.strips.iter().find(|(kept, _)| kept == rows);
        of_rows.map(|(_, layers)| &layers[..])
    }
}

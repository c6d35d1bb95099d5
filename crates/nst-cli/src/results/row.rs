//! A row of the table.

use serde::{Deserialize, Serialize};

/// The version of the table. Whoever changes the meaning of a column counts it up.
pub(crate) const SCHEMA: u32 = 3;

/// The method that all others are compared with: the plain estimate S.
pub(crate) const PLAIN: &str = "none";

/// One method on one run at one sample count; the fields are the table's columns, in their
/// order. What was not measured, or is not known, is `None`, an empty field of the table.
///
/// Errors are means over lanes of (x − R₁)(x − R₂), where R₁ and R₂ are independent halves of
/// a reference: they are unbiased, and may be 0 or negative by chance.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    /// The scene's name.
    pub(crate) scene: String,
    /// The method's name; [`PLAIN`] is the plain estimate.
    pub(crate) method: String,
    /// Samples per pixel.
    pub(crate) spp: u32,
    /// Number of the run; runs are independent.
    pub(crate) run: u32,
    /// Mean squared error.
    pub(crate) mse: Option<f64>,
    /// Mean squared error relative to the squared reference.
    pub(crate) relmse: Option<f64>,
    /// Symmetric mean absolute percentage error, from 0 to 1.
    pub(crate) smape: Option<f64>,
    /// The mean squared error without the 0.1 % of pixels whose errors are the largest.
    pub(crate) mse_trimmed: Option<f64>,
    /// The squared bias: the mean of (a − R₁)(b − R₂), where a is this run, and b the other
    /// one of a pair; both rows have the same value. Unbiased, so it may be negative.
    pub(crate) bias2: Option<f64>,
    /// What the method itself says its MSE is.
    pub(crate) predicted_mse: Option<f64>,
    /// What the method itself says its MSE is, relative to that of the plain estimate.
    pub(crate) predicted_ratio: Option<f64>,
    /// The lower end of the 95 % interval of that.
    pub(crate) predicted_low: Option<f64>,
    /// The upper end of it.
    pub(crate) predicted_high: Option<f64>,
    /// Seconds to load the scene.
    pub(crate) load_seconds: Option<f64>,
    /// Seconds to render.
    pub(crate) render_seconds: Option<f64>,
    /// Seconds of the first transformation, with what is read and opened for it.
    pub(crate) transform_seconds: Option<f64>,
    /// Seconds of a second transformation.
    pub(crate) transform_warm_seconds: Option<f64>,
    /// Seconds to write the picture.
    pub(crate) io_seconds: Option<f64>,
    /// Seconds that a user waits: to load, render, transform (cold) and write.
    pub(crate) total_seconds: Option<f64>,
    /// Width of the film in pixels.
    pub(crate) width: u32,
    /// Height of the film in pixels.
    pub(crate) height: u32,
    /// The reference's own MSE.
    pub(crate) reference_mse: Option<f64>,
    /// The scene's fingerprint, which names what its pixels depend on; empty where it is not known.
    pub(crate) fingerprint: String,
    /// The seed of the run's random numbers.
    pub(crate) seed: Option<u64>,
    /// Which random numbers were used: `random`, or the name of another sampler.
    pub(crate) sampler: String,
    /// Threads that were used.
    pub(crate) threads: Option<u32>,
    /// The machine's processor.
    pub(crate) machine: String,
    /// What networks ran on, if it was a GPU.
    pub(crate) adapter: Option<String>,
    /// The version of the program that wrote the row.
    pub(crate) version: String,
    /// The version of the table: [`SCHEMA`].
    pub(crate) schema: u32,
    /// Why nothing was measured, in one sentence.
    pub(crate) failure: Option<String>,
}

impl Row {
    /// The names of the columns, in their order.
    pub(super) fn columns() -> csv::StringRecord {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.serialize(Self::default()).expect("a row consists of numbers and texts");
        let table = writer.into_inner().expect("memory can be written to");
        let mut reader = csv::Reader::from_reader(&table[..]);
        reader.headers().expect("it was just written").clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table is a format that other programs read.
    #[test]
    fn the_columns_have_their_order() {
        let columns = "scene method spp run mse relmse smape mse_trimmed bias2 predicted_mse \
                       predicted_ratio predicted_low predicted_high load_seconds render_seconds transform_seconds transform_warm_seconds \
                       io_seconds total_seconds width height reference_mse fingerprint seed sampler threads \
                       machine adapter version schema failure";
        assert_eq!(Row::columns(), columns.split_whitespace().collect::<Vec<_>>());
    }
}

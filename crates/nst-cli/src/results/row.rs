//! A row of the table.

use serde::{Deserialize, Serialize};

/// The version of the table. Whoever changes the meaning of a column, or of the name of a method,
/// counts it up.
pub(crate) const SCHEMA: u32 = 6;

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
    /// one of a pair; both rows have the same value. Unbiased, so it may be negative. Runs
    /// without a partner have none.
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
    /// A hash of the reference's pixels, or of those of its halves; empty where it is not known.
    pub(crate) reference: String,
    /// Samples per pixel of each half of the reference, if it was rendered.
    pub(crate) reference_spp: Option<u32>,
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
    /// In what two rows differ that must agree within a table, and wherever tables are joined;
    /// and what both have. A reference that is not known may be any of the same error.
    pub(crate) fn difference(&self, other: &Self) -> Option<(&'static str, [String; 2])> {
        let size = |row: &Self| format!("{}x{}", row.width, row.height);
        let text = |mse: Option<f64>| mse.map_or_else(String::new, |mse| mse.to_string());
        let both = |field: fn(&Self) -> &String| [self, other].map(|row| field(row).clone());
        let mut references = both(|row| &row.reference);
        if references.iter().any(String::is_empty) {
            references = [self, other].map(|row| text(row.reference_mse));
        }
        let all = [
            ("scene", both(|row| &row.scene)),
            ("scene (fingerprint)", both(|row| &row.fingerprint)),
            ("size", [self, other].map(size)),
            ("sampler", both(|row| &row.sampler)),
            ("reference", references),
        ];
        all.into_iter().find(|(_, [a, b])| a != b)
    }

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

    #[test]
    fn rows_of_one_table_agree() {
        let row = Row {
            scene: "a".into(),
            width: 4,
            height: 2,
            reference: "1e9".into(),
            reference_mse: Some(0.5),
            ..Row::default()
        };
        let unknown = Row { reference: String::new(), ..row.clone() };
        let allowed = Row { machine: "another".into(), seed: Some(3), ..row.clone() };
        for other in [&row, &unknown, &allowed] {
            assert_eq!(row.difference(other), None, "{other:?}");
        }
        let values = |a: &str, b: &str| [a.to_owned(), b.to_owned()];
        for (other, what, both) in [
            (Row { scene: "b".into(), ..row.clone() }, "scene", values("a", "b")),
            (
                Row { fingerprint: "x".into(), ..row.clone() },
                "scene (fingerprint)",
                values("", "x"),
            ),
            (Row { height: 3, ..row.clone() }, "size", values("4x2", "4x3")),
            (Row { sampler: "halton".into(), ..row.clone() }, "sampler", values("", "halton")),
            (Row { reference: "2".into(), ..row.clone() }, "reference", values("1e9", "2")),
            (Row { reference_mse: None, ..unknown }, "reference", values("0.5", "")),
        ] {
            assert_eq!(row.difference(&other), Some((what, both)));
        }
    }

    /// The table is a format that other programs read.
    #[test]
    fn the_columns_have_their_order() {
        let columns = "scene method spp run mse relmse smape mse_trimmed bias2 predicted_mse \
                       predicted_ratio predicted_low predicted_high load_seconds render_seconds \
                       transform_seconds transform_warm_seconds \
                       io_seconds total_seconds width height reference_mse reference reference_spp \
                       fingerprint seed sampler threads machine adapter version schema failure";
        assert_eq!(Row::columns(), columns.split_whitespace().collect::<Vec<_>>());
    }
}

//! The runs of one method at one sample count.

use std::collections::BTreeMap;

use super::{
    metric::Metric,
    row::Row,
    statistics::{Spread, mean, median},
    text::number,
};

/// What the runs of one method at one sample count have in common. What no run has is `None`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Summary {
    pub(crate) method: String,
    /// Samples per pixel.
    pub(crate) spp: u32,
    /// Runs that were measured: those with an MSE.
    pub(crate) runs: usize,
    /// By metric, in the order of [`Metric::ALL`].
    pub(crate) errors: [Option<Spread>; Metric::ALL.len()],
    /// Mean squared bias.
    pub(crate) bias2: Option<f64>,
    /// The mean of MSE − bias².
    pub(crate) variance: Option<f64>,
    /// The mean of the MSE that the method predicts.
    pub(crate) predicted_mse: Option<f64>,
    /// Medians of the times.
    pub(crate) seconds: Seconds,
    /// Why a run failed, the first reason; or why the mean of the runs is not judged, which has
    /// no error then.
    pub(crate) failure: Option<String>,
}

/// Times in seconds, as in [`Row`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Seconds {
    pub(crate) load: Option<f64>,
    pub(crate) render: Option<f64>,
    pub(crate) transform: Option<f64>,
    pub(crate) transform_warm: Option<f64>,
    pub(crate) io: Option<f64>,
    pub(crate) total: Option<f64>,
}

impl Summary {
    /// One for each method and sample count: methods in the order in which they first come,
    /// sample counts from the smallest.
    pub(super) fn all(rows: &[Row]) -> Vec<Self> {
        let mut order: BTreeMap<&str, usize> = BTreeMap::new();
        let mut groups: BTreeMap<(usize, u32), Vec<&Row>> = BTreeMap::new();
        for row in rows {
            let next = order.len();
            let method = *order.entry(&row.method).or_insert(next);
            groups.entry((method, row.spp)).or_default().push(row);
        }
        groups.values().map(|rows| Self::of(rows)).collect()
    }

    /// Of rows that have the method and the sample count in common; there is at least one.
    fn of(rows: &[&Row]) -> Self {
        fn all<'a>(
            rows: &'a [&Row],
            field: impl Fn(&Row) -> Option<f64> + 'a,
        ) -> impl Iterator<Item = f64> + 'a {
            rows.iter().filter_map(move |row| field(row))
        }
        let average = |field: fn(&Row) -> Option<f64>| mean(&all(rows, field).collect::<Vec<_>>());
        let middle = |field: fn(&Row) -> Option<f64>| median(all(rows, field));
        // The mean decides: if single runs did, the unlucky ones would be left.
        let unjudged = unjudged(average(|row| row.mse), average(|row| row.reference_mse));
        let judged = unjudged.is_none();
        let errors = |metric: Metric| Spread::of(all(rows, move |row| metric.of(row)));
        Self {
            method: rows[0].method.clone(),
            spp: rows[0].spp,
            runs: all(rows, |row| row.mse).count(),
            errors: Metric::ALL.map(|metric| errors(metric).filter(|_| judged)),
            bias2: average(|row| row.bias2).filter(|_| judged),
            variance: average(|row| Some(row.mse? - row.bias2?)).filter(|_| judged),
            predicted_mse: average(|row| row.predicted_mse),
            seconds: Seconds {
                load: middle(|row| row.load_seconds),
                render: middle(|row| row.render_seconds),
                transform: middle(|row| row.transform_seconds),
                transform_warm: middle(|row| row.transform_warm_seconds),
                io: middle(|row| row.io_seconds),
                total: middle(|row| row.total_seconds),
            },
            failure: rows.iter().find_map(|row| row.failure.clone()).or(unjudged),
        }
    }

    /// The error by a metric.
    pub(crate) fn error(&self, metric: Metric) -> Option<Spread> {
        let place = Metric::ALL.iter().position(|it| *it == metric).expect("ALL has every metric");
        self.errors[place]
    }
}

/// Why a mean error is not judged, if it is below the reference's own.
fn unjudged(mse: Option<f64>, own: Option<f64>) -> Option<String> {
    let (mse, own) = mse.zip(own).filter(|(mse, own)| mse < own)?;
    Some(format!(
        "its mean MSE, {}, is below the reference's own, {}; judge it by a reference of more \
         samples per pixel (--reference-spp)",
        number(mse, 2),
        number(own, 2)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(method: &str, spp: u32, run: u32, mse: f64, seconds: f64) -> Row {
        let method = method.to_owned();
        let (mse, total_seconds) = (Some(mse), Some(seconds));
        Row { method, spp, run, mse, total_seconds, ..Row::default() }
    }

    #[test]
    fn rows_are_grouped_by_method_and_sample_count() {
        let mut rows = vec![
            row("none", 16, 0, 1.0, 5.0),
            row("auto", 8, 0, 3.0, 1.0),
            row("none", 8, 0, 4.0, 2.0),
            row("none", 8, 1, 2.0, 9.0),
            row("none", 8, 2, 3.0, 3.0),
        ];
        (rows[2].bias2, rows[3].bias2) = (Some(0.5), Some(0.5));
        rows[4].relmse = Some(7.0);
        rows.push(Row { failure: Some("too dark".into()), mse: None, ..rows[0].clone() });
        let all = Summary::all(&rows);
        let names: Vec<_> = all.iter().map(|it| (&*it.method, it.spp, it.runs)).collect();
        assert_eq!(names, [("none", 8, 3), ("none", 16, 1), ("auto", 8, 1)]);
        let [first, failed, _] = &all[..] else { panic!("three summaries") };
        assert_eq!(first.error(Metric::Mse).map(|mse| (mse.mean, mse.median)), Some((3.0, 3.0)));
        assert_eq!(first.error(Metric::RelMse).map(|it| it.mean), Some(7.0));
        assert_eq!(first.error(Metric::Smape), None);
        // Only two runs have a squared bias: (4 + 2) / 2 − 0.5.
        assert_eq!((first.bias2, first.variance), (Some(0.5), Some(2.5)));
        assert_eq!((first.seconds.total, first.seconds.io), (Some(3.0), None));
        assert_eq!((failed.runs, failed.failure.as_deref()), (1, Some("too dark")));
    }

    /// Of runs around the reference's own error, none is dropped: the worse ones alone would
    /// have too large a mean.
    #[test]
    fn the_mean_is_judged() {
        let of = |errors: [f64; 3]| {
            let runs = errors.iter().zip(0..).map(|(&mse, run)| Row {
                reference_mse: Some(1.0),
                relmse: Some(mse),
                bias2: Some(0.1),
                ..row("none", 8, run, mse, 1.0)
            });
            Summary::all(&runs.collect::<Vec<_>>()).remove(0)
        };
        let above = of([0.7, 0.9, 1.7]);
        let mean = above.error(Metric::Mse).map(|mse| mse.mean).expect("it is judged");
        assert!((mean - 1.1).abs() < 1e-12, "{mean}");
        assert_eq!((above.runs, above.failure), (3, None));
        let below = of([0.7, 0.5, 1.5]);
        assert_eq!((below.runs, below.errors, below.bias2), (3, [None; 4], None));
        let why = below.failure.expect("a reason");
        assert!(why.contains("0.9, is below the reference's own, 1;"), "{why}");
    }
}

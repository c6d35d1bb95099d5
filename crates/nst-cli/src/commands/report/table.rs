//! The page's table, and what else it says in words.

use std::collections::BTreeMap;

use nst_core::metrics::Metric as Formula;
use serde::Serialize;
use serde_json::Value;

use crate::{
    results::{Metric, PLAIN, Results, SCHEMA, Summary, text::number},
    words::counted,
};

/// A column of the table.
#[derive(Serialize)]
pub(super) struct Column {
    label: &'static str,
    /// What it contains, in a sentence.
    hint: &'static str,
    /// Whether it contains texts.
    text: bool,
    /// Whether it contains whole numbers, which are written in full.
    whole: bool,
    /// Whether the lowest of all with as many samples is the best.
    #[serde(skip)]
    lowest: bool,
    #[serde(skip)]
    value: fn(&Table<'_>, &Summary) -> Value,
}

/// A row of the table.
#[derive(Serialize)]
pub(super) struct Line {
    /// One for each column: a number, a text, or null.
    cells: Vec<Value>,
    /// The columns in which it has the lowest value of those with as many samples.
    best: Vec<usize>,
}

/// The summaries of a table of results.
pub(super) struct Table<'a> {
    summaries: &'a [Summary],
    /// The plain estimate's MSE, by samples per pixel.
    plain: BTreeMap<u32, f64>,
    /// Methods and samples per pixel on the Pareto front of MSE and time.
    front: Vec<(String, u32)>,
}

/// A column of numbers.
const fn numbers(
    label: &'static str,
    hint: &'static str,
    value: fn(&Table<'_>, &Summary) -> Value,
) -> Column {
    Column { label, hint, text: false, whole: false, lowest: false, value }
}

/// All columns, in their order. A new one is an entry here.
pub(super) const COLUMNS: [Column; 20] = [
    Column {
        text: true,
        ..numbers("method", "none is the plain estimate", |_, it| it.method.clone().into())
    },
    Column { whole: true, ..numbers("spp", "samples per pixel", |_, it| it.spp.into()) },
    Column { whole: true, ..numbers("runs", "independent runs", |_, it| it.runs.into()) },
    Column {
        lowest: true,
        ..numbers("MSE", "mean squared error: the mean over the runs", |_, it| {
            mean(it, Metric::Mse)
        })
    },
    numbers(
        "± 95 %",
        "half the 95 % interval of the MSE, by Student's t over the runs",
        |_, it| half_interval(it).into(),
    ),
    Column {
        lowest: true,
        ..numbers(
            "÷ plain",
            "MSE over that of the plain estimate of as many samples; below 1 is a gain",
            |table, it| table.ratio(it).into(),
        )
    },
    Column {
        text: true,
        ..numbers(
            "front",
            "on the Pareto front: nothing is both as fast and as good",
            |table, it| table.on_front(it),
        )
    },
    Column {
        lowest: true,
        ..numbers("relMSE", "squared error relative to the reference's square", |_, it| {
            mean(it, Metric::RelMse)
        })
    },
    Column {
        lowest: true,
        ..numbers("SMAPE", "symmetric mean absolute percentage error, from 0 to 1", |_, it| {
            mean(it, Metric::Smape)
        })
    },
    numbers(
        "bias²",
        "what more runs would not average out; unbiased, so it may be negative",
        |_, it| it.bias2.into(),
    ),
    numbers("variance", "MSE − bias²", |_, it| it.variance.into()),
    numbers("median", "the MSE of the median run", |_, it| {
        it.error(Metric::Mse).map(|mse| mse.median).into()
    }),
    numbers("95th", "the MSE of the run at the 95th percentile", |_, it| {
        it.error(Metric::Mse).map(|mse| mse.p95).into()
    }),
    Column {
        lowest: true,
        ..numbers(
            "trimmed",
            "MSE without the 0.1 % of lanes whose errors are the largest",
            |_, it| mean(it, Metric::MseTrimmed),
        )
    },
    numbers("predicted", "the MSE that the method itself predicts", |_, it| {
        it.predicted_mse.into()
    }),
    numbers(
        "total s",
        "seconds that a user waits: to load, render, transform and write; medians",
        |_, it| it.seconds.total.into(),
    ),
    numbers("render s", "seconds to load the scene and to render", |_, it| {
        sum(it.seconds.load, it.seconds.render).into()
    }),
    numbers(
        "transform s",
        "seconds of the first transformation, with what is opened for it",
        |_, it| it.seconds.transform.into(),
    ),
    numbers("again s", "seconds of a second transformation", |_, it| {
        it.seconds.transform_warm.into()
    }),
    numbers("write s", "seconds to write the picture", |_, it| it.seconds.io.into()),
];

fn mean(summary: &Summary, metric: Metric) -> Value {
    summary.error(metric).map(|error| error.mean).into()
}

fn half_interval(summary: &Summary) -> Option<f64> {
    let [low, high] = summary.error(Metric::Mse)?.interval?;
    Some((high - low) / 2.0)
}

fn sum(load: Option<f64>, render: Option<f64>) -> Option<f64> {
    Some(load.unwrap_or_default() + render?)
}

impl<'a> Table<'a> {
    pub(super) fn new(results: &Results, summaries: &'a [Summary]) -> Self {
        let mse = |it: &Summary| Some((it.spp, it.error(Metric::Mse)?.mean));
        let plain = summaries.iter().filter(|it| it.method == PLAIN).filter_map(mse).collect();
        let curves = results.curves(Metric::Mse);
        let front = curves.curves.iter().flat_map(|curve| {
            let points = curve.points.iter().filter(|point| point.on_front);
            points.map(|point| (curve.method.clone(), point.spp))
        });
        Self { summaries, plain, front: front.collect() }
    }

    /// Whether a method is on the front at some sample count.
    pub(super) fn ever_on_front(&self, method: &str) -> bool {
        self.front.iter().any(|(it, _)| it == method)
    }

    fn on_front(&self, summary: &Summary) -> Value {
        let found = self.front.iter().any(|(it, spp)| *it == summary.method && *spp == summary.spp);
        found.then_some("yes").into()
    }

    fn ratio(&self, summary: &Summary) -> Option<f64> {
        let plain = self.plain.get(&summary.spp)?;
        // An error that is too small to be measured may be 0 or less by chance.
        Some(summary.error(Metric::Mse)?.mean / plain).filter(|ratio| *plain > 0.0 && *ratio > 0.0)
    }

    /// The rows, in the order of the summaries.
    pub(super) fn lines(&self) -> Vec<Line> {
        let cells = |it: &Summary| COLUMNS.map(|column| (column.value)(self, it)).into();
        let mut lines: Vec<Line> =
            self.summaries.iter().map(|it| Line { cells: cells(it), best: Vec::new() }).collect();
        let mut counts: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (row, summary) in self.summaries.iter().enumerate() {
            counts.entry(summary.spp).or_default().push(row);
        }
        for rows in counts.values() {
            for column in (0..COLUMNS.len()).filter(|&column| COLUMNS[column].lowest) {
                let value = |&row: &usize| Some((row, lines[row].cells[column].as_f64()?));
                let found: Vec<_> = rows.iter().filter_map(value).collect();
                let best = found.iter().min_by(|a, b| a.1.total_cmp(&b.1));
                if let Some(&(row, _)) = best.filter(|_| found.len() > 1) {
                    lines[row].best.push(column);
                }
            }
        }
        lines
    }
}

/// Which methods failed where, and why.
pub(super) fn failures(summaries: &[Summary]) -> Vec<String> {
    let failure = |it: &Summary| {
        let why = it.failure.as_ref()?;
        Some(format!("{} at {} spp: {why}", it.method, it.spp))
    };
    summaries.iter().filter_map(failure).collect()
}

/// What was compared, in a line.
pub(super) fn headline(results: &Results, summaries: &[Summary]) -> String {
    let [width, height] = results.size();
    let methods = results.distinct(|row| &row.method).len();
    let spp = summaries.iter().map(|it| it.spp);
    let counts = match (spp.clone().min(), spp.max()) {
        (Some(least), Some(most)) if least < most => format!("{least} to {most}"),
        (least, _) => least.unwrap_or_default().to_string(),
    };
    format!(
        "{width} × {height} pixels, {counts} samples per pixel, {}, {}",
        results.runs(),
        counted(methods, "method")
    )
}

/// Names and values of what else belongs to a measurement.
pub(super) fn facts(results: &Results, table: &str) -> Vec<(&'static str, String)> {
    let rows = results.rows();
    let list = |names: Vec<&str>| {
        let names: Vec<_> = names.into_iter().filter(|name| !name.is_empty()).collect();
        if names.is_empty() { "–".to_owned() } else { names.join(", ") }
    };
    let threads: Vec<String> = results.threads().iter().map(u32::to_string).collect();
    let own = rows.iter().find_map(|row| row.reference_mse);
    let own = own.map_or("–".to_owned(), |mse| {
        format!("{}, its own MSE: mean errors below it are not told apart", number(mse, 2))
    });
    let formula = |metric: Formula| metric.formula().to_owned();
    vec![
        ("Reference", own),
        ("Processor", list(results.distinct(|row| &row.machine))),
        ("Threads", list(threads.iter().map(String::as_str).collect())),
        ("GPU", list(results.distinct(|row| row.adapter.as_deref().unwrap_or_default()))),
        ("Version of nst", list(results.distinct(|row| &row.version))),
        ("Table", format!("{table}, version {SCHEMA}")),
        ("MSE", formula(Formula::Mse)),
        ("relMSE", formula(Formula::RelMse)),
        ("SMAPE", formula(Formula::Smape)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Row;

    fn results() -> Results {
        let row = |method: &str, spp, mse, total| Row {
            method: method.into(),
            spp,
            mse,
            total_seconds: total,
            relmse: mse.map(|mse| 2.0 * mse),
            width: 4,
            height: 2,
            ..Row::default()
        };
        let failed = Some("it has <b>".to_owned());
        Results::of([
            row("none", 8, Some(4.0), Some(1.0)),
            row("none", 16, Some(2.0), Some(2.0)),
            row("a", 8, Some(1.0), Some(1.5)),
            row("a", 16, Some(-1.0), Some(9.0)),
            Row { failure: failed, ..row("b", 8, None, None) },
        ])
        .expect("rows that fit together")
    }

    fn cell(lines: &[Line], row: usize, label: &str) -> Value {
        let column = COLUMNS.iter().position(|column| column.label == label).expect("a column");
        lines[row].cells[column].clone()
    }

    #[test]
    fn rows_have_a_cell_for_each_column() {
        let results = results();
        let summaries = results.summaries();
        let table = Table::new(&results, summaries);
        let lines = table.lines();
        assert!(lines.iter().all(|line| line.cells.len() == COLUMNS.len()));
        let ratios: Vec<_> = (0..5).map(|row| cell(&lines, row, "÷ plain")).collect();
        assert_eq!(ratios, [1.0.into(), 1.0.into(), 0.25.into(), Value::Null, Value::Null]);
        let front: Vec<_> = (0..5).map(|row| cell(&lines, row, "front")).collect();
        assert_eq!(front, ["yes".into(), Value::Null, "yes".into(), Value::Null, Value::Null]);
        assert_eq!(cell(&lines, 4, "MSE"), Value::Null);
        assert!(table.ever_on_front("a") && !table.ever_on_front("b"));
    }

    #[test]
    fn the_lowest_errors_of_as_many_samples_are_marked() {
        let results = results();
        let summaries = results.summaries();
        let lines = Table::new(&results, summaries).lines();
        let marked: Vec<Vec<&str>> = lines
            .iter()
            .map(|line| line.best.iter().map(|&column| COLUMNS[column].label).collect())
            .collect();
        let none: Vec<&str> = Vec::new();
        // A single ratio has nothing to be compared with.
        let all = [none.clone(), none.clone(), vec!["MSE", "÷ plain", "relMSE"]];
        assert_eq!(marked, [&all[..], &[vec!["MSE", "relMSE"], none]].concat());
    }

    #[test]
    fn words() {
        let results = results();
        let summaries = results.summaries();
        assert_eq!(failures(summaries), ["b at 8 spp: it has <b>"]);
        let headline = headline(&results, summaries);
        assert_eq!(headline, "4 × 2 pixels, 8 to 16 samples per pixel, 1 run, 3 methods");
        let facts = facts(&results, "x.csv");
        assert!(facts.contains(&("Table", format!("x.csv, version {SCHEMA}"))), "{facts:?}");
        assert!(facts.contains(&("Processor", "–".into())), "{facts:?}");
    }
}

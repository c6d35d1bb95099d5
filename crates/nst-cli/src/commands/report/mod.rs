//! `nst report`: the results of `nst bench scene` as a page for browsers.
//!
//! `page/` contains the page's HTML, style and script, `page.rs` puts them together with the
//! data: the table, charts, and the pictures.

mod comparer;
mod page;
mod sources;
mod stored;
mod table;

use std::{fmt, io::Write, path::Path};

use nst_files::output::{Kind, Name, OutputFile, Outputs};
use serde::Serialize;

use crate::{
    args::ReportArgs,
    chart::Chart,
    error::Error,
    results::{Metric, Results, advice, beside},
};

use comparer::{Comparer, Stored};
use table::{COLUMNS, Column, Line, Table};

/// What `page/main.js` reads.
#[derive(Serialize)]
struct Data<'a> {
    scene: &'a str,
    headline: String,
    advice: String,
    /// The first is shown, the others may be opened.
    charts: Vec<Figure>,
    columns: &'a [Column],
    rows: Vec<Line>,
    failures: Vec<String>,
    facts: Vec<(&'static str, String)>,
    comparer: Option<Comparer>,
    /// Why there is no comparer, and how to get one.
    no_pictures: Option<String>,
}

/// A chart, and the places of its marks with their values.
#[derive(Serialize)]
struct Figure {
    title: String,
    svg: String,
    /// Pixels from the left and from the top, in the SVG's units, and what is there.
    marks: Vec<(f64, f64, String)>,
}

/// What was written.
#[derive(Serialize)]
pub(super) struct Report {
    scene: String,
    advice: String,
    pictures: usize,
    bytes: usize,
    files: Vec<String>,
    notes: Vec<String>,
}

pub(super) fn run(args: &ReportArgs) -> Result<Report, Error> {
    let exr = beside(&args.table);
    let others = args.picture.iter().map(|picture| &picture.file);
    let mut outputs = Outputs::of_inputs([&args.table, &exr].into_iter().chain(others));
    let (path, name) = match &args.output {
        Some(path) => (path.clone(), Name::Given),
        None => (args.table.with_extension("html"), Name::Default),
    };
    let output = outputs.open(&path, Kind::Html, name)?;
    let results = Results::read(std::slice::from_ref(&args.table), args.scene.as_deref())?;
    let summaries = results.summaries();
    let table = Table::new(&results, summaries);
    let mut data = Data {
        scene: results.scene(),
        headline: table::headline(&results, summaries),
        advice: advice(&results, Metric::Mse),
        charts: figures(&results),
        columns: &COLUMNS,
        rows: table.lines(),
        failures: table::failures(summaries),
        facts: table::facts(&results, &file_name(&args.table)),
        comparer: None,
        no_pictures: None,
    };
    let pictures = add_pictures(&mut data, args, &exr, &results, &table)?;
    let page = page::page(&data, &pictures);
    let done = Report {
        scene: data.scene.to_owned(),
        advice: data.advice,
        pictures: pictures.len(),
        bytes: page.len(),
        files: vec![path.display().to_string()],
        notes: match (&data.comparer, &data.no_pictures) {
            (Some(comparer), _) => comparer.notes().to_vec(),
            (None, why) => why.iter().cloned().collect(),
        },
    };
    write(output, &page)?;
    Ok(done)
}

/// Charts of the MSE, and of the other metrics if they were measured.
fn figures(results: &Results) -> Vec<Figure> {
    let figure = |metrics: &[Metric]| {
        let chart = Chart::without_heading(results, metrics);
        let names: Vec<_> = metrics.iter().map(|metric| metric.name()).collect();
        Figure {
            title: format!("{} against time and samples", names.join(" and ")),
            svg: chart.svg,
            marks: chart.marks.into_iter().map(|mark| (mark.x, mark.y, mark.label)).collect(),
        }
    };
    let mut others = vec![Metric::RelMse, Metric::Smape];
    others.retain(|metric| !results.curves(*metric).curves.is_empty());
    let first = figure(&[Metric::Mse]);
    [first].into_iter().chain((!others.is_empty()).then(|| figure(&others))).collect()
}

/// Adds the comparer, if there are pictures; returns these as they are stored.
fn add_pictures(
    data: &mut Data<'_>,
    args: &ReportArgs,
    exr: &Path,
    results: &Results,
    table: &Table<'_>,
) -> Result<Stored, Error> {
    if !exr.exists() {
        let missing = format!(
            "'{}' is missing, the pictures that nst bench scene writes beside the table",
            exr.display()
        );
        if !args.picture.is_empty() {
            return Err(Error::Usage(format!("--picture: there is no reference: {missing}")));
        }
        data.no_pictures = Some(format!(
            "There are no pictures to compare: {missing}. Measure again, or put that file there, \
             and make this page again."
        ));
        return Ok(Stored::new());
    }
    let sources = sources::sources(exr, &args.picture, results, table)?;
    let used = page::page(data, &[]).len();
    let (comparer, stored) = Comparer::new(&sources, results, used)?;
    data.comparer = Some(comparer);
    Ok(stored)
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn write(mut output: OutputFile, page: &str) -> Result<(), Error> {
    output.file().write_all(page.as_bytes()).map_err(|source| {
        let path = output.path().to_owned();
        Error::Files(nst_files::Error::Io { action: "write", path, source })
    })?;
    Ok(output.commit()?)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.advice)?;
        for note in &self.notes {
            writeln!(f, "note: {note}")?;
        }
        let megabytes = self.bytes as f64 / 1e6;
        write!(f, "wrote {} ({megabytes:.1} MB, {} pictures)", self.files.join(", "), self.pictures)
    }
}

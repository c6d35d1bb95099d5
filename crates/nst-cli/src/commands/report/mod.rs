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

use nst_files::{
    header::ExrHeader,
    output::{Kind, Name, OutputFile, Outputs},
};
use serde::Serialize;

use crate::{
    args::ReportArgs,
    chart::Chart,
    error::Error,
    results::{Metric, Results, advice, belongs, beside},
};

use comparer::{Comparer, Stored};
use table::{COLUMNS, Column, Line, Table};

/// What `page/main.js` reads.
#[derive(Serialize)]
struct Data<'a> {
    scene: &'a str,
    headline: String,
    /// By MSE and by relMSE.
    advice: [String; 2],
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
    advice: [String; 2],
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
        advice: [Metric::Mse, Metric::RelMse].map(|metric| advice(&results, metric)),
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
    let notes = match (&data.comparer, &data.no_pictures) {
        (Some(comparer), _) => comparer.notes().to_vec(),
        (None, why) => why.iter().cloned().collect(),
    };
    let done = Report {
        scene: data.scene.to_owned(),
        advice: data.advice,
        pictures: pictures.len(),
        bytes: page.len(),
        files: vec![path.display().to_string()],
        notes: [results.notes(), notes].concat(),
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
    if let Some(why) = unusable(exr, args, results)? {
        if !args.picture.is_empty() {
            return Err(Error::Usage(format!("--picture: there is no reference: {why}")));
        }
        data.no_pictures = Some(format!("There are no pictures to compare: {why}."));
        return Ok(Stored::new());
    }
    let sources = sources::sources(exr, &args.picture, results, table)?;
    let used = page::page(data, &[]).len();
    let (comparer, stored) = Comparer::new(&sources, results, used)?;
    data.comparer = Some(comparer);
    Ok(stored)
}

/// Why the file beside the table has no pictures for its page, if that is so. Pictures of
/// another table look alike; those that do not say whose they are count if the user names
/// their file.
///
/// # Errors
/// [`Error::Unlike`] if they are those of another table.
fn unusable(exr: &Path, args: &ReportArgs, results: &Results) -> Result<Option<String>, Error> {
    let shown = exr.display();
    if !exr.exists() {
        return Ok(Some(format!(
            "'{shown}' is missing, the pictures that nst bench scene writes beside the table; \
             measure again, or put that file there, and make this page again"
        )));
    }
    let same = |file: &Path| file.canonicalize().ok() == exr.canonicalize().ok();
    let is_named = args.picture.iter().any(|picture| same(&picture.file));
    match belongs(&ExrHeader::read(exr)?, &results.rows()[0]) {
        Some(true) => Ok(None),
        None if is_named => Ok(None),
        Some(false) => Err(Error::Unlike(format!(
            "'{shown}' has the pictures of another table, whose scene or reference is another; \
             let nst bench scene end, or move the file away"
        ))),
        None => Ok(Some(format!(
            "'{shown}' does not say whether its pictures are those of the table; if they are, \
             name one of them: --picture NAME={shown}:LAYER"
        ))),
    }
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
        let [mse, relmse] = &self.advice;
        writeln!(f, "{mse}")?;
        if relmse != mse {
            writeln!(f, "{relmse}")?;
        }
        for note in &self.notes {
            writeln!(f, "note: {note}")?;
        }
        let megabytes = self.bytes as f64 / 1e6;
        write!(f, "wrote {} ({megabytes:.1} MB, {} pictures)", self.files.join(", "), self.pictures)
    }
}

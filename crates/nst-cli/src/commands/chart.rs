//! `nst chart`: a table of results → SVG and PNG.

use std::{
    fmt,
    io::Write,
    path::{Path, PathBuf},
};

use nst_files::{
    output::{Kind, Name, OutputFile, Outputs, commit},
    png,
};
use serde::Serialize;

use super::check_distinct;
use crate::{
    args::{ChartArgs, has_extension},
    chart::Chart,
    error::Error,
    results::{Metric, Results, advice},
};

/// What was drawn.
#[derive(Serialize)]
pub(super) struct Report {
    scene: String,
    methods: Vec<String>,
    rows: usize,
    /// By each metric.
    advice: Vec<String>,
    notes: Vec<String>,
    files: Vec<String>,
    #[serde(skip)]
    metrics: Vec<Metric>,
}

pub(super) fn run(args: &ChartArgs) -> Result<Report, Error> {
    check_distinct(&args.tables)?;
    if let Some(folder) = args.tables.iter().find(|path| path.is_dir()) {
        let source = std::io::Error::other("it is a folder; name the table in it");
        let path = folder.clone();
        return Err(nst_files::Error::Io { action: "read", path, source }.into());
    }
    let (paths, name) = match &args.output {
        Some(path) => (vec![path.clone()], Name::Given),
        None => {
            let named = |extension| args.tables[0].with_extension(extension);
            (vec![named("svg"), named("png")], Name::Default)
        }
    };
    let mut outputs = Outputs::of_inputs(&args.tables);
    let open = |path: &PathBuf| outputs.open(path, kind(path), name);
    let mut files: Vec<OutputFile> = paths.iter().map(open).collect::<Result<_, _>>()?;
    let results = Results::read(&args.tables, args.scene.as_deref())?;
    let metrics = args.metric.map_or(vec![Metric::Mse, Metric::RelMse], |metric| vec![metric]);
    let chart = Chart::draw(&results, &metrics);
    for file in &mut files {
        write(&chart, file)?;
    }
    commit(files)?;
    let methods = results.distinct(|row| &row.method);
    Ok(Report {
        scene: results.scene().to_owned(),
        methods: methods.into_iter().map(str::to_owned).collect(),
        rows: results.rows().len(),
        advice: metrics.iter().map(|metric| advice(&results, *metric)).collect(),
        notes: results.notes(),
        files: paths.iter().map(|path| path.display().to_string()).collect(),
        metrics,
    })
}

fn kind(path: &Path) -> Kind {
    if has_extension(path, "png") { Kind::Png } else { Kind::Svg }
}

fn write(chart: &Chart, output: &mut OutputFile) -> Result<(), Error> {
    if kind(output.path()) == Kind::Png {
        let (size, pixels) = chart.pixels();
        return Ok(png::write_rgb8(output, size, &pixels)?);
    }
    let path = output.path().to_owned();
    let written = output.file().write_all(chart.svg.as_bytes());
    let failed = |source| nst_files::Error::Io { action: "write", path, source };
    Ok(written.map_err(failed)?)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "results    {} rows of {}", self.rows, self.scene)?;
        for (metric, advice) in self.metrics.iter().zip(&self.advice) {
            writeln!(f, "{:<11}{advice}", format!("by {}", metric.name()))?;
        }
        for note in &self.notes {
            writeln!(f, "note       {note}")?;
        }
        write!(f, "wrote      {}", self.files.join(", "))
    }
}

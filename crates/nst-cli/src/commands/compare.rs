//! `nst compare`: how far pictures are from a reference.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use nst_core::metrics::{Decomposition, EPSILON, Means, Metric, RunErrors, TRIMMED};
use nst_files::{
    false_color,
    header::{ExrHeader, Window},
    output::{Kind, Name, OutputFile, Outputs},
    picture::Picture,
};
use serde::Serialize;

use super::check_distinct;
use crate::{args::CompareArgs, error::Error, progress::Progress, words::counted};

/// The range of the error map: from where noise is no longer visible to errors above the
/// radiance itself. It is the same for all pictures, so that maps can be compared.
pub(super) const MAP_SCALE: [f64; 2] = [1e-5, 1e1];

/// How far the pictures are from the reference.
#[derive(Serialize)]
pub(super) struct Report {
    reference: String,
    /// The layers that were compared; empty for main pictures.
    layer: String,
    reference_layer: String,
    width: u32,
    height: u32,
    /// The left upper corner of what was compared.
    position: [i32; 2],
    channels: usize,
    runs: usize,
    epsilon: f64,
    trimmed_pixels: usize,
    /// Pixels that are not finite in some channel, summed over the runs.
    nonfinite_pixels: usize,
    mse: Row,
    relmse: Row,
    smape: Row,
    error_map: Option<Map>,
    notes: Vec<String>,
}

/// The means of a metric over the runs. Values that need two runs or a squared metric may
/// be missing.
#[derive(Serialize)]
struct Row {
    error: f64,
    standard_error: Option<f64>,
    trimmed: f64,
    bias_squared: Option<f64>,
    variance: Option<f64>,
}

#[derive(Serialize)]
struct Map {
    file: String,
    metric: &'static str,
    formula: &'static str,
    scale: &'static str,
    colors: &'static str,
    low: f64,
    high: f64,
}

pub(super) fn run(args: &CompareArgs) -> Result<Report, Error> {
    let Some((reference_path, pictures @ [_, ..])) = args.files.split_last() else {
        let message = "nothing to compare; name one or more pictures, and then the reference";
        return Err(Error::Usage(message.into()));
    };
    check_distinct(pictures)?;
    let mut outputs = Outputs::of_inputs(&args.files);
    let open = |path: &PathBuf| outputs.open(path, Kind::Png, Name::Given);
    let mut map = args.error_map.as_ref().map(open).transpose()?;
    let reference = open_reference(args, reference_path)?;
    let runs = pictures
        .iter()
        .map(|path| Picture::open(path, args.layer.as_deref()))
        .collect::<Result<Vec<_>, _>>()?;
    let window = common_window(&runs, &reference)?;

    let progress = Progress::count(
        &format!("reading {}", reference_path.display()),
        "compare",
        runs.len() as u64,
        &args.common,
    );
    let truth = reference.read_window(&window)?;
    let channels = reference.channel_names.len();
    let mut errors = RunErrors::new(&truth, channels)?;
    let mut means = Vec::new();
    let mut nonfinite_pixels = 0;
    for run in &runs {
        let (run, nonfinite) = errors.push(&run.read_window(&window)?)?;
        means.push(run);
        nonfinite_pixels += nonfinite;
        progress.advance(1);
    }
    drop(progress);
    let row = |index: usize| {
        let of_metric: Vec<Means> = means.iter().map(|run| run[index]).collect();
        Row::new(&of_metric, errors.decomposition(Metric::ALL[index]))
    };
    if let Some(output) = &mut map {
        false_color::write_png(output, window.size, errors.relative_error_map(), MAP_SCALE)?;
    }
    let report = Report {
        reference: reference_path.display().to_string(),
        layer: runs[0].layer.clone(),
        reference_layer: reference.layer.clone(),
        width: window.size[0],
        height: window.size[1],
        position: window.position,
        channels,
        runs: runs.len(),
        epsilon: EPSILON,
        trimmed_pixels: errors.trimmed_pixels(),
        nonfinite_pixels,
        mse: row(0),
        relmse: row(1),
        smape: row(2),
        error_map: map.as_ref().map(Map::of),
        notes: notes(&runs, &reference, &window),
    };
    map.map(OutputFile::commit).transpose()?;
    Ok(report)
}

/// The layer that was asked for; or that of the pictures, if the reference has it.
fn open_reference(args: &CompareArgs, path: &Path) -> Result<Picture, Error> {
    if let Some(layer) = &args.reference_layer {
        return Ok(Picture::open(path, Some(layer))?);
    }
    if let Some(layer) = &args.layer
        && ExrHeader::read(path)?.choose(Some(layer)).is_ok()
    {
        return Ok(Picture::open(path, Some(layer))?);
    }
    Ok(Picture::open(path, None)?)
}

/// The pixels that all pictures have, which are parts of one frame.
fn common_window(runs: &[Picture], reference: &Picture) -> Result<Window, Error> {
    let mut common = reference.window();
    for run in runs {
        let channels = run.channel_names.len() == reference.channel_names.len();
        // The same pixels, or parts of the same frame.
        let frame = run.window() == reference.window() || run.display == reference.display;
        let found = common.intersection(&run.window()).filter(|_| frame && channels);
        common = found.ok_or_else(|| unlike(run, reference))?;
    }
    Ok(common)
}

fn unlike(run: &Picture, reference: &Picture) -> Error {
    let of = |picture: &Picture| {
        let Window { position: [x, y], size: [width, height] } = picture.window();
        let [wide, high] = picture.display.size;
        let channels = picture.channel_names.join(", ");
        format!("{width}x{height} pixels from ({x}, {y}) of a {wide}x{high} frame, of {channels}")
    };
    Error::Unlike(format!(
        "'{}' has {}, but the reference '{}' has {}; they must be parts of one frame with pixels \
         in common, and have the same number of channels",
        run.path().display(),
        of(run),
        reference.path().display(),
        of(reference)
    ))
}

/// What a user should know about the comparison.
fn notes(runs: &[Picture], reference: &Picture, window: &Window) -> Vec<String> {
    let all = || runs.iter().chain([reference]);
    let mut notes: Vec<_> = all().filter_map(Picture::primaries_note).collect();
    if all().any(|picture| picture.window() != *window) {
        let Window { position: [x, y], size: [width, height] } = window;
        notes.push(format!(
            "the pictures are different parts of their frame: compared are the {width}x{height} \
             pixels from ({x}, {y}) that all of them have"
        ));
    }
    notes
}

impl Map {
    fn of(output: &OutputFile) -> Self {
        Self {
            file: output.path().display().to_string(),
            metric: "relMSE",
            formula: "(x − I)² / (I² + 0.01)",
            scale: "log10",
            colors: "inferno",
            low: MAP_SCALE[0],
            high: MAP_SCALE[1],
        }
    }
}

impl Row {
    fn new(runs: &[Means], decomposition: Option<Decomposition>) -> Self {
        let count = runs.len() as f64;
        let error = runs.iter().map(|run| run.all).sum::<f64>() / count;
        let squares = runs.iter().map(|run| (run.all - error).powi(2)).sum::<f64>();
        Self {
            error,
            standard_error: (runs.len() > 1).then(|| (squares / (count - 1.0) / count).sqrt()),
            trimmed: runs.iter().map(|run| run.trimmed).sum::<f64>() / count,
            bias_squared: decomposition.map(|parts| parts.bias_squared),
            variance: decomposition.map(|parts| parts.variance),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_table(f)?;
        writeln!(
            f,
            "trimmed: without the {} of largest error ({} %) of each picture",
            counted(self.trimmed_pixels, "pixel"),
            100.0 * TRIMMED
        )?;
        writeln!(f, "not finite: {}, left out", counted(self.nonfinite_pixels, "pixel"))?;
        if self.runs > 1 {
            writeln!(
                f,
                "error: the mean over the pictures, taken for independent runs; it is bias² + \
                 variance\n\
                 variance: s² = Σ (x − x̄)² / (R − 1); bias²: (x̄ − I)² − s² / R, which may be \
                 below 0"
            )?;
        }
        for note in &self.notes {
            writeln!(f, "note: {note}")?;
        }
        if let Some(map) = &self.error_map {
            writeln!(
                f,
                "wrote {}: {} of each pixel, {}, {} from {:e} (black) to {:e} (yellow); cyan is \
                 not finite",
                map.file, map.formula, map.colors, map.scale, map.low, map.high
            )?;
        }
        Ok(())
    }
}

impl Report {
    fn write_table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { runs, reference, width, height, .. } = self;
        let of = |layer: &str| match layer {
            "" => String::new(),
            layer => format!(" (layer {layer})"),
        };
        writeln!(
            f,
            "{}{} against {reference}{}: {width}x{height} pixels, {}",
            counted(*runs, "picture"),
            of(&self.layer),
            of(&self.reference_layer),
            counted(self.channels, "channel")
        )?;
        let (spread, parts) = if *runs > 1 {
            (format!("{:>11}", "± s.e."), format!("{:>12}{:>12}", "bias²", "variance"))
        } else {
            Default::default()
        };
        writeln!(f, "{:42}{:>11}{spread}{:>12}{parts}", "", "error", "trimmed")?;
        for (metric, row) in Metric::ALL.into_iter().zip([&self.mse, &self.relmse, &self.smape]) {
            let optional = |value: Option<f64>, width: usize| match value {
                Some(value) => format!("{value:>width$.3e}"),
                None if *runs > 1 => format!("{:>width$}", "–"),
                None => String::new(),
            };
            writeln!(
                f,
                "{:8}{:34}{:>11.4e}{}{:>12.4e}{}{}",
                metric,
                metric.formula(),
                row.error,
                optional(row.standard_error, 11),
                row.trimmed,
                optional(row.bias_squared, 12),
                optional(row.variance, 12)
            )?;
        }
        Ok(())
    }
}

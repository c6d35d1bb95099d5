//! Pictures of a bench: those of other programs, and those that it writes for a report.

use nst_files::{ColorModel, output::OutputFile, picture::Picture, picture_writer::write_exr};

use super::{
    measure::{Meter, Methods},
    source::Source,
};
use crate::{
    args::NamedPicture,
    error::Error,
    interrupt,
    results::{Metric, PLAIN, Results, Row, Summary, layer_of},
};

/// The most methods that a report's pictures show, beside the plain estimate and `auto`.
const MOST_SHOWN: usize = 6;

/// A picture of another program.
pub(super) struct Other {
    row: Row,
    lanes: Vec<f32>,
}

/// Reads and judges pictures of other programs. Several of one name and one sample count
/// are independent runs.
pub(super) fn others(meter: &Meter<'_>, named: &[NamedPicture]) -> Result<Vec<Other>, Error> {
    let mut others: Vec<Other> = Vec::new();
    for NamedPicture { name, file, layer } in named {
        let picture = Picture::open(file, layer.as_deref())?;
        let shown = file.display();
        let [width, height] = meter.origin.size;
        if picture.size != meter.origin.size || picture.channel_names.len() != 3 {
            return Err(Error::Unlike(format!(
                "'{shown}' is no RGB picture of {width}x{height} pixels, as the bench's are"
            )));
        }
        let Some(spp) = picture.samples_per_pixel else {
            return Err(Error::Unlike(format!(
                "'{shown}' does not say with how many samples per pixel it was rendered; write \
                 the attribute samplesPerPixel into it"
            )));
        };
        let same = |other: &&Other| other.row.method == *name && other.row.spp == spp;
        let run = others.iter().filter(same).count() as u32;
        let seconds = picture.render_seconds;
        let mut row = Row {
            method: name.clone(),
            spp,
            run,
            render_seconds: seconds,
            total_seconds: seconds,
            ..meter.blank()
        };
        let lanes = picture.read()?;
        meter.judge(&mut row, &lanes, None)?;
        others.push(Other { row, lanes });
    }
    Ok(others)
}

pub(super) fn rows(others: &[Other]) -> Vec<Row> {
    others.iter().map(|other| other.row.clone()).collect()
}

/// Writes `x.exr` beside `x.csv`: the reference, and the first run of the best methods as
/// layers `METHOD.SPP`.
pub(super) fn write(
    meter: &Meter<'_>,
    source: &Source,
    methods: &mut Methods,
    others: Vec<Other>,
    results: &Results,
    mut output: OutputFile,
) -> Result<(), Error> {
    let mut layers = vec![(String::new(), meter.reference.mean())];
    let window = methods.window(meter.origin)?;
    let names = shown(results);
    for spp in results.sample_counts() {
        let of_source = |row: &Row| row.spp == spp && methods.names().any(|it| it == row.method);
        if !results.rows().iter().any(of_source) {
            continue;
        }
        let run = source.run(spp, 0, window)?;
        if interrupt::asked() {
            let why = format!("all rows are measured, but '{}' is not", output.path().display());
            return Err(Error::Interrupted(why));
        }
        for name in &names {
            if let Some(lanes) = methods.picture(name, meter.origin, &run) {
                layers.push((layer_of(name, spp), lanes));
            }
        }
    }
    let first = others.into_iter().filter(|other| other.row.run == 0);
    layers.extend(first.map(|it| (layer_of(&it.row.method, it.row.spp), it.lanes)));
    let layers: Vec<_> = layers.iter().map(|(name, lanes)| (&**name, &**lanes)).collect();
    write_exr(&mut output, meter.origin.size, ColorModel::Rgb, &layers)?;
    Ok(output.commit()?)
}

/// The methods to show: the plain estimate, `auto`, and those with the lowest relMSE,
/// relative to the plain one, at some sample count.
fn shown(results: &Results) -> Vec<String> {
    let ratio = |it: &Summary| {
        let plain = results.error(PLAIN, it.spp, Metric::RelMse)?;
        Some(it.error(Metric::RelMse)?.mean / plain)
    };
    let mut ranked: Vec<(f64, &str)> = results
        .summaries()
        .iter()
        .filter(|it| it.method != PLAIN && it.method != "auto")
        .filter_map(|it| Some((ratio(it)?, &*it.method)))
        .collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut names = vec![PLAIN.to_owned(), "auto".to_owned()];
    for (_, name) in ranked {
        if names.iter().all(|it| it != name) && names.len() < 2 + MOST_SHOWN {
            names.push(name.to_owned());
        }
    }
    names
}

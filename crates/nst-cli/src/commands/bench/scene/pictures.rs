//! Pictures of a bench: those of other programs, and those that it writes for a report.

use std::path::PathBuf;

use nst_files::{
    ColorModel,
    header::ExrHeader,
    output::OutputFile,
    picture::Picture,
    picture_writer::{PictureInfo, write_exr},
};

use super::{measure::Meter, methods::Methods, source::Source};
use crate::{
    args::NamedPicture,
    error::Error,
    interrupt,
    results::{Metric, PLAIN, Results, Row, Summary, belongs, layer_of},
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
        if picture.channel_names.len() != ColorModel::Rgb.channels().len() {
            return Err(Error::Unlike(format!("'{shown}' has no channels R, G and B")));
        }
        if picture.size != meter.origin.size {
            let [w, h] = picture.size;
            return Err(Error::Unlike(format!(
                "'{shown}' has {w}x{h} pixels, but the bench's pictures have {width}x{height}"
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
        let again = |other: &&Other| other.row.method == *name && other.lanes == lanes;
        if meter.reference.is(&lanes) || others.iter().any(|other| again(&other)) {
            return Err(Error::Unlike(format!(
                "'{shown}' has the very pixels of the reference, or of another picture '{name}'; \
                 runs and references must be independent"
            )));
        }
        meter.judge(&mut row, &lanes, None)?;
        others.push(Other { row, lanes });
    }
    Ok(others)
}

pub(super) fn rows(others: &[Other]) -> Vec<Row> {
    others.iter().map(|other| other.row.clone()).collect()
}

/// The pictures that an earlier bench wrote for the same table.
struct Earlier {
    path: PathBuf,
    layers: Vec<String>,
}

impl Earlier {
    /// Those of a file, none if it is not there or is of another table than a row.
    fn of(path: PathBuf, row: &Row) -> Self {
        let header =
            ExrHeader::read(&path).ok().filter(|header| belongs(header, row) == Some(true));
        let layers = header.iter().flat_map(ExrHeader::layers).map(|layer| layer.name).collect();
        Self { path, layers }
    }

    /// A method's picture, if it is there and can be read.
    fn read(&self, method: &str, spp: u32) -> Option<Vec<f32>> {
        let name = layer_of(method, spp);
        let layer = self.layers.iter().find(|layer| **layer == name)?;
        Picture::open(&self.path, Some(layer)).ok()?.read().ok()
    }
}

/// Writes `x.exr` beside `x.csv`: the reference, and the first run of the best methods as
/// layers `METHOD.SPP`. Pictures that cannot be made again are taken from the file that is
/// there.
pub(super) fn write(
    meter: &Meter<'_>,
    source: &Source,
    methods: &mut Methods,
    others: Vec<Other>,
    results: &Results,
    mut output: OutputFile,
) -> Result<(), Error> {
    let earlier = Earlier::of(output.path().to_owned(), &meter.blank());
    let mut layers = vec![(String::new(), meter.reference.mean())];
    let shown = shown(results, |name| methods.can_make(name));
    let needs = methods.needs(shown.iter().map(String::as_str), meter.origin)?;
    let is_given = |name: &str| others.iter().any(|other| other.row.method == name);
    let all = results.distinct(|row| &row.method);
    let kept = all.into_iter().filter(|name| !methods.can_make(name) && !is_given(name));
    let kept: Vec<&str> = kept.collect();
    for spp in results.sample_counts() {
        let measured = |row: &Row| row.spp == spp && shown.contains(&row.method);
        let run = (source.has(spp, 0) && results.rows().iter().any(measured))
            .then(|| source.run(spp, 0, needs))
            .transpose()?;
        if interrupt::asked() {
            let why = format!("all rows are measured, but '{}' is not", output.path().display());
            return Err(Error::Interrupted(why));
        }
        for name in shown.iter().map(String::as_str).chain(kept.iter().copied()) {
            let made = run.as_ref().filter(|_| methods.can_make(name));
            let made = made.and_then(|run| methods.picture(name, meter.origin, run));
            if let Some(lanes) = made.or_else(|| earlier.read(name, spp)) {
                layers.push((layer_of(name, spp), lanes));
            }
        }
    }
    let first = others.into_iter().filter(|other| other.row.run == 0);
    layers.extend(first.map(|it| (layer_of(&it.row.method, it.row.spp), it.lanes)));
    let layers: Vec<_> = layers.iter().map(|(name, lanes)| (&**name, &**lanes)).collect();
    let info = PictureInfo {
        scene: Some(meter.origin.fingerprint.clone()),
        reference: Some(meter.reference.hash.clone()),
        ..PictureInfo::default()
    };
    write_exr(&mut output, meter.origin.size, ColorModel::Rgb, &layers, &info)?;
    Ok(output.commit()?)
}

/// The methods to show: the plain estimate, `auto`, and those with the lowest relMSE,
/// relative to the plain one, at some sample count; of those that can be made.
fn shown(results: &Results, can_make: impl Fn(&str) -> bool) -> Vec<String> {
    let ratio = |it: &Summary| {
        let plain = results.error(PLAIN, it.spp, Metric::RelMse)?;
        Some(it.error(Metric::RelMse)?.mean / plain)
    };
    let mut ranked: Vec<(f64, &str)> = results
        .summaries()
        .iter()
        .filter(|it| it.method != PLAIN && it.method != "auto" && can_make(&it.method))
        .filter_map(|it| Some((ratio(it)?, &*it.method)))
        .collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let there = results.distinct(|row| &row.method);
    let mut names = vec![PLAIN.to_owned(), "auto".to_owned()];
    names.retain(|name| there.contains(&&**name));
    for (_, name) in ranked {
        if names.iter().all(|it| it != name) && names.len() < 2 + MOST_SHOWN {
            names.push(name.to_owned());
        }
    }
    names
}

//! `nst transform`: a stored sequence → transformation → picture, strip by strip.

use std::time::{Duration, Instant};

use nst_core::{Estimates, Grid, SequenceBatch, Side, Strips, Support};
use nst_files::{
    output::{Name, Outputs},
    picture_writer::PictureWriter,
    png::PngWriter,
    sequence_file::{SequenceInfo, SequenceReader},
};

use super::picture_files::{PictureFiles, header};
use crate::{
    adapter::caught,
    args::TransformArgs,
    error::Error,
    method::Method,
    progress::Progress,
    summary::{Outcome, Stopwatch, Summary, TimedStrips, timed},
};

pub(super) fn run(args: &TransformArgs) -> Result<Summary, Error> {
    let mut watch = Stopwatch::start();
    let mut reader = timed(&mut watch.io, || SequenceReader::open(&args.sequence))?;
    let info = reader.info().clone();
    let method = Method::resolve(&args.method, &info.sampler)?;
    let advice = format!(
        "store more of them in '{}' with 'nst render --keep all', or use --transform none",
        args.sequence.display()
    );
    method.check_terms(info.sample_counts.len(), &advice)?;
    if method.transform.requires().support == Support::Picture {
        reader = reader.with_strip_rows(info.size[1]);
    }

    let mut outputs = Outputs::of_inputs([&args.sequence].into_iter().chain(args.method.files()));
    let default = args.sequence.with_extension("nst.exr");
    let (path, name) = match &args.output {
        Some(path) => (path, Name::Given),
        None => (&default, Name::Default),
    };
    let mut files = PictureFiles::open(&mut outputs, path, name)?;
    let lanes = write(args, &mut watch, &method, &mut reader, &info, &mut files)?;
    let files = timed(&mut watch.io, || files.commit())?;
    Ok(watch.summary(None, &method, lanes, files, (Vec::new(), 0)))
}

/// Transforms the sequence into a picture with the layers `S` and `Variance`, and into a PNG.
fn write(
    args: &TransformArgs,
    watch: &mut Stopwatch,
    method: &Method,
    reader: &mut SequenceReader,
    info: &SequenceInfo,
    files: &mut PictureFiles,
) -> Result<Outcome, Error> {
    let start = Instant::now();
    let lanes_in_all =
        info.size.map(u64::from).iter().product::<u64>() * info.model.channels().len() as u64;
    let before = format!("reading {}", args.sequence.display());
    let progress = Progress::count(&before, "transform", lanes_in_all, &args.common);
    let mut strips = TimedStrips { strips: reader, time: Duration::ZERO };
    let fitted = method.transform.fit(&mut strips)?;
    watch.transform += start.elapsed().saturating_sub(strips.time);

    let mut layers = vec!["", "S"];
    let variance = info.sides.contains(&Side::Variance);
    layers.extend(variance.then_some("Variance"));
    let seconds = Some(info.render_seconds).filter(|&seconds| seconds > 0.0);
    let about = header(info.samples(), seconds, fitted.judgement());
    let exr = files.exr.as_mut();
    let mut exr = exr
        .map(|exr| PictureWriter::create(exr, info.size, info.model, &layers, &about))
        .transpose()?;
    let mut png = PngWriter::create(&mut files.png, info.size)?;
    let channels = info.model.channels().len();
    let mut estimates = Estimates::default();
    let mut lanes = Outcome::new(fitted.judgement().cloned());
    strips.rewind(method.transform.requires().halo())?;
    while let Some(strip) = strips.next_strip()? {
        timed(&mut watch.transform, || caught(|| fitted.apply(&strip, &mut estimates)))?;
        lanes.add(&estimates);
        let [last, variance] = [Some(strip.last()), strip.side(&Side::Variance)]
            .map(|values| values.map(|values| inner(&strip, values)));
        let layers: Vec<&[f32]> = [estimates.values()]
            .into_iter()
            .chain([&last, &variance].into_iter().flatten().map(AsRef::as_ref))
            .collect();
        timed(&mut watch.io, || {
            let (exr, png) = rayon::join(
                || exr.as_mut().map_or(Ok(()), |exr| exr.push(&layers)),
                || png.push(estimates.values(), channels),
            );
            exr.and(png)
        })?;
        progress.advance(estimates.values().len() as u64);
    }
    watch.io += strips.time;
    timed(&mut watch.io, || {
        exr.map_or(Ok(()), PictureWriter::finish)?;
        png.finish()
    })?;
    Ok(lanes)
}

/// The lanes of a strip without those of its halo.
fn inner<'a>(strip: &SequenceBatch, lanes: &'a [f32]) -> std::borrow::Cow<'a, [f32]> {
    strip.grid().map_or(lanes.into(), |grid: &Grid| grid.inner(lanes))
}

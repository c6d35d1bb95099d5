//! `nst transform`: a stored sequence → transformation → picture, strip by strip.

use std::time::{Duration, Instant};

use nst_core::{Estimates, Grid, SequenceBatch, Side, Strips, Support};
use nst_files::{
    output::{Kind, Name, OutputFile, Outputs, commit},
    picture_writer::PictureWriter,
    png::PngWriter,
    sequence_file::{SequenceInfo, SequenceReader},
};

use crate::{
    args::TransformArgs,
    error::Error,
    fallback::caught,
    method::{Method, Origin},
    summary::{LaneCounts, Stopwatch, Summary, TimedStrips, timed},
};

pub(super) fn run(args: &TransformArgs) -> Result<Summary, Error> {
    let mut watch = Stopwatch::start();
    let mut reader = timed(&mut watch.io, || SequenceReader::open(&args.sequence))?;
    let info = reader.info().clone();
    let origin = Origin { scene: &info.scene, sampler: &info.sampler, counts: &info.sample_counts };
    let method = Method::resolve(&args.method, origin)?;
    let advice = format!(
        "store more of them in '{}' with 'nst render --keep all', or use --transform none",
        args.sequence.display()
    );
    method.check_terms(info.sample_counts.len(), &advice)?;
    if method.transform.requires().support == Support::Picture {
        reader = reader.with_strip_rows(info.size[1]);
    }

    let mut outputs = Outputs::of_inputs([&args.sequence].into_iter().chain(&args.method.weights));
    let default = args.sequence.with_extension("nst.exr");
    let (path, name) = match &args.output {
        Some(path) => (path, Name::Given),
        None => (&default, Name::Default),
    };
    let mut exr = outputs.open(path, Kind::Picture, name)?;
    // The program chose this name, not the user.
    let mut png = outputs.open(&path.with_extension("png"), Kind::Png, Name::Default)?;
    let lanes = write(&mut watch, &method, &mut reader, &info, [&mut exr, &mut png])?;
    let files = [&exr, &png].map(|file| file.path().display().to_string()).to_vec();
    timed(&mut watch.io, || commit([exr, png]))?;
    Ok(watch.summary(None, &method, lanes, files, (Vec::new(), 0)))
}

/// Transforms the sequence into a picture with the layers `S` and `Variance`, and into a PNG.
fn write(
    watch: &mut Stopwatch,
    method: &Method,
    reader: &mut SequenceReader,
    info: &SequenceInfo,
    [exr, png]: [&mut OutputFile; 2],
) -> Result<LaneCounts, Error> {
    let start = Instant::now();
    let mut strips = TimedStrips { strips: reader, time: Duration::ZERO };
    let fitted = method.transform.fit(&mut strips)?;
    watch.transform += start.elapsed().saturating_sub(strips.time);

    let mut layers = vec!["", "S"];
    let variance = info.sides.contains(&Side::Variance);
    layers.extend(variance.then_some("Variance"));
    let mut picture = PictureWriter::create(exr, info.size, info.model, &layers)?;
    let mut png = PngWriter::create(png, info.size)?;
    let channels = info.model.channels().len();
    let mut estimates = Estimates::default();
    let mut lanes = LaneCounts::default();
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
            let (exr, png) =
                rayon::join(|| picture.push(&layers), || png.push(estimates.values(), channels));
            exr.and(png)
        })?;
    }
    watch.io += strips.time;
    timed(&mut watch.io, || {
        picture.finish()?;
        png.finish()
    })?;
    Ok(lanes)
}

/// The lanes of a strip without those of its halo.
fn inner<'a>(strip: &SequenceBatch, lanes: &'a [f32]) -> std::borrow::Cow<'a, [f32]> {
    strip.grid().map_or(lanes.into(), |grid: &Grid| grid.inner(lanes))
}

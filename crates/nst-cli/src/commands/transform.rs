//! `nst transform`: a stored sequence → transformation → picture, strip by strip.

use std::time::{Duration, Instant};

use nst_core::{Estimates, Strips};
use nst_files::{
    output::{Name, Outputs},
    sequence_file::{KeptStrips, SequenceInfo, SequenceReader},
};

use super::picture_files::{Further, PictureFiles, header};
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
    let method = Method::resolve(&args.method, &info.sampler, &args.common)?;
    let advice = format!(
        "store more of them in '{}' with 'nst render --keep all', or use --transform none",
        args.sequence.display()
    );
    method.check_terms(info.sample_counts.len(), &advice)?;
    let mut notes: Vec<String> = method.check_statistics(&info.sides)?.into_iter().collect();
    let samples = info.sample_counts.last().copied().unwrap_or_default();
    notes.extend(method.notes(&args.method, &info.sides, samples, &info.sampler));
    reader = reader.with_least_strip_rows(method.transform.requires().least_rows());

    let mut outputs = Outputs::of_inputs([&args.sequence].into_iter().chain(args.method.files()));
    let default = args.sequence.with_extension("nst.exr");
    let (path, name) = match &args.output {
        Some(path) => (path, Name::Given),
        None => (&default, Name::Default),
    };
    let mut files = PictureFiles::open(&mut outputs, path, name)?;
    let strips: Box<dyn Strips> = match method.transform.requires().fits {
        true => Box::new(KeptStrips::new(reader)),
        false => Box::new(reader),
    };
    let lanes = write(args, &mut watch, &method, strips, &info, &mut files)?;
    let files = timed(&mut watch.io, || files.commit())?;
    Ok(watch.summary(None, &method, lanes, files, (notes, 0)))
}

/// Transforms the sequence into a picture with the layers `S` and `Variance`, and into a PNG.
fn write(
    args: &TransformArgs,
    watch: &mut Stopwatch,
    method: &Method,
    mut strips: Box<dyn Strips>,
    info: &SequenceInfo,
    files: &mut PictureFiles,
) -> Result<Outcome, Error> {
    let start = Instant::now();
    let lanes_in_all =
        info.size.map(u64::from).iter().product::<u64>() * info.model.channels().len() as u64;
    let before = format!("reading {}", args.sequence.display());
    let progress = Progress::count(&before, "transform", lanes_in_all, &args.common);
    let mut strips = TimedStrips { strips: &mut *strips, time: Duration::ZERO };
    let seconds = Some(info.render_seconds).filter(|&seconds| seconds > 0.0);
    seconds.into_iter().for_each(|seconds| method.rendered_in(seconds));
    let fitted = method.transform.fit(&mut strips)?;
    watch.transform += start.elapsed().saturating_sub(strips.time);

    let about = header(info.samples(), seconds, fitted.judgement());
    let further = Further::of(&*fitted);
    let mut picture = files.begin(info.size, info.model, &info.sides, &further, &about)?;
    let mut estimates = Estimates::default();
    let mut lanes = Outcome::new(fitted.judgement().cloned());
    strips.rewind(method.transform.requires().halo())?;
    while let Some(strip) = strips.next_strip()? {
        timed(&mut watch.transform, || caught(|| fitted.apply(&strip, &mut estimates)))?;
        lanes.add(&estimates);
        let values = estimates.values();
        timed(&mut watch.io, || picture.push(&strip, values, &further.parts(&estimates)))?;
        progress.advance(estimates.values().len() as u64);
    }
    watch.io += strips.time;
    timed(&mut watch.io, || picture.finish())?;
    Ok(lanes)
}

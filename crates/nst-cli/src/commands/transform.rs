//! `nst transform`: a stored sequence → transformation → picture, strip by strip.

use nst_core::Estimates;
use nst_render::{
    VARIANCE, film::PictureWriter, output::OutputFile, sequence_file::SequenceReader,
};

use super::set_threads;
use crate::{
    args::TransformArgs,
    error::Error,
    method::{Method, Origin},
    summary::{LaneCounts, Stopwatch, timed},
};

pub(crate) fn run(args: &TransformArgs) -> Result<(), Error> {
    set_threads(&args.common)?;
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

    let path = args.output.clone().unwrap_or_else(|| args.sequence.with_extension("nst.exr"));
    let mut exr = OutputFile::create(&path)?;
    let mut layers = vec!["S"];
    layers.extend(info.sides.iter().map(String::as_str).filter(|&name| name == VARIANCE));
    let mut picture = PictureWriter::create(&mut exr, info.size, info.model, &layers)?;
    let mut estimates = Estimates::default();
    let mut lanes = LaneCounts::default();
    while !reader.is_done() {
        let batch = timed(&mut watch.io, || reader.read_rows(reader.strip_rows()))?;
        timed(&mut watch.transform, || method.transform.apply(&batch, &mut estimates))?;
        lanes.add(&estimates);
        let mut layers = vec![estimates.values(), batch.last()];
        layers.extend(batch.side(VARIANCE));
        timed(&mut watch.io, || picture.push(&layers))?;
    }
    timed(&mut watch.io, || picture.finish())?;
    timed(&mut watch.io, || exr.commit())?;
    let written = vec![path.display().to_string()];
    watch.summary(None, &method, lanes, written).print(&args.common);
    Ok(())
}

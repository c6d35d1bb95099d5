//! `nst transform`: a stored sequence → transformation → picture.

use nst_core::Estimates;
use nst_render::{output::OutputFile, sequence_file::SequenceFile};

use super::{set_threads, write_picture};
use crate::{
    args::TransformArgs,
    error::Error,
    method::Method,
    summary::{Stopwatch, timed},
};

pub(crate) fn run(args: &TransformArgs) -> Result<(), Error> {
    set_threads(&args.common)?;
    let mut watch = Stopwatch::start();
    let file = timed(&mut watch.io, || SequenceFile::read(&args.sequence))?;
    let batch = &file.batch;
    let samples = batch.sample_counts().last().copied().unwrap_or_default();
    let method = Method::resolve(&args.method, &file.scene, samples)?;
    let advice = format!(
        "store more of them in '{}' with 'nst render --keep all', or use --transform none",
        args.sequence.display()
    );
    method.check_terms(batch.sample_counts().len(), &advice)?;

    let output = args.output.clone().unwrap_or_else(|| args.sequence.with_extension("nst.exr"));
    let mut exr = OutputFile::create(&output)?;
    let mut estimates = Estimates::default();
    timed(&mut watch.transform, || method.transform.apply(batch, &mut estimates))?;
    timed(&mut watch.io, || {
        write_picture(&mut exr, file.size, batch, &estimates)?;
        Ok::<_, Error>(exr.commit()?)
    })?;
    let written = vec![output.display().to_string()];
    watch.summary(None, &method, &estimates, written).print(&args.common);
    Ok(())
}

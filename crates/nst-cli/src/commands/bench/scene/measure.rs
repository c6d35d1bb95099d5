//! Runs and pictures, compared with the reference.

use std::time::{Duration, Instant};

use nst_core::{Side, halves::HalvesError};
use nst_files::{
    ColorModel,
    output::OutputFile,
    picture_writer::{PictureInfo, write_exr},
};

use super::{
    methods::{Methods, Transformed},
    reference::{Reference, nonfinite},
    source::{Origin, Run},
};
use crate::{
    commands::picture_files::layers,
    error::Error,
    results::{PLAIN, Row},
    words::counted,
};

/// What is measured, and against what.
pub(super) struct Meter<'a> {
    pub(super) origin: &'a Origin,
    pub(super) reference: &'a Reference,
    pub(super) loading: Option<Duration>,
}

impl Meter<'_> {
    /// The rows of one run, or of a pair of runs, of one sample count.
    pub(super) fn measure(
        &self,
        methods: &mut Methods,
        wanted: impl Fn(&str, u32) -> bool,
        runs: &[Run],
    ) -> Result<Vec<Row>, Error> {
        let writing = runs.iter().map(|run| self.write_and_drop(run));
        let writing = writing.collect::<Result<Vec<_>, _>>()?;
        let mut rows = Vec::new();
        let names: Vec<String> = methods.names().map(str::to_owned).collect();
        for name in names {
            if !runs.iter().any(|run| wanted(&name, run.number)) {
                continue;
            }
            let results: Vec<_> =
                runs.iter().map(|run| methods.transform(&name, self.origin, &run.batch)).collect();
            let bias2 = match &results[..] {
                [Ok(a), Ok(b)] => Some(self.reference.halves().bias_squared(&a.values, &b.values)?),
                _ => None,
            };
            for ((run, result), &writing) in runs.iter().zip(&results).zip(&writing) {
                let mut row = self.row(&name, run);
                match result {
                    Ok(transformed) => {
                        self.judge(&mut row, &transformed.values, bias2)?;
                        self.time(&mut row, run, transformed, writing);
                        if let Some(judgement) = &transformed.judgement {
                            row.predicted_ratio = Some(judgement.ratio);
                            [row.predicted_low, row.predicted_high] = judgement.interval.map(Some);
                        }
                    }
                    Err(why) => row.failure = Some(why.clone()),
                }
                if name == PLAIN {
                    row.predicted_mse = run.batch.side(&Side::Variance).map(mean);
                }
                rows.push(row);
            }
        }
        Ok(rows)
    }

    /// Fails if a run of a file is the reference: it would have no error. Of scenes, references
    /// have seeds of their own, though noise may be missing altogether.
    pub(super) fn check_independent(&self, run: &Run) -> Result<(), Error> {
        if self.loading.is_none() && self.reference.is(run.batch.last()) {
            return Err(Error::Unlike(format!(
                "run {} at {} spp has the very pixels of the reference; a reference of other \
                 samples is needed",
                run.number, run.spp
            )));
        }
        Ok(())
    }

    /// A row without errors and times.
    fn row(&self, method: &str, run: &Run) -> Row {
        Row {
            method: method.to_owned(),
            spp: run.spp,
            run: run.number,
            seed: run.seed,
            ..self.blank()
        }
    }

    /// What all rows have in common.
    pub(super) fn blank(&self) -> Row {
        Row {
            reference_mse: self.reference.own_mse,
            reference: self.reference.hash.clone(),
            reference_spp: self.reference.spp,
            ..self.origin.row()
        }
    }

    /// Writes the errors of a picture into its row, or why it has none.
    pub(super) fn judge(
        &self,
        row: &mut Row,
        picture: &[f32],
        bias2: Option<f64>,
    ) -> Result<(), Error> {
        let broken = nonfinite(picture).count();
        if broken > 0 {
            // A mean over the others would be that of another picture.
            let verb = if broken == 1 { "is" } else { "are" };
            row.failure = Some(format!("{} of it {verb} not finite", counted(broken, "pixel")));
            return Ok(());
        }
        let HalvesError { mse, relmse, smape, mse_trimmed, .. } =
            self.reference.halves().error(picture)?;
        let finite = |error: f64| Some(error).filter(|error| error.is_finite());
        row.mse = finite(mse);
        row.relmse = finite(relmse);
        row.smape = finite(smape);
        row.mse_trimmed = finite(mse_trimmed);
        row.bias2 = bias2.filter(|bias2| bias2.is_finite());
        Ok(())
    }

    fn time(&self, row: &mut Row, run: &Run, transformed: &Transformed, writing: Duration) {
        let Transformed { warm, adapter, .. } = transformed;
        // Of files it is not known that they were rendered in the same process.
        let rendering = run.render_time.filter(|_| self.loading.is_some());
        let cold = transformed.cold + transformed.opening.waited(rendering);
        let whole =
            self.loading.unwrap_or_default() + run.render_time.unwrap_or_default() + cold + writing;
        row.load_seconds = self.loading.map(|time| time.as_secs_f64());
        row.render_seconds = run.render_time.map(|time| time.as_secs_f64());
        row.transform_seconds = Some(cold.as_secs_f64());
        row.transform_warm_seconds = Some(warm.as_secs_f64());
        row.io_seconds = Some(writing.as_secs_f64());
        // Where it is not known how long the samples took, the whole is not known.
        row.total_seconds = run.render_time.map(|_| whole.as_secs_f64());
        row.adapter.clone_from(adapter);
    }

    /// Writes an EXR picture as `nst render` does, to measure the time, and drops it.
    fn write_and_drop(&self, run: &Run) -> Result<Duration, Error> {
        let begin = Instant::now();
        let mut exr = OutputFile::create(&std::env::temp_dir().join("nst-bench.exr"))?;
        let layers = layers(&run.batch, run.batch.last());
        write_exr(&mut exr, self.origin.size, ColorModel::Rgb, &layers, &PictureInfo::default())?;
        Ok(begin.elapsed())
    }
}

fn mean(lanes: &[f32]) -> f64 {
    lanes.iter().map(|&x| f64::from(x)).sum::<f64>() / lanes.len() as f64
}

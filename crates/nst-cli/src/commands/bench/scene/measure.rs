//! The methods of a bench, applied to runs and compared with the reference.

use std::{
    collections::BTreeMap,
    path::PathBuf,
    time::{Duration, Instant},
};

use nst_core::{Estimates, SequenceBatch, Side, halves::HalvesError};
use nst_files::{ColorModel, output::OutputFile, picture_writer::write_exr};

use super::{
    reference::Reference,
    source::{Origin, Run},
};
use crate::{
    adapter::caught,
    args::{BackendArg, TransformArg},
    commands::picture_files::layers,
    error::Error,
    method::{self, DEFAULT_WINDOW, Method},
    results::{PLAIN, Row, SCHEMA},
    system,
};

/// The methods, each of which is made ready once.
pub(super) struct Methods {
    backend: BackendArg,
    names: Vec<(String, Choice)>,
    ready: BTreeMap<String, Ready>,
}

/// Where a method comes from.
#[derive(Clone)]
enum Choice {
    Named(TransformArg),
    Weights(PathBuf),
}

struct Ready {
    method: Method,
    /// How long it took to make it, to read a network for instance.
    making: Duration,
    /// What its first transformation took beyond the second, to open a GPU for instance.
    warming: Option<Duration>,
}

/// Estimates of a method, and how long they took.
struct Transformed {
    values: Vec<f32>,
    cold: Duration,
    warm: Duration,
    adapter: Option<String>,
}

impl Methods {
    /// The plain estimate, and then these, each once, and the networks of these files.
    ///
    /// # Errors
    /// [`Error::Usage`] if a file has the name of another method.
    pub(super) fn new(
        asked: &[TransformArg],
        weights: &[PathBuf],
        backend: BackendArg,
    ) -> Result<Self, Error> {
        let mut names: Vec<(String, Choice)> = Vec::new();
        for &transform in [TransformArg::None].iter().chain(asked) {
            let name = transform.name();
            if names.iter().all(|(earlier, _)| earlier != name) {
                names.push((name.to_owned(), Choice::Named(transform)));
            }
        }
        for path in weights {
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            if TransformArg::named(&name).is_some() || names.iter().any(|(it, _)| *it == name) {
                return Err(Error::Usage(format!(
                    "--weights {}: there is another method '{name}'; rename the file",
                    path.display()
                )));
            }
            names.push((name.into_owned(), Choice::Weights(path.clone())));
        }
        Ok(Self { backend, names, ready: BTreeMap::new() })
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(|(name, _)| &**name)
    }

    /// The most last terms that a method reads.
    pub(super) fn window(&mut self, origin: &Origin) -> Result<usize, Error> {
        let mut window = DEFAULT_WINDOW;
        for (name, choice) in self.names.clone() {
            let method = &self.ready(&name, &choice, origin, &[])?.method;
            window = window.max(method.transform.requires().window);
        }
        Ok(window)
    }

    /// Makes a method ready; for `auto`, that is the one that it chooses.
    fn ready(
        &mut self,
        name: &str,
        choice: &Choice,
        origin: &Origin,
        counts: &[u32],
    ) -> Result<&mut Ready, Error> {
        let origin =
            method::Origin { scene: &origin.fingerprint, sampler: &origin.sampler, counts };
        let (name, choice) = match choice {
            Choice::Named(auto @ TransformArg::Auto) => {
                let name = Method::named(*auto, BackendArg::Cpu, origin)?.name;
                let named = TransformArg::named(&name).expect("methods have names");
                (name, Choice::Named(named))
            }
            choice => (name.to_owned(), choice.clone()),
        };
        if !self.ready.contains_key(&name) {
            let begin = Instant::now();
            let method = match choice {
                Choice::Named(named) => Method::named(named, self.backend, origin)?,
                Choice::Weights(path) => Method::of_file(&path, self.backend)?,
            };
            let ready = Ready { method, making: begin.elapsed(), warming: None };
            self.ready.insert(name.clone(), ready);
        }
        Ok(self.ready.get_mut(&name).expect("it was put there"))
    }

    /// The estimates of a method, or why it fails on this run.
    fn transform(
        &mut self,
        name: &str,
        choice: &Choice,
        origin: &Origin,
        batch: &SequenceBatch,
    ) -> Result<Transformed, String> {
        let ready = self.ready(name, choice, origin, batch.sample_counts());
        let ready = ready.map_err(|error| error.to_string())?;
        let window = ready.method.transform.requires().window;
        let terms = batch.sample_counts().len();
        if terms < window {
            return Err(format!("it reads the last {window} terms, but there are {terms}"));
        }
        let mut estimates = Estimates::default();
        let mut once = || {
            let begin = Instant::now();
            caught(|| ready.method.transform.transform(batch, &mut estimates))
                .map_err(|error| error.to_string())?;
            Ok::<_, String>(begin.elapsed())
        };
        if ready.warming.is_none() {
            let first = once()?;
            ready.warming = Some(first.saturating_sub(once()?));
        }
        let warm = once()?;
        Ok(Transformed {
            values: estimates.values().to_vec(),
            cold: warm + ready.making + ready.warming.unwrap_or_default(),
            warm,
            adapter: ready.method.adapter(),
        })
    }

    /// The picture that a method makes of a run, if it does not fail.
    pub(super) fn picture(&mut self, name: &str, origin: &Origin, run: &Run) -> Option<Vec<f32>> {
        let (name, choice) = self.names.iter().find(|(known, _)| known == name)?.clone();
        Some(self.transform(&name, &choice, origin, &run.batch).ok()?.values)
    }
}

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
        for (name, choice) in methods.names.clone() {
            if !runs.iter().any(|run| wanted(&name, run.number)) {
                continue;
            }
            let results: Vec<_> = runs
                .iter()
                .map(|run| methods.transform(&name, &choice, self.origin, &run.batch))
                .collect();
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
        let Origin { scene, fingerprint, sampler, size: [width, height] } = self.origin;
        Row {
            scene: scene.clone(),
            width: *width,
            height: *height,
            reference_mse: self.reference.own_mse,
            fingerprint: fingerprint.clone(),
            sampler: sampler.clone(),
            threads: Some(rayon::current_num_threads() as u32),
            machine: system::processor(),
            version: system::VERSION.to_owned(),
            schema: SCHEMA,
            ..Row::default()
        }
    }

    /// Writes the errors of a picture into its row, unless they are too small to be judged.
    pub(super) fn judge(
        &self,
        row: &mut Row,
        picture: &[f32],
        bias2: Option<f64>,
    ) -> Result<(), Error> {
        let HalvesError { mse, relmse, smape, mse_trimmed, .. } =
            self.reference.halves().error(picture)?;
        if let Some(own) = self.reference.own_mse.filter(|&own| mse < own) {
            row.failure = Some(format!(
                "its MSE, {mse:.2e}, is below the reference's own, {own:.2e}; take a reference of \
                 more samples per pixel (--reference-spp)"
            ));
            return Ok(());
        }
        let finite = |error: f64| Some(error).filter(|error| error.is_finite());
        row.mse = finite(mse);
        row.relmse = finite(relmse);
        row.smape = finite(smape);
        row.mse_trimmed = finite(mse_trimmed);
        row.bias2 = bias2.filter(|bias2| bias2.is_finite());
        Ok(())
    }

    fn time(&self, row: &mut Row, run: &Run, transformed: &Transformed, writing: Duration) {
        let Transformed { cold, warm, adapter, .. } = transformed;
        let whole = self.loading.unwrap_or_default()
            + run.render_time.unwrap_or_default()
            + *cold
            + writing;
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
        write_exr(&mut exr, self.origin.size, ColorModel::Rgb, &layers)?;
        Ok(begin.elapsed())
    }
}

fn mean(lanes: &[f32]) -> f64 {
    lanes.iter().map(|&x| f64::from(x)).sum::<f64>() / lanes.len() as f64
}

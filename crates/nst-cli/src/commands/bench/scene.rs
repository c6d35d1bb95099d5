//! `nst bench scene`: the error of each method against a reference, one row per run.

use std::{
    collections::BTreeMap,
    fmt,
    time::{Duration, Instant},
};

use nst_core::{Estimates, Keep, metrics};
use nst_files::{
    ColorModel,
    output::{Kind, Name, OutputFile, Outputs},
    picture::Picture,
    picture_writer::write_exr,
};
use nst_render::{LoadOptions, RenderSettings, Rendering, SamplerKind, Scene, render};
use serde::Serialize;

use crate::{
    adapter::caught,
    args::{BenchSceneArgs, TransformArg},
    error::Error,
    method::{DEFAULT_WINDOW, Method, Origin},
    summary::timed,
};

/// The error and the times of one method on one rendering.
#[derive(Serialize)]
struct SceneRow<'a> {
    scene: &'a str,
    method: &'a str,
    spp: u32,
    run: u32,
    mse: f64,
    relmse: f64,
    smape: f64,
    render_seconds: f64,
    transform_seconds: f64,
    io_seconds: f64,
    total_seconds: f64,
}

/// The mean over the runs of a method and a sample count.
#[derive(Serialize)]
struct Mean {
    method: String,
    spp: u32,
    mse: f64,
    /// Relative to the plain estimates'.
    mse_ratio: f64,
}

#[derive(Serialize)]
pub(super) struct Report {
    runs: u32,
    means: Vec<Mean>,
    output: String,
}

/// What all runs share.
struct Bench<'a> {
    args: &'a BenchSceneArgs,
    scene: Scene,
    fingerprint: String,
    reference: Vec<f32>,
    /// How long the scene took to load.
    loading: Duration,
}

pub(super) fn run(args: &BenchSceneArgs) -> Result<Report, Error> {
    if args.seed.checked_add(u64::from(args.runs - 1)).is_none() {
        return Err(Error::Usage(format!(
            "--seed {} is too large for {} runs, whose seeds count up from it",
            args.seed, args.runs
        )));
    }
    let bench = Bench::open(args)?;
    let inputs = bench.scene.inputs.iter().chain([&args.reference]);
    let mut output = Outputs::of_inputs(inputs).open(&args.output, Kind::Csv, Name::Given)?;
    let mut writer = csv::Writer::from_writer(output.file());
    // MSE summed over the runs, by method and sample count.
    let mut sums: BTreeMap<(String, u32), f64> = BTreeMap::new();
    for &spp in &args.spp {
        let methods = bench.methods(spp)?;
        for run in 0..args.runs {
            let rendering = bench.render(&methods, spp, run)?;
            for method in &methods {
                let row = bench.measure(method, &rendering, spp, run)?;
                *sums.entry((method.name.clone(), spp)).or_default() += row.mse;
                writer
                    .serialize(row)
                    .map_err(|source| Error::Csv { path: args.output.clone(), source })?;
            }
        }
    }
    let flushed = writer.flush();
    flushed.map_err(|error| Error::Csv { path: args.output.clone(), source: error.into() })?;
    drop(writer);
    output.commit()?;
    let plain = |spp| sums[&("none".to_owned(), spp)];
    let mean = |((method, spp), &sum): (&(String, u32), &f64)| Mean {
        method: method.clone(),
        spp: *spp,
        mse: sum / f64::from(args.runs),
        mse_ratio: sum / plain(*spp),
    };
    let means = sums.iter().map(mean).collect();
    Ok(Report { runs: args.runs, means, output: args.output.display().to_string() })
}

impl<'a> Bench<'a> {
    /// Loads the scene, and the reference, which sets the film's size.
    fn open(args: &'a BenchSceneArgs) -> Result<Self, Error> {
        let start = Instant::now();
        let reference = Picture::open(&args.reference, None)?;
        if reference.channel_names.len() != ColorModel::Rgb.channels().len() {
            return Err(Error::Unlike(format!(
                "the reference '{}' has no channels R, G and B, which renderings have",
                args.reference.display()
            )));
        }
        let options = LoadOptions { size: Some(reference.size), ..Default::default() };
        let scene = Scene::load_with(&args.scene, &options)?;
        let loading = start.elapsed();
        let fingerprint = scene.fingerprint();
        Ok(Self { args, scene, fingerprint, reference: reference.read()?, loading })
    }

    /// The plain estimate and the methods that were asked for, each once: `auto` may be one
    /// that is also named.
    fn methods(&self, spp: u32) -> Result<Vec<Method>, Error> {
        let sampler = SamplerKind::default().to_string();
        let origin = Origin { scene: &self.fingerprint, sampler: &sampler, counts: &[spp] };
        let mut methods: Vec<Method> = Vec::new();
        for &transform in [TransformArg::None].iter().chain(&self.args.transform) {
            let method = Method::named(transform, self.args.backend, origin)?;
            method.check_terms(spp as usize, "leave this sample count out of --spp")?;
            if methods.iter().all(|earlier| earlier.name != method.name) {
                methods.push(method);
            }
        }
        Ok(methods)
    }

    fn render(&self, methods: &[Method], spp: u32, run: u32) -> Result<Rendering, Error> {
        let windows = methods.iter().map(|method| method.transform.requires().window);
        let keep = Keep::Window(windows.fold(DEFAULT_WINDOW, usize::max) as u32);
        let seed = self.args.seed + u64::from(run);
        let settings = RenderSettings { spp, sampler: SamplerKind::default(), seed, keep };
        Ok(render(&self.scene, &settings, &|_| {})?)
    }

    fn measure<'r>(
        &'r self,
        method: &'r Method,
        rendering: &Rendering,
        spp: u32,
        run: u32,
    ) -> Result<SceneRow<'r>, Error> {
        let (mut transform, mut io) = (Duration::ZERO, self.loading);
        let mut estimates = Estimates::default();
        timed(&mut transform, || {
            caught(|| method.transform.transform(&rendering.batch, &mut estimates))
        })?;
        timed(&mut io, || write_and_drop(&self.scene, &estimates))?;
        let error = metrics::error(estimates.values(), &self.reference)?;
        Ok(SceneRow {
            scene: &self.scene.name,
            method: &method.name,
            spp,
            run,
            mse: error.mse,
            relmse: error.relmse,
            smape: error.smape,
            render_seconds: rendering.time.as_secs_f64(),
            transform_seconds: transform.as_secs_f64(),
            io_seconds: io.as_secs_f64(),
            total_seconds: (rendering.time + transform + io).as_secs_f64(),
        })
    }
}

/// Writes the picture as `nst render` would, to measure the time, and drops it.
fn write_and_drop(scene: &Scene, estimates: &Estimates) -> Result<(), Error> {
    let mut exr = OutputFile::create(&std::env::temp_dir().join("nst-bench.exr"))?;
    Ok(write_exr(&mut exr, scene.size, ColorModel::Rgb, &[("", estimates.values())])?)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "MSE = mean (x − I)², ratio to none, over {} runs", self.runs)?;
        for Mean { method, spp, mse, mse_ratio } in &self.means {
            writeln!(f, "{method:12} {spp:5} spp  {mse:.3e}  {mse_ratio:.3}")?;
        }
        write!(f, "wrote {}", self.output)
    }
}

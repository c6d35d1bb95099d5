//! `nst bench scene`: the error of each method against a reference, one row per run.

use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

use nst_core::{Estimates, metrics};
use nst_render::{Keep, RenderSettings, SamplerKind, Scene, film, output::OutputFile, render};
use serde::Serialize;

use crate::{
    args::{BenchSceneArgs, TransformArg},
    commands::set_threads,
    error::Error,
    method::{DEFAULT_WINDOW, Method, Origin},
    summary::timed,
};

/// A rendering by one method; times are those of the whole job.
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

pub(super) fn run(args: &BenchSceneArgs) -> Result<(), Error> {
    set_threads(&args.common)?;
    let start = Instant::now();
    let mut scene = Scene::load(&args.scene)?;
    let loading = start.elapsed();
    let (size, reference) = film::read_exr_layer(&args.reference, "")?;
    scene.size = size;
    let fingerprint = scene.fingerprint();
    let sampler = SamplerKind::default();

    let csv_error = |source| Error::Csv { path: args.output.clone(), source };
    let mut output = OutputFile::create(&args.output)?;
    let mut writer = csv::Writer::from_writer(output.file());
    // MSE summed over the runs, by method and sample count.
    let mut sums: BTreeMap<(String, u32), f64> = BTreeMap::new();
    for &spp in &args.spp {
        let origin = Origin { scene: &fingerprint, sampler: sampler.name(), counts: &[spp] };
        let transforms = [TransformArg::None].iter().chain(&args.transform);
        let methods = transforms
            .map(|&transform| Method::named(transform, args.backend, origin))
            .collect::<Result<Vec<_>, _>>()?;
        for method in &methods {
            method.check_terms(spp as usize, "leave this sample count out of --spp")?;
        }
        let window = methods.iter().map(|m| m.transform.window()).fold(DEFAULT_WINDOW, usize::max);
        for run in 0..args.runs {
            let seed = args.seed + u64::from(run);
            let settings = RenderSettings { spp, sampler, seed, keep: Keep::Window(window as u32) };
            let rendering = render(&scene, &settings, &|_| {})?;
            for (i, method) in methods.iter().enumerate() {
                // `auto` may stand for a method that is here already.
                if methods[..i].iter().any(|earlier| earlier.name == method.name) {
                    continue;
                }
                let (mut transform, mut io) = (Duration::ZERO, loading);
                let mut estimates = Estimates::default();
                timed(&mut transform, || method.transform.apply(&rendering.batch, &mut estimates))?;
                timed(&mut io, || write_and_drop(&scene, &estimates))?;
                let error = metrics::error(estimates.values(), &reference)?;
                *sums.entry((method.name.clone(), spp)).or_default() += error.mse;
                let row = SceneRow {
                    scene: &scene.name,
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
                };
                writer.serialize(row).map_err(csv_error)?;
            }
        }
    }
    writer.flush().map_err(|error| csv_error(error.into()))?;
    drop(writer);
    output.commit()?;
    if !args.common.quiet {
        println!("MSE = mean (x − I)², ratio to none, over {} runs", args.runs);
        for ((method, spp), mse) in &sums {
            let none = sums[&("none".to_owned(), *spp)];
            println!(
                "{method:12} {spp:5} spp  {:.3e}  {:.3}",
                mse / f64::from(args.runs),
                mse / none
            );
        }
    }
    Ok(())
}

/// Writes the picture as `nst render` would, to time it, and throws it away.
fn write_and_drop(scene: &Scene, estimates: &Estimates) -> Result<(), Error> {
    let folder = std::env::temp_dir();
    let mut exr = OutputFile::create(&folder.join("nst-bench.exr"))?;
    film::write_exr(&mut exr, scene.size, estimates.values(), &[])?;
    Ok(())
}

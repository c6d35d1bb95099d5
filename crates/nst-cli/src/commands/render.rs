//! `nst render`: scene → sequence → transformation → pictures.

use std::path::PathBuf;

use indicatif::{ProgressBar, ProgressStyle};
use nst_core::Estimates;
use nst_render::{
    Keep, RenderSettings, Rendering, Scene, VARIANCE, film, output::OutputFile, render,
    sequence_file::SequenceFile,
};

use super::set_threads;
use crate::{
    args::{KeepArg, RenderArgs},
    error::Error,
    method::{DEFAULT_WINDOW, Method},
    summary::{RenderStats, Stopwatch, timed},
};

pub(crate) fn run(args: &RenderArgs) -> Result<(), Error> {
    set_threads(&args.common)?;
    let mut watch = Stopwatch::start();
    let scene = timed(&mut watch.io, || load_scene(args))?;
    let method = Method::resolve(&args.method, &scene.fingerprint(), args.spp)?;
    let advice = format!("use --spp {} or more, or --transform none", method.transform.window());
    method.check_terms(args.spp as usize, &advice)?;

    // Created now, so that a place that cannot be written to is found out early.
    let exr_path =
        args.output.clone().unwrap_or_else(|| PathBuf::from(format!("{}.exr", scene.name)));
    let mut exr = OutputFile::create(&exr_path)?;
    let mut png = OutputFile::create(&exr_path.with_extension("png"))?;
    let mut sequence = args.sequence.as_deref().map(OutputFile::create).transpose()?;

    if !(args.common.quiet || args.common.json) {
        describe(&scene, args.spp);
    }
    let settings = RenderSettings {
        spp: args.spp,
        seed: args.seed,
        keep: match args.keep {
            KeepArg::All => Keep::All,
            KeepArg::Window => Keep::Window(method.transform.window().max(DEFAULT_WINDOW) as u32),
        },
    };
    let paths = u64::from(scene.size[0]) * u64::from(scene.size[1]) * u64::from(args.spp);
    let bar = progress_bar(paths, args.common.quiet || args.common.json);
    let Rendering { batch, time } = render(&scene, &settings, &|paths| bar.inc(paths))?;
    bar.finish_and_clear();

    let mut estimates = Estimates::default();
    timed(&mut watch.transform, || method.transform.apply(&batch, &mut estimates))?;

    let mut written = Vec::new();
    timed(&mut watch.io, || -> Result<(), Error> {
        let mut layers = vec![("S", batch.last())];
        layers.extend(batch.side(VARIANCE).map(|variance| (VARIANCE, variance)));
        film::write_exr(&mut exr, scene.size, estimates.values(), &layers)?;
        film::write_png(&mut png, scene.size, estimates.values())?;
        if let Some(output) = &mut sequence {
            let file = SequenceFile {
                size: scene.size,
                batch,
                scene: scene.fingerprint(),
                sampler: "random".to_owned(),
                seed: args.seed,
                render_seconds: time.as_secs_f32(),
            };
            file.write(output)?;
        }
        for output in [exr, png].into_iter().chain(sequence) {
            written.push(output.path().display().to_string());
            output.commit()?;
        }
        Ok(())
    })?;
    watch
        .summary(Some(RenderStats { time, paths }), &method, &estimates, written)
        .print(&args.common);
    Ok(())
}

fn load_scene(args: &RenderArgs) -> Result<Scene, Error> {
    let mut scene = Scene::load(&args.scene)?;
    scene.size = args.size.unwrap_or(scene.size);
    scene.max_depth = args.max_depth.unwrap_or(scene.max_depth);
    scene.pixel_filter = args.pixel.into();
    Ok(scene)
}

fn describe(scene: &Scene, spp: u32) {
    let lights = scene.triangles.iter().filter(|t| scene.materials[t.material as usize].emits());
    println!(
        "scene      {}: {} triangles, {} of them lights, {} materials",
        scene.name,
        scene.triangles.len(),
        lights.count(),
        scene.materials.len()
    );
    for default in &scene.defaults {
        println!("           default: {default}");
    }
    let [width, height] = scene.size;
    println!("film       {width}x{height}, {spp} spp, paths of up to {} vertices", scene.max_depth);
}

/// A bar on a terminal, nothing in a pipe.
fn progress_bar(paths: u64, hidden: bool) -> ProgressBar {
    if hidden {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("render     {bar:40} {percent:>3} %, {eta} left")
        .expect("the template is a constant");
    ProgressBar::new(paths).with_style(style)
}

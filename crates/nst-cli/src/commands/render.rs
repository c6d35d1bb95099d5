//! `nst render`: scene → sequence → transformation → pictures.

use indicatif::{ProgressBar, ProgressStyle};
use nst_core::Estimates;
use nst_render::{
    Keep, RenderSettings, Rendering, Scene,
    dataset::{DatasetInfo, DatasetWriter},
    film,
    output::OutputFile,
    render,
    sequence_file::SequenceFile,
};

use super::{set_threads, write_picture};
use crate::{
    args::{IntegratorArg, KeepArg, RenderArgs},
    error::Error,
    method::{DEFAULT_WINDOW, Method},
    summary::{RenderStats, Stopwatch, timed},
};

pub(crate) fn run(args: &RenderArgs) -> Result<(), Error> {
    set_threads(&args.common)?;
    match args.runs {
        Some(runs) => dataset(args, runs),
        None => picture(args),
    }
}

fn picture(args: &RenderArgs) -> Result<(), Error> {
    let mut watch = Stopwatch::start();
    let scene = timed(&mut watch.io, || load_scene(args))?;
    let exr_path = args.output(&scene.name)?;
    let fingerprint = scene.fingerprint();
    let method = Method::resolve(&args.method, &fingerprint, args.spp)?;
    let advice = format!("use --spp {} or more, or --transform none", method.transform.window());
    method.check_terms(args.spp as usize, &advice)?;

    // Created now, so that a place that cannot be written to is found out early.
    let mut exr = OutputFile::create(&exr_path)?;
    let mut png = OutputFile::create(&exr_path.with_extension("png"))?;
    let mut sequence = args.sequence.as_deref().map(OutputFile::create).transpose()?;

    let silent = args.common.quiet || args.common.json;
    if !silent {
        describe(&scene, args.spp);
    }
    let keep = match args.keep {
        KeepArg::All => Keep::All,
        KeepArg::Window => Keep::Window(method.transform.window().max(DEFAULT_WINDOW) as u32),
    };
    let settings = settings(args, keep);
    let paths = paths(&scene, args.spp);
    let bar = progress_bar(paths, silent);
    let Rendering { batch, time } = render(&scene, &settings, &|paths| bar.inc(paths))?;
    bar.finish_and_clear();

    let mut estimates = Estimates::default();
    timed(&mut watch.transform, || method.transform.apply(&batch, &mut estimates))?;

    let mut written = Vec::new();
    timed(&mut watch.io, || -> Result<(), Error> {
        write_picture(&mut exr, scene.size, &batch, &estimates)?;
        film::write_png(&mut png, scene.size, estimates.values())?;
        if let Some(output) = &mut sequence {
            let file = SequenceFile {
                size: scene.size,
                batch,
                scene: fingerprint,
                sampler: settings.sampler.name().to_owned(),
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

/// Renders `runs` times with all terms kept, straight to a file.
fn dataset(args: &RenderArgs, runs: u32) -> Result<(), Error> {
    let scene = load_scene(args)?;
    let path = args.output(&scene.name)?;
    let settings = settings(args, Keep::All);
    let info = DatasetInfo {
        size: scene.size,
        channels: 3,
        runs,
        sample_counts: (1..=args.spp).collect(),
        scene: scene.fingerprint(),
        sampler: settings.sampler.name().to_owned(),
        first_seed: Some(args.seed),
    };
    let mut writer = DatasetWriter::new(OutputFile::create(&path)?, info)?;
    let silent = args.common.quiet || args.common.json;
    if !silent {
        describe(&scene, args.spp);
    }
    let bar = progress_bar(paths(&scene, args.spp) * u64::from(runs), silent);
    for run in 0..u64::from(runs) {
        let settings = RenderSettings { seed: args.seed.wrapping_add(run), ..settings };
        writer.push(&render(&scene, &settings, &|paths| bar.inc(paths))?.batch)?;
    }
    bar.finish_and_clear();
    writer.finish()?;
    if !silent {
        println!("wrote      {} ({runs} runs)", path.display());
    }
    Ok(())
}

fn settings(args: &RenderArgs, keep: Keep) -> RenderSettings {
    RenderSettings { spp: args.spp, sampler: args.sampler.into(), seed: args.seed, keep }
}

fn paths(scene: &Scene, spp: u32) -> u64 {
    u64::from(scene.size[0]) * u64::from(scene.size[1]) * u64::from(spp)
}

fn load_scene(args: &RenderArgs) -> Result<Scene, Error> {
    let mut scene = Scene::load(&args.scene)?;
    scene.size = args.size.unwrap_or(scene.size);
    scene.max_depth = match args.integrator {
        Some(IntegratorArg::Direct) => 2,
        _ => args.max_depth.unwrap_or(scene.max_depth),
    };
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

//! `nst render`: scene → sequence → transformation → pictures.

use indicatif::{ProgressBar, ProgressStyle};
use nst_core::Estimates;
use nst_render::{
    Control, Keep, RenderSettings, Rendering, Scene,
    dataset::{DatasetInfo, DatasetWriter},
    film::{self, ColorModel},
    output::OutputFile,
    render_from,
    sequence_file::{ResumeInfo, SequenceInfo, SequenceWriter},
};

use super::{
    resume::{self, Start},
    set_threads, write_picture,
};
use crate::{
    args::{IntegratorArg, KeepArg, RenderArgs},
    error::Error,
    interrupt,
    method::{DEFAULT_WINDOW, Method, Origin},
    summary::{LaneCounts, RenderStats, Stopwatch, timed},
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
    let resumed = timed(&mut watch.io, || args.resume.as_deref().map(resume::open).transpose())?;
    let stored = resumed.as_ref().map(|resumed| &resumed.info);
    let scene = timed(&mut watch.io, || load_scene(args, stored))?;
    let exr_path = args.output(&scene.name)?;
    let fingerprint = scene.fingerprint();
    let sampler = match &resumed {
        None => args.sampler.map_or_else(Default::default, Into::into),
        Some(resumed) => resumed.sampler,
    };
    let for_spp = |spp| {
        let origin = Origin { scene: &fingerprint, sampler: sampler.name(), counts: &[spp] };
        Method::resolve(&args.method, origin)
    };
    let method = for_spp(args.spp)?;
    let advice = format!("use --spp {} or more, or --transform none", method.transform.window());
    method.check_terms(args.spp as usize, &advice)?;
    let settings = match &resumed {
        None => settings(args, method.transform.window(), KeepArg::Window),
        Some(resumed) => resumed.settings(args, &scene, &fingerprint, &method)?,
    };

    // Created now, so that a place that cannot be written to is found out early.
    let mut exr = OutputFile::create(&exr_path)?;
    let mut png = OutputFile::create(&exr_path.with_extension("png"))?;
    let sequence_path = args.sequence.as_deref().or(args.resume.as_deref());
    if sequence_path == Some(&exr_path) {
        let path = exr_path.display();
        return Err(Error::Usage(format!(
            "'{path}' cannot be both the picture and the sequence; give another --output"
        )));
    }
    let mut sequence = sequence_path.map(OutputFile::create).transpose()?;

    interrupt::watch()?;
    let start = timed(&mut watch.io, || resumed.map(resume::Resumed::read).transpose())?;
    let silent = args.common.quiet || args.common.json;
    if !silent {
        describe(&scene, args.spp, start.as_ref());
    }
    let (done, spent) = start.as_ref().map_or((0, 0.0), |start| (start.samples, start.seconds));
    let bar = progress_bar(paths(&scene, args.spp - done), silent);
    let progress = |paths| bar.inc(paths);
    let control = Control { progress: &progress, stop: &interrupt::asked };
    let start = start.map(|start| start.rendering);
    let rendering = render_from(start, &scene, &settings, control)?;
    bar.finish_and_clear();
    let samples = *rendering.batch.sample_counts().last().expect("a rendering has a term");
    // Another network, or none, may be the one for fewer samples.
    let method = if samples == args.spp { method } else { for_spp(samples)? };

    let mut estimates = Estimates::default();
    timed(&mut watch.transform, || method.transform.apply(&rendering.batch, &mut estimates))?;

    let mut written = Vec::new();
    timed(&mut watch.io, || -> Result<(), Error> {
        write_picture(&mut exr, scene.size, &rendering.batch, &estimates)?;
        film::write_png(&mut png, scene.size, estimates.values())?;
        if let Some(output) = &mut sequence {
            write_sequence(output, &scene, fingerprint, &settings, &rendering, spent)?;
        }
        for output in [exr, png].into_iter().chain(sequence) {
            written.push(output.path().display().to_string());
            output.commit()?;
        }
        Ok(())
    })?;
    let mut lanes = LaneCounts::default();
    lanes.add(&estimates);
    let stats = RenderStats {
        time: rendering.time,
        build_time: rendering.build_time,
        paths: paths(&scene, samples - done),
    };
    watch.summary(Some(stats), &method, lanes, written).print(&args.common);
    if samples == args.spp {
        return Ok(());
    }
    let how = match sequence_path {
        Some(path) => format!("; --resume {} goes on from there", path.display()),
        None => String::new(),
    };
    Err(Error::Interrupted(format!("{samples} of {} spp are in the files{how}", args.spp)))
}

/// Writes a rendering that had taken `spent` seconds before it was continued.
fn write_sequence(
    output: &mut OutputFile,
    scene: &Scene,
    fingerprint: String,
    settings: &RenderSettings,
    rendering: &Rendering,
    spent: f32,
) -> Result<(), Error> {
    let batch = &rendering.batch;
    let info = SequenceInfo {
        size: scene.size,
        model: ColorModel::Rgb,
        sample_counts: batch.sample_counts().to_vec(),
        sides: batch.sides().map(|(name, _)| name.to_owned()).collect(),
        scene: fingerprint,
        sampler: settings.sampler.name().to_owned(),
        seeds: vec![settings.seed],
        render_seconds: spent + rendering.time.as_secs_f32(),
        resume: Some(ResumeInfo {
            keep: settings.keep,
            pixel_filter: scene.pixel_filter,
            max_depth: scene.max_depth,
            russian_roulette: scene.russian_roulette,
        }),
    };
    let mut writer = SequenceWriter::create(output, &info)?;
    writer.push(batch, Some(&rendering.sums))?;
    Ok(writer.finish()?)
}

/// Renders `runs` times, straight to a file.
fn dataset(args: &RenderArgs, runs: u32) -> Result<(), Error> {
    let scene = load_scene(args, None)?;
    let path = args.output(&scene.name)?;
    let settings = settings(args, DEFAULT_WINDOW, KeepArg::All);
    let sample_counts = settings.keep.sample_counts(args.spp);
    let info = DatasetInfo {
        size: scene.size,
        channels: 3,
        runs,
        sample_counts: sample_counts.clone(),
        scene: scene.fingerprint(),
        sampler: settings.sampler.name().to_owned(),
        first_seed: Some(settings.seed),
    };
    let mut writer = DatasetWriter::new(OutputFile::create(&path)?, info)?;
    interrupt::watch()?;
    let silent = args.common.quiet || args.common.json;
    if !silent {
        describe(&scene, args.spp, None);
    }
    let bar = progress_bar(paths(&scene, args.spp) * u64::from(runs), silent);
    let progress = |paths| bar.inc(paths);
    let control = Control { progress: &progress, stop: &interrupt::asked };
    let mut done = 0;
    for run in 0..runs {
        let seed = settings.seed.wrapping_add(u64::from(run));
        let rendering = render_from(None, &scene, &RenderSettings { seed, ..settings }, control)?;
        // A run that Ctrl-C has cut short is left out.
        if rendering.batch.sample_counts() != sample_counts {
            break;
        }
        writer.push(&rendering.batch)?;
        done += 1;
        if interrupt::asked() {
            break;
        }
    }
    bar.finish_and_clear();
    if done == 0 {
        return Err(Error::Interrupted("no run was complete, nothing is written".into()));
    }
    writer.finish()?;
    if !silent {
        println!("wrote      {} ({done} runs)", path.display());
    }
    if done < runs {
        let message = format!("{done} of {runs} runs are in '{}'", path.display());
        return Err(Error::Interrupted(message));
    }
    Ok(())
}

/// `keep` is what `--keep` is without being given.
fn settings(args: &RenderArgs, window: usize, keep: KeepArg) -> RenderSettings {
    let window = window.max(DEFAULT_WINDOW) as u32;
    RenderSettings {
        spp: args.spp,
        sampler: args.sampler.map_or_else(Default::default, Into::into),
        seed: args.seed.unwrap_or_default(),
        keep: match args.keep.unwrap_or(keep) {
            KeepArg::All => Keep::All,
            KeepArg::Pow2 => Keep::Pow2(window),
            KeepArg::Window => Keep::Window(window),
        },
    }
}

fn paths(scene: &Scene, spp: u32) -> u64 {
    u64::from(scene.size[0]) * u64::from(scene.size[1]) * u64::from(spp)
}

/// Loads the scene; a stored sequence stands in for options that are not given.
fn load_scene(args: &RenderArgs, stored: Option<&SequenceInfo>) -> Result<Scene, Error> {
    let mut scene = Scene::load(&args.scene)?;
    let how = stored.and_then(|info| info.resume);
    scene.size = args.size.or(stored.map(|info| info.size)).unwrap_or(scene.size);
    let direct = matches!(args.integrator, Some(IntegratorArg::Direct)).then_some(2);
    let depth = direct.or(args.max_depth).or(how.map(|how| how.max_depth));
    scene.max_depth = depth.unwrap_or(scene.max_depth);
    let filter = args.pixel.map(Into::into).or(how.map(|how| how.pixel_filter));
    scene.pixel_filter = filter.unwrap_or_default();
    Ok(scene)
}

fn describe(scene: &Scene, spp: u32, start: Option<&Start>) {
    let lights = scene.triangles.iter().filter(|t| scene.materials[t.material as usize].emits());
    println!(
        "scene      {}: {} triangles, {} of them lights, {} materials",
        scene.name,
        scene.triangles.len(),
        lights.count(),
        scene.materials.len()
    );
    for note in &scene.notes {
        println!("           note: {note}");
    }
    let [width, height] = scene.size;
    println!("film       {width}x{height}, {spp} spp, paths of up to {} vertices", scene.max_depth);
    if let Some(start) = start {
        println!("resumed    from {} spp", start.samples);
    }
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

//! `nst render`: scene → sequence → transformation → pictures.

mod dataset;
mod picture;
mod resume;

use nst_core::{FurtherPowers, Keep};
use nst_files::{output::Outputs, sequence_file::SequenceInfo};
use nst_render::{PixelFilter, RenderSettings, Scene};

use crate::{
    args::{CommonArgs, IntegratorArg, KeepArg, RenderArgs},
    error::Error,
    method::DEFAULT_WINDOW,
    progress::Progress,
    report::{Done, say},
    words::counted,
};

pub(super) fn run(args: &RenderArgs) -> Result<Done, Error> {
    match args.runs {
        Some(runs) => dataset::run(args, runs),
        None => picture::run(args),
    }
}

/// How to render; `window` is how many terms are read, and `keep` is the default of `--keep`.
fn settings(args: &RenderArgs, window: usize, keep: KeepArg) -> RenderSettings {
    // Others may read stored terms later. Without them, memory counts.
    let stored = args.sequence.is_some() || args.runs.is_some();
    let window = window.max(if stored { DEFAULT_WINDOW } else { 1 }) as u32;
    RenderSettings {
        spp: args.spp,
        sampler: args.sampler.map_or_else(Default::default, Into::into),
        seed: args.seed.unwrap_or_default(),
        powers: FurtherPowers::NONE,
        keep: match args.keep.unwrap_or(keep) {
            KeepArg::All => Keep::All,
            KeepArg::Pow2 => Keep::Pow2(window),
            KeepArg::Window => Keep::Window(window),
        },
        features: args.features,
    }
}

fn paths(scene: &Scene, spp: u32) -> u64 {
    // What is too large is refused elsewhere.
    (u64::from(scene.size[0]) * u64::from(scene.size[1])).saturating_mul(spp.into())
}

/// The outputs of a job that reads a scene, and perhaps weights.
fn outputs(args: &RenderArgs, scene: &Scene) -> Outputs {
    Outputs::of_inputs(scene.inputs.iter().chain(args.method.files()))
}

/// Loads the scene. Options that are not given come from the stored sequence, if there is
/// one.
fn load_scene(args: &RenderArgs, stored: Option<&SequenceInfo>) -> Result<Scene, Error> {
    let mut options = args.load_options();
    options.size = args.size.or(stored.map(|info| info.size));
    let reading = Progress::step(format!("reading {}", args.scene.display()), &args.common);
    let mut scene = Scene::load_with(&args.scene, &options)?;
    drop(reading);
    let how = stored.and_then(|info| info.resume.as_ref());
    let direct = matches!(args.integrator, Some(IntegratorArg::Direct)).then_some(2);
    let depth = direct.or(args.max_depth).or(how.map(|how| how.max_depth));
    scene.max_depth = depth.unwrap_or(scene.max_depth);
    scene.pixel_filter = match (args.pixel, how) {
        (Some(filter), _) => filter.into(),
        (None, Some(how)) => how.pixel_filter.parse().map_err(nst_render::Error::Settings)?,
        (None, None) => PixelFilter::default(),
    };
    Ok(scene)
}

/// Tells the user what will be rendered.
fn describe(scene: &Scene, spp: u32, common: &CommonArgs) {
    let lights = scene.triangles.iter().filter(|t| scene.materials[t.material as usize].emits());
    let mut lines = format!(
        "scene      {}: {} ({} light), {}\n",
        scene.name,
        counted(scene.triangles.len(), "triangle"),
        match lights.count() {
            0 => "none emits".into(),
            1 => "1 emits".into(),
            count => format!("{count} emit"),
        },
        counted(scene.materials.len(), "material")
    );
    for note in &scene.notes {
        lines += &format!("           note: {note}\n");
    }
    let [width, height] = scene.size;
    lines += &format!(
        "film       {width}x{height} pixels, {} per pixel, paths of up to {} vertices",
        counted(spp as usize, "sample"),
        scene.max_depth
    );
    say(&lines, common);
}

/// What the terminal shows while so many paths are traced, and the tree before them is built.
fn progress(scene: &Scene, paths: u64, common: &CommonArgs) -> Progress {
    let before = format!("building the tree of {}", counted(scene.triangles.len(), "triangle"));
    Progress::count(&before, "render", paths, common)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::args::{Args, Command};

    #[test]
    fn terms_are_kept_for_who_reads_them() {
        let keep = |options: &str, window: usize| {
            let line = format!("nst render --scene x.obj {options}");
            let args = Args::try_parse_from(line.split_whitespace()).expect("a command line");
            let Command::Render(args) = args.command else { panic!("it renders") };
            settings(&args, window, KeepArg::Window).keep
        };
        assert_eq!(keep("", 1), Keep::Window(1));
        assert_eq!(keep("", 8), Keep::Window(8));
        assert_eq!(keep("--sequence s.exr", 1), Keep::Window(8));
        assert_eq!(keep("--sequence s.exr", 16), Keep::Window(16));
        assert_eq!(keep("--sequence s.exr --keep pow2", 1), Keep::Pow2(8));
        assert_eq!(keep("--runs 2", 1), Keep::Window(8));
        assert_eq!(keep("--sequence s.exr --keep all", 1), Keep::All);
    }
}

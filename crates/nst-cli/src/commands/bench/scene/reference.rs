//! The reference of a bench: two independent halves, rendered once for each scene.

use std::path::{Path, PathBuf};

use nst_core::{Keep, halves::Halves};
use nst_files::{ColorModel, output::OutputFile, picture::Picture, picture_writer::write_exr};
use nst_render::{Control, RenderSettings, SamplerKind, Scene, render_from};

use crate::{args::CommonArgs, error::Error, interrupt, progress::Progress, system::VERSION};

/// The seeds of the halves; no run has them.
pub(super) const SEEDS: [u64; 2] = [u64::MAX - 1, u64::MAX];

/// The true values, as well as they are known.
pub(super) struct Reference {
    pub(super) size: [u32; 2],
    /// Planar R, G, B; twice the same if there is one picture alone.
    halves: [Vec<f32>; 2],
    /// The MSE of the mean of both halves; `None` if there is one picture alone.
    pub(super) own_mse: Option<f64>,
}

impl Reference {
    /// Reads one picture, or two independent ones.
    pub(super) fn read(paths: &[PathBuf]) -> Result<Self, Error> {
        let pictures = paths.iter().map(|path| open(path)).collect::<Result<Vec<_>, _>>()?;
        let size = pictures[0].size;
        if let Some(other) = pictures.iter().find(|picture| picture.size != size) {
            return Err(Error::Unlike(format!(
                "the references '{}' and '{}' have different sizes",
                pictures[0].path().display(),
                other.path().display()
            )));
        }
        let mut halves = pictures.iter().map(|picture| Ok(picture.read()?));
        let first = halves.next().expect("the command line asks for one")?;
        let second = halves.next().unwrap_or_else(|| Ok::<_, Error>(first.clone()))?;
        if paths.len() > 1 && first == second {
            return Err(Error::Unlike(format!(
                "the references '{}' and '{}' are the same picture; two independent renderings \
                 are needed, or one picture alone",
                paths[0].display(),
                paths[1].display()
            )));
        }
        Ok(Self::of(size, [first, second], paths.len() > 1))
    }

    /// Renders the halves with so many samples per pixel each, or takes those of an earlier
    /// bench of this scene.
    pub(super) fn render(scene: &Scene, spp: u32, common: &CommonArgs) -> Result<Self, Error> {
        let [first, second] = SEEDS.map(|seed| half(scene, spp, seed, common));
        Ok(Self::of(scene.size, [first?, second?], true))
    }

    fn of(size: [u32; 2], halves: [Vec<f32>; 2], independent: bool) -> Self {
        let mut reference = Self { size, halves, own_mse: None };
        reference.own_mse = independent.then(|| reference.halves().own_mse());
        reference
    }

    pub(super) fn halves(&self) -> Halves<'_> {
        let [first, second] = &self.halves;
        Halves::new(first, second, ColorModel::Rgb.channels().len())
            .expect("both are pictures of one size")
    }

    /// The mean of both halves.
    pub(super) fn mean(&self) -> Vec<f32> {
        let [first, second] = &self.halves;
        first.iter().zip(second).map(|(&a, &b)| f32::midpoint(a, b)).collect()
    }
}

fn open(path: &Path) -> Result<Picture, Error> {
    let picture = Picture::open(path, None)?;
    if picture.channel_names.len() != ColorModel::Rgb.channels().len() {
        return Err(Error::Unlike(format!(
            "the reference '{}' has no channels R, G and B, which renderings have",
            path.display()
        )));
    }
    Ok(picture)
}

/// A half, rendered now or earlier.
fn half(scene: &Scene, spp: u32, seed: u64, common: &CommonArgs) -> Result<Vec<f32>, Error> {
    let file = cache()?.join(name(scene, spp, seed));
    // A file that is damaged, or is not there, is rendered again.
    if let Ok(picture) = open(&file)
        && picture.size == scene.size
        && let Ok(lanes) = picture.read()
    {
        return Ok(lanes);
    }
    let [width, height] = scene.size.map(u64::from);
    let progress = Progress::count(
        "building the tree of the scene",
        "reference",
        width * height * u64::from(spp),
        common,
    );
    let advance = |paths| progress.advance(paths);
    let control = Control { progress: &advance, stop: &interrupt::asked };
    let settings =
        RenderSettings { spp, sampler: SamplerKind::Random, seed, keep: Keep::Window(1) };
    let rendering = render_from(None, scene, &settings, control)?;
    if rendering.batch.sample_counts().last() != Some(&spp) {
        let why = "the reference was not finished; nothing was measured";
        return Err(Error::Interrupted(why.into()));
    }
    let lanes = rendering.batch.last().to_vec();
    let mut output = OutputFile::create(&file)?;
    write_exr(&mut output, scene.size, ColorModel::Rgb, &[("", &lanes)])?;
    output.commit()?;
    Ok(lanes)
}

/// The name of a half's file: all that decides its pixels.
fn name(scene: &Scene, spp: u32, seed: u64) -> String {
    let [width, height] = scene.size;
    let half = u64::MAX - seed;
    let scene: String = scene
        .fingerprint()
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' })
        .collect();
    format!("{scene}-{width}x{height}-{spp}spp-{half}-v{VERSION}.exr")
}

/// The folder of references, which is made where it is missing: `nst/references` in the
/// user's folder of caches.
fn cache() -> Result<PathBuf, Error> {
    let of = |variable: &str| std::env::var_os(variable).filter(|it| !it.is_empty());
    let caches = of("XDG_CACHE_HOME")
        .map(PathBuf::from)
        .or_else(|| of("HOME").map(|home| PathBuf::from(home).join(".cache")))
        .or_else(|| of("LOCALAPPDATA").map(PathBuf::from))
        .unwrap_or_else(std::env::temp_dir);
    let folder = caches.join("nst").join("references");
    std::fs::create_dir_all(&folder).map_err(|error| {
        Error::Unlike(format!(
            "cannot make the folder '{}' for references: {error}; name another one with the \
             environment variable XDG_CACHE_HOME",
            folder.display()
        ))
    })?;
    Ok(folder)
}

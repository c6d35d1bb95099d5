//! The reference of a bench: two independent halves, rendered once for each scene.

use std::path::{Path, PathBuf};

use nst_core::{FurtherPowers, Keep, halves::Halves};
use nst_files::{
    ColorModel,
    output::OutputFile,
    picture::Picture,
    picture_writer::{PictureInfo, write_exr},
};
use nst_render::{Control, RenderSettings, SamplerKind, Scene, render_from};

use super::cache;
use crate::{
    args::CommonArgs, error::Error, interrupt, progress::Progress, system::VERSION, words::counted,
};

/// The seeds of the halves; no run has them.
pub(super) const SEEDS: [u64; 2] = [u64::MAX - 1, u64::MAX];

/// The true values, as well as they are known.
pub(super) struct Reference {
    pub(super) size: [u32; 2],
    /// Planar R, G, B; twice the same if there is one picture alone.
    halves: [Vec<f32>; 2],
    /// The MSE of the mean of both halves; `None` if there is one picture alone.
    pub(super) own_mse: Option<f64>,
    /// Of the pixels of both halves, or of the picture.
    pub(super) hash: String,
    /// Samples per pixel of each half, if they were rendered here.
    pub(super) spp: Option<u32>,
    /// Pixels that are not finite in both halves; they are left out of all means.
    nonfinite: usize,
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
        let reference = Self::of(size, [first, second], paths.len() > 1);
        if reference.nonfinite == reference.halves[0].len() / ColorModel::Rgb.channels().len() {
            return Err(Error::Unlike(format!(
                "the reference '{}' has no pixel that is finite",
                paths[0].display()
            )));
        }
        Ok(reference)
    }

    /// Renders the halves with so many samples per pixel each, or takes those of an earlier
    /// bench of this scene.
    pub(super) fn render(scene: &Scene, spp: u32, common: &CommonArgs) -> Result<Self, Error> {
        let [first, second] = SEEDS;
        let stopped = |why: &str| {
            Error::Interrupted(format!(
                "{why}; no row was added, and the same command goes on from there"
            ))
        };
        let first = half(scene, spp, first, common)?
            .ok_or_else(|| stopped("the first half of the reference was not finished"))?;
        let second = half(scene, spp, second, common)?.ok_or_else(|| {
            stopped("the first half of the reference is kept, the second was not finished")
        })?;
        Ok(Self { spp: Some(spp), ..Self::of(scene.size, [first, second], true) })
    }

    fn of(size: [u32; 2], halves: [Vec<f32>; 2], independent: bool) -> Self {
        let pictures = &halves[..if independent { 2 } else { 1 }];
        // The bytes of little-endian numbers, on every machine.
        let bytes = pictures.iter().map(|lanes| lanes.iter().flat_map(|x| x.to_le_bytes()));
        let bytes: Vec<Vec<u8>> = bytes.map(Iterator::collect).collect();
        let hash = cache::hash(bytes.iter().map(Vec::as_slice));
        let mut broken: Vec<usize> = pictures.iter().flat_map(|lanes| nonfinite(lanes)).collect();
        broken.sort_unstable();
        broken.dedup();
        let mut reference =
            Self { size, halves, own_mse: None, hash, spp: None, nonfinite: broken.len() };
        reference.own_mse = independent.then(|| reference.halves().own_mse());
        reference
    }

    /// Whether a picture is the reference itself, or one of its halves.
    pub(super) fn is(&self, picture: &[f32]) -> bool {
        self.halves.iter().any(|half| half == picture)
    }

    /// What to tell about it.
    pub(super) fn notes(&self) -> Option<String> {
        (self.nonfinite > 0).then(|| {
            let (pixels, are) =
                (counted(self.nonfinite, "pixel"), if self.nonfinite == 1 { "is" } else { "are" });
            format!("{pixels} of the reference {are} not finite, and left out of all errors")
        })
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

/// The pixels of which a channel is not finite, of planar R, G, B.
pub(super) fn nonfinite(lanes: &[f32]) -> impl Iterator<Item = usize> {
    let pixels = lanes.len() / ColorModel::Rgb.channels().len();
    (0..pixels).filter(move |pixel| {
        lanes.iter().skip(*pixel).step_by(pixels).any(|value| !value.is_finite())
    })
}

/// A half, rendered now or earlier; `None` if a signal came before it was finished.
fn half(
    scene: &Scene,
    spp: u32,
    seed: u64,
    common: &CommonArgs,
) -> Result<Option<Vec<f32>>, Error> {
    let file = cache::folder("references")?.join(name(scene, spp, seed));
    // A file that is damaged, or is not there, is rendered again.
    if let Ok(picture) = open(&file)
        && picture.size == scene.size
        && let Ok(lanes) = picture.read()
    {
        return Ok(Some(lanes));
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
    let settings = RenderSettings {
        spp,
        sampler: SamplerKind::Random,
        seed,
        keep: Keep::Window(1),
        features: false,
        powers: FurtherPowers::NONE,
    };
    let rendering = render_from(None, scene, &settings, control)?;
    if rendering.samples() != spp {
        return Ok(None);
    }
    let lanes = rendering.last();
    let mut output = OutputFile::create(&file)?;
    let info = PictureInfo {
        samples_per_pixel: Some(spp),
        scene: Some(scene.fingerprint()),
        ..PictureInfo::default()
    };
    write_exr(&mut output, scene.size, ColorModel::Rgb, &[("", &lanes)], &info)?;
    output.commit()?;
    Ok(Some(lanes))
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

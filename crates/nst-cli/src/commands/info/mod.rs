//! `nst info`: what is in a file.

mod exr;
mod png;
#[cfg(feature = "render")]
mod scene;
mod system;
mod tensors;

use std::{borrow::Cow, fmt, path::Path};

use nst_core::Weights;
use nst_files::{dataset, guard_table, header::is_exr};
use serde::Serialize;

use crate::{
    args::{InfoArgs, has_extension},
    error::Error,
    progress::Progress,
    report::Done,
    words::on_one_line,
};

/// The facts of a file.
#[derive(Serialize)]
pub(super) struct Report {
    file: String,
    #[serde(flatten)]
    content: Content,
}

#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum Content {
    #[cfg(feature = "render")]
    Scene(scene::SceneInfo),
    Png(png::PngReport),
    Weights(tensors::WeightsInfo),
    Dataset(tensors::DatasetReport),
    Sequence(exr::SequenceReport),
    Picture(exr::PictureReport),
}

pub(super) fn run(args: &InfoArgs) -> Result<Done, Error> {
    if let Some(name) = &args.network {
        let weights = Weights::builtin(name);
        let weights = weights.unwrap_or_else(|| unreachable!("clap admits known names only"))?;
        let content = Content::Weights(tensors::WeightsInfo::of(&weights));
        return Ok(Done::whole(Report { file: name.clone(), content }));
    }
    Ok(match &args.file {
        None => Done::whole(system::SystemInfo::read()),
        Some(path) => {
            let reading = Progress::step(format!("reading {}", path.display()), &args.common);
            let content = read(path)?;
            drop(reading);
            Done::whole(Report { file: path.display().to_string(), content })
        }
    })
}

fn read(path: &Path) -> Result<Content, Error> {
    if has_extension(path, "obj") {
        scene(path)
    } else if has_extension(path, "safetensors") {
        Ok(match dataset::safetensors_format(path)?.as_str() {
            dataset::FORMAT => Content::Dataset(tensors::DatasetReport::read(path)?),
            guard_table::FORMAT => {
                return Err(Error::Unlike(format!(
                    "'{}' is a table for training the guard, which 'python -m nst_train \
                     guard-tables' reads",
                    path.display()
                )));
            }
            // Anything else is judged by the reader of weights, which says what it misses.
            _ => Content::Weights(tensors::WeightsInfo::read(path)?),
        })
    } else if has_extension(path, "png") {
        Ok(Content::Png(png::PngReport::read(path)?))
    } else if is_exr(path)? {
        exr::read(path)
    } else {
        Err(Error::Unlike(format!(
            "'{}' is no EXR file, and its name does not end in .obj (a scene), .safetensors \
             (weights or a dataset) or .png (a picture)",
            path.display()
        )))
    }
}

#[cfg(feature = "render")]
fn scene(path: &Path) -> Result<Content, Error> {
    Ok(Content::Scene(scene::SceneInfo::read(path)?))
}

#[cfg(not(feature = "render"))]
fn scene(path: &Path) -> Result<Content, Error> {
    Err(Error::Unlike(format!(
        "'{}' is a scene, which this nst, built without the feature 'render', cannot read",
        path.display()
    )))
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.file)?;
        match &self.content {
            #[cfg(feature = "render")]
            Content::Scene(scene) => scene.fmt(f),
            Content::Png(png) => png.fmt(f),
            Content::Weights(weights) => weights.fmt(f),
            Content::Dataset(dataset) => dataset.fmt(f),
            Content::Sequence(sequence) => sequence.fmt(f),
            Content::Picture(picture) => picture.fmt(f),
        }
    }
}

fn or_unknown(text: &str) -> Cow<'_, str> {
    if text.is_empty() { Cow::Borrowed("not recorded") } else { on_one_line(text) }
}

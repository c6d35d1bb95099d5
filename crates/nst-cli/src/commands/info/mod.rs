//! `nst info`: what is in a file.

mod exr;
mod scene;
mod tensors;

use std::fmt;

use nst_files::{dataset, header::is_exr};
use serde::Serialize;

use super::{list, numbers};
use crate::{
    args::{InfoArgs, has_extension},
    error::Error,
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
    Scene(scene::SceneInfo),
    Weights(tensors::WeightsInfo),
    Dataset(tensors::DatasetReport),
    Sequence(exr::SequenceReport),
    Picture(exr::PictureReport),
}

pub(super) fn run(args: &InfoArgs) -> Result<Report, Error> {
    let path = &args.file;
    let content = if has_extension(path, "obj") {
        Content::Scene(scene::SceneInfo::read(path)?)
    } else if has_extension(path, "safetensors") {
        match dataset::safetensors_format(path)?.as_str() {
            dataset::FORMAT => Content::Dataset(tensors::DatasetReport::read(path)?),
            // Anything else is judged by the reader of weights, which says what it misses.
            _ => Content::Weights(tensors::WeightsInfo::read(path)?),
        }
    } else if is_exr(path)? {
        exr::read(path)?
    } else {
        return Err(Error::Unlike(format!(
            "'{}' is no EXR file, and its name ends neither in .obj (a scene) nor in .safetensors \
             (weights or a dataset)",
            path.display()
        )));
    };
    Ok(Report { file: path.display().to_string(), content })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.file)?;
        match &self.content {
            Content::Scene(scene) => scene.fmt(f),
            Content::Weights(weights) => weights.fmt(f),
            Content::Dataset(dataset) => dataset.fmt(f),
            Content::Sequence(sequence) => sequence.fmt(f),
            Content::Picture(picture) => picture.fmt(f),
        }
    }
}

fn or_unknown(text: &str) -> &str {
    if text.is_empty() { "not recorded" } else { text }
}

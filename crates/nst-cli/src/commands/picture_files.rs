//! The files of a picture: EXR and PNG, or PNG alone.

use std::path::Path;

use nst_core::{SequenceBatch, Side, guard::Judgement};
use nst_files::{
    output::{Kind, Name, OutputFile, Outputs, commit},
    picture_writer::PictureInfo,
};

use crate::{args::has_extension, error::Error};

/// The layers of a picture: estimates, the plain ones, and the variance of these.
pub(super) fn layers<'a>(batch: &'a SequenceBatch, values: &'a [f32]) -> Vec<(&'a str, &'a [f32])> {
    let mut layers = vec![("", values), ("S", batch.last())];
    layers.extend(batch.side(&Side::Variance).map(|variance| ("Variance", variance)));
    layers
}

/// What the header of a picture says: the samples behind it, how long they took where that is
/// known, and what a method that measures its own gain has found.
pub(super) fn header(
    samples: u32,
    render_seconds: Option<f32>,
    judgement: Option<&Judgement>,
) -> PictureInfo {
    let expert = judgement.map(|it| {
        let experts: Vec<_> = it.experts.iter().map(|(name, w)| format!("{name} {w:.4}")).collect();
        if experts.is_empty() { "none".to_owned() } else { experts.join(", ") }
    });
    PictureInfo {
        samples_per_pixel: Some(samples),
        render_seconds,
        expert,
        predicted: judgement.map(|it| [it.ratio, it.interval[0], it.interval[1]].map(|x| x as f32)),
        ..PictureInfo::default()
    }
}

/// Where a picture goes. All of it is there at the end, or nothing.
pub(super) struct PictureFiles {
    /// Left out if the user asked for a PNG.
    pub(super) exr: Option<OutputFile>,
    pub(super) png: OutputFile,
}

impl PictureFiles {
    /// Opens the file of this name, which ends in .exr or .png; a PNG stands beside an EXR.
    pub(super) fn open(outputs: &mut Outputs, path: &Path, name: Name) -> Result<Self, Error> {
        if has_extension(path, "png") {
            return Ok(Self { exr: None, png: outputs.open(path, Kind::Png, name)? });
        }
        let exr = outputs.open(path, Kind::Picture, name)?;
        // The program chose this name, not the user.
        let png = outputs.open(&path.with_extension("png"), Kind::Png, Name::Default)?;
        Ok(Self { exr: Some(exr), png })
    }

    /// Puts the files in their places; returns their paths.
    pub(super) fn commit(self) -> Result<Vec<String>, Error> {
        let files: Vec<_> = self.exr.into_iter().chain([self.png]).collect();
        let paths = files.iter().map(|file| file.path().display().to_string()).collect();
        commit(files)?;
        Ok(paths)
    }
}

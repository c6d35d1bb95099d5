//! The files of a picture: EXR and PNG, or PNG alone.

use std::{borrow::Cow, path::Path};

use nst_core::{Estimates, Fitted, SequenceBatch, Side, guard::Judgement};
use nst_files::{
    ColorModel,
    output::{Kind, Name, OutputFile, Outputs, commit},
    picture_writer::{PictureInfo, PictureWriter},
    png::PngWriter,
};

use crate::{args::has_extension, error::Error, summary::weighed_by};

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
        guard: judgement.map(|it| weighed_by(it).to_owned()),
        predicted: judgement.map(|it| [it.ratio, it.interval[0], it.interval[1]].map(|x| x as f32)),
        ..PictureInfo::default()
    }
}

/// What a method says of its estimates beside their values.
#[derive(Clone, Debug, Default)]
pub(super) struct Further {
    /// Whether their errors are known.
    pub(super) errors: bool,
    /// The experts whose weights are known at each pixel.
    pub(super) weights: Vec<String>,
}

impl Further {
    pub(super) fn of(fitted: &dyn Fitted) -> Self {
        let judgement = fitted.judgement().filter(|_| fitted.has_weights());
        let experts = judgement.into_iter().flat_map(|it| &it.experts);
        let weights = experts.map(|(name, _)| name.clone()).collect();
        Self { errors: fitted.estimates_errors(), weights }
    }

    /// These of some estimates.
    pub(super) fn parts<'a>(&self, estimates: &'a Estimates) -> Vec<&'a [f32]> {
        let errors = self.errors.then(|| estimates.errors());
        let weights = (!self.weights.is_empty()).then(|| estimates.weights());
        errors.into_iter().chain(weights).collect()
    }
}

/// Where a picture goes. All of it is there at the end, or nothing.
pub(super) struct PictureFiles {
    /// Left out if the user asked for a PNG.
    exr: Option<OutputFile>,
    png: OutputFile,
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

    /// Begins to write. The EXR has the layers `S`, `Variance` if there is that side channel,
    /// `StdError` if errors are estimated, a channel `weight.NAME` of each expert whose weights are
    /// known, and features that are among the side channels.
    pub(super) fn begin(
        &mut self,
        size: [u32; 2],
        model: ColorModel,
        sides: &[Side],
        further: &Further,
        info: &PictureInfo,
    ) -> Result<PictureRows<'_>, Error> {
        let mut layers = vec!["", "S"];
        layers.extend(sides.contains(&Side::Variance).then_some("Variance"));
        layers.extend(further.errors.then_some("StdError"));
        let weights: Vec<_> = further.weights.iter().map(|name| format!("weight.{name}")).collect();
        let features: Vec<Side> = sides.iter().filter(|side| is_shown(side)).cloned().collect();
        let create =
            |exr| PictureWriter::create(exr, size, model, &layers, &weights, &features, info);
        let exr = self.exr.as_mut().map(create);
        let png = PngWriter::create(&mut self.png, size)?;
        Ok(PictureRows { exr: exr.transpose()?, png, channels: model.channels().len(), features })
    }

    /// Puts the files in their places; returns their paths.
    pub(super) fn commit(self) -> Result<Vec<String>, Error> {
        let files: Vec<_> = self.exr.into_iter().chain([self.png]).collect();
        let paths = files.iter().map(|file| file.path().display().to_string()).collect();
        commit(files)?;
        Ok(paths)
    }
}

/// The files of a picture while they are written, some rows at a time.
pub(super) struct PictureRows<'a> {
    exr: Option<PictureWriter<'a>>,
    png: PngWriter<'a>,
    channels: usize,
    features: Vec<Side>,
}

/// Whether a picture has a layer of this feature: of folds, none.
pub(super) fn is_shown(side: &Side) -> bool {
    side.is_feature() && !side.is_of_fold()
}

impl PictureRows<'_> {
    /// Writes a strip, without its halo, its estimates, and what is known [further](Further) of
    /// these: errors, then weights.
    pub(super) fn push(
        &mut self,
        strip: &SequenceBatch,
        values: &[f32],
        further: &[&[f32]],
    ) -> Result<(), Error> {
        let inner = |lanes| strip.grid().map_or(Cow::Borrowed(lanes), |grid| grid.inner(lanes));
        let plain = layers(strip, values).into_iter().skip(1).map(|(_, lanes)| inner(lanes));
        let plain: Vec<Cow<'_, [f32]>> = plain.collect();
        let features = self.features.iter().map(|side| inner(strip.side(side).unwrap_or_default()));
        let features: Vec<Cow<'_, [f32]>> = features.collect();
        let layers = [values].into_iter().chain(plain.iter().map(AsRef::as_ref));
        let layers = layers.chain(further.iter().copied());
        let layers: Vec<&[f32]> = layers.chain(features.iter().map(AsRef::as_ref)).collect();
        let (exr, png) = rayon::join(
            || self.exr.as_mut().map_or(Ok(()), |exr| exr.push(&layers)),
            || self.png.push(values, self.channels),
        );
        Ok(exr.and(png)?)
    }

    /// Completes the files, of which all rows must have been written.
    pub(super) fn finish(self) -> Result<(), Error> {
        self.exr.map_or(Ok(()), PictureWriter::finish)?;
        Ok(self.png.finish()?)
    }
}

//! Sequences as EXR files: R, G, B hold S_N; the layer `S0008` the term of 8
//! samples, and so on; `fold0` … and `Variance` the side channels.

use std::path::Path;

use ndarray::Array2;
use nst_core::SequenceBatch;

use crate::{
    Error,
    exr_file::{self, Attribute, Channels, ExrFile},
    film::{insert_layer, take_layer},
    output::OutputFile,
};

/// The version of the format that this module writes, and the only one it reads.
const VERSION: &str = "1";

/// A batch of planar RGB lanes, and where it came from.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceFile {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Three planar channels of lanes.
    pub batch: SequenceBatch,
    /// The scene's fingerprint.
    pub scene: String,
    /// The sampler's name.
    pub sampler: String,
    /// The sampler's seed.
    pub seed: u64,
    /// How long the rendering took.
    pub render_seconds: f32,
}

fn term_name(sample_count: u32) -> String {
    format!("S{sample_count:04}")
}

impl SequenceFile {
    /// Writes the file. The caller commits `output`.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn write(&self, output: &mut OutputFile) -> Result<(), Error> {
        let batch = &self.batch;
        let mut channels = Channels::new();
        insert_layer(&mut channels, "", batch.last());
        for (k, count) in batch.sample_counts().iter().enumerate() {
            insert_layer(&mut channels, &term_name(*count), batch.term(k));
        }
        for (name, values) in batch.sides() {
            insert_layer(&mut channels, name, values);
        }
        let terms: Vec<_> = batch.sample_counts().iter().map(u32::to_string).collect();
        let folds = batch.sides().filter(|(name, _)| name.starts_with("fold")).count();
        let samples = batch.sample_counts()[batch.sample_counts().len() - 1];
        let attributes = [
            ("nst.version", Attribute::Text(VERSION.into())),
            ("nst.terms", Attribute::Text(terms.join(","))),
            ("nst.folds", Attribute::Text(folds.to_string())),
            ("nst.scene", Attribute::Text(self.scene.clone())),
            ("nst.sampler", Attribute::Text(self.sampler.clone())),
            ("nst.seed", Attribute::Text(self.seed.to_string())),
            ("samplesPerPixel", Attribute::I32(i32::try_from(samples).unwrap_or(i32::MAX))),
            ("renderTimeSeconds", Attribute::F32(self.render_seconds)),
        ];
        let attributes = attributes.map(|(name, value)| (name.to_owned(), value)).into();
        exr_file::write(output, self.size, channels, attributes)
    }

    /// Reads a file that [`SequenceFile::write`] wrote.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Image`] names the file and what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let mut file = ExrFile::read(path)?;
        let text = |name: &str| match file.attributes.get(name) {
            Some(Attribute::Text(text)) => Ok(text.clone()),
            Some(_) => Err(Error::image(path, format!("attribute '{name}' is not text"))),
            None => Err(Error::image(
                path,
                format!(
                    "it holds no sequence (attribute '{name}' is missing); 'nst render --sequence FILE' writes one"
                ),
            )),
        };
        let version = text("nst.version")?;
        if version != VERSION {
            return Err(Error::image(
                path,
                format!("format version {version}; this program reads version {VERSION}"),
            ));
        }
        let counts = text("nst.terms")?;
        let sample_counts =
            counts.split(',').map(str::parse).collect::<Result<Vec<u32>, _>>().map_err(|_| {
                Error::image(
                    path,
                    format!("attribute 'nst.terms' is '{counts}', not a list of sample counts"),
                )
            })?;
        let seed = text("nst.seed")?;
        let seed = seed.parse().map_err(|_| {
            Error::image(path, format!("attribute 'nst.seed' is '{seed}', not a number"))
        })?;
        let (scene, sampler) = (text("nst.scene")?, text("nst.sampler")?);
        let render_seconds = match file.attributes.get("renderTimeSeconds") {
            Some(Attribute::F32(seconds)) => *seconds,
            _ => 0.0,
        };

        let mut terms = Vec::new();
        for count in &sample_counts {
            terms.extend(take_layer(&mut file, path, &term_name(*count))?);
        }
        let lanes = terms.len() / sample_counts.len();
        let inconsistent = |error: &dyn std::fmt::Display| Error::image(path, error.to_string());
        let terms = Array2::from_shape_vec((sample_counts.len(), lanes), terms)
            .map_err(|error| inconsistent(&error))?;
        let mut batch =
            SequenceBatch::new(terms, sample_counts).map_err(|error| inconsistent(&error))?;
        // What is left beside the picture itself are side channels.
        while let Some(layer) = file.channels.keys().find_map(|name| name.strip_suffix(".R")) {
            let layer = layer.to_owned();
            let values = take_layer(&mut file, path, &layer)?;
            batch.set_side(&layer, values).map_err(|error| inconsistent(&error))?;
        }
        Ok(Self { size: file.size, batch, scene, sampler, seed, render_seconds })
    }
}

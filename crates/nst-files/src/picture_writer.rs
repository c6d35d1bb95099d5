//! EXR pictures with layers, written whole or row by row.

use nst_core::Side;

use crate::{
    ColorModel, Error,
    layers::layer_channels,
    output_file::OutputFile,
    rows::{Attribute, Attributes, RowWriter},
};

/// What the header of a picture says beside its layers; what is `None` is left out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PictureInfo {
    /// The samples behind each pixel, as `samplesPerPixel`.
    pub samples_per_pixel: Option<u32>,
    /// How long it took to render the samples, as `renderTimeSeconds`.
    pub render_seconds: Option<f32>,
    /// The scene's fingerprint, as `nst.scene`.
    pub scene: Option<String>,
    /// The experts that the estimates are blended of, with the means of their weights, as
    /// `nst.expert`.
    pub expert: Option<String>,
    /// What weighs them, `closed` or `learned`, as `nst.guard`.
    pub guard: Option<String>,
    /// The MSE of the estimates that the blend predicts, relative to that of the plain ones, and
    /// the ends of its 95 % interval, as `nst.predictedRatio`, `nst.predictedLow` and
    /// `nst.predictedHigh`.
    pub predicted: Option<[f32; 3]>,
    /// A hash of the reference that the main picture is the mean of, as `nst.reference`.
    pub reference: Option<String>,
}

impl PictureInfo {
    fn attributes(&self) -> Attributes {
        let samples = self.samples_per_pixel.and_then(|it| i32::try_from(it).ok());
        let text = |text: &Option<String>| text.clone().map(Attribute::Text);
        let predicted = |i: usize| self.predicted.map(|of| Attribute::F32(of[i]));
        let all = [
            ("samplesPerPixel", samples.map(Attribute::I32)),
            ("renderTimeSeconds", self.render_seconds.map(Attribute::F32)),
            ("nst.expert", text(&self.expert)),
            ("nst.guard", text(&self.guard)),
            ("nst.predictedRatio", predicted(0)),
            ("nst.predictedLow", predicted(1)),
            ("nst.predictedHigh", predicted(2)),
            ("nst.scene", text(&self.scene)),
            ("nst.reference", text(&self.reference)),
        ];
        all.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect()
    }
}

/// Writes an EXR picture row by row.
pub struct PictureWriter<'a> {
    rows: RowWriter<'a>,
    model: ColorModel,
}

impl<'a> PictureWriter<'a> {
    /// Begins a picture with these layers, of which one may have no name: its channels
    /// have no prefix, and are what programs show first. Then come channels that stand alone, such as
    /// `weight.filter`, and layers of side channels, with the channels that those have in sequences.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn create(
        output: &'a mut OutputFile,
        size: [u32; 2],
        model: ColorModel,
        layers: &[&str],
        alone: &[String],
        sides: &[Side],
        info: &PictureInfo,
    ) -> Result<Self, Error> {
        let layers = layers.iter().flat_map(|layer| layer_channels(layer, model.channels()));
        let alone = alone.iter().flat_map(|name| layer_channels("", &[name]).collect::<Vec<_>>());
        let sides = sides.iter().flat_map(|side| {
            layer_channels(&side.to_string(), model.side_channels(side)).collect::<Vec<_>>()
        });
        let channels: Vec<_> = layers.chain(alone).chain(sides).collect();
        Ok(Self { rows: RowWriter::create(output, size, &channels, info.attributes())?, model })
    }

    /// Appends rows of each layer and channel, as planar lanes; the first must be one of lanes. All calls but
    /// the last need a multiple of 16 rows.
    ///
    /// # Errors
    /// [`Error::Io`] if they cannot be written, [`Error::Mismatch`] if they are not the
    /// rows that follow.
    pub fn push(&mut self, layers: &[&[f32]]) -> Result<(), Error> {
        let lanes = layers.first().map_or(0, |lanes| lanes.len());
        let pixels = (lanes / self.model.channels().len()).max(1);
        let planes: Vec<&[u8]> = layers
            .iter()
            .flat_map(|lanes| lanes.chunks(pixels))
            .map(bytemuck::cast_slice)
            .collect();
        self.rows.push(&planes)
    }

    /// Completes the file; all its rows must have been pushed. The caller commits the
    /// output.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written, [`Error::Mismatch`] if rows are missing.
    pub fn finish(self) -> Result<(), Error> {
        self.rows.finish()
    }
}

/// Writes an EXR picture: named layers, each of planar lanes.
///
/// # Errors
/// [`Error::Io`] if it cannot be written, [`Error::Mismatch`] if a layer has another size.
pub fn write_exr(
    output: &mut OutputFile,
    size: [u32; 2],
    model: ColorModel,
    layers: &[(&str, &[f32])],
    info: &PictureInfo,
) -> Result<(), Error> {
    let (names, lanes): (Vec<&str>, Vec<&[f32]>) = layers.iter().copied().unzip();
    let mut writer = PictureWriter::create(output, size, model, &names, &[], &[], info)?;
    writer.push(&lanes)?;
    writer.finish()
}

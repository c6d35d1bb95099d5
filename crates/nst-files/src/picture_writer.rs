//! EXR pictures with layers, written whole or row by row.

use crate::{
    ColorModel, Error,
    layers::layer_channels,
    output_file::OutputFile,
    rows::{Attributes, RowWriter},
};

/// Writes an EXR picture row by row.
pub struct PictureWriter<'a> {
    rows: RowWriter<'a>,
    model: ColorModel,
}

impl<'a> PictureWriter<'a> {
    /// Begins a picture with these layers, of which one may have no name: its channels
    /// have no prefix, and are what programs show first.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn create(
        output: &'a mut OutputFile,
        size: [u32; 2],
        model: ColorModel,
        layers: &[&str],
    ) -> Result<Self, Error> {
        let channels: Vec<_> =
            layers.iter().flat_map(|layer| layer_channels(layer, model.channels())).collect();
        Ok(Self { rows: RowWriter::create(output, size, &channels, Attributes::new())?, model })
    }

    /// Appends rows of each layer, as planar lanes. All calls but the last need a multiple
    /// of 16 rows.
    ///
    /// # Errors
    /// [`Error::Io`] if they cannot be written, [`Error::Mismatch`] if they are not the
    /// rows that follow.
    pub fn push(&mut self, layers: &[&[f32]]) -> Result<(), Error> {
        let channels = self.model.channels().len();
        let planes: Vec<&[u8]> = layers
            .iter()
            .flat_map(|lanes| lanes.chunks((lanes.len() / channels).max(1)))
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
) -> Result<(), Error> {
    let (names, lanes): (Vec<&str>, Vec<&[f32]>) = layers.iter().copied().unzip();
    let mut writer = PictureWriter::create(output, size, model, &names)?;
    writer.push(&lanes)?;
    writer.finish()
}

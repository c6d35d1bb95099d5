//! EXR pictures of any program, read whole: named f32 channels.

use std::{collections::BTreeMap, path::Path};

use exr::prelude::*;

use crate::Error;

/// A file that was read: channels `[y][x]` by name.
#[derive(Clone, Debug)]
pub(crate) struct ExrFile {
    pub(crate) size: [u32; 2],
    pub(crate) channels: BTreeMap<String, Vec<f32>>,
}

impl ExrFile {
    /// Reads the first part of an EXR file; f16 and u32 channels become f32.
    pub(crate) fn read(path: &Path) -> std::result::Result<Self, Error> {
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_file(path)
            .map_err(|error| match error {
                exr::error::Error::Io(error) => Error::io("read", path, error),
                error => Error::image(path, format!("not a readable EXR file: {error}")),
            })?;
        let layer = image.layer_data;
        let size = u32::try_from(layer.size.x()).ok().zip(u32::try_from(layer.size.y()).ok());
        let (width, height) = size.ok_or_else(|| Error::image(path, "it is too large"))?;
        let channels = layer
            .channel_data
            .list
            .into_iter()
            .map(|channel| {
                let values = match channel.sample_data {
                    FlatSamples::F32(values) => values,
                    other => other.values_as_f32().collect(),
                };
                (channel.name.to_string(), values)
            })
            .collect();
        Ok(Self { size: [width, height], channels })
    }

    /// A channel by name, or an error that names it.
    pub(crate) fn take(&mut self, path: &Path, name: &str) -> std::result::Result<Vec<f32>, Error> {
        self.channels
            .remove(name)
            .ok_or_else(|| Error::image(path, format!("channel '{name}' is missing")))
    }
}

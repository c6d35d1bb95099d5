//! The names of channels: which of them make up a layer.

use exr::prelude::SampleType;
use nst_core::{Extent, Side};

use crate::rows::Channel;

/// The channels of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorModel {
    /// One channel, Y.
    Mono,
    /// R, G and B in linear sRGB primaries.
    Rgb,
}

impl ColorModel {
    /// The channels' names, in the order of planar lanes.
    #[must_use]
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Mono => &["Y"],
            Self::Rgb => &["R", "G", "B"],
        }
    }

    /// The channels of a side channel's layer: those of the picture if it has a value for
    /// each lane, one alone if it has a value for each pixel, or three coordinates.
    pub(crate) fn side_channels(self, side: &Side) -> &'static [&'static str] {
        match (side.extent(), side) {
            (Extent::Lane, _) => self.channels(),
            // As every program calls a depth.
            (Extent::Pixel, Side::Depth) => &["Z"],
            (Extent::Pixel, _) => Self::Mono.channels(),
            (Extent::Vector, _) => &["X", "Y", "Z"],
        }
    }
}

/// The name of a layer's channel, `S.R` for instance; the main picture has no prefix.
pub(crate) fn channel_name(layer: &str, channel: &str) -> String {
    if layer.is_empty() { channel.to_owned() } else { format!("{layer}.{channel}") }
}

/// The f32 channels of a layer.
pub(crate) fn layer_channels<'a>(
    layer: &'a str,
    channels: &'a [&str],
) -> impl Iterator<Item = Channel> + 'a {
    channels.iter().map(move |channel| (channel_name(layer, channel), SampleType::F32))
}

//! PNG files.

use std::{fmt, path::Path};

use nst_files::png::PngInfo;
use serde::Serialize;

use crate::error::Error;

#[derive(Serialize)]
pub(super) struct PngReport {
    bytes: u64,
    width: u32,
    height: u32,
    channels: u32,
    /// Per channel.
    bits: u32,
    software: Option<String>,
}

impl PngReport {
    pub(super) fn read(path: &Path) -> Result<Self, Error> {
        let PngInfo { size: [width, height], channels, bits, software } = PngInfo::read(path)?;
        let bytes = std::fs::metadata(path).map(|file| file.len()).unwrap_or_default();
        Ok(Self { bytes, width, height, channels, bits, software })
    }
}

impl fmt::Display for PngReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { bytes, width, height, channels, bits, software } = self;
        writeln!(f, "picture (PNG), {bytes} bytes")?;
        writeln!(f, "pixels      {width}x{height}, {channels} channels of {bits} bits")?;
        let software = software.as_deref().unwrap_or("not recorded");
        writeln!(f, "software    {software}")
    }
}

//! How files begin.

use std::{
    fs::File,
    io::{self, Read},
    path::Path,
};

/// The first bytes of every EXR file: 20000630, little-endian.
pub(crate) const EXR: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// The first bytes of a file, as many as those of EXR files, if there are so many.
pub(crate) fn start(path: &Path) -> io::Result<Vec<u8>> {
    let mut start = Vec::new();
    File::open(path)?.take(EXR.len() as u64).read_to_end(&mut start)?;
    Ok(start)
}

//! Images from EXR files.

use std::path::Path;

use nst_files::picture::Picture;

use super::{Pixels, Purpose};
use crate::Error;

/// The channels R, G and B, or Y, as they are.
pub(super) fn read(path: &Path, most_bytes: u64, purpose: Purpose) -> Result<Pixels, Error> {
    let picture = Picture::open(path, None)?;
    let [width, height] = picture.size.map(u64::from);
    if width * height * (size_of::<f32>() * picture.channel_names.len()) as u64 > most_bytes {
        let message = format!(
            "{width} by {height} pixels are too many, for this program or for the file's length"
        );
        return Err(Error::image(path, message));
    }
    let lanes = picture.read()?;
    let pixels = (width * height) as usize;
    let channel = |channel: usize| &lanes[channel * pixels..][..pixels];
    // One channel is grey.
    let [r, g, b] = if lanes.len() == pixels { [0; 3] } else { [0, 1, 2] }.map(channel);
    let texels = r.iter().zip(g).zip(b).map(|((&r, &g), &b)| [r, g, b]).collect();
    let alpha = match (purpose, picture.layer.as_str()) {
        (Purpose::Opacity, "") => Picture::open(path, Some("A")).ok(),
        (Purpose::Opacity, layer) => Picture::open(path, Some(&format!("{layer}.A"))).ok(),
        _ => None,
    };
    let alpha = alpha.map(|alpha| alpha.read()).transpose()?;
    Ok(Pixels { size: picture.size, texels, alpha })
}

//! Values of several options.

use std::path::{Path, PathBuf};

pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    text.split_once('x')
        .and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]))
        .filter(|size| !size.contains(&0))
        .ok_or_else(|| "a size is two numbers above 0, as in 512x512".to_owned())
}

pub(super) fn exr_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if has_extension(&path, "exr") { Ok(path) } else { Err("the name must end in .exr".to_owned()) }
}

pub(super) fn png_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if has_extension(&path, "png") { Ok(path) } else { Err("the name must end in .png".to_owned()) }
}

/// Whether a path ends in the extension, in upper or lower case.
pub(crate) fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_paths() {
        assert_eq!(size("640x480"), Ok([640, 480]));
        for bad in ["640", "640x", "0x3", "-1x3", "1x2x3"] {
            assert!(size(bad).is_err(), "{bad}");
        }
        assert!(exr_path("x.png").is_err());
    }
}

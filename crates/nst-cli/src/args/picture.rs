//! Pictures of other programs, with names.

use std::path::PathBuf;

use crate::results::check_name;

/// A picture, and what to call it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct NamedPicture {
    pub(crate) name: String,
    pub(crate) file: PathBuf,
    pub(crate) layer: Option<String>,
}

/// The layer stands after the file's `.exr:`; a colon elsewhere belongs to the file's name.
pub(super) fn named_picture(text: &str) -> Result<NamedPicture, String> {
    let (name, file) = text
        .split_once('=')
        .filter(|(name, file)| !name.is_empty() && !file.is_empty())
        .ok_or_else(|| "a name and a file are needed, as in oidn=denoised.exr".to_owned())?;
    check_name(name)?;
    let split = file.to_ascii_lowercase().rfind(".exr:").map(|at| at + ".exr".len());
    let layer = split.map(|at| file[at + 1..].to_owned());
    if layer.as_ref().is_some_and(String::is_empty) {
        return Err("the name of a layer is missing after the colon".to_owned());
    }
    let file = PathBuf::from(&file[..split.unwrap_or(file.len())]);
    Ok(NamedPicture { name: name.to_owned(), file, layer })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_have_names_and_perhaps_layers() {
        for (text, expected) in [
            ("a=x.exr", ("a", "x.exr", None)),
            ("a b=c:/x.EXR:S", ("a b", "c:/x.EXR", Some("S"))),
            ("a=x=y.exr", ("a", "x=y.exr", None)),
            ("a=c:/x", ("a", "c:/x", None)),
            ("a=x.exr:y.exr:View.R", ("a", "x.exr:y.exr", Some("View.R"))),
        ] {
            let found = named_picture(text).expect(text);
            let found = (&*found.name, found.file.to_str(), found.layer.as_deref());
            assert_eq!(found, (expected.0, Some(expected.1), expected.2));
        }
        for bad in ["x.exr", "=x.exr", "a=", "a=x.exr:", "", "a\tb=x.exr"] {
            assert!(named_picture(bad).is_err(), "{bad}");
        }
    }
}

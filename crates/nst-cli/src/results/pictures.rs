//! Where the pictures of a table are: an EXR file beside it, with a layer for each.

use std::path::{Path, PathBuf};

use nst_files::header::ExrHeader;

use super::row::Row;

/// The most characters of a name, and the most bytes: names of channels in EXR files, of which
/// it is a part, have at most 255 bytes.
const MOST_CHARACTERS: usize = 100;
const MOST_BYTES: usize = 200;

/// Whether a method may have a name; `Err` says why not.
pub(crate) fn check_name(name: &str) -> Result<(), String> {
    if name.chars().any(char::is_control) {
        return Err(format!("the name {name:?} has control characters"));
    }
    if name.chars().count() > MOST_CHARACTERS || name.len() > MOST_BYTES {
        let start: String = name.chars().take(20).collect();
        return Err(format!(
            "the name '{start}…' has more than {MOST_CHARACTERS} characters, or more than \
             {MOST_BYTES} bytes"
        ));
    }
    Ok(())
}

/// Whether the pictures of a file are those of the table of a row, by the scene and the
/// reference; `None` if one of them does not say it.
pub(crate) fn belongs(header: &ExrHeader, row: &Row) -> Option<bool> {
    let attributes = &header.parts.first()?.attributes;
    let reference = attributes.get("nst.reference").filter(|_| !row.reference.is_empty())?;
    let scene = attributes.get("nst.scene").map_or("", String::as_str);
    Some(*reference == row.reference && scene == row.fingerprint)
}

/// The file of a table's pictures. Its main picture is the reference.
pub(crate) fn beside(table: &Path) -> PathBuf {
    table.with_extension("exr")
}

/// The layer of a method at a sample count.
#[cfg(feature = "render")]
pub(crate) fn layer_of(method: &str, spp: u32) -> String {
    format!("{method}.{spp}")
}

/// A method of the table and a sample count, if the name of a layer consists of them.
pub(crate) fn method_of<'a>(layer: &'a str, methods: &[&str]) -> Option<(&'a str, u32)> {
    let (method, spp) = layer.rsplit_once('.')?;
    Some((method, spp.parse().ok()?)).filter(|(method, _)| methods.contains(method))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_short_texts() {
        for name in ["oidn", "a b", "Größe", &"x".repeat(100), &"é".repeat(100)] {
            assert_eq!(check_name(name), Ok(()), "{name}");
        }
        for (name, why) in [
            ("a\nb", "control characters"),
            ("\u{7f}", "control characters"),
            (&"x".repeat(101), "'xxxxxxxxxxxxxxxxxxxx…' has more than 100 characters"),
            (&"日".repeat(67), "more than 200 bytes"),
        ] {
            assert!(check_name(name).is_err_and(|error| error.contains(why)), "{name:?}");
        }
    }

    #[test]
    fn layers_of_methods_are_known() {
        let methods = ["none", "a.b", "8"];
        for (layer, expected) in [
            ("none.64", Some(("none", 64))),
            ("a.b.8", Some(("a.b", 8))),
            ("8.8", Some(("8", 8))),
            ("other.64", None),
            ("none.x", None),
            ("none", None),
            ("", None),
        ] {
            assert_eq!(method_of(layer, &methods), expected, "{layer}");
        }
    }
}

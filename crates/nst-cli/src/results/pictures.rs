//! Where the pictures of a table are: an EXR file beside it, with a layer for each.

use std::path::{Path, PathBuf};

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

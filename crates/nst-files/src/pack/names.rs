//! What the names of files say about their content.

use std::path::Path;

/// The number of samples in a file's name: the one beside `spp`, else the last,
/// as in `box-0064spp.exr` and `box_64.exr`.
#[must_use]
pub fn samples_in_name(path: &Path) -> Option<u32> {
    let stem = path.file_stem()?.to_string_lossy().to_ascii_lowercase();
    let digits = |text: &str| -> String { text.chars().take_while(char::is_ascii_digit).collect() };
    let last_digits = |text: &str| -> String {
        let reversed = digits(&text.chars().rev().collect::<String>());
        reversed.chars().rev().collect()
    };
    let separators = ['-', '_', ' ', '.', '='];
    let beside = stem.split_once("spp").map(|(before, after)| {
        let before = last_digits(before.trim_end_matches(separators));
        if before.is_empty() { digits(after.trim_start_matches(separators)) } else { before }
    });
    let number = beside
        .filter(|number| !number.is_empty())
        .unwrap_or_else(|| last_digits(stem.trim_end_matches(|c: char| !c.is_ascii_digit())));
    number.parse().ok().filter(|&number| number > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names() {
        for (name, samples) in [
            ("box-0064spp.exr", Some(64)),
            ("a/box_64.exr", Some(64)),
            ("spp16.exr", Some(16)),
            ("1080p_16_spp_v2.exr", Some(16)),
            ("1080p-spp=32_v2.exr", Some(32)),
            ("v2-00128-final.exr", Some(128)),
            ("spp.exr", None),
            ("box.exr", None),
            ("box-0.exr", None),
            ("box-99999999999.exr", None),
        ] {
            assert_eq!(samples_in_name(Path::new(name)), samples, "{name}");
        }
    }
}

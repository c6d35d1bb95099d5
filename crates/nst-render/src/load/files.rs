//! The files that scene files mean.

use std::path::{Path, PathBuf};

/// The file that a scene file means by `name`: beside it, with the slashes of
/// either system; a folder that only the author had is left out.
pub(super) fn find(scene_file: &Path, name: &str) -> PathBuf {
    let name = name.replace('\\', "/");
    let path = scene_file.with_file_name(&name);
    let last = name.rsplit('/').next().filter(|last| !last.is_empty());
    match last.map(|last| scene_file.with_file_name(last)) {
        Some(beside) if !path.exists() && beside.exists() => beside,
        _ => path,
    }
}

/// Drops options such as `-s 1 1 1` in front of a file's name, which may have spaces.
pub(super) fn without_options(text: &str) -> &str {
    let word = |text: &str| text.split_whitespace().next().unwrap_or_default().len();
    let mut rest = text;
    loop {
        let option = &rest[..word(rest)];
        let arguments = match option {
            "-blendu" | "-blendv" | "-bm" | "-boost" | "-cc" | "-clamp" | "-imfchan"
            | "-texres" | "-type" => 1,
            "-mm" => 2,
            "-o" | "-s" | "-t" => 3,
            _ => return rest,
        };
        rest = rest[option.len()..].trim_start();
        for _ in 0..arguments {
            let argument = &rest[..word(rest)];
            // The second and third number of -o, -s and -t may be left out.
            if arguments == 3 && argument.parse::<f32>().is_err() {
                break;
            }
            rest = rest[argument.len()..].trim_start();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_files_of_other_systems() {
        let folder = tempfile::tempdir().expect("a folder");
        let mtl = folder.path().join("x.mtl");
        std::fs::create_dir(folder.path().join("maps")).expect("a folder");
        for name in ["maps/a.png", "b c.png"] {
            std::fs::write(folder.path().join(name), "").expect("a file");
        }
        assert_eq!(find(&mtl, "maps\\a.png"), folder.path().join("maps/a.png"));
        assert_eq!(find(&mtl, "D:\\me\\b c.png"), folder.path().join("b c.png"));
        assert_eq!(find(&mtl, "/home/me/b c.png"), folder.path().join("b c.png"));
        assert_eq!(find(&mtl, "gone/a.png"), folder.path().join("gone/a.png"));
    }

    #[test]
    fn options_are_dropped() {
        let name = "2 woods.png";
        let options = ["", "-s 1 1 1 ", "-o 0.5 -clamp on ", "-mm 0 1 -bm .5  ", "-imfchan r "];
        for option in &options[..2] {
            assert_eq!(without_options(&format!("{option}{name}")), name);
        }
        for option in options {
            assert_eq!(without_options(&format!("{option}a b.png")), "a b.png");
        }
        for nothing in ["", "-s", "-s 1 1 1", "-mm 0"] {
            assert_eq!(without_options(nothing), "");
        }
        assert_eq!(without_options("-unknown a.png"), "-unknown a.png");
    }
}

//! The files that scene files mean.

use std::path::{Path, PathBuf};

use super::{report::Report, text::quoted};

/// The file that a scene file means by `name`: beside it, with the slashes of
/// either system. Where there is none, but one of that name without folders, it is
/// that one, with a note: the author's folders are not on this machine.
pub(super) fn find(scene_file: &Path, name: &str, report: &mut Report) -> PathBuf {
    let path = named(scene_file, name);
    let Some(last) = path.file_name() else { return path };
    let beside = scene_file.with_file_name(last);
    if exists(&path) || !exists(&beside) {
        return path;
    }
    report.note(format!("{} is not there: '{}' is used", quoted(name), beside.display()));
    beside
}

/// Whether [`find`] finds a file.
pub(super) fn is_found(scene_file: &Path, name: &str) -> bool {
    let path = named(scene_file, name);
    exists(&path) || path.file_name().is_some_and(|last| exists(&scene_file.with_file_name(last)))
}

fn named(scene_file: &Path, name: &str) -> PathBuf {
    scene_file.with_file_name(name.replace('\\', "/"))
}

/// A file that cannot even be looked at counts as absent: the error comes, with its
/// reason, from whoever then reads it.
fn exists(path: &Path) -> bool {
    path.exists()
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
        let cases = [
            ("maps\\a.png", "maps/a.png", 0),
            ("D:\\me\\b c.png", "b c.png", 1),
            ("/home/me/b c.png", "b c.png", 1),
            ("gone/a.png", "gone/a.png", 0),
        ];
        for (name, expected, notes) in cases {
            let mut report = Report::default();
            assert_eq!(find(&mtl, name, &mut report), folder.path().join(expected));
            assert_eq!(report.notes().len(), notes, "{name}: {:?}", report.notes());
            assert_eq!(is_found(&mtl, name), name != "gone/a.png", "{name}");
        }
    }
}

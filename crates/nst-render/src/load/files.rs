//! The files that scene files mean.

use std::{
    ffi::OsStr,
    path::{Component, Path, PathBuf},
};

use unicode_normalization::UnicodeNormalization;

use super::{
    report::Report,
    text::{quoted, without_quotes},
};

/// The file that a scene file means by `name`: beside it, with the slashes of either system.
/// Where there is none, a file is taken, with a note, whose name differs in the case of
/// letters or in how accents are composed; or one that is below the scene file's folder
/// without the first of the named folders, as the author's are not on this machine.
pub(super) fn find(scene_file: &Path, name: &str, report: &mut Report) -> PathBuf {
    let Some(found) = look(scene_file, name, report.is_strict()) else {
        return scene_file.with_file_name(slashes(without_quotes(name)));
    };
    if !found.is_exact {
        let path = found.path.display().to_string();
        // Such names look the same.
        let composed = |text: &str| text.nfc().collect::<String>();
        let looks_same = composed(&path).ends_with(&composed(&slashes(name)));
        let how = if looks_same { ", whose accents are composed in another way" } else { "" };
        report.note(format!("{} is not there: '{path}' is used{how}", quoted(name)));
    }
    found.path
}

/// Whether [`find`] finds a file.
pub(super) fn is_found(scene_file: &Path, name: &str, strict: bool) -> bool {
    look(scene_file, name, strict).is_some()
}

struct Found {
    path: PathBuf,
    /// Whether it is just what the name says.
    is_exact: bool,
}

fn look(scene_file: &Path, name: &str, strict: bool) -> Option<Found> {
    let folder = scene_file.parent()?;
    let mut names = vec![slashes(name), slashes(without_quotes(name))];
    if !strict {
        names.push(slashes_of_two_bytes(name));
    }
    names.dedup();
    // A file that cannot even be looked at counts as absent: the error comes, with its
    // reason, from whoever then reads it.
    let mut exact = names.iter().map(|name| folder.join(name)).filter(|_| !name.is_empty());
    if let Some(path) = exact.find(|path| path.exists()) {
        return Some(Found { path, is_exact: true });
    }
    let alike = |from: PathBuf, parts: &[Component]| {
        parts.iter().try_fold(from, |path, part| step(path, part, strict))
    };
    for name in &names {
        let parts: Vec<_> = Path::new(name).components().collect();
        for skipped in 0..parts.len() {
            let path = alike(folder.to_owned(), &parts[skipped..]);
            if let Some(path) = path.filter(|path| path.is_file()) {
                return Some(Found { path, is_exact: false });
            }
        }
    }
    None
}

/// The entry of a folder that part of a path means.
fn step(mut folder: PathBuf, part: &Component, strict: bool) -> Option<PathBuf> {
    let Component::Normal(wanted) = part else {
        folder.push(part);
        return Some(folder);
    };
    let path = folder.join(wanted);
    if path.exists() {
        return Some(path);
    }
    if strict {
        return None;
    }
    let wanted = wanted.to_str()?;
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { &folder };
    let names = std::fs::read_dir(here).ok()?.filter_map(|entry| Some(entry.ok()?.file_name()));
    let likeness = |name: &OsStr| likeness(name, wanted);
    // Of several, the most alike; of these, always the same.
    let best = names.filter_map(|name| Some((likeness(&name)?, name))).min()?;
    Some(folder.join(best.1))
}

/// How a file's name differs from the one that is wanted, if it is the same to a reader:
/// 0 in composition, 1 in case, 2 in encoding.
fn likeness(name: &OsStr, wanted: &str) -> Option<u32> {
    let Some(name) = name.to_str() else {
        // What was read as Latin-1 are the bytes of the name, if it is in the same encoding.
        let bytes = wanted.chars().map(|c| u8::try_from(c).ok());
        let is_same = bytes.eq(name.as_encoded_bytes().iter().map(|&byte| Some(byte)));
        return is_same.then_some(2);
    };
    if name.nfc().eq(wanted.nfc()) {
        return Some(0);
    }
    let folded = |name: &str| name.nfc().collect::<String>().to_lowercase();
    (folded(name) == folded(wanted)).then_some(1)
}

fn slashes(name: &str) -> String {
    name.replace('\\', "/")
}

/// As [`slashes`], of a name in an encoding that has backslashes as second bytes of
/// characters, and was read as Latin-1.
fn slashes_of_two_bytes(name: &str) -> String {
    let mut before = ' ';
    let part = |c: char| {
        let is_slash = c == '\\' && !('\u{80}'..='\u{ff}').contains(&before);
        before = c;
        if is_slash { '/' } else { c }
    };
    without_quotes(name).chars().map(part).collect()
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
            // The second and third number of -o, -s and -t may be left out: what is no
            // number is then the name.
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

    /// A folder with these files.
    fn folder(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        for name in names {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            std::fs::write(path, "").expect("a file");
        }
        folder
    }

    /// Name, what is found, and the number of notes.
    fn check(folder: &tempfile::TempDir, cases: &[(&str, Option<&str>, usize)], strict: bool) {
        let mtl = folder.path().join("x.mtl");
        for &(name, expected, notes) in cases {
            let mut report = Report::new(strict);
            let found = find(&mtl, name, &mut report);
            assert_eq!(is_found(&mtl, name, strict), expected.is_some(), "{name}");
            if let Some(expected) = expected {
                assert_eq!(found, folder.path().join(expected), "{name}");
            } else {
                assert!(!found.exists(), "{name}: {found:?}");
            }
            assert_eq!(report.notes().len(), notes, "{name}: {:?}", report.notes());
        }
    }

    #[test]
    fn finds_files_of_other_systems() {
        let folder = folder(&["maps/a.png", "b c.png", "d.png"]);
        let cases = [
            ("maps\\a.png", Some("maps/a.png"), 0),
            ("\"b c.png\"", Some("b c.png"), 0),
            ("D:\\me\\b c.png", Some("b c.png"), 1),
            ("/home/me/b c.png", Some("b c.png"), 1),
            ("D:\\me\\maps\\a.png", Some("maps/a.png"), 1),
            ("textures/d.png", Some("d.png"), 1),
            ("gone/a.png", None, 0),
            ("a.png", None, 0),
            ("", None, 0),
        ];
        for strict in [false, true] {
            check(&folder, &cases[..8], strict);
        }
        assert!(!is_found(&folder.path().join("x.mtl"), "", false));
    }

    #[test]
    fn finds_names_of_other_case_and_composition() {
        let names = ["Maps/A.PNG", "fu\u{308}r.png", "\u{e9}.png", "t.png", "u.PNG", "U.png"];
        let folder = folder(&names);
        let cases = [
            ("maps/a.png", Some("Maps/A.PNG"), 1),
            ("D:/MAPS/a.png", Some("Maps/A.PNG"), 1),
            ("f\u{fc}r.png", Some(names[1]), 1),
            ("F\u{dc}R.PNG", Some(names[1]), 1),
            ("e\u{301}.png", Some(names[2]), 1),
            ("T.PNG", Some("t.png"), 1),
            ("t.png", Some("t.png"), 0),
            // One of two, but always the same.
            ("u.png", Some("U.png"), 1),
            ("v.png", None, 0),
        ];
        check(&folder, &cases, false);
        let strict = cases.map(|(name, found, notes)| match notes {
            0 => (name, found, 0),
            _ => (name, None, 0),
        });
        check(&folder, &strict, true);
    }

    #[test]
    fn names_that_look_the_same_are_told_apart() {
        let folder = folder(&["fu\u{308}r.png", "T.png"]);
        let mut report = Report::default();
        for name in ["f\u{fc}r.png", "t.png"] {
            find(&folder.path().join("x.mtl"), name, &mut report);
        }
        let notes = report.notes();
        assert!(notes[0].ends_with("is used, whose accents are composed in another way"));
        assert!(notes[1].ends_with("T.png' is used"), "{notes:?}");
    }

    /// A name in Shift-JIS, on the disk and in the file, which was read as Latin-1.
    #[cfg(target_os = "linux")]
    #[test]
    fn finds_names_of_bytes() {
        use std::os::unix::ffi::OsStrExt;
        let folder = folder(&["x"]);
        let bytes = OsStr::from_bytes(b"\x95\\.png");
        std::fs::write(folder.path().join(bytes), "").expect("a file");
        let found = find(&folder.path().join("x.mtl"), "\u{95}\\.png", &mut Report::default());
        assert_eq!(found, folder.path().join(bytes));
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

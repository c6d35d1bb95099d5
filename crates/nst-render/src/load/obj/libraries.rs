//! The MTL files that an OBJ file names, and the names of their materials.

use std::{
    collections::{HashMap, HashSet},
    io::ErrorKind,
    path::{Path, PathBuf},
};

use super::super::{
    files::{find, is_found},
    report::Report,
    text::{COMMENT, quoted, without_comment, without_quotes},
};
use crate::{Error, Material};

/// Words of a statement that are put together to names with spaces; longer lists have
/// names without spaces alone, as trying all takes the square of their number.
const MOST_WORDS: usize = 32;

/// The MTL files that `mtllib` statements (line and name) mean, each once, in the order of
/// the file.
///
/// # Errors
/// Where one is missing and loading is strict.
pub(super) fn libraries(
    path: &Path,
    statements: &[(usize, String)],
    report: &mut Report,
) -> Result<Vec<PathBuf>, Error> {
    let mut libraries = Vec::new();
    let mut seen = HashSet::new();
    // Some programs repeat the statement for each object.
    for (line, name) in statements.iter().filter(|(_, name)| seen.insert(name)) {
        for name in names(path, *line, name, report)? {
            let library = find(path, name, report);
            let metadata = std::fs::metadata(&library).and_then(|metadata| {
                if metadata.is_dir() { Err(ErrorKind::IsADirectory.into()) } else { Ok(metadata) }
            });
            if let Err(error) = metadata {
                let kind = "MTL files that are not there, left out";
                report.forgive(kind, path, *line, || {
                    format!("mtllib: cannot read '{}': {error}", library.display())
                })?;
            } else if !libraries.contains(&library) {
                libraries.push(library);
            }
        }
    }
    Ok(libraries)
}

/// The names in one statement: one, with spaces and whatever else, if there is such a file;
/// otherwise several that there are; otherwise what is most likely meant.
fn names<'a>(
    path: &Path,
    line: usize,
    stated: &'a str,
    report: &mut Report,
) -> Result<Vec<&'a str>, Error> {
    let is_there = |name: &str| is_found(path, name, report.is_strict());
    if is_there(stated) {
        return Ok(vec![stated]);
    }
    let name = without_comment(stated);
    let names = if is_there(without_quotes(name)) || name.is_empty() {
        vec![without_quotes(name)]
    } else if name.contains('"') {
        name.split('"').map(str::trim_ascii).filter(|name| !name.is_empty()).collect()
    } else {
        split(name, is_there)
    };
    if name.len() < stated.len() {
        report.forgive(COMMENT, path, line, || format!("{} ends in a comment", quoted(stated)))?;
    }
    Ok(names)
}

/// Cuts a list at spaces into names of files that are there. If there is no way to do so,
/// into those that are there and what is between them.
fn split(list: &str, is_there: impl Fn(&str) -> bool) -> Vec<&str> {
    let words: Vec<&str> = list.split_ascii_whitespace().collect();
    let place = |word: &str| word.as_ptr().addr() - list.as_ptr().addr();
    let name =
        |i: usize, j: usize| &list[place(words[i])..place(words[j - 1]) + words[j - 1].len()];
    let count = words.len();
    if count > MOST_WORDS {
        return words;
    }
    let is_file: Vec<Vec<bool>> =
        (0..count).map(|i| (i + 1..=count).map(|j| is_there(name(i, j))).collect()).collect();
    // From each word on: the least number of words that are in no file, and where the name ends.
    let mut best = vec![(0, count); count + 1];
    for i in (0..count).rev() {
        let ends = i + 1..=count;
        let cost = |j: usize| best[j].0 + if is_file[i][j - i - 1] { 0 } else { j - i };
        best[i] = ends
            .map(|j| (cost(j), j))
            .min_by_key(|&(cost, j)| (cost, count - j))
            .unwrap_or_default();
    }
    let mut names = Vec::new();
    let mut i = 0;
    while i < count {
        names.push(name(i, best[i].1));
        i = best[i].1;
    }
    // Where no word is in a file, the whole list is one name, unless its ends tell.
    match names[..] {
        [one] if !is_there(one) && words.iter().all(|word| is_mtl(word)) => words,
        _ => names,
    }
}

fn is_mtl(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mtl"))
}

/// The materials that names mean. Where a name occurs twice, the later material counts.
pub(super) struct Names {
    whole: HashMap<String, u32>,
    plain: HashMap<String, u32>,
}

impl Names {
    pub(super) fn new(materials: &[Material]) -> Self {
        let names = || (0..).zip(materials.iter().map(|material| &material.name));
        Self {
            whole: names().map(|(id, name)| (name.clone(), id)).collect(),
            plain: names().map(|(id, name)| (plain(name).to_owned(), id)).collect(),
        }
    }

    /// The material of a name, and whether it is there under the whole name.
    pub(super) fn get(&self, name: &str) -> Option<(u32, bool)> {
        let whole = self.whole.get(name).map(|&id| (id, true));
        let name = plain(name);
        let alike = || self.whole.get(name).or_else(|| self.plain.get(name));
        // A comment alone is no name that another comment could mean.
        whole.or_else(|| alike().filter(|_| !name.is_empty()).map(|&id| (id, false)))
    }
}

/// A name without comment and quotation marks.
pub(super) fn plain(name: &str) -> &str {
    without_quotes(without_comment(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_cut_into_files() {
        let cases: [(&str, &[&str], &[&str]); 7] = [
            ("a b.mtl c d.mtl", &["a b.mtl", "c d.mtl"], &["a b.mtl", "c d.mtl"]),
            ("a.mtl b.mtl", &["a.mtl", "b.mtl"], &["a.mtl", "b.mtl"]),
            ("a.mtl  b c.mtl", &["b c.mtl"], &["a.mtl", "b c.mtl"]),
            // The longest first name is a trap.
            ("a b c d", &["a", "a b", "b c d"], &["a", "b c d"]),
            ("gone.mtl lost.mtl", &[], &["gone.mtl", "lost.mtl"]),
            ("my lost.mtl", &[], &["my lost.mtl"]),
            ("", &[], &[]),
        ];
        for (list, files, expected) in cases {
            assert_eq!(split(list, |name| files.contains(&name)), expected, "{list}");
        }
        let long = "a ".repeat(10_000);
        assert_eq!(split(&long, |_| panic!("not asked")).len(), 10_000);
    }
}

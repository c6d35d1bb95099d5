//! OBJ and MTL as text: lines, words and numbers, and where they are.

use std::{borrow::Cow, ops::RangeInclusive, path::Path};

use super::report::Report;
use crate::Error;

/// A statement of an OBJ or MTL file, without the line continuations.
pub(super) struct Line<'a> {
    /// Of its first line in the file, from 1.
    pub(super) number: usize,
    text: Cow<'a, str>,
}

impl Line<'_> {
    pub(super) fn keyword(&self) -> &str {
        self.text.split_whitespace().next().unwrap_or_default()
    }

    /// Everything behind the keyword: a name may contain spaces.
    pub(super) fn name(&self) -> &str {
        let text = self.text.trim();
        text[self.keyword().len()..].trim_start()
    }

    /// The words behind the keyword, up to a comment.
    pub(super) fn words(&self) -> impl Iterator<Item = &str> {
        self.text.split_whitespace().skip(1).take_while(|word| !word.starts_with('#'))
    }

    /// The line's error, in the file `path`.
    pub(super) fn error(&self, path: &Path, message: impl AsRef<str>) -> Error {
        error_at(path, self.number, message)
    }
}

pub(super) fn error_at(path: &Path, line: usize, message: impl AsRef<str>) -> Error {
    scene_error(path, &format!("line {line}: {}", message.as_ref()))
}

/// An error of a scene file, however long the words are that it quotes.
pub(super) fn scene_error(path: &Path, message: &str) -> Error {
    const MOST: usize = 1000;
    match message.char_indices().nth(MOST) {
        None => Error::scene(path, message),
        Some((end, _)) => Error::scene(path, format!("{}…", &message[..end])),
    }
}

/// Reads a text file. What is not UTF-8 is taken for Latin-1, as it comes from
/// older programs on Windows, with a note; line ends become `\n`.
///
/// # Errors
/// When the file cannot be read, or has a zero byte, which no text has.
pub(super) fn read(path: &Path, report: &mut Report) -> Result<String, Error> {
    let bytes = report.read(path)?;
    if let Some(zero) = bytes.iter().position(|&byte| byte == 0) {
        let line = bytes[..zero].iter().filter(|&&byte| byte == b'\n').count() + 1;
        return Err(error_at(path, line, "a zero byte: this is no text file"));
    }
    let mut text = String::from_utf8(bytes).unwrap_or_else(|error| {
        report.note(format!("'{}' is not UTF-8: read as Latin-1", path.display()));
        error.into_bytes().into_iter().map(char::from).collect()
    });
    if text.starts_with('\u{feff}') {
        text.remove(0);
    }
    Ok(if text.contains('\r') { text.replace("\r\n", "\n").replace('\r', "\n") } else { text })
}

/// The statements of a text: no empty lines and no comments; a backslash at the
/// end of a line continues it.
pub(super) fn lines(text: &str) -> impl Iterator<Item = Line<'_>> {
    let mut lines = (1..).zip(text.lines());
    std::iter::from_fn(move || {
        let (number, first) = lines
            .find(|(_, line)| !matches!(line.trim_start().chars().next(), None | Some('#')))?;
        let mut text = Cow::Borrowed(first);
        while let Some(begun) = text.trim_end().strip_suffix('\\') {
            let rest = lines.next().map_or("", |(_, line)| line);
            let joined = format!("{begun} {rest}");
            let ended = rest.is_empty();
            text = Cow::Owned(joined);
            if ended {
                break;
            }
        }
        Some(Line { number, text })
    })
}

/// A word as it may be quoted in an error.
pub(super) fn quoted(word: &str) -> String {
    const MOST: usize = 40;
    match word.char_indices().nth(MOST) {
        None => format!("'{word}'"),
        Some((end, _)) => format!("'{}…'", &word[..end]),
    }
}

/// A finite number; `what` names it in the error.
pub(super) fn number(what: &str, word: &str) -> Result<f32, String> {
    match word.parse::<f32>() {
        Ok(number) if number.is_finite() => Ok(number),
        Ok(_) if word.contains(|c: char| c.is_ascii_digit()) => {
            Err(format!("{what} {} is not finite: beyond 3.4e38", quoted(word)))
        }
        Ok(_) => Err(format!("{what} {} is not finite", quoted(word))),
        Err(_) => Err(format!("{what} {} is not a number", quoted(word))),
    }
}

/// A number within a range.
pub(super) fn number_within(
    what: &str,
    word: &str,
    range: &RangeInclusive<f32>,
) -> Result<f32, String> {
    let number = number(what, word)?;
    let (least, most) = (range.start(), range.end());
    if range.contains(&number) {
        Ok(number)
    } else if *most == f32::MAX {
        Err(format!("{what} {} is less than {least}", quoted(word)))
    } else {
        Err(format!("{what} {} is not within {least} and {most:?}", quoted(word)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn statements(text: &str) -> Vec<(usize, String, String)> {
        lines(text)
            .map(|line| (line.number, line.keyword().to_owned(), line.name().to_owned()))
            .collect()
    }

    #[test]
    fn lines_keep_their_numbers_and_names_their_spaces() {
        let text = "# a comment\\\n\n \tusemtl\ta wall \nf 1 2 \\\n 3 \\\n4\n  # x\nf 5 6 7 # seven\nv 1\\";
        let expected = [
            (3, "usemtl", "a wall"),
            (4, "f", "1 2   3  4"),
            (8, "f", "5 6 7 # seven"),
            (9, "v", "1"),
        ];
        let expected = expected.map(|(n, keyword, name)| (n, keyword.to_owned(), name.to_owned()));
        assert_eq!(statements(text), expected);
        let words = lines("f 5 6 7 # seven").next().map(|line| line.words().count());
        assert_eq!(words, Some(3));
    }

    #[test]
    fn reads_what_editors_write() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.obj");
        let text = |bytes: &[u8]| {
            std::fs::write(&path, bytes).expect("a file");
            let mut report = Report::default();
            read(&path, &mut report).map(|text| (text, report.notes().len()))
        };
        let plain = text(b"\xef\xbb\xbfv 1\r\nv 2\rv 3\n").expect("text");
        assert_eq!(plain, ("v 1\nv 2\nv 3\n".to_owned(), 0));
        let latin = text(b"usemtl caf\xe9\n").expect("Latin-1");
        assert_eq!(latin, ("usemtl café\n".to_owned(), 1));
        let error = text(b"v 1\nv\x00").expect_err("a zero byte").to_string();
        assert!(error.contains("x.obj") && error.contains("line 2"), "{error}");
    }

    #[test]
    fn numbers_say_what_is_wrong_with_them() {
        let message = |word: &str| number("vertex", word).expect_err("no number");
        assert_eq!(number("vertex", "-1.5e-3"), Ok(-1.5e-3));
        assert!(message("1,5").contains("'1,5' is not a number"));
        assert!(message("nan").contains("not finite"));
        assert!(message("1e39").contains("3.4e38"));
        let long = error_at(Path::new("x.obj"), 3, "é".repeat(10_000)).to_string();
        assert!(long.contains("line 3") && long.chars().count() < 1100);
        assert!(message(&"9x".repeat(10_000)).len() < 100);
        assert!(number_within("d", "2", &(0.0..=1.0)).is_err());
        assert!(number_within("Ns", "-2", &(0.0..=f32::MAX)).is_err());
    }
}

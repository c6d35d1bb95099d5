//! OBJ and MTL as text: lines, words and numbers, and where they are.

use std::{
    borrow::Cow,
    ops::{Deref, RangeInclusive},
    path::Path,
};

pub(super) use super::place::{error_at, scene_error};
use super::report::Report;
use crate::Error;

/// What ends a text file of DOS; behind it is what the disk contained before.
const CTRL_Z: u8 = 0x1a;

/// The text of a file, with `\n` as line ends.
pub(super) struct Text {
    text: String,
    /// Whether its characters are known. Otherwise each is a byte: of Latin-1, or of an
    /// encoding such as Shift-JIS, GBK or Big5, whose characters have two.
    is_unicode: bool,
}

impl Deref for Text {
    type Target = str;

    fn deref(&self) -> &str {
        &self.text
    }
}

/// A statement of an OBJ or MTL file, without the line continuations.
pub(super) struct Line<'a> {
    /// Of its first line in the file, from 1.
    pub(super) number: usize,
    text: Cow<'a, str>,
    is_unicode: bool,
}

impl Line<'_> {
    /// The whole statement, where numbers are to be read from it: all its white space is
    /// ASCII's.
    pub(super) fn plain(&self) -> Cow<'_, str> {
        let is_space = |c: char| !c.is_ascii() && self.is_space(c);
        if self.text.is_ascii() || !self.text.contains(is_space) {
            return Cow::Borrowed(&self.text);
        }
        Cow::Owned(self.text.replace(is_space, " "))
    }

    pub(super) fn keyword(&self) -> &str {
        let text = self.text.trim_start_matches(|c| self.is_space(c));
        text.split(|c| self.is_space(c)).next().unwrap_or_default()
    }

    /// Everything behind the keyword: a name may contain spaces.
    pub(super) fn name(&self) -> &str {
        let text = self.text.trim_matches(|c| self.is_space(c));
        text[self.keyword().len()..].trim_start_matches(|c| self.is_space(c))
    }

    /// The words behind the keyword, up to a comment.
    pub(super) fn words(&self) -> impl Iterator<Item = &str> {
        let words = self.text.split(|c| self.is_space(c)).filter(|word| !word.is_empty());
        words.skip(1).take_while(|word| !word.starts_with('#'))
    }

    /// Some bytes of other encodings would be white space of Latin-1.
    fn is_space(&self, c: char) -> bool {
        if self.is_unicode { c.is_whitespace() } else { c.is_ascii() && c.is_whitespace() }
    }

    /// The line's error, in the file `path`.
    pub(super) fn error(&self, path: &Path, message: impl AsRef<str>) -> Error {
        error_at(path, self.number, message)
    }
}

/// The kind of fault of names with comments behind them.
pub(super) const COMMENT: &str = "comments behind names, left out";

/// A name without the comment behind it: `a b` of `a b # c`. As a name may itself contain
/// ` #`, the whole name is to be tried first, where there is something to compare it with.
pub(super) fn without_comment(name: &str) -> &str {
    let is_comment = |&(at, _): &(usize, &str)| {
        name[..at].ends_with(|c: char| c.is_ascii_whitespace()) || at == 0
    };
    match name.match_indices('#').find(is_comment) {
        Some((at, _)) => name[..at].trim_ascii_end(),
        None => name,
    }
}

/// A name without the quotation marks around it.
pub(super) fn without_quotes(name: &str) -> &str {
    let within = |mark| name.strip_prefix(mark).and_then(|name| name.strip_suffix(mark));
    within('"').or_else(|| within('\'')).unwrap_or(name).trim_ascii()
}

/// Reads a text file, as [`decode`].
///
/// # Errors
/// When the file cannot be read, or is no text.
pub(super) fn read(path: &Path, report: &mut Report) -> Result<Text, Error> {
    let bytes = report.read(path)?;
    decode(path, bytes, report)
}

/// The text of a file. What is not UTF-8 is taken for Latin-1, as it comes from older
/// programs on Windows, or UTF-16, with a note; line ends become `\n`.
///
/// # Errors
/// When there is a zero byte, which no text has; for strict reports, when there is padding.
pub(super) fn decode(path: &Path, bytes: Vec<u8>, report: &mut Report) -> Result<Text, Error> {
    let mut bytes = bytes;
    let mut is_unicode = true;
    let mut text = if let Some(text) = utf16(&bytes) {
        report.note(format!("'{}' is UTF-16", path.display()));
        text
    } else {
        cut_padding(path, &mut bytes, report)?;
        String::from_utf8(bytes).unwrap_or_else(|error| {
            report.note(format!("'{}' is not UTF-8: read as Latin-1", path.display()));
            is_unicode = false;
            error.into_bytes().into_iter().map(char::from).collect()
        })
    };
    if text.as_bytes().contains(&0) {
        let before = text.bytes().take_while(|&byte| byte != 0);
        let line = before.filter(|&byte| byte == b'\n').count() + 1;
        return Err(error_at(path, line, "a zero byte: this is no text file"));
    }
    if text.starts_with('\u{feff}') {
        text.remove(0);
    }
    if text.contains('\r') {
        text = text.replace("\r\n", "\n").replace('\r', "\n");
    }
    Ok(Text { text, is_unicode })
}

/// Text of two bytes per character: with a byte order mark, or with zeros beside the
/// first two characters, which no other text has.
fn utf16(bytes: &[u8]) -> Option<String> {
    let little = match *bytes {
        [0xff, 0xfe, ..] => true,
        [0xfe, 0xff, ..] => false,
        [1..0x80, 0, 1..0x80, 0, ..] => true,
        [0, 1..0x80, 0, 1..0x80, ..] => false,
        _ => return None,
    };
    let unit = |pair: &[u8; 2]| {
        if little { u16::from_le_bytes(*pair) } else { u16::from_be_bytes(*pair) }
    };
    let (pairs, _) = bytes.as_chunks();
    let text = char::decode_utf16(pairs.iter().map(unit));
    let mut text: String = text.map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect();
    text.truncate(text.trim_end_matches(['\0', char::from(CTRL_Z)]).len());
    Some(text)
}

/// Drops zeros and Ctrl-Z at the end, and what is behind a line that begins with Ctrl-Z.
fn cut_padding(path: &Path, bytes: &mut Vec<u8>, report: &mut Report) -> Result<(), Error> {
    let is_padding = |&byte: &u8| byte == 0 || byte == CTRL_Z;
    let is_text = |byte: &u8| !is_padding(byte) && !byte.is_ascii_whitespace();
    let text_end = bytes.iter().rposition(is_text).map_or(0, |last| last + 1);
    let padding = bytes[text_end..].iter().position(is_padding);
    let mut end = padding.map_or(bytes.len(), |padding| text_end + padding);
    if bytes[..text_end].contains(&CTRL_Z) {
        let begins = |pair: &[u8]| pair[1] == CTRL_Z && matches!(pair[0], b'\n' | b'\r');
        end = bytes.windows(2).position(begins).map_or(end, |before| before + 1);
    }
    if text_end > 0 && end < bytes.len() {
        let line = bytes[..end].iter().filter(|&&byte| byte == b'\n').count() + 1;
        report.forgive("what is behind the end of the text, left out", path, line, || {
            format!("{} bytes at the end are no text", bytes.len() - end)
        })?;
        bytes.truncate(end);
    }
    Ok(())
}

/// The statements of a text: no empty lines and no comments; a backslash at the
/// end of a line continues it.
pub(super) fn lines(text: &Text) -> impl Iterator<Item = Line<'_>> {
    let is_unicode = text.is_unicode;
    let mut lines = (1..).zip(text.lines());
    let is_statement = move |line: &str| {
        let line = line.trim_ascii_start();
        let line = if line.is_ascii() || !is_unicode { line } else { line.trim_start() };
        !line.is_empty() && !line.starts_with('#')
    };
    std::iter::from_fn(move || {
        let (number, first) = lines.find(|&(_, line)| is_statement(line))?;
        let mut text = Cow::Borrowed(first);
        while let Some(begun) = continued(&text, is_unicode) {
            let length = begun.len();
            let Some((_, rest)) = lines.next() else {
                text.to_mut().truncate(length);
                break;
            };
            let joined = text.to_mut();
            joined.truncate(length);
            joined.push(' ');
            joined.push_str(rest);
            if rest.is_empty() {
                break;
            }
        }
        Some(Line { number, text, is_unicode })
    })
}

/// What is before the backslash that continues a line. Behind a byte that is not ASCII, it
/// is no backslash, but the second byte of a character.
fn continued(line: &str, is_unicode: bool) -> Option<&str> {
    let begun = line.trim_ascii_end().strip_suffix('\\')?;
    (is_unicode || begun.is_empty() || begun.ends_with(|c: char| c.is_ascii())).then_some(begun)
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

    fn text(text: &str) -> Text {
        Text { text: text.to_owned(), is_unicode: true }
    }

    fn statements(text: &Text) -> Vec<(usize, String, String)> {
        lines(text)
            .map(|line| (line.number, line.keyword().to_owned(), line.name().to_owned()))
            .collect()
    }

    #[test]
    fn lines_keep_their_numbers_and_names_their_spaces() {
        let all = "# a comment\\\n\n \tusemtl\ta wall \nf 1 2 \\\n 3 \\\n4\n  # x\nf 5 6 7 # seven\n\
                   f 1\\\\\n\nv 1\\";
        let expected = [
            (3, "usemtl", "a wall"),
            (4, "f", "1 2   3  4"),
            (8, "f", "5 6 7 # seven"),
            (9, "f", "1\\"),
            (11, "v", "1"),
        ];
        let expected = expected.map(|(n, keyword, name)| (n, keyword.to_owned(), name.to_owned()));
        assert_eq!(statements(&text(all)), expected);
        let words = lines(&text("f 5 6 7 # seven")).next().map(|line| line.words().count());
        assert_eq!(words, Some(3));
        // A hundred thousand continuations take no time that grows with their square.
        let long = text(&format!("f{}", " 1 \\\n".repeat(100_000)));
        assert_eq!(lines(&long).map(|line| line.words().count()).collect::<Vec<_>>(), [100_000]);
    }

    /// White space that is not ASCII separates words of Unicode, but is part of others.
    #[test]
    fn white_space_of_any_kind() {
        let all = text("\u{a0}v\u{3000}1\u{a0}2 3\u{2003}\n");
        let line = lines(&all).next().expect("a line");
        assert_eq!((line.keyword(), line.name()), ("v", "1\u{a0}2 3"));
        assert_eq!(line.words().collect::<Vec<_>>(), ["1", "2", "3"]);
        assert_eq!(line.plain(), " v 1 2 3 ");
        let bytes = Text { text: "usemtl \u{8a}\u{a0} \u{85}".to_owned(), is_unicode: false };
        let line = lines(&bytes).next().expect("a line");
        assert_eq!(line.name(), "\u{8a}\u{a0} \u{85}");
    }

    #[test]
    fn names_lose_comments_and_quotes() {
        for (name, expected) in
            [("a b # c", "a b"), ("a#b", "a#b"), ("a#b\t#c # d", "a#b"), ("# a", ""), ("a", "a")]
        {
            assert_eq!(without_comment(name), expected, "{name}");
        }
        for (name, expected) in [("\"a b\"", "a b"), ("'a'", "a"), ("\"a", "\"a"), ("\"", "\"")] {
            assert_eq!(without_quotes(name), expected, "{name}");
        }
    }

    /// The text, and the number of notes.
    fn decoded(bytes: &[u8], strict: bool) -> Result<(String, usize), String> {
        let mut report = Report::new(strict);
        let text = decode(Path::new("x.obj"), bytes.to_vec(), &mut report);
        text.map(|text| (text.text, report.notes().len())).map_err(|error| error.to_string())
    }

    #[test]
    fn reads_what_editors_write() {
        let text = |bytes: &[u8]| decoded(bytes, true).expect("text");
        assert_eq!(text(b"\xef\xbb\xbfv 1\r\nv 2\rv 3\n"), ("v 1\nv 2\nv 3\n".to_owned(), 0));
        assert_eq!(text(b"usemtl caf\xe9\n"), ("usemtl café\n".to_owned(), 1));
        let error = decoded(b"v 1\nv\x00 2\n", false).expect_err("a zero byte");
        assert!(error.contains("x.obj") && error.contains("line 2"), "{error}");
        let expected = ("# é\nv 1\n".to_owned(), 1);
        let units: Vec<u16> = "# é\r\nv 1\n".encode_utf16().collect();
        for mark in [false, true] {
            let units = || mark.then_some(0xfeff).into_iter().chain(units.iter().copied());
            let little: Vec<u8> = units().flat_map(u16::to_le_bytes).collect();
            let big: Vec<u8> = units().flat_map(u16::to_be_bytes).collect();
            assert_eq!((text(&little), text(&big)), (expected.clone(), expected.clone()));
        }
    }

    #[test]
    fn padding_behind_the_text_is_forgiven() {
        let padded: [&[u8]; 5] = [
            b"v 1\n\0\0\0\0",
            b"v 1\n\x1a",
            b"v 1\n\x1a\r\n\x1a\0",
            b"v 1\n\x1av 2\n\0 garbage",
            b"v 1\n\0\n\0",
        ];
        for bytes in padded {
            assert_eq!(decoded(bytes, false), Ok(("v 1\n".to_owned(), 1)), "{bytes:?}");
            let error = decoded(bytes, true).expect_err("it is strict");
            assert!(error.contains("line 2: ") && error.contains("are no text"), "{error}");
        }
        for bytes in [&b"v 1\n\n"[..], b"v \x1a1\n"] {
            assert_eq!(decoded(bytes, true).expect("text").1, 0, "{bytes:?}");
        }
        for bytes in [&b"\0\0\0"[..], b"v 1\n\0v 2\n"] {
            assert!(decoded(bytes, false).is_err(), "{bytes:?}");
        }
    }

    /// 0x5c is the second byte of a character in Shift-JIS, GBK and Big5.
    #[test]
    fn second_bytes_continue_no_line() {
        let mut report = Report::default();
        let statements = |bytes: &[u8], report: &mut Report| -> Vec<usize> {
            let text = decode(Path::new("x.obj"), bytes.to_vec(), report).expect("text");
            lines(&text).map(|line| line.number).collect()
        };
        for name in [b"\x95\\", b"\xbf\\", b"\xa5\\"] {
            let bytes = [b"usemtl ", &name[..], b"\nf 1 2 3 \\\n4\nf 1 2 3\n"].concat();
            assert_eq!(statements(&bytes, &mut report), [1, 2, 4]);
        }
        assert_eq!(statements("usemtl é\\\nb\nf 1 2 3\n".as_bytes(), &mut report), [1, 3]);
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

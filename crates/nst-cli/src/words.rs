//! Numbers, lists and times as people write them.

use std::{borrow::Cow, time::Duration};

/// The most numbers or names that a line of text lists, so that it fits a screen.
const MOST_LISTED: usize = 12;

/// The most columns of a label at the beginning of a line, with the spaces behind it.
const LABEL: usize = 13;

/// A number and what it counts, `noun` being the singular: "1 run", "2 runs".
pub(crate) fn counted(number: usize, noun: &str) -> String {
    let plural = if number == 1 { "" } else { "s" };
    format!("{number} {noun}{plural}")
}

/// Numbers as text, like the names of [`list`].
pub(crate) fn numbers(numbers: &[u32]) -> String {
    list(&numbers.iter().map(u32::to_string).collect::<Vec<_>>(), "none")
}

/// Names as text; the middle of a long list is left out, and `none` is the text of an empty
/// one.
pub(crate) fn list(names: &[impl AsRef<str>], none: &str) -> String {
    let names: Vec<_> = names.iter().map(AsRef::as_ref).collect();
    match names.len() {
        0 => none.to_owned(),
        1..=MOST_LISTED => names.join(", "),
        count => {
            let (start, end) = (&names[..MOST_LISTED / 2], &names[count - MOST_LISTED / 2..]);
            format!("{}, …, {} ({count})", start.join(", "), end.join(", "))
        }
    }
}

/// A text of a file for a terminal: what would move its cursor or change its colours is escaped.
pub(crate) fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, |c| c.is_control() && c != '\n')
}

/// The same on one line.
pub(crate) fn on_one_line(text: &str) -> Cow<'_, str> {
    escaped(text, char::is_control)
}

fn escaped(text: &str, escapes: fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(escapes) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if escapes(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
    Cow::Owned(out)
}

/// A time in one or two units, rounded up: "9 s", "4 min 20 s", "3 h 5 min".
pub(crate) fn duration(time: Duration) -> String {
    let seconds = time.as_secs_f64().ceil() as u64;
    let [minutes, hours] = [seconds.div_ceil(60), seconds.div_ceil(3600)];
    match seconds {
        0..60 => format!("{seconds} s"),
        60..600 => format!("{} min {} s", seconds / 60, seconds % 60),
        600..3600 => format!("{minutes} min"),
        3600..36_000 => format!("{} h {} min", minutes / 60, minutes % 60),
        _ => format!("{hours} h"),
    }
}

/// A text for a terminal of so many columns: lines that begin with a label, or are indented
/// as those that continue one, are broken between words; others are left as they are.
pub(crate) fn wrapped(text: &str, columns: usize) -> String {
    text.split_inclusive('\n').map(|line| wrapped_line(line, columns)).collect()
}

fn wrapped_line(line: &str, columns: usize) -> Cow<'_, str> {
    let label = line.find("  ").unwrap_or(line.len());
    let indent = label + line[label..].chars().take_while(|&c| c == ' ').count();
    // A narrower terminal than this breaks the words themselves.
    let fits = line.trim_end().chars().count() <= columns || columns < 2 * LABEL;
    if fits || indent == label || indent > LABEL {
        return line.into();
    }
    let (mut text, mut at) = (line[..indent].to_owned(), indent);
    for (i, word) in line[indent..].split_whitespace().enumerate() {
        let length = word.chars().count();
        if i > 0 && at + 1 + length > columns {
            text += &format!("\n{:indent$}", "");
            at = indent;
        } else if i > 0 {
            text.push(' ');
            at += 1;
        }
        text += word;
        at += length;
    }
    text.push('\n');
    text.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_one_or_two_units() {
        let said = |seconds: f64| duration(Duration::from_secs_f64(seconds));
        assert_eq!([said(0.0), said(0.2), said(59.0)], ["0 s", "1 s", "59 s"]);
        assert_eq!(
            [said(59.5), said(260.0), said(599.0)],
            ["1 min 0 s", "4 min 20 s", "9 min 59 s"]
        );
        assert_eq!([said(601.0), said(3599.0)], ["11 min", "60 min"]);
        assert_eq!([said(3600.0), said(11_101.0), said(1e6)], ["1 h 0 min", "3 h 6 min", "278 h"]);
    }

    #[test]
    fn lines_with_a_label_are_broken() {
        let wrapped = |text| wrapped(text, 30);
        let long = "transform  none (no network was trained on this scene)\ntotal      1 s\n";
        let broken = "transform  none (no network\n           was trained on this\n           scene)\n\
                      total      1 s\n";
        assert_eq!(wrapped(long), broken);
        let word = "wrote      /a/path/that/is/longer/than/the/terminal.exr\n";
        assert_eq!(wrapped(word), word);
        let others = "a line without a label is not broken at all\nerror\n";
        assert_eq!(wrapped(others), others);
    }

    #[test]
    fn control_characters_are_shown() {
        let text = "a title\x1b[2J\x07, two\nlines\u{9b}1m, and Ω";
        assert_eq!(printable(text), "a title\\u{1b}[2J\\u{7}, two\nlines\\u{9b}1m, and Ω");
        assert_eq!(on_one_line("two\r\nlines"), "two\\r\\nlines");
        assert!(matches!(printable("usual\ntext"), Cow::Borrowed(_)));
    }

    #[test]
    fn one_is_singular() {
        assert_eq!([counted(1, "run"), counted(0, "run")], ["1 run", "0 runs"]);
    }
}

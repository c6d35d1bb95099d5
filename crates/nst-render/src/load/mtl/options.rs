//! The options and the file of a statement such as `map_Kd -s 2 2 1 wood.png`.

use std::path::Path;

use glam::Vec2;

use super::super::{
    files::is_found,
    maps::{Channel, Values},
};

/// What options say, and what of them is left out.
#[derive(Debug, PartialEq)]
pub(super) struct Options {
    pub(super) scale: Vec2,
    pub(super) offset: Vec2,
    pub(super) clamp: bool,
    pub(super) values: Values,
    /// Of bump maps.
    pub(super) multiplier: f32,
    /// Known ones without effect here.
    pub(super) unused: Vec<String>,
    /// What is wrong with the others.
    pub(super) faults: Vec<String>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            scale: Vec2::ONE,
            offset: Vec2::ZERO,
            clamp: false,
            values: Values::default(),
            multiplier: 1.0,
            unused: vec![],
            faults: vec![],
        }
    }
}

/// The largest number of an option: with texture coordinates of any size, products are finite.
const MOST: f32 = 1e6;

/// The options, and the name of the file, which may contain spaces. Options may also be behind it.
pub(super) fn parse<'a>(mtl: &Path, text: &'a str) -> (Options, &'a str) {
    let mut options = Options::default();
    let mut rest = text.trim();
    while rest.starts_with('-') && !is_found(mtl, rest, false) {
        let Some(behind) = options.read(mtl, rest) else { break };
        rest = behind;
    }
    if !is_found(mtl, rest, false)
        && let Some(start) = trailing(rest)
    {
        let mut more = rest[start..].trim_start();
        rest = rest[..start].trim_end();
        while let Some(behind) = options.read(mtl, more) {
            more = behind;
        }
    }
    (options, rest.trim_matches('"').trim())
}

/// Where known options begin behind a name.
fn trailing(text: &str) -> Option<usize> {
    text.match_indices(" -").map(|(at, _)| at).find(|&at| {
        let option = first_word(text[at..].trim_start());
        at > 0 && arguments(option).is_some()
    })
}

/// The least and the greatest number of a known option's arguments.
fn arguments(option: &str) -> Option<usize> {
    Some(match option.to_ascii_lowercase().as_str() {
        "-blendu" | "-blendv" | "-bm" | "-boost" | "-cc" | "-clamp" | "-colorspace"
        | "-imfchan" | "-texres" | "-type" => 1,
        "-mm" => 2,
        "-o" | "-s" | "-t" => 3,
        _ => return None,
    })
}

fn first_word(text: &str) -> &str {
    text.split_whitespace().next().unwrap_or_default()
}

/// The first word, and what follows it.
fn split(text: &str) -> (&str, &str) {
    let word = first_word(text);
    (word, text[word.len()..].trim_start())
}

impl Options {
    /// Reads the option that the text begins with, and returns what is behind it; `None` if
    /// it begins with none.
    fn read<'a>(&mut self, mtl: &Path, text: &'a str) -> Option<&'a str> {
        let (option, mut rest) = split(text);
        let Some(most) = arguments(option) else { return self.unknown(mtl, text) };
        let key = option.to_ascii_lowercase();
        if matches!(key.as_str(), "-mm" | "-o" | "-s" | "-t" | "-bm" | "-boost") {
            let mut numbers = Vec::new();
            while numbers.len() < most
                && let (word, behind) = split(rest)
                && let Ok(number) = word.parse::<f32>()
            {
                numbers.push(number);
                rest = behind;
            }
            self.apply_numbers(&key, &numbers);
        } else {
            let (word, behind) = split(rest);
            // Without its word, the option stands before the name of the file.
            if behind.is_empty() && is_found(mtl, rest, false) {
                self.faults.push(format!("{option} without a word"));
            } else {
                self.apply_word(&key, word);
                rest = behind;
            }
        }
        Some(rest)
    }

    /// An option of some other program: the numbers behind it belong to it, and else a word, if
    /// the name is then still to come.
    fn unknown<'a>(&mut self, mtl: &Path, text: &'a str) -> Option<&'a str> {
        let (option, mut rest) = split(text);
        let is_word = option.len() > 1 && option[1..].starts_with(|c: char| c.is_alphabetic());
        if !is_word || rest.is_empty() {
            return None;
        }
        self.faults.push(format!("there is no option {option}"));
        if is_found(mtl, rest, false) {
            return Some(rest);
        }
        let (word, mut behind) = split(rest);
        if word.parse::<f32>().is_err() {
            let is_value = !behind.is_empty() && !word.starts_with('-');
            return Some(if is_value { behind } else { rest });
        }
        while !behind.is_empty() {
            rest = behind;
            let word;
            (word, behind) = split(rest);
            if word.parse::<f32>().is_err() {
                break;
            }
        }
        Some(rest)
    }

    fn apply_numbers(&mut self, key: &str, numbers: &[f32]) {
        let least = if key == "-mm" { 2 } else { 1 };
        if numbers.len() < least || !numbers.iter().all(|x| x.abs() <= MOST) {
            return self.faults.push(format!("{key} needs numbers of at most {MOST:e}"));
        }
        let pair = |default| Vec2::new(numbers[0], *numbers.get(1).unwrap_or(&default));
        match key {
            "-s" => self.scale = pair(1.0),
            "-o" => self.offset = pair(0.0),
            "-bm" => self.multiplier = numbers[0],
            "-mm" => (self.values.base, self.values.gain) = (numbers[0], numbers[1]),
            _ => self.unused.push(key.to_owned()),
        }
    }

    fn apply_word(&mut self, key: &str, word: &str) {
        let lower = word.to_ascii_lowercase();
        match (key, lower.as_str()) {
            ("-clamp", "on") => self.clamp = true,
            ("-clamp", "off") => self.clamp = false,
            ("-imfchan", channel) => match channel {
                "r" => self.values.channel = Some(Channel::Red),
                "g" => self.values.channel = Some(Channel::Green),
                "b" => self.values.channel = Some(Channel::Blue),
                "m" => self.values.channel = Some(Channel::Alpha),
                "l" => self.values.channel = Some(Channel::Luminance),
                _ => self.faults.push(format!("-imfchan {word} is none of r, g, b, m, l")),
            },
            ("-colorspace", name) => match is_linear(name) {
                Some(linear) => self.values.linear = linear,
                None => self.faults.push(format!("-colorspace {word} is unknown")),
            },
            // How a texture is filtered and stored makes no difference here; and off is off.
            ("-blendu" | "-blendv" | "-cc" | "-texres" | "-type", _) => {}
            _ => self.faults.push(format!("{key} {word} is neither on nor off")),
        }
    }
}

/// Whether a colour space, by its name in lower case, is linear; `None` if nobody knows.
fn is_linear(name: &str) -> Option<bool> {
    let linear = ["linear", "lin", "raw", "non-color", "noncolor", "non-colour", "none", "data"];
    if linear.contains(&name) || name.starts_with("lin_") || name.starts_with("linear") {
        return Some(true);
    }
    name.contains("srgb").then_some(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> (Options, &str) {
        parse(Path::new("/nowhere/x.mtl"), text)
    }

    #[test]
    fn options_are_told_from_names() {
        let plain = ["", "-cc on ", "-texres 512 -type sphere ", "-blendu off -blendv on "];
        for option in plain {
            let text = format!("{option}a b.png");
            let (options, name) = parsed(&text);
            assert_eq!((options, name), (Options::default(), "a b.png"), "{option}");
        }
        for numbers in ["-s 2", "-s 2 1", "-s 2 1 1"] {
            let text = format!("{numbers} woods.png");
            let (options, name) = parsed(&text);
            assert_eq!((options.scale, name), (Vec2::new(2.0, 1.0), "woods.png"));
        }
        let (options, name) =
            parsed("-o .5 -clamp on -mm .1 .2 -bm 3 -imfchan r -colorspace Non-Color \"a b.png\"");
        let values = Values { linear: true, channel: Some(Channel::Red), base: 0.1, gain: 0.2 };
        let expected = Options {
            offset: Vec2::new(0.5, 0.0),
            clamp: true,
            multiplier: 3.0,
            values,
            ..Default::default()
        };
        assert_eq!((options, name), (expected, "a b.png"));
        let (options, name) = parsed("a b.png -bm 0.3 -clamp on");
        assert_eq!((options.multiplier, options.clamp, name), (0.3, true, "a b.png"));
        assert_eq!(parsed("a -b.png"), (Options::default(), "a -b.png"));
        for nothing in ["", "-s", "-s 1 1 1", "-mm 0 1"] {
            assert_eq!(parsed(nothing).1, "", "{nothing}");
        }
    }

    #[test]
    fn unknown_options_are_faults() {
        for option in [
            "-new 1 2",
            "-new word",
            "-imfchan q",
            "-colorspace huh",
            "-s nan",
            "-mm 1",
            "-s 1e30",
            "-clamp perhaps",
        ] {
            let text = format!("{option} a.png");
            let (options, name) = parsed(&text);
            assert_eq!((options.faults.len(), name), (1, "a.png"), "{option}: {options:?}");
            assert_eq!((options.scale, options.values), (Vec2::ONE, Values::default()));
        }
        assert_eq!(parsed("-new a.png").1, "a.png");
        assert_eq!(parsed("-new").1, "-new");
        assert_eq!(parsed("-t 1 1 1 a.png").0.unused, ["-t"]);
    }
}

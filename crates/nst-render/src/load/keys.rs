//! The keys of a TOML file: where they are, and which are misspelt.

use std::ops::Range;

use toml::de::{DeTable, DeValue};

/// The text of a TOML file with the places of its keys and values.
pub(super) struct Document<'a> {
    text: &'a str,
    root: DeTable<'a>,
}

/// A table's keys; those of `materials` are names, each with a table of its own.
pub(super) struct Table {
    pub(super) name: &'static str,
    pub(super) keys: &'static [&'static str],
    pub(super) of_tables: bool,
}

impl<'a> Document<'a> {
    /// # Errors
    /// What TOML does not allow; the message quotes the line.
    pub(super) fn parse(text: &'a str) -> Result<Self, String> {
        let root = DeTable::parse(text).map_err(|error| format!("\n{error}"))?;
        Ok(Self { text, root: root.into_inner() })
    }

    /// `line N: message`, for the innermost of nested keys that is there.
    pub(super) fn error(&self, keys: &[&str], message: &str) -> String {
        let mut table = &self.root;
        let mut place = None;
        for &key in keys {
            let Some((found, value)) = table.get_key_value(key) else { break };
            place = Some(found.span());
            let DeValue::Table(inner) = value.get_ref() else { break };
            table = inner;
        }
        place.map_or(message.to_owned(), |place| self.error_at(place, message))
    }

    fn error_at(&self, place: Range<usize>, message: &str) -> String {
        let line = self.text.bytes().take(place.start).filter(|&byte| byte == b'\n').count() + 1;
        format!("line {line}: {message}")
    }

    /// Refuses keys that are not in `tables`.
    pub(super) fn check(&self, tables: &[Table]) -> Result<(), String> {
        let names: Vec<_> = tables.iter().map(|table| table.name).collect();
        for (key, value) in &self.root {
            let Some(known) = tables.iter().find(|table| table.name == key.get_ref()) else {
                return Err(self.unknown(key.span(), "table", key.get_ref(), "", &names));
            };
            let DeValue::Table(table) = value.get_ref() else {
                let message = format!("'{}' is no table; write [{}]", known.name, known.name);
                return Err(self.error_at(key.span(), &message));
            };
            if !known.of_tables {
                self.check_keys(table, known.name, known.keys)?;
                continue;
            }
            for (name, value) in table {
                let place = format!("{}.{}", known.name, name.get_ref());
                let DeValue::Table(inner) = value.get_ref() else {
                    let message = format!("'{place}' is no table; write [{}.NAME]", known.name);
                    return Err(self.error_at(name.span(), &message));
                };
                self.check_keys(inner, &place, known.keys)?;
            }
        }
        Ok(())
    }

    fn check_keys(&self, table: &DeTable, place: &str, known: &[&str]) -> Result<(), String> {
        match table.keys().find(|key| !known.contains(&key.get_ref().as_ref())) {
            Some(key) => {
                let place = format!(" in [{place}]");
                Err(self.unknown(key.span(), "key", key.get_ref(), &place, known))
            }
            None => Ok(()),
        }
    }

    fn unknown(
        &self,
        place: Range<usize>,
        what: &str,
        key: &str,
        within: &str,
        known: &[&str],
    ) -> String {
        let message = format!("unknown {what} '{key}'{within}; {}", suggestion(key, known));
        self.error_at(place, &message)
    }
}

/// How many names a person reads.
const MOST_LISTED: usize = 16;

/// Names the nearest of `known`, or all if none is near and they are few.
pub(super) fn suggestion(name: &str, known: &[&str]) -> String {
    // The comparison takes time and memory by the product of the lengths.
    let start = |name: &str| name.chars().take(100).collect::<String>().to_lowercase();
    let likeness =
        |other: &&&str| strsim::normalized_damerau_levenshtein(&start(name), &start(other));
    match known.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b))) {
        None => "there are none".to_owned(),
        Some(nearest) if likeness(&nearest) >= 0.5 || known.len() > MOST_LISTED => {
            format!("did you mean '{nearest}'?")
        }
        Some(_) => format!("there are {}", known.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLES: [Table; 2] = [
        Table { name: "camera", keys: &["position", "vertical_fov"], of_tables: false },
        Table { name: "materials", keys: &["color"], of_tables: true },
    ];

    #[test]
    fn unknown_keys_are_refused_with_their_line_and_the_nearest() {
        let cases = [
            (
                "[camera]\nposition = 1\nvertical_fo = 2",
                "line 3: unknown key 'vertical_fo' in [camera]; did you mean 'vertical_fov'?",
            ),
            ("\n[camra]\n", "line 2: unknown table 'camra'; did you mean 'camera'?"),
            (
                "camera.zzz = 1",
                "line 1: unknown key 'zzz' in [camera]; there are position, vertical_fov",
            ),
            ("camera = 3", "line 1: 'camera' is no table"),
            ("[materials]\nwall = 3", "line 2: 'materials.wall' is no table"),
            (
                "[materials.\"a b\"]\ncolour = 3",
                "line 2: unknown key 'colour' in [materials.a b]; did you mean 'color'?",
            ),
        ];
        for (text, expected) in cases {
            let error = Document::parse(text).expect("good TOML").check(&TABLES);
            let error = error.expect_err(text);
            assert!(error.starts_with(expected), "{error}");
        }
        assert!(Document::parse("[camera").err().expect("an error").contains("line 1"));
    }

    #[test]
    fn errors_name_the_line_of_the_innermost_key() {
        let text = "[camera]\nposition = [\n1]\n[materials.a]\ncolor = 1";
        let document = Document::parse(text).expect("good TOML");
        assert_eq!(document.error(&["camera", "position"], "no"), "line 2: no");
        assert_eq!(document.error(&["camera", "target"], "no"), "line 1: no");
        assert_eq!(document.error(&["materials", "a", "color"], "no"), "line 5: no");
        assert_eq!(document.error(&["film"], "no"), "no");
    }
}

//! Reading tables.

use std::path::Path;

use csv::{DeserializeErrorKind, ErrorKind, StringRecord};

use super::row::{Row, SCHEMA};
use crate::error::Error;

/// The columns that are texts: they may say `inf` or `nan`.
const TEXTS: [&str; 9] = [
    "scene",
    "method",
    "reference",
    "fingerprint",
    "sampler",
    "machine",
    "adapter",
    "version",
    "failure",
];

/// Reads all rows of a table: at least one.
///
/// # Errors
/// [`Error::Files`] that names the file, the line and what to do, if it cannot be read, has no
/// rows, is of another version, lacks columns, or if a field is not what its column contains.
pub(crate) fn read_rows(path: &Path) -> Result<Vec<Row>, Error> {
    let bytes = std::fs::read(path).map_err(|source| {
        Error::Files(nst_files::Error::Io { action: "read", path: path.to_owned(), source })
    })?;
    parse_table(&bytes).map_err(|message| {
        Error::Files(nst_files::Error::Malformed { path: path.to_owned(), message })
    })
}

/// The rows of a table as [`read_rows`]; `Err` is what is wrong with it.
pub(crate) fn parse_table(bytes: &[u8]) -> Result<Vec<Row>, String> {
    let failed = |error: csv::Error| describe(bytes, error.kind());
    let mut reader = csv::Reader::from_reader(bytes);
    let header = reader.headers().map_err(failed)?.clone();
    if header.is_empty() {
        return Err("it is empty; nst bench scene writes tables of results".into());
    }
    let mut record = StringRecord::new();
    let mut rows = Vec::new();
    while reader.read_record(&mut record).map_err(failed)? {
        if rows.is_empty() {
            check_version(&header, &record)?;
        }
        let line = || line(bytes, record.position());
        rows.push(parse(&header, &record, line)?);
    }
    if rows.is_empty() {
        check_version(&header, &record)?;
        return Err("it has a header, but no rows; let nst bench scene end".into());
    }
    Ok(rows)
}

/// The line of a record, of which the first is the header's. The reader's own count is one too
/// small where lines end with a carriage return and a line feed: it takes the latter for the
/// beginning of the next record.
fn line(bytes: &[u8], position: Option<&csv::Position>) -> usize {
    let start = position.map_or(0, |position| position.byte() as usize).min(bytes.len());
    let ends = |byte: &u8| matches!(byte, b'\r' | b'\n');
    let start = start + bytes[start..].iter().take_while(|byte| ends(byte)).count();
    let ends_line = |&i: &usize| match bytes[i] {
        b'\n' => true,
        byte => byte == b'\r' && bytes.get(i + 1) != Some(&b'\n'),
    };
    1 + (0..start).filter(ends_line).count()
}

/// Whether a table has this version, and every column.
fn check_version(header: &StringRecord, first: &StringRecord) -> Result<(), String> {
    let schema = header.iter().position(|name| name == "schema").and_then(|at| first.get(at));
    if let Some(schema) = schema.filter(|schema| *schema != SCHEMA.to_string()) {
        return Err(format!(
            "the table has version '{schema}', and this program reads version {SCHEMA}; write it \
             again with this program's nst bench scene"
        ));
    }
    let columns = Row::columns();
    let lacks = |name: &&str| header.iter().all(|there| there != *name);
    let missing: Vec<&str> = columns.iter().filter(lacks).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let what = if missing.len() == columns.len() {
        "it is no table of nst bench scene"
    } else {
        "perhaps an earlier version wrote it; write it again with nst bench scene"
    };
    Err(format!("columns are missing: {}; {what}", missing.join(", ")))
}

fn parse(
    header: &StringRecord,
    record: &StringRecord,
    line: impl Fn() -> usize,
) -> Result<Row, String> {
    for (name, text) in header.iter().zip(record) {
        let infinite = text.parse::<f64>().is_ok_and(|number| !number.is_finite());
        if infinite && !TEXTS.contains(&name) {
            return Err(format!(
                "line {}, column {name}: '{text}' is not finite; what was not measured is left \
                 empty",
                line()
            ));
        }
    }
    let row: Row = record.deserialize(Some(header)).map_err(|error| match error.kind() {
        ErrorKind::Deserialize { err, .. } => {
            let field = err.field().map(|field| field as usize);
            let column = field.and_then(|field| header.get(field)).unwrap_or("?");
            let text = field.and_then(|field| record.get(field)).unwrap_or_default();
            let why = match err.kind() {
                DeserializeErrorKind::ParseInt(_) => format!("'{text}' is no whole number"),
                DeserializeErrorKind::ParseFloat(_) => format!("'{text}' is no number"),
                other => other.to_string(),
            };
            format!("line {}, column {column}: {why}; correct it, or delete the line", line())
        }
        kind => describe(&[], kind),
    })?;
    if row.schema != SCHEMA {
        return Err(format!(
            "line {}: the row has version {}, and the others {SCHEMA}; delete it",
            line(),
            row.schema
        ));
    }
    Ok(row)
}

/// What is wrong with the text of a table.
fn describe(bytes: &[u8], kind: &ErrorKind) -> String {
    let line = |position: &Option<csv::Position>| {
        let position = position.as_ref();
        position.map_or_else(String::new, |it| format!("line {}: ", line(bytes, Some(it))))
    };
    match kind {
        ErrorKind::Utf8 { pos, .. } => {
            format!("{}it is no UTF-8 text; store the table as UTF-8", line(pos))
        }
        ErrorKind::UnequalLengths { pos, expected_len, len } => format!(
            "{}it has {len} fields, and the header {expected_len}; correct it, or delete the line",
            line(pos)
        ),
        kind => format!("it is no readable table: {kind:?}"),
    }
}

#[cfg(test)]
mod tests;

//! Reading tables.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use csv::{DeserializeErrorKind, ErrorKind, StringRecord};

use super::{
    curves::Curves,
    metric::Metric,
    row::{Row, SCHEMA},
    summary::Summary,
};
use crate::error::Error;

/// The columns that are texts: they may say `inf` or `nan`.
const TEXTS: [&str; 7] =
    ["scene", "method", "fingerprint", "machine", "adapter", "version", "failure"];

/// The rows of one scene: at least one, all of one film, no run twice.
#[derive(Clone, Debug)]
pub(crate) struct Results {
    rows: Vec<Row>,
    summaries: Vec<Summary>,
}

impl Results {
    /// Reads the rows of one scene from all tables; `scene` may be left out if there is only
    /// one.
    ///
    /// # Errors
    /// As [`read_rows`], and [`Error::Usage`] if the tables have not the scene, or have
    /// several and none was chosen; [`Error::Unlike`] if rows do not fit together.
    pub(crate) fn read(paths: &[PathBuf], scene: Option<&str>) -> Result<Self, Error> {
        let mut rows = Vec::new();
        for path in paths {
            rows.extend(read_rows(path)?);
        }
        let scenes: BTreeSet<&str> = rows.iter().map(|row| &*row.scene).collect();
        let all = || scenes.iter().map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ");
        let chosen = match scene {
            Some(name) if scenes.contains(name) => name.to_owned(),
            Some(name) => {
                return Err(Error::Usage(format!(
                    "there is no scene '{name}'; there are {}",
                    all()
                )));
            }
            None if scenes.len() > 1 => {
                return Err(Error::Usage(format!(
                    "there are several scenes, choose one with --scene: {}",
                    all()
                )));
            }
            None => rows[0].scene.clone(),
        };
        Self::of(rows.into_iter().filter(|row| row.scene == chosen))
    }

    /// Rows of one scene, of which there is at least one. A run that comes again with the same
    /// errors counts once.
    ///
    /// # Errors
    /// [`Error::Unlike`] if films differ, or if a run comes again with other errors.
    pub(crate) fn of(rows: impl IntoIterator<Item = Row>) -> Result<Self, Error> {
        let mut places: BTreeMap<(String, u32, u32), usize> = BTreeMap::new();
        let mut kept: Vec<Row> = Vec::new();
        for row in rows {
            let size = |row: &Row| format!("{}x{}", row.width, row.height);
            if let Some(first) = kept.first().filter(|first| size(first) != size(&row)) {
                return Err(Error::Unlike(format!(
                    "the results are of films of {} and of {} pixels; use tables of one size",
                    size(first),
                    size(&row)
                )));
            }
            let errors = |row: &Row| Metric::ALL.map(|metric| metric.of(row));
            let place =
                *places.entry((row.method.clone(), row.spp, row.run)).or_insert_with(|| kept.len());
            match kept.get(place) {
                None => kept.push(row),
                Some(first) if errors(first) == errors(&row) => {}
                Some(_) => {
                    return Err(Error::Unlike(format!(
                        "run {} of '{}' at {} spp is there twice, with different errors; use tables \
                         whose runs have the same seeds, or one table",
                        row.run, row.method, row.spp
                    )));
                }
            }
        }
        Ok(Self { summaries: Summary::all(&kept), rows: kept })
    }

    pub(crate) fn rows(&self) -> &[Row] {
        &self.rows
    }

    pub(crate) fn scene(&self) -> &str {
        &self.rows[0].scene
    }

    /// Width and height of the film in pixels.
    pub(crate) fn size(&self) -> [u32; 2] {
        [self.rows[0].width, self.rows[0].height]
    }

    /// What the rows have in a field, each value once, in the order in which they first come:
    /// the machines, for instance.
    pub(crate) fn distinct<'a>(&'a self, field: impl Fn(&'a Row) -> &'a str) -> Vec<&'a str> {
        let mut seen = BTreeSet::new();
        self.rows.iter().map(field).filter(|value| seen.insert(*value)).collect()
    }

    /// All sample counts, from the smallest.
    pub(crate) fn sample_counts(&self) -> Vec<u32> {
        ascending(self.rows.iter().map(|row| row.spp))
    }

    /// All numbers of threads, from the smallest.
    pub(crate) fn threads(&self) -> Vec<u32> {
        ascending(self.rows.iter().filter_map(|row| row.threads))
    }

    /// One for each method and sample count.
    pub(crate) fn summaries(&self) -> &[Summary] {
        &self.summaries
    }

    /// The mean error of a method at a sample count, if it was measured.
    #[cfg(feature = "render")]
    pub(crate) fn error(&self, method: &str, spp: u32, metric: Metric) -> Option<f64> {
        let it = self.summaries.iter().find(|it| it.method == method && it.spp == spp)?;
        Some(it.error(metric)?.mean)
    }

    /// Errors against time, by one metric.
    pub(crate) fn curves(&self, metric: Metric) -> Curves {
        Curves::of(&self.summaries, metric)
    }
}

/// Each number once, from the smallest.
fn ascending(numbers: impl Iterator<Item = u32>) -> Vec<u32> {
    numbers.collect::<BTreeSet<_>>().into_iter().collect()
}

/// Reads all rows of a table: at least one.
///
/// # Errors
/// [`Error::Files`] that names the file, the line and what to do, if it cannot be read, has no
/// rows, is of another version, lacks columns, or if a field is not what its column contains.
pub(crate) fn read_rows(path: &Path) -> Result<Vec<Row>, Error> {
    let malformed = |message: String| {
        Error::Files(nst_files::Error::Malformed { path: path.to_owned(), message })
    };
    let io = |source| {
        Error::Files(nst_files::Error::Io { action: "read", path: path.to_owned(), source })
    };
    let failed = |error: csv::Error| match error.into_kind() {
        ErrorKind::Io(source) => io(source),
        kind => malformed(describe(&kind)),
    };
    let file = std::fs::File::open(path).map_err(io)?;
    let mut reader = csv::Reader::from_reader(file);
    let header = reader.headers().map_err(failed)?.clone();
    if header.is_empty() {
        return Err(malformed("it is empty; nst bench scene writes tables of results".into()));
    }
    let mut record = StringRecord::new();
    let mut rows = Vec::new();
    while reader.read_record(&mut record).map_err(failed)? {
        if rows.is_empty() {
            check_version(&header, &record).map_err(malformed)?;
        }
        rows.push(parse(&header, &record).map_err(malformed)?);
    }
    if rows.is_empty() {
        check_version(&header, &record).map_err(malformed)?;
        return Err(malformed("it has a header, but no rows; let nst bench scene end".into()));
    }
    Ok(rows)
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

fn parse(header: &StringRecord, record: &StringRecord) -> Result<Row, String> {
    let line = record.position().map_or(0, csv::Position::line);
    for (name, text) in header.iter().zip(record) {
        let infinite = text.parse::<f64>().is_ok_and(|number| !number.is_finite());
        if infinite && !TEXTS.contains(&name) {
            return Err(format!(
                "line {line}, column {name}: '{text}' is not finite; what was not measured is left \
                 empty"
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
            format!("line {line}, column {column}: {why}; correct it, or delete the line")
        }
        kind => describe(kind),
    })?;
    if row.schema != SCHEMA {
        return Err(format!(
            "line {line}: the row has version {}, and the others {SCHEMA}; delete it",
            row.schema
        ));
    }
    Ok(row)
}

/// What is wrong with the text of a table.
fn describe(kind: &ErrorKind) -> String {
    let line = |position: &Option<csv::Position>| {
        position.as_ref().map_or(String::new(), |position| format!("line {}: ", position.line()))
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

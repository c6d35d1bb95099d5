//! Which pictures there are, and which of them matter most.

use std::path::Path;

use nst_files::{header::ExrHeader, picture::Picture};

use crate::{
    args::NamedPicture,
    error::Error,
    results::{PLAIN, Results, method_of},
};

use super::table::Table;

/// A picture that the page could show.
pub(super) struct Source {
    pub(super) picture: Picture,
    /// What users read.
    pub(super) name: String,
    /// The method, if it is one of the table's.
    pub(super) method: Option<String>,
    /// Samples per pixel, where the name of the layer says it.
    pub(super) spp: Option<u32>,
    /// Less is more useful.
    rank: u32,
}

/// The reference and all pictures, the most useful first. The reference is the main picture of
/// the file, and each method's picture is a layer `METHOD.SPP`; further layers, and pictures by
/// other programs, have names alone.
///
/// # Errors
/// [`Error::Files`] if a file or a layer cannot be read, [`Error::Unlike`] if its size is not
/// that of the table.
pub(super) fn sources(
    file: &Path,
    others: &[NamedPicture],
    results: &Results,
    table: &Table<'_>,
) -> Result<Vec<Source>, Error> {
    let spp = usual_spp(results);
    let methods = results.distinct(|row| &row.method);
    let layers = ExrHeader::read(file)?.layers();
    if layers.iter().all(|layer| !layer.name.is_empty()) {
        let message = "it has no main picture (R, G and B), which is the reference in files of nst \
                       bench scene";
        let path = file.to_owned();
        return Err(nst_files::Error::Malformed { path, message: message.into() }.into());
    }
    let mut sources = vec![Source::new(open(file, Some(""), results)?, "reference".into(), 0)];
    for other in others {
        let picture = open(&other.file, other.layer.as_deref(), results)?;
        sources.push(Source::new(picture, other.name.clone(), 0));
    }
    for layer in layers.into_iter().filter(|layer| !layer.name.is_empty()) {
        let picture = open(file, Some(&layer.name), results)?;
        sources.push(match method_of(&layer.name, &methods) {
            Some((method, samples)) => Source {
                picture,
                name: if method == PLAIN { "none (plain)".into() } else { method.to_owned() },
                method: Some(method.to_owned()),
                spp: Some(samples),
                rank: rank(method, samples == spp, table),
            },
            None => Source::new(picture, layer.name, u32::MAX),
        });
    }
    for other in others {
        let name = &other.name;
        let is_name = |it: &&Source| it.name == *name || it.method.as_deref() == Some(name);
        if sources.iter().filter(is_name).count() > 1 {
            return Err(Error::Usage(format!(
                "--picture {name}=…: the page has another picture of this name; choose another one"
            )));
        }
    }
    sources.sort_by_key(|source| source.rank);
    Ok(sources)
}

/// The methods and sample counts that were measured, but have no picture.
pub(super) fn without_picture(sources: &[Source], results: &Results) -> Vec<String> {
    let summaries = results.summaries();
    let has = |method: &str, spp: u32| {
        let of = |it: &Source| it.method.as_deref() == Some(method) && it.spp == Some(spp);
        sources.iter().any(of)
    };
    let missing = summaries.iter().filter(|it| it.runs > 0 && !has(&it.method, it.spp));
    missing.map(|it| format!("{} at {} spp", it.method, it.spp)).collect()
}

/// The sample count that is shown first: the one in the middle.
pub(super) fn usual_spp(results: &Results) -> u32 {
    let counts = results.sample_counts();
    counts[counts.len() / 2]
}

impl Source {
    fn new(picture: Picture, name: String, rank: u32) -> Self {
        Self { picture, name, method: None, spp: None, rank }
    }

    /// The name, with the samples per pixel.
    pub(super) fn full_name(&self) -> String {
        match self.spp {
            Some(spp) => format!("{} at {spp} spp", self.name),
            None => self.name.clone(),
        }
    }
}

/// How soon a picture is left out if there is no room for all: plain estimates, `auto` and
/// methods on the Pareto front matter most, and so does the sample count that is shown first.
fn rank(method: &str, usual: bool, table: &Table<'_>) -> u32 {
    let class = match method {
        PLAIN => 1,
        "auto" => 2,
        method if table.ever_on_front(method) => 3,
        _ => 6,
    };
    if usual { class } else { class + 3 }
}

/// Opens a layer that has as many pixels as the results' film.
fn open(file: &Path, layer: Option<&str>, results: &Results) -> Result<Picture, Error> {
    let picture = Picture::open(file, layer)?;
    if picture.size != results.size() {
        let text = |[width, height]: [u32; 2]| format!("{width}x{height}");
        return Err(Error::Unlike(format!(
            "'{}' has {} pixels, but the results are of {}; use pictures of the same film",
            file.display(),
            text(picture.size),
            text(results.size())
        )));
    }
    Ok(picture)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Row;

    #[test]
    fn what_matters_most_comes_first() {
        let row = |method: &str, spp, mse, time| Row {
            method: method.into(),
            spp,
            mse: Some(mse),
            total_seconds: Some(time),
            ..Row::default()
        };
        let rows = [
            row("none", 8, 4.0, 1.0),
            row("none", 64, 1.0, 8.0),
            row("auto", 8, 5.0, 1.0),
            row("good", 8, 2.0, 2.0),
            row("bad", 8, 9.0, 9.0),
        ];
        let results = Results::of(rows).expect("rows that fit together");
        assert_eq!(usual_spp(&results), 64);
        let summaries = results.summaries();
        let table = Table::new(&results, summaries);
        let ranks = |usual| ["none", "auto", "good", "bad"].map(|it| rank(it, usual, &table));
        assert_eq!((ranks(true), ranks(false)), ([1, 2, 3, 6], [4, 5, 6, 9]));
    }
}

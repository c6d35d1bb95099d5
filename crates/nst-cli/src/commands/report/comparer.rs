//! The page's comparer: pictures as they are stored in it, and what is said of them.

use nst_core::metrics::EPSILON;
use nst_files::false_color::INFERNO;
use serde::Serialize;

use super::{
    sources::{Source, usual_spp, without_picture},
    stored::{encode, reduce},
};
use crate::{
    commands::compare::MAP_SCALE,
    error::Error,
    results::{Metric, PLAIN, Results},
    words::list,
};

/// The most bytes of a page: what mails and trackers usually take.
pub(super) const MOST_BYTES: usize = 10_000_000;

/// What remains of it for names and remarks of pictures.
const RESERVE: usize = 100_000;

/// The most pixels of a stored picture; larger films are reduced.
const MOST_PIXELS: usize = 512 * 512;

/// What `page/comparer.js` reads.
#[derive(Debug, Serialize)]
pub(super) struct Comparer {
    width: usize,
    height: usize,
    /// The sample counts of which there are pictures.
    spps: Vec<u32>,
    /// Those that are shown first; the right one may be missing.
    spp: Option<u32>,
    left: String,
    right: Option<String>,
    pictures: Vec<Shown>,
    errors: Scale,
    notes: Vec<String>,
}

/// A picture of the page.
#[derive(Debug, Serialize)]
struct Shown {
    /// The stored picture's name.
    id: String,
    name: String,
    method: Option<String>,
    spp: Option<u32>,
}

/// The false colours of errors.
#[derive(Debug, Serialize)]
struct Scale {
    low: f64,
    high: f64,
    epsilon: f64,
    palette: &'static [[u8; 3]],
}

/// Pictures as text, with their names.
pub(super) type Stored = Vec<(String, String)>;

impl Comparer {
    /// Reads and stores pictures, the most useful first, as many as leave the page below
    /// [`MOST_BYTES`]; `used` is the length of the page without them. The first is the
    /// reference, which is stored in any case.
    pub(super) fn new(
        sources: &[Source],
        results: &Results,
        used: usize,
    ) -> Result<(Self, Stored), Error> {
        let [width, height] = results.size().map(|length| length as usize);
        let factor = factor(width, height);
        let (mut shown, mut stored) = (Vec::new(), Stored::new());
        let mut notes = vec![
            "The page stores a pixel as three bytes and an exponent: values are off by up to 0.4 % \
             of the pixel's brightest channel, and relative squared errors below 2e-5 are rounding."
                .to_owned(),
        ];
        if factor > 1 {
            notes.push(format!(
                "The pictures are reduced to means of {factor} × {factor} pixels of the film of \
                 {width} × {height}; their errors are those of the means."
            ));
        }
        let mut room = MOST_BYTES.saturating_sub(used + RESERVE);
        let mut left_out = Vec::new();
        for (index, source) in sources.iter().enumerate() {
            if !left_out.is_empty() {
                left_out.push(source.full_name());
                continue;
            }
            let lanes = source.picture.read()?;
            let channels = source.picture.channel_names.len();
            let (small, [columns, _]) = reduce(&lanes, [width, height], factor);
            let text = encode(&small, columns, channels);
            if text.len() > room && index > 0 {
                left_out.push(source.full_name());
                continue;
            }
            room = room.saturating_sub(text.len());
            notes.extend(remarks(source, &lanes, channels));
            let picture = Shown::new(index, source);
            stored.push((picture.id.clone(), text));
            shown.push(picture);
        }
        notes.extend(note("Left out, so that the page stays below 10 MB", &left_out));
        notes.extend(note("Without a picture", &without_picture(sources, results)));
        let size = [width, height].map(|length| length.div_ceil(factor));
        Ok((Self::of(shown, size, notes, results), stored))
    }

    fn of(
        mut pictures: Vec<Shown>,
        [width, height]: [usize; 2],
        notes: Vec<String>,
        results: &Results,
    ) -> Self {
        // Keys choose them in this order: the reference, the methods in the order of the
        // table, and then those of other programs.
        let methods = results.distinct(|row| &row.method);
        pictures.sort_by_key(|it| {
            let place = methods.iter().position(|method| it.method.as_deref() == Some(*method));
            (it.id != REFERENCE, place.is_none(), place)
        });
        let mut spps: Vec<u32> = pictures.iter().filter_map(|it| it.spp).collect();
        spps.sort_unstable();
        spps.dedup();
        let usual = usual_spp(results);
        let spp = spps.iter().copied().find(|&spp| spp == usual).or(spps.last().copied());
        let find = |method: &str| {
            pictures.iter().find(|it| it.spp == spp && it.method.as_deref() == Some(method))
        };
        let left = find(PLAIN).unwrap_or(&pictures[0]).id.clone();
        let best = best_method(results, spp, |method| find(method).is_some());
        let right = find("auto").or_else(|| find(&best?)).map(|it| it.id.clone());
        let [low, high] = MAP_SCALE;
        let errors = Scale { low, high, epsilon: EPSILON, palette: &INFERNO };
        Self { width, height, spps, spp, left, right, pictures, errors, notes }
    }

    /// What is said of the pictures.
    pub(super) fn notes(&self) -> &[String] {
        &self.notes
    }
}

/// The name of the reference's stored picture.
const REFERENCE: &str = "reference";

impl Shown {
    fn new(index: usize, source: &Source) -> Self {
        Self {
            id: if index == 0 { REFERENCE.to_owned() } else { index.to_string() },
            name: source.name.clone(),
            method: source.method.clone(),
            spp: source.spp,
        }
    }
}

/// The least whole number by which width and height must be divided.
fn factor(width: usize, height: usize) -> usize {
    let fits = |factor: &usize| width.div_ceil(*factor) * height.div_ceil(*factor) <= MOST_PIXELS;
    (1..).find(fits).expect("a large factor leaves one pixel")
}

/// The method with the lowest MSE, other than the plain estimate, among those that have a
/// picture.
fn best_method(results: &Results, spp: Option<u32>, has: impl Fn(&str) -> bool) -> Option<String> {
    let summaries = results.summaries();
    let candidates =
        summaries.iter().filter(|it| Some(it.spp) == spp && it.method != PLAIN && has(&it.method));
    let errors = candidates.filter_map(|it| Some((it.error(Metric::Mse)?.mean, it.method.clone())));
    errors.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, method)| method)
}

/// What a user should know about a picture.
fn remarks(source: &Source, lanes: &[f32], channels: usize) -> Vec<String> {
    let pixels = lanes.len() / channels;
    let finite = |pixel: &usize| (0..channels).all(|it| lanes[it * pixels + pixel].is_finite());
    let nonfinite = (0..pixels).filter(|pixel| !finite(pixel)).count();
    let count = (nonfinite > 0).then(|| {
        let pixels = if nonfinite == 1 { "1 pixel is" } else { &format!("{nonfinite} pixels are") };
        format!("{}: {pixels} not finite, and magenta here.", source.full_name())
    });
    count.into_iter().chain(source.picture.primaries_note()).collect()
}

fn note(what: &str, names: &[String]) -> Option<String> {
    (!names.is_empty()).then(|| format!("{what}: {}.", list(names, "")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn films_are_reduced_as_little_as_is_needed() {
        for (size, expected) in [
            ([512, 512], 1),
            ([1, 1], 1),
            ([513, 512], 2),
            ([1024, 1024], 2),
            ([1920, 1080], 3),
            ([1 << 20, 1], 4),
        ] {
            assert_eq!(factor(size[0], size[1]), expected, "{size:?}");
        }
    }
}

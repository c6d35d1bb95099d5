//! Features in the files of other renderers: what the camera sees beside radiance, by the names
//! that Mitsuba's `aov` integrator (as its users call them), pbrt's `gbuffer` film and Blender's
//! passes have, or by those that the user gives.

use std::ops::Range;

use nst_core::{FOLDS, Side};

use crate::{
    Error,
    header::{ExrHeader, Layer, title},
    picture::Picture,
};

/// The layers that the user names.
#[derive(Clone, Copy, Debug, Default)]
pub struct FeatureNames<'a> {
    /// Reflectance, R, G and B.
    pub albedo: Option<&'a str>,
    /// Normals, X, Y and Z.
    pub normal: Option<&'a str>,
    /// Directly seen light, R, G and B.
    pub emission: Option<&'a str>,
}

/// A feature of all pictures.
#[derive(Debug)]
pub struct Feature {
    side: Side,
    /// The layers of the first picture that it is the sum of.
    layers: Vec<String>,
    /// `[picture][layer]`
    pictures: Vec<Vec<Picture>>,
    /// How many values of the files are not finite, and how many means were out of range.
    nonfinite: u64,
    out_of_range: u64,
    /// Whether any mean is not zero.
    has_values: bool,
}

/// Kinds of features, with their channels and the names of their layers, the best first.
const KNOWN: [(Side, &[&str], &[&str]); 4] = [
    (Side::Albedo, &["R", "G", "B"], &["Denoising Albedo", "albedo", "alb"]),
    (
        Side::Normal,
        &["X", "Y", "Z"],
        &["Denoising Normal", "sh_normal", "Ns", "normal", "normals", "nn", "N"],
    ),
    (Side::Depth, &[], &["depth", "dd.y", "dd"]),
    (Side::Emission, &["R", "G", "B"], &["Emission", "Emit"]),
];

/// Blender's pass of what the camera sees of the environment, which it does not count as emission.
const ENVIRONMENT: &[&str] = &["Environment", "Env"];

/// From here on, a depth is that of nothing: Blender writes 10¹⁰.
const NO_DEPTH: f32 = 1e9;

/// Finds features that all pictures have: the named ones, and others by their names. Returns
/// them, and notes of what was left out.
///
/// # Errors
/// [`Error::Malformed`] names a file that lacks a layer which the user names, or has it in
/// another size; [`Error::Io`] one that cannot be read.
pub fn find(
    pictures: &[Picture],
    names: FeatureNames<'_>,
) -> Result<(Vec<Feature>, Vec<String>), Error> {
    let headers = pictures.iter().map(|picture| ExrHeader::read(picture.path()));
    let headers = headers.collect::<Result<Vec<_>, Error>>()?;
    let (mut features, mut notes) = (Vec::new(), Vec::new());
    for (side, channels, known) in KNOWN {
        let given = match side {
            Side::Albedo => names.albedo,
            Side::Normal => names.normal,
            Side::Emission => names.emission,
            _ => None,
        };
        let of_picture = |(picture, header): (&Picture, &ExrHeader)| {
            let mut layers: Vec<Layer> = Vec::new();
            if let Some(name) = given {
                layers.push(named(picture, header, name, channels)?);
            } else {
                layers.extend(by_name(picture, header, channels, known)?);
                if side == Side::Emission {
                    layers.extend(by_name(picture, header, channels, ENVIRONMENT)?);
                }
            }
            layers.into_iter().map(|layer| opened(picture, header, layer)).collect()
        };
        let found = pictures.iter().zip(&headers).map(of_picture);
        let found: Result<Vec<Vec<Picture>>, Error> = found.collect();
        match found {
            Err(error) if given.is_some() => return Err(error),
            Err(error) => notes.push(format!("{side} is left out: {error}")),
            Ok(of_pictures) => {
                let layers: Vec<String> =
                    of_pictures[0].iter().map(|it| it.layer.clone()).collect();
                if let Some(i) = of_pictures.iter().position(|it| it.len() != layers.len()) {
                    let (first, other) = (pictures[0].path(), pictures[i].path());
                    notes.push(format!(
                        "{side} is left out: '{}' and '{}' do not have the same layers of it",
                        first.display(),
                        other.display()
                    ));
                } else if !layers.is_empty() {
                    features.push(Feature::new(side, layers, of_pictures));
                }
            }
        }
    }
    if pictures[0].channel_names.len() == 1 {
        // Features have the channels of a picture in colour.
        let given = [names.albedo, names.normal, names.emission].into_iter().flatten().next();
        if let Some(name) = given {
            let message =
                format!("it is packed as one channel, beside which '{name}' has no place");
            return Err(Error::malformed(pictures[0].path(), message));
        }
        features.clear();
    }
    Ok((features, notes))
}

/// The layer of a name that the user gives.
fn named(
    picture: &Picture,
    header: &ExrHeader,
    name: &str,
    channels: &[&str],
) -> Result<Layer, Error> {
    let layers = header.layers_with(channels);
    let all: Vec<_> = layers.iter().map(|layer| title(&layer.name).to_owned()).collect();
    layers.into_iter().find(|layer| layer.name == name).ok_or_else(|| {
        let message = format!(
            "no layer '{name}' with the channels {}; its layers with those are {}",
            channels.join(", "),
            if all.is_empty() { "none".into() } else { all.join(", ") }
        );
        Error::malformed(picture.path(), message)
    })
}

/// The layer of the first of some names that there is, in the view layer of the picture if it
/// has one; `None` if there is none.
fn by_name(
    picture: &Picture,
    header: &ExrHeader,
    channels: &[&str],
    known: &[&str],
) -> Result<Option<Layer>, Error> {
    let mut layers = match channels {
        [] => header.layers().into_iter().filter(|layer| layer.channels.len() == 1).collect(),
        _ => header.layers_with(channels),
    };
    layers.retain(|layer| layer.name != picture.layer);
    let view = picture.layer.rsplit_once('.').map_or("", |(view, _)| view);
    // How well a name fits: in the same view layer, alone, in another one.
    let rank = |full: &str, known: &str| {
        let (before, own) = full.split_at_checked(full.len().checked_sub(known.len())?)?;
        let fits = own.eq_ignore_ascii_case(known) && (before.is_empty() || before.ends_with('.'));
        let in_view = before.strip_suffix('.').unwrap_or(before) == view;
        fits.then_some(if in_view { 0 } else { 1 + usize::from(!before.is_empty()) })
    };
    for known in known {
        let best = layers.iter().filter_map(|layer| rank(&layer.name, known)).min();
        let Some(best) = best else { continue };
        let fits = |layer: &&Layer| rank(&layer.name, known) == Some(best);
        let found: Vec<&Layer> = layers.iter().filter(fits).collect();
        if let [first, second, ..] = found[..] {
            let message =
                format!("it has both '{}' and '{}'; name one of them", first.name, second.name);
            return Err(Error::malformed(picture.path(), message));
        }
        return Ok(found.first().map(|&layer| layer.clone()));
    }
    Ok(None)
}

/// A layer beside the picture, of the same size.
fn opened(picture: &Picture, header: &ExrHeader, layer: Layer) -> Result<Picture, Error> {
    let beside = Picture::of_layer(picture.path(), header, layer)?;
    if beside.window() == picture.window() {
        return Ok(beside);
    }
    let ([width, height], [x, y]) = (beside.size, beside.position);
    let message = format!(
        "layer '{}' has {width}x{height} pixels from ({x}, {y}), the picture {}x{} from ({}, {})",
        beside.layer, picture.size[0], picture.size[1], picture.position[0], picture.position[1]
    );
    Err(Error::malformed(picture.path(), message))
}

impl Feature {
    fn new(side: Side, layers: Vec<String>, pictures: Vec<Vec<Picture>>) -> Self {
        Self { side, layers, pictures, nonfinite: 0, out_of_range: 0, has_values: false }
    }

    /// What it is.
    #[must_use]
    pub fn side(&self) -> &Side {
        &self.side
    }

    /// The layers of the files that it is taken from, in the first of them.
    #[must_use]
    pub fn layers(&self) -> &[String] {
        &self.layers
    }

    /// Uses the last picture alone: of snapshots, it has all samples.
    pub(super) fn keep_last(&mut self) {
        self.pictures.drain(..self.pictures.len() - 1);
    }

    /// The side channels that it becomes.
    pub(super) fn sides(&self) -> Vec<Side> {
        let has_folds = self.pictures.len() >= FOLDS;
        let folds = (0..FOLDS as u8).filter(|_| has_folds);
        let folds = folds.filter_map(|fold| self.side.of_fold(fold));
        [self.side.clone()].into_iter().chain(folds).collect()
    }

    /// The means over all pictures, and over the folds of some, of some rows.
    pub(super) fn read(&mut self, rows: &Range<u32>) -> Result<Vec<(Side, Vec<f32>)>, Error> {
        let mut means: Vec<(Side, Means)> =
            self.sides().into_iter().map(|side| (side, Means::default())).collect();
        for (i, layers) in self.pictures.iter().enumerate() {
            let mut values = layers[0].read_rows(rows.clone())?;
            for layer in &layers[1..] {
                let others = layer.read_rows(rows.clone())?;
                values.iter_mut().zip(others).for_each(|(value, other)| *value += other);
            }
            if self.side == Side::Depth {
                let nothing = values.iter_mut().filter(|value| **value >= NO_DEPTH);
                nothing.for_each(|value| *value = 0.0);
            }
            self.nonfinite += values.iter().filter(|value| !value.is_finite()).count() as u64;
            let fold = self.side.of_fold((i % FOLDS) as u8);
            let takes = |side: &Side| !side.is_of_fold() || Some(side) == fold.as_ref();
            let of_picture = means.iter_mut().filter(|(side, _)| takes(side));
            of_picture.for_each(|(_, means)| means.add(&values));
        }
        let mut sides: Vec<(Side, Vec<f32>)> =
            means.into_iter().map(|(side, means)| (side, means.rounded())).collect();
        for (side, values) in &mut sides {
            let out_of_range = match self.side {
                Side::Albedo => clip_colors(values),
                Side::Normal => shorten_normals(values),
                _ => 0,
            };
            if !side.is_of_fold() {
                self.out_of_range += out_of_range;
            }
            self.has_values |= values.iter().any(|&value| value != 0.0);
        }
        Ok(sides)
    }

    /// What to tell when all rows are read.
    pub(super) fn notes(&self) -> Vec<String> {
        let Self { side, nonfinite, out_of_range, .. } = self;
        let layers = self.layers.join(" and ");
        let mut notes = Vec::new();
        if *nonfinite > 0 {
            notes.push(format!(
                "{side} ({layers}): {nonfinite} not finite, and left out of the means"
            ));
        }
        if *out_of_range > 0 {
            let what = match side {
                Side::Albedo => "below 0 or above 1, and clipped",
                _ => "longer than 1, and shortened to it",
            };
            notes.push(format!("{side} ({layers}): {out_of_range} {what}"));
        }
        if !self.has_values {
            notes.push(format!("{side} ({layers}): zero everywhere; it tells nothing"));
        }
        notes
    }
}

/// Means of finite values; 0 where there are none.
#[derive(Default)]
struct Means {
    sums: Vec<f64>,
    counts: Vec<u32>,
}

impl Means {
    fn add(&mut self, values: &[f32]) {
        self.sums.resize(values.len(), 0.0);
        self.counts.resize(values.len(), 0);
        for ((sum, count), &value) in self.sums.iter_mut().zip(&mut self.counts).zip(values) {
            if value.is_finite() {
                *sum += f64::from(value);
                *count += 1;
            }
        }
    }

    fn rounded(self) -> Vec<f32> {
        let mean = |(sum, count): (f64, u32)| (sum / f64::from(count.max(1))) as f32;
        self.sums.into_iter().zip(self.counts).map(mean).collect()
    }
}

/// Clips reflectances to what denoisers accept, 0 to 1; returns how many were beyond.
fn clip_colors(values: &mut [f32]) -> u64 {
    let beyond = values.iter_mut().filter(|value| !(0.0..=1.0).contains(*value));
    beyond.map(|value| *value = value.clamp(0.0, 1.0)).count() as u64
}

/// Scales vectors `[coordinate][pixel]` that are longer than 1, but for rounding to f16, to that
/// length; returns how many were.
fn shorten_normals(values: &mut [f32]) -> u64 {
    let pixels = values.len() / 3;
    let mut shortened = 0;
    for pixel in 0..pixels {
        let squares = (0..3).map(|axis| values[axis * pixels + pixel].powi(2)).sum::<f32>();
        if squares > 1.0 {
            (0..3).for_each(|axis| values[axis * pixels + pixel] /= squares.sqrt());
            shortened += u64::from(squares > 1.01);
        }
    }
    shortened
}

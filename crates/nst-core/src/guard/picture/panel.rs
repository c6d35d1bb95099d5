//! The experts at work on strips of a picture.

use rayon::prelude::*;

use super::{
    super::{hats::Place, lanes::FittedGuard, logarithm::ln, sample::CHUNK},
    cells::{BRIGHTNESS, Held},
    changes::believed_changes,
    layers::{EMITTED, Feature, Layers, Strip},
    seen::{PictureExpert, SeenPicture},
};
use crate::{Error, FOLDS};

/// What the blend of the guard of lanes is called.
const LANE: &str = "lane";

/// In how many ways an expert that looks at neighbours estimates emission, if it does.
pub(super) const WAYS: usize = 2;

/// Below this brightness, relative to the mean of the picture, all is alike.
const FLOOR: f32 = 0.01;

/// The experts of a picture, and what they must know of it.
pub(super) struct Panel<'a> {
    pub(super) lane: FittedGuard<'a>,
    /// Whether the guard of lanes is one of the experts.
    pub(super) blends_lane: bool,
    pub(super) experts: Vec<&'a dyn PictureExpert>,
    /// How many samples are in each fold.
    pub(super) counts: [f64; FOLDS],
    pub(super) unit: f64,
}

/// An expert that could not estimate.
pub(super) struct Failure {
    /// Its number.
    pub(super) expert: usize,
    pub(super) error: Error,
}

/// What experts say of a layer, `[expert][lane]`.
type Estimates = Vec<Vec<f32>>;

impl Panel<'_> {
    /// The experts of the reflected layer.
    pub(super) fn names(&self) -> Vec<&str> {
        let lane = self.blends_lane.then_some(LANE);
        lane.into_iter().chain(self.experts.iter().map(|expert| expert.name())).collect()
    }

    /// How many estimates there are of the emitted one.
    pub(super) fn count_of_emission(&self) -> usize {
        usize::from(self.blends_lane) + WAYS * self.of_emission().count()
    }

    /// The experts that look at neighbours and estimate emission, with their numbers.
    fn of_emission(&self) -> impl Iterator<Item = (usize, &dyn PictureExpert)> {
        self.numbered().filter(|(_, it)| it.estimates_emission())
    }

    fn numbered(&self) -> impl Iterator<Item = (usize, &dyn PictureExpert)> {
        self.experts.iter().copied().enumerate()
    }

    /// What the experts change in the inner rows of a strip, in each layer, without a group; with
    /// what is missing, if there is such a group.
    pub(super) fn look(&self, strip: &Strip<'_>, group: usize) -> Result<Vec<Held>, Failure> {
        let layers = strip.layers(&self.counts, group);
        let of_lane = if self.blends_lane {
            let changes = self.lane.changes(strip.batch, strip.grid, group);
            by_layer(strip, &layers, changes).into_iter().map(|changes| vec![changes]).collect()
        } else {
            vec![Vec::new(); layers.parts.len()]
        };
        let estimates = self.estimates(strip, &layers)?;
        let missing = strip.missing(group, &layers);
        let mut views = Vec::new();
        for ((missing, mut changes), estimates) in missing.into_iter().zip(of_lane).zip(estimates) {
            let number = views.len();
            let mean = &layers.parts[number].mean;
            for mut estimates in estimates {
                // Most pixels see no lamp, and nothing is reflected where no surface is.
                let sees_nothing = |pixel| number == EMITTED || layers.sees_no_surface(pixel);
                believed_changes(strip.grid, sees_nothing, mean, &mut estimates);
                changes.push(estimates);
            }
            let mean = strip.grid.inner(mean);
            let places = self.places(&mean, changes.last(), strip.grid.channels());
            views.push(Held { changes, missing, places });
        }
        Ok(views)
    }

    /// What experts that look at neighbours say of each layer.
    ///
    /// Of the emission they say it in two ways: a lamp alone, on black, is no picture that a
    /// denoiser knows. It also sees all light and what surfaces reflect of it, and emission is what
    /// it says of the one more than of the other.
    fn estimates(&self, strip: &Strip<'_>, layers: &Layers) -> Result<Vec<Estimates>, Failure> {
        let [reflected, emitted @ ..] = &layers.parts[..] else {
            unreachable!("surfaces are a layer")
        };
        let all = vec![true; strip.grid.inner_rows().len()];
        let seen = self.seen(strip, layers, (&reflected.mean, &reflected.root), &all);
        let of_reflected = estimates(self.numbered(), &seen)?;
        let [emitted] = emitted else { return Ok(vec![of_reflected]) };
        let asked = layers.rows_that_emit(strip.grid);
        let mut of_emission = estimates(
            self.of_emission(),
            &self.seen(strip, layers, (&emitted.mean, &emitted.root), &asked),
        )?;
        let light: Vec<f32> =
            reflected.mean.par_iter().zip(&emitted.mean).map(|(a, b)| a + b).collect();
        let mut of_light = estimates(
            self.of_emission(),
            &self.seen(strip, layers, (&light, &emitted.root), &asked),
        )?;
        for ((expert, _), of_light) in self.of_emission().zip(&mut of_light) {
            let lanes = of_light.par_iter_mut().zip(&of_reflected[expert]);
            lanes.for_each(|(light, reflected)| {
                let emitted = *light - reflected;
                // What is no number stays so.
                *light = if emitted < 0.0 { 0.0 } else { emitted };
            });
        }
        of_emission.append(&mut of_light);
        Ok(vec![of_reflected, of_emission])
    }

    /// What an expert sees of a strip.
    fn seen<'a>(
        &self,
        strip: &'a Strip<'_>,
        layers: &'a Layers,
        (mean, root): (&'a [f32], &'a [f32]),
        asked: &'a [bool],
    ) -> SeenPicture<'a> {
        let (grid, samples, unit) = (strip.grid, layers.samples, self.unit);
        let [albedo, normal] =
            [&layers.albedo, &layers.normal].map(|it| it.as_ref().map(Feature::seen));
        SeenPicture { grid, asked, samples, unit, mean, root, albedo, normal }
    }

    /// Where the brightness of pixels lies by what an expert changes in a layer.
    fn places(&self, mean: &[f32], changes: Option<&Vec<f32>>, channels: usize) -> Vec<Place> {
        let pixels = mean.len() / channels;
        let scale = 1.0 / (channels as f32 * self.unit as f32);
        let mut places = vec![BRIGHTNESS.place(ln(FLOOR)); pixels];
        places.par_chunks_mut(CHUNK).enumerate().for_each(|(number, places)| {
            let mut sums = vec![0.0; places.len()];
            for lanes in [Some(mean), changes.map(Vec::as_slice)].into_iter().flatten() {
                for plane in lanes.chunks_exact(pixels) {
                    let plane = &plane[number * CHUNK..];
                    sums.iter_mut().zip(plane).for_each(|(sum, x)| *sum += x);
                }
            }
            // By vector instructions, which places are not written with.
            sums.iter_mut().for_each(|sum| *sum = ln((scale * *sum).max(0.0) + FLOOR));
            places.iter_mut().zip(sums).for_each(|(it, log)| *it = BRIGHTNESS.place(log));
        });
        places
    }
}

/// Estimates of the inner rows by experts, with their numbers.
fn estimates<'a>(
    experts: impl Iterator<Item = (usize, &'a dyn PictureExpert)>,
    seen: &SeenPicture<'_>,
) -> Result<Estimates, Failure> {
    let lanes = seen.grid.channels() * seen.grid.inner_rows().len() * seen.grid.width();
    let of_expert = |(expert, it): (usize, &dyn PictureExpert)| {
        let mut estimates = vec![0.0; lanes];
        it.estimate(seen, &mut estimates).map_err(|error| Failure { expert, error })?;
        Ok(estimates)
    };
    experts.map(of_expert).collect()
}

/// Changes of lanes, for each layer: those of pixels that emit belong to the emission.
fn by_layer(strip: &Strip<'_>, layers: &Layers, mut changes: Vec<f32>) -> Vec<Vec<f32>> {
    if layers.parts.len() == 1 {
        return vec![changes];
    }
    let (width, inner) = (strip.grid.width(), strip.grid.inner_rows());
    let emits = &layers.emits[inner.start * width..][..inner.len() * width];
    let mut emitted = vec![0.0; changes.len()];
    let planes = changes.chunks_exact_mut(emits.len()).zip(emitted.chunks_exact_mut(emits.len()));
    for (changes, emitted) in planes {
        let lanes = changes.par_iter_mut().zip(emitted).zip(emits).filter(|(_, emits)| **emits);
        lanes.for_each(|((change, emitted), _)| std::mem::swap(change, emitted));
    }
    vec![changes, emitted]
}

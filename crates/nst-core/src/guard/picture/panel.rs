//! The experts at work on strips of a picture.

use rayon::prelude::*;

use super::{
    super::{hats::Place, lanes::FittedGuard, logarithm::ln, sample::CHUNK},
    cells::{BRIGHTNESS, Held},
    changes::believed_changes,
    layers::{EMITTED, Feature, Layer, Layers, Strip},
    seen::{PictureExpert, SeenPicture},
};
use crate::{Error, FOLDS};

/// What the blend of the guard of lanes is called.
const LANE: &str = "lane";

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

impl Panel<'_> {
    /// The experts of the reflected layer.
    pub(super) fn names(&self) -> Vec<&str> {
        let lane = self.blends_lane.then_some(LANE);
        lane.into_iter().chain(self.experts.iter().map(|expert| expert.name())).collect()
    }

    /// Those of the emitted one.
    pub(super) fn names_of_emission(&self) -> Vec<&str> {
        let lane = self.blends_lane.then_some(LANE);
        let experts = self.experts.iter().filter(|expert| expert.estimates_emission());
        lane.into_iter().chain(experts.map(|expert| expert.name())).collect()
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
        let of_layers = strip.missing(group, &layers).into_iter().zip(of_lane).enumerate();
        let of_layer = |(number, (missing, of_lane))| {
            let (changes, places) = self.estimate(strip, &layers, number, of_lane)?;
            Ok(Held { changes, missing, places })
        };
        of_layers.map(of_layer).collect()
    }

    /// What the experts change in a layer, after what the first ones do, and where its brightness
    /// lies by what the last one says.
    fn estimate(
        &self,
        strip: &Strip<'_>,
        layers: &Layers,
        number: usize,
        mut changes: Vec<Vec<f32>>,
    ) -> Result<(Vec<Vec<f32>>, Vec<Place>), Failure> {
        let (grid, Layer { mean, root, .. }) = (strip.grid, &layers.parts[number]);
        let [albedo, normal] =
            [&layers.albedo, &layers.normal].map(|it| it.as_ref().map(Feature::seen));
        let (samples, unit) = (layers.samples, self.unit);
        let seen = SeenPicture { grid, samples, unit, mean, root, albedo, normal };
        let mean = grid.inner(mean);
        for (expert, it) in self.experts.iter().enumerate() {
            if number == EMITTED && !it.estimates_emission() {
                continue;
            }
            let mut estimates = vec![0.0; mean.len()];
            it.estimate(&seen, &mut estimates).map_err(|error| Failure { expert, error })?;
            // Most pixels see no lamp, and nothing is reflected where no surface is.
            let sees_nothing = |pixel| number == EMITTED || layers.sees_no_surface(pixel);
            believed_changes(grid, sees_nothing, &layers.parts[number].mean, &mut estimates);
            changes.push(estimates);
        }
        let places = self.places(&mean, changes.last(), grid.channels());
        Ok((changes, places))
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

//! The guard over experts that look at neighbours: filters and denoisers.
//!
//! It is the guard of [lanes](super), with other lanes that are alike: those near each other in
//! the picture, and as bright. The sums A and b are in cells of a few pixels and steps of
//! brightness, smoothed over both (a *bilateral grid*: Chen, Paris, Durand, *Real-time
//! Edge-aware Image Processing with the Bilateral Grid*, SIGGRAPH 2007), with a little of the
//! whole picture's sums at the same brightness. The weights that follow are interpolated.
//!
//! The blend of the guard of lanes is one expert. It was learnt from the other half of the
//! chessboard, so that without a group of a lane's folds it knows nothing of that group.
//!
//! Emission that the camera sees directly is a layer with sums and weights of its own.

mod cells;
mod layers;
mod seen;
mod simplex;
mod weights;

use rayon::prelude::*;

use cells::{BRIGHTNESS, Cells, Division, Held, Rows};
use layers::{Feature, Layer, Layers, Strip};
pub use seen::{PictureExpert, SeenFeature, SeenPicture};
use simplex::MOST;
use weights::{Gain, Weights};

use super::{
    FittedGuard, Guard, Judgement, hats::Place, judge::interval, logarithm::ln, sample::GROUPS,
    seen::STATISTICS,
};
use crate::{
    Error, Estimates, FOLDS, Fitted, Requirements, SequenceBatch, Side, Status, Strips, Support,
    Transform,
};

/// What the blend of the guard of lanes is called.
const LANE: &str = "lane";

/// Below this brightness, relative to the mean of the picture, all is alike.
const FLOOR: f32 = 0.01;

/// The features that are read where there are any: by fold, as they are as noisy as radiance where
/// a pixel sees several surfaces.
const FEATURES: &[Side] = Side::FEATURES.split_at(4).1;

/// Blends the plain estimate with experts that look at neighbours, and with the [`Guard`] of
/// lanes, as far as samples that were held out support it. Without a [`Grid`](crate::Grid), it
/// is that guard alone.
pub struct PictureGuard {
    lane: Guard,
    /// Whether the guard of lanes is one of the experts.
    blends_lane: bool,
    experts: Vec<Box<dyn PictureExpert>>,
}

/// A [`PictureGuard`] that has measured its experts on a picture.
struct FittedPicture<'a> {
    lane: FittedGuard<'a>,
    blends_lane: bool,
    experts: Vec<&'a dyn PictureExpert>,
    /// How many samples are in each fold.
    counts: [f64; FOLDS],
    unit: f64,
    /// Of the reflected layer, and of the emitted one if there is one.
    weights: Vec<Weights>,
    judgement: Judgement,
}

impl PictureGuard {
    /// The most experts that look at neighbours.
    pub const MOST_EXPERTS: usize = MOST - 1;

    /// A guard over these experts and the blend of a guard of lanes.
    ///
    /// # Errors
    /// [`Error::Batch`] if there are too many.
    pub fn new(lane: Guard, experts: Vec<Box<dyn PictureExpert>>) -> Result<Self, Error> {
        if experts.len() > Self::MOST_EXPERTS {
            let (count, most) = (experts.len(), Self::MOST_EXPERTS);
            let message =
                format!("{count} experts that look at neighbours; at most {most} can be blended");
            return Err(Error::Batch(message));
        }
        Ok(Self { lane, blends_lane: true, experts })
    }

    /// The same without the blend of the guard of lanes.
    #[must_use]
    pub fn without_lane(self) -> Self {
        Self { blends_lane: false, ..self }
    }

    /// How many rows beside a strip its experts read.
    fn halo(&self) -> u32 {
        let halo = |expert: &Box<dyn PictureExpert>| match expert.support() {
            Support::Radius(radius) => radius,
            Support::Lane | Support::Pixel | Support::Picture => 0,
        };
        self.experts.iter().map(halo).max().unwrap_or(0)
    }

    /// Measures the experts on all strips; the number of the one that fails, if one does.
    fn measure<'a>(
        &self,
        fitted: &FittedPicture<'a>,
        strips: &mut dyn Strips,
        pixels: usize,
    ) -> Result<Result<Vec<Cells>, Failure>, Error> {
        let mut cells: Vec<Cells> = Vec::new();
        strips.rewind(self.halo())?;
        while let Some(batch) = strips.next_strip()? {
            let strip = Strip::new(&batch).expect("the guard of lanes has seen folds");
            let width = strip.grid.width();
            let views = (0..=GROUPS).map(|group| fitted.look(&strip, group));
            let views = match views.collect::<Result<Vec<_>, _>>() {
                Ok(views) => views,
                Err(failure) => return Ok(Err(failure)),
            };
            if cells.is_empty() {
                let division = Division::new(width, pixels / width);
                cells.resize_with(views[0].len(), || Cells::new(division));
            }
            let inner = strip.grid.inner_rows();
            let halves = batch.halves(inner.start * width..inner.end * width);
            for (layer, cells) in cells.iter_mut().enumerate() {
                let rows = Rows {
                    width,
                    channels: strip.grid.channels(),
                    first: strip.grid.first_row() as usize + inner.start,
                    halves: &halves,
                    held: std::array::from_fn(|group| &views[group][layer]),
                };
                cells.add(&rows, &fitted.counts);
            }
        }
        Ok(Ok(cells))
    }
}

/// An expert that could not estimate.
struct Failure {
    /// Its number.
    expert: usize,
    error: Error,
}

impl Transform for PictureGuard {
    fn requires(&self) -> Requirements {
        let whole = self.experts.iter().any(|expert| expert.support() == Support::Picture);
        let support = if whole { Support::Picture } else { Support::Radius(self.halo()) };
        Requirements { support, optional: FEATURES, powers: self.lane.powers(), ..STATISTICS }
    }

    fn fit<'a>(&'a self, strips: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        let lane = self.lane.measure(strips)?;
        strips.rewind(0)?;
        let has_grid = strips.next_strip()?.is_some_and(|strip| strip.grid().is_some());
        let learnt = lane.learnt.as_ref().ok().filter(|_| has_grid);
        let Some((counts, unit, pixels)) = learnt.map(|it| (it.counts, it.unit, it.pixels)) else {
            return Ok(Box::new(lane));
        };
        let judgement = Judgement::default();
        let experts = self.experts.iter().map(|expert| &**expert).collect();
        let (blends_lane, weights) = (self.blends_lane, Vec::new());
        let mut fitted =
            FittedPicture { lane, blends_lane, experts, counts, unit, weights, judgement };
        let mut notes = fitted.lane.judgement().notes.clone();
        let cells = loop {
            match self.measure(&fitted, strips, pixels)? {
                Ok(cells) => break cells,
                Err(Failure { expert, error }) => {
                    let expert = fitted.experts.remove(expert);
                    notes.push(format!("'{}' is left out: {}", expert.name(), reason(error)));
                }
            }
        };
        let counts_of_experts = [fitted.names().len(), fitted.names_of_emission().len()];
        let fits = cells.iter().zip(counts_of_experts);
        let (weights, gains): (Vec<_>, Vec<_>) =
            fits.map(|(cells, count)| Weights::fit(cells, count)).unzip();
        fitted.weights = weights;
        fitted.judgement = fitted.judge(&gains, notes);
        Ok(Box::new(fitted))
    }
}

/// What an error says of an expert.
fn reason(error: Error) -> String {
    match error {
        Error::Batch(why) => why,
        error => error.to_string(),
    }
}

impl FittedPicture<'_> {
    /// The experts of the reflected layer.
    fn names(&self) -> Vec<&str> {
        let lane = self.blends_lane.then_some(LANE);
        lane.into_iter().chain(self.experts.iter().map(|expert| expert.name())).collect()
    }

    /// Those of the emitted one.
    fn names_of_emission(&self) -> Vec<&str> {
        let lane = self.blends_lane.then_some(LANE);
        let experts = self.experts.iter().filter(|expert| expert.estimates_emission());
        lane.into_iter().chain(experts.map(|expert| expert.name())).collect()
    }

    /// What the experts change in the inner rows of a strip, in each layer, without a group; with
    /// what is missing, if there is such a group.
    fn look(&self, strip: &Strip<'_>, group: usize) -> Result<Vec<Held>, Failure> {
        let mut layers = strip.layers(&self.counts, group);
        let missing =
            if group < GROUPS { strip.missing(group, &layers) } else { Default::default() };
        let [of_reflected, of_emitted] = missing;
        let emitted = layers.emitted.take();
        let mut lane = if self.blends_lane {
            vec![self.lane.changes(strip.batch, strip.grid, group)]
        } else {
            Vec::new()
        };
        let mut lane_of_emission = lane.clone();
        if let Some(emitted) = &emitted {
            let emission = strip.grid.inner(&emitted.mean);
            let pixels = emission.len() / strip.grid.channels();
            for pixel in 0..pixels {
                let lanes = (pixel..emission.len()).step_by(pixels);
                let emits = lanes.clone().any(|lane| emission[lane] != 0.0);
                let without = if emits { &mut lane } else { &mut lane_of_emission };
                without.iter_mut().for_each(|it| lanes.clone().for_each(|lane| it[lane] = 0.0));
            }
        }
        let reflected =
            self.held(strip, &layers, &layers.reflected, of_reflected, lane, |_| true)?;
        let mut held = vec![reflected];
        if let Some(emitted) = &emitted {
            let of_emission = |expert: &dyn PictureExpert| expert.estimates_emission();
            let experts = lane_of_emission;
            held.push(self.held(strip, &layers, emitted, of_emitted, experts, of_emission)?);
        }
        Ok(held)
    }

    /// The same for a layer, and for some experts.
    fn held(
        &self,
        strip: &Strip<'_>,
        layers: &Layers,
        layer: &Layer,
        missing: Vec<f32>,
        mut changes: Vec<Vec<f32>>,
        takes_part: impl Fn(&dyn PictureExpert) -> bool,
    ) -> Result<Held, Failure> {
        let (grid, samples) = (strip.grid, layer.samples);
        let Layer { mean, root, .. } = layer;
        let [albedo, normal] =
            [&layers.albedo, &layers.normal].map(|it| it.as_ref().map(Feature::seen));
        let seen = SeenPicture { grid, samples, unit: self.unit, mean, root, albedo, normal };
        let mean = grid.inner(mean);
        let guide = changes.len();
        for (number, expert) in self.experts.iter().enumerate().filter(|it| takes_part(*it.1)) {
            let mut estimates = vec![0.0; mean.len()];
            let failure = |error| Failure { expert: number, error };
            expert.estimate(&seen, &mut estimates).map_err(failure)?;
            for (estimate, mean) in estimates.iter_mut().zip(&*mean) {
                let change = *estimate - mean;
                *estimate = if change.is_finite() { change } else { 0.0 };
            }
            changes.push(estimates);
        }
        let places = self.places(&mean, changes.get(guide).or(changes.first()), grid.channels());
        Ok(Held { changes, missing, places })
    }

    /// Where the brightness of pixels lies by what an expert changes in a layer.
    fn places(&self, mean: &[f32], changes: Option<&Vec<f32>>, channels: usize) -> Vec<Place> {
        let pixels = mean.len() / channels;
        let mut sums = vec![0.0; pixels];
        for lanes in [Some(mean), changes.map(Vec::as_slice)].into_iter().flatten() {
            for plane in lanes.chunks_exact(pixels) {
                sums.iter_mut().zip(plane).for_each(|(sum, x)| *sum += x);
            }
        }
        let scale = 1.0 / (channels as f32 * self.unit as f32);
        let place = |sum: f32| BRIGHTNESS.place(ln((scale * sum).max(0.0) + FLOOR));
        sums.into_iter().map(place).collect()
    }

    /// What the weights of both layers gain.
    fn judge(&self, gains: &[Gain], notes: Vec<String>) -> Judgement {
        let mut blocks = gains[0].blocks.clone();
        for gain in &gains[1..] {
            let pairs = blocks.iter_mut().flatten().zip(gain.blocks.iter().flatten());
            pairs.for_each(|(sum, more)| *sum += more);
        }
        let samples = self.counts.iter().sum();
        let trusted = gains.iter().flat_map(|gain| gain.trust).any(|trust| trust > 0.0);
        let (ratio, interval) = interval(&blocks, samples, trusted);
        let names = self.names().into_iter().map(str::to_owned);
        Judgement { experts: names.zip(gains[0].trust).collect(), ratio, interval, notes }
    }

    /// Writes the estimates of the inner rows of a strip.
    fn estimate(&self, strip: &Strip<'_>, layers: &[Held], out: &mut Estimates) {
        let (grid, inner) = (strip.grid, strip.grid.inner_rows());
        let (width, channels, pixels) = (grid.width(), grid.channels(), inner.len() * grid.width());
        let last = grid.inner(strip.batch.last());
        let variances = strip.variances();
        let halves = strip.batch.halves(inner.start * width..inner.end * width);
        let first_row = grid.first_row() as usize + inner.start;
        let (values, status, errors) = out.reset_with_errors(last.len());
        let mut rows: Vec<Vec<_>> = (0..inner.len()).map(|_| Vec::new()).collect();
        let planes = values.chunks_mut(pixels).zip(status.chunks_mut(pixels));
        for ((values, status), errors) in planes.zip(errors.chunks_mut(pixels)) {
            let parts = values.chunks_mut(width).zip(status.chunks_mut(width));
            let parts = parts.zip(errors.chunks_mut(width));
            rows.iter_mut().zip(parts).for_each(|(row, ((v, s), e))| row.push((v, s, e)));
        }
        rows.into_par_iter().enumerate().for_each(|(y, mut of_channels)| {
            for x in 0..width {
                let pixel = y * width + x;
                let half = usize::from(halves[pixel]);
                let mut error = 0.0;
                let mut changes = vec![0.0; channels];
                for (layer, weights) in layers.iter().zip(&self.weights) {
                    let place = layer.places[pixel];
                    let (w, variance) = weights.at(x, first_row + y, half, place);
                    if variance > 0.0 {
                        error += variance;
                    }
                    for (channel, sum) in changes.iter_mut().enumerate() {
                        let lane = channel * pixels + pixel;
                        let experts = layer.changes.iter().zip(w);
                        *sum += experts.map(|(lanes, w)| w * lanes[lane]).sum::<f32>();
                    }
                }
                let shares = (0..channels).map(|channel| variances[channel * pixels + pixel]);
                let sum: f32 = shares.sum();
                for (channel, (values, status, errors)) in of_channels.iter_mut().enumerate() {
                    let lane = channel * pixels + pixel;
                    let share =
                        if sum > 0.0 { channels as f32 * variances[lane] / sum } else { 1.0 };
                    (values[x], errors[x]) =
                        (last[lane] + changes[channel], (error * share).sqrt());
                    if !values[x].is_finite() {
                        (values[x], status[x], errors[x]) =
                            (last[lane], Status::NotFinite, f32::NAN);
                    }
                }
            }
        });
    }
}

impl Fitted for FittedPicture<'_> {
    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let Some(strip) = Strip::new(batch) else {
            out.fall_back(batch, Status::NoFolds);
            return Ok(());
        };
        match self.look(&strip, GROUPS) {
            Ok(layers) => self.estimate(&strip, &layers, out),
            Err(_) => {
                out.fall_back(batch, Status::ExpertFailed);
                out.errors_unknown();
            }
        }
        Ok(())
    }

    fn estimates_errors(&self) -> bool {
        true
    }

    fn judgement(&self) -> Option<&Judgement> {
        Some(&self.judgement)
    }
}

//! The guard: blends any estimates with the plain one, and measures what that gains, without a
//! reference.
//!
//! The samples of a lane are in four folds. Without fold j, an expert E gives E_j, and the
//! plain mean of the same samples is S_j. The mean h_j of the fold held out has the
//! expectation I, and is independent of both. So for lanes that are alike, with the changes
//! d_j = E_j − S_j of all experts,
//!
//! ```text
//! A = Σ d_j d_jᵀ,   b = Σ d_j (h_j − S_j),   E[b] = E[Σ d_j (I − S_j)],
//! ```
//!
//! and the weights w = argmin wᵀA w − 2 bᵀw, w ≥ 0, Σw ≤ 1 estimate the best blend T = S + Σ w
//! (E − S), where E and S see all folds. An expert with the bias β beside S of the variance V
//! gets a weight of about V/(V + β²): much at few samples, nothing at many, so that T
//! converges with S whatever the experts do.
//!
//! Lanes are alike if their brightness is. Pixels are split as on a chessboard: what is learnt
//! from one half is applied to the other, so that the same sums say what T gains there.

mod hats;
mod judge;
mod regression;
mod sample;
mod seen;
mod simplex;
mod table;
mod view;
mod weights;

use rayon::prelude::*;

pub use judge::Judgement;
use judge::judge;
use regression::Regressions;
use sample::{GROUPS, LaneMeans, Sample, sides};
pub use seen::{Expert, OfTransform, Seen};
use simplex::MOST;
use table::Table;
use view::{Lanes, Numbers, View};
use weights::{Changes, Weights, strata};

use crate::{
    Error, Estimates, FOLDS, Fitted, Requirements, SequenceBatch, Side, Status, Strips, Support,
    Transform,
};

/// Lanes per task of the thread pool when estimates are made.
const CHUNK: usize = 4096;

/// What the guard calls the experts that learn from the batch itself.
const CORRECTIONS: [&str; 3] = ["relative regression", "regression", "table"];

/// Blends the plain estimate with experts as far as samples that were held out support it.
/// Three more experts, two regressions and a table of corrections, are learnt from the batch
/// itself.
#[derive(Default)]
pub struct Guard {
    experts: Vec<Box<dyn Expert>>,
}

/// A [`Guard`] that has measured its experts on a batch.
pub struct FittedGuard<'a> {
    experts: Vec<&'a dyn Expert>,
    /// Or why all lanes keep the plain estimate.
    learnt: Result<Learnt, Status>,
    judgement: Judgement,
}

/// What is learnt from a batch.
struct Learnt {
    corrections: Corrections,
    weights: Weights,
    /// The mean of |S| over all lanes.
    unit: f64,
    /// How many samples are in each fold.
    counts: [f64; FOLDS],
}

/// The experts that learn from the batch.
struct Corrections {
    regressions: Regressions,
    table: Table,
}

impl Corrections {
    /// The changes of a lane whose pixel is in this half, by what the other half teaches, in the
    /// order of [`CORRECTIONS`].
    fn changes(&self, unit: f64, numbers: &Numbers, half: usize) -> [f64; CORRECTIONS.len()] {
        let [relative, absolute] = self.regressions.changes(unit, numbers, half);
        [relative, absolute, self.table.change(numbers, half)]
    }

    /// Those of all lanes, `[expert][lane]`.
    fn of_lanes(&self, sample: &Sample, lanes: &Lanes) -> [Vec<f32>; CORRECTIONS.len()] {
        let of_lane = |(lane, numbers): (usize, &Numbers)| {
            let half = sample.pixels[lane / sample.channels].half;
            self.changes(lanes.unit, numbers, half).map(|change| change as f32)
        };
        let all: Vec<_> = lanes.numbers.par_iter().enumerate().map(of_lane).collect();
        std::array::from_fn(|k| all.iter().map(|changes| changes[k]).collect())
    }
}

impl Guard {
    /// A guard over these experts and those that learn from the batch.
    ///
    /// # Errors
    /// [`Error::Batch`] if there are too many.
    pub fn new(experts: Vec<Box<dyn Expert>>) -> Result<Self, Error> {
        const MOST_EXPERTS: usize = MOST - CORRECTIONS.len();
        if experts.len() > MOST_EXPERTS {
            let message =
                format!("{} experts; at most {MOST_EXPERTS} can be blended", experts.len());
            return Err(Error::Batch(message));
        }
        Ok(Self { experts })
    }

    /// As [`Transform::fit`], with what the guard has found.
    ///
    /// # Errors
    /// Those of `strips`.
    pub fn measure<'a>(&'a self, strips: &mut dyn Strips) -> Result<FittedGuard<'a>, Error> {
        let plain = |status: Status, why: &str| FittedGuard {
            experts: Vec::new(),
            learnt: Err(status),
            judgement: Judgement::plain(why),
        };
        let Some(sample) = Sample::take(strips)? else {
            let why = "there are no statistics of four folds, as of snapshots, old files, or fewer \
                       than four samples, so nothing can be held out";
            return Ok(plain(Status::NoFolds, why));
        };
        if sample.counts.contains(&0.0) {
            let why = "there are fewer than four samples, so nothing can be held out";
            return Ok(plain(Status::TooShort, why));
        }
        if !sample.units.iter().all(|unit| *unit > 0.0 && unit.is_finite()) {
            return Ok(plain(Status::Constant, "all estimates are 0"));
        }
        let views: Vec<View> = (0..=GROUPS)
            .into_par_iter()
            .map(|group| View::new(&sample.lanes, &sample.counts, group, sample.units[group]))
            .collect();
        let missing = missing(&sample, &views[..GROUPS]);
        let lanes: Vec<Lanes> = views.iter().map(Lanes::of).collect();
        let held_out = &lanes[..GROUPS];
        let corrections = Corrections {
            regressions: Regressions::fit(&sample, held_out, &missing),
            table: Table::fit(&sample, held_out, &missing),
        };
        let mut changes = vec![Vec::new(); CORRECTIONS.len()];
        for lanes in &lanes {
            let of_view = corrections.of_lanes(&sample, lanes);
            changes.iter_mut().zip(of_view).for_each(|(changes, of_view)| changes.push(of_view));
        }
        let mut notes = Vec::new();
        let mut experts: Vec<&dyn Expert> = Vec::new();
        for expert in &self.experts {
            match views.iter().map(|view| change(&**expert, view)).collect() {
                Ok(found) => {
                    experts.push(&**expert);
                    changes.push(found);
                }
                Err(error) => notes.push(format!("'{}' is left out: {error}", expert.name())),
            }
        }
        let changes = Changes::new(&sample, &lanes, &missing, changes);
        let weights = Weights::fit(&changes);
        let names = CORRECTIONS.into_iter().chain(experts.iter().map(|expert| expert.name()));
        let judgement = judge(&changes, &weights, names.map(str::to_owned).collect(), notes);
        let (unit, counts) = (sample.units[GROUPS], sample.counts);
        let learnt = Learnt { corrections, weights, unit, counts };
        Ok(FittedGuard { experts, learnt: Ok(learnt), judgement })
    }
}

/// The means of the groups held out minus the plain estimates of the others, `[group][lane]`.
fn missing(sample: &Sample, views: &[View]) -> Vec<Vec<f32>> {
    let of_group = |(group, view): (usize, &View)| {
        let lanes = sample.lanes.iter().zip(&view.mean);
        lanes.map(|(lane, mean)| lane[0][group] - mean).collect()
    };
    views.par_iter().enumerate().map(of_group).collect()
}

/// What an expert changes, 0 where that is not finite.
fn change(expert: &dyn Expert, view: &View) -> Result<Vec<f32>, Error> {
    let mut estimates = vec![0.0; view.mean.len()];
    expert.estimate(&view.seen(), &mut estimates)?;
    for (estimate, mean) in estimates.iter_mut().zip(&view.mean) {
        let change = *estimate - mean;
        *estimate = if change.is_finite() { change } else { 0.0 };
    }
    Ok(estimates)
}

impl FittedGuard<'_> {
    /// What was found out about the experts.
    #[must_use]
    pub fn judgement(&self) -> &Judgement {
        &self.judgement
    }

    /// The estimates of some lanes.
    fn estimate(
        &self,
        learnt: &Learnt,
        chunk: &Chunk<'_>,
        values: &mut [f32],
        status: &mut [Status],
    ) -> Result<(), Error> {
        let Learnt { corrections, weights, unit, counts } = learnt;
        let mut view = View::new(&chunk.lanes, counts, GROUPS, *unit);
        view.mean.copy_from_slice(chunk.last);
        let changes = self.experts.iter().map(|expert| change(*expert, &view));
        let changes = changes.collect::<Result<Vec<_>, _>>()?;
        for (lane, value) in values.iter_mut().enumerate() {
            let plain = f64::from(chunk.last[lane]);
            if !chunk.lanes[lane].iter().flatten().all(|x| x.is_finite()) || !plain.is_finite() {
                (*value, status[lane]) = (chunk.last[lane], Status::NotFinite);
                continue;
            }
            let half = chunk.strip.half(chunk.first + lane);
            let numbers = view.numbers(lane);
            let mut d = [0.0; MOST];
            let corrected = corrections.changes(*unit, &numbers, half).into_iter();
            let all = corrected.chain(changes.iter().map(|change| f64::from(change[lane])));
            d.iter_mut().zip(all).for_each(|(d, change)| *d = change);
            let w = weights.at(strata(*unit, &numbers, d[0]), half);
            let blend = plain + d.iter().zip(w).map(|(d, w)| d * w).sum::<f64>();
            *value = blend as f32;
            if !value.is_finite() {
                (*value, status[lane]) = (chunk.last[lane], Status::NotFinite);
            }
        }
        Ok(())
    }
}

/// Lanes of a strip that follow each other.
struct Chunk<'a> {
    strip: &'a SequenceBatch,
    first: usize,
    last: &'a [f32],
    lanes: Vec<LaneMeans>,
}

impl Transform for Guard {
    fn requires(&self) -> Requirements {
        Requirements { window: 1, sides: Side::EVERY_OF_FOLDS, support: Support::Lane, fits: true }
    }

    fn fit<'a>(&'a self, strips: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        Ok(Box::new(self.measure(strips)?))
    }
}

impl Fitted for FittedGuard<'_> {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let (learnt, sides) = match (&self.learnt, sides(strip)) {
            (Ok(learnt), Some(sides)) => (learnt, sides),
            (Ok(_), None) => {
                out.fall_back(strip, Status::NoFolds);
                return Ok(());
            }
            (Err(status), _) => {
                out.fall_back(strip, *status);
                return Ok(());
            }
        };
        let (values, status) = out.reset(strip.lanes());
        let chunks = values.par_chunks_mut(CHUNK).zip(status.par_chunks_mut(CHUNK));
        chunks.enumerate().try_for_each(|(number, (values, status))| {
            let first = number * CHUNK;
            let range = first..first + values.len();
            let lane = |lane: usize| sides.map(|folds| folds.map(|fold| fold[lane]));
            let lanes = range.clone().map(lane).collect();
            let chunk = Chunk { strip, first, last: &strip.last()[range], lanes };
            self.estimate(learnt, &chunk, values, status)
        })
    }

    fn judgement(&self) -> Option<&Judgement> {
        Some(&self.judgement)
    }
}

#[cfg(test)]
mod tests;

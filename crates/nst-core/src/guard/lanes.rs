//! The guard over experts that look at lanes one by one.

use std::ops::Range;

use rayon::prelude::*;

use super::{
    judge::{ErrorRatios, Judgement, judge},
    refit::{Adapting, Refit},
    regression::Regressions,
    sample::{
        CHUNK, FoldMeans, FurtherMeans, GROUPS, Sample, fold_means, further_means, inner_planes,
        of_inner, part_of,
    },
    seen::{Expert, STATISTICS, left_out, to_changes},
    simplex::MOST,
    table::Table,
    view::{Lanes, View},
    weights::{CORRECTIONS, Changes, Strata, Weights, strata},
};
use crate::{
    Error, Estimates, FOLDS, Fit, Fitted, FurtherPowers, Grid, Power, Requirements, SequenceBatch,
    Status, Strips, Transform,
};

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
    /// Those that were fitted again.
    refits: Vec<Refit<'a>>,
    /// Or why all lanes keep the plain estimate.
    learnt: Result<Learnt, Status>,
    judgement: Judgement,
}

/// What is learnt from a batch.
struct Learnt {
    corrections: Corrections,
    weights: Weights,
    errors: ErrorRatios,
    /// The mean of |S| over the lanes that were learnt from.
    unit: f64,
    /// How many samples are in each fold.
    counts: [f64; FOLDS],
    /// Further powers that experts see.
    powers: Vec<Power>,
    /// How many pixels the batch has.
    pixels: usize,
    /// Whether they are those of a picture.
    has_grid: bool,
}

/// The experts that learn from the batch.
struct Corrections {
    regressions: Regressions,
    table: Table,
}

impl Corrections {
    /// What they change, in the order of [`CORRECTIONS`], `[expert][lane]`, by the half that each
    /// lane is in: the other half teaches.
    fn changes(&self, lanes: &Lanes, halves: &[u8]) -> Vec<Vec<f32>> {
        let [relative, absolute] = self.regressions.changes(lanes, halves);
        let mut changes = vec![relative, absolute, self.table.changes(lanes, halves)];
        changes.iter_mut().for_each(|changes| lanes.bound(changes));
        changes
    }
}

impl Guard {
    /// The most experts beside those that learn from the batch. One that
    /// [adapts](Expert::adapts) counts twice: as itself, and fitted again.
    pub const MOST_EXPERTS: usize = MOST - CORRECTIONS.len();

    /// A guard over these experts and those that learn from the batch.
    ///
    /// # Errors
    /// [`Error::Batch`] if there are too many.
    pub fn new(experts: Vec<Box<dyn Expert>>) -> Result<Self, Error> {
        const MOST_EXPERTS: usize = Guard::MOST_EXPERTS;
        let adapting = experts.iter().filter(|expert| expert.adapts().is_some()).count();
        if experts.len() + adapting > MOST_EXPERTS {
            let message = format!(
                "{} experts, {adapting} of them also refitted; at most {MOST_EXPERTS} can be blended",
                experts.len()
            );
            return Err(Error::Batch(message));
        }
        Ok(Self { experts })
    }

    /// As [`Transform::fit`], with what the guard has found.
    ///
    /// # Errors
    /// Those of `strips`.
    pub fn measure<'a>(&'a self, strips: &mut dyn Strips) -> Result<FittedGuard<'a>, Error> {
        self.measure_within(strips, 0)
    }

    /// The same of strips that are read with a halo, as others read them.
    pub(super) fn measure_within<'a>(
        &'a self,
        strips: &mut dyn Strips,
        halo: u32,
    ) -> Result<FittedGuard<'a>, Error> {
        let mut sample = Sample::new(self.powers());
        sample.add_all(strips, halo)?;
        Ok(self.learn(sample))
    }

    /// Learns from a sample of all strips.
    fn learn(&self, sample: Sample) -> FittedGuard<'_> {
        let plain = |status: Status, why: &str| FittedGuard {
            experts: Vec::new(),
            refits: Vec::new(),
            learnt: Err(status),
            judgement: Judgement::plain(why),
        };
        let sample = match sample.finish() {
            Ok(sample) => sample,
            Err(status) => {
                let why = match status {
                    Status::NoFolds => {
                        "there are no statistics of four folds, as of snapshots, old files, or fewer \
                         than four samples, so nothing can be held out"
                    }
                    Status::TooShort => {
                        "there are fewer than four samples, so nothing can be held out"
                    }
                    _ => "no pixel has folds that are finite, and whose squares are",
                };
                return plain(status, why);
            }
        };
        let views: Vec<View> = (0..=GROUPS)
            .into_par_iter()
            .map(|group| View::new(&sample.means(), &sample.further(), &sample.counts, group, None))
            .collect();
        if !views.iter().all(|view| view.unit > 0.0 && view.unit.is_finite()) {
            return plain(Status::Constant, "all estimates are 0");
        }
        let missing = missing(&sample, &views[..GROUPS]);
        let Asked { experts, changes: of_experts, adapting, notes } = self.ask(&views);
        let (unit, counts) = (views[GROUPS].unit, sample.counts);
        let lanes: Vec<Lanes> = views.into_par_iter().map(View::lanes).collect();
        let held_out = &lanes[..GROUPS];
        let corrections = Corrections {
            regressions: Regressions::fit(&sample, held_out, &missing),
            table: Table::fit(&sample, held_out, &missing),
        };
        let refit = |adapting| Refit::fit(adapting, &sample, held_out, &missing);
        let refits: Vec<Refit<'_>> = adapting.iter().map(refit).collect();
        let halves = sample.halves();
        let half = |lane: usize| usize::from(halves[lane]);
        let of_corrections = lanes.par_iter().map(|lanes| corrections.changes(lanes, &halves));
        let mut changes: Vec<Vec<Vec<f32>>> = of_corrections.collect();
        changes.iter_mut().zip(of_experts).for_each(|(all, of_experts)| all.extend(of_experts));
        for (refit, adapting) in refits.iter().zip(&adapting) {
            let all = changes.iter_mut().zip(&adapting.of_views);
            all.for_each(|(all, features)| all.push(refit.changes(features, half)));
        }
        let changes = Changes::new(&sample, &lanes, &missing, &changes);
        let weights = Weights::fit(&changes);
        let names = CORRECTIONS.into_iter().chain(experts.iter().map(|expert| expert.name()));
        let names = names.chain(refits.iter().map(|refit| refit.name.as_str()));
        let (judgement, errors) =
            judge(&changes, &weights, names.map(str::to_owned).collect(), notes);
        let powers = sample.further().into_iter().map(|(power, _)| power).collect();
        let (pixels, has_grid) = (sample.pixels_of_batch(), sample.has_grid);
        let learnt =
            Learnt { corrections, weights, errors, unit, counts, powers, pixels, has_grid };
        FittedGuard { experts, refits, learnt: Ok(learnt), judgement }
    }

    /// The powers that experts need beside those that all batches have.
    pub(super) fn powers(&self) -> FurtherPowers {
        let experts = self.experts.iter().map(|expert| FurtherPowers::of(expert.powers()));
        experts.fold(FurtherPowers::NONE, FurtherPowers::with)
    }

    /// Asks all experts about views.
    fn ask(&self, views: &[View]) -> Asked<'_> {
        let mut asked = Asked { changes: vec![Vec::new(); views.len()], ..Asked::default() };
        for expert in &self.experts {
            let expert = &**expert;
            let changes: Result<Vec<_>, _> =
                views.iter().map(|view| change(expert, view)).collect();
            match changes.and_then(|changes| Ok((changes, Adapting::ask(expert, views)?))) {
                Ok((changes, adapting)) => {
                    asked.experts.push(expert);
                    let all = asked.changes.iter_mut().zip(changes);
                    all.for_each(|(all, changes)| all.push(changes));
                    asked.adapting.extend(adapting);
                }
                Err(error) => asked.notes.push(left_out(expert.name(), error)),
            }
        }
        asked
    }
}

/// What experts say of views.
#[derive(Default)]
struct Asked<'a> {
    /// Those that did not fail.
    experts: Vec<&'a dyn Expert>,
    /// What they change, `[view][expert][lane]`.
    changes: Vec<Vec<Vec<f32>>>,
    adapting: Vec<Adapting<'a>>,
    /// Why others failed.
    notes: Vec<String>,
}

/// The means of the groups held out minus the plain estimates of the others, `[group][lane]`.
fn missing(sample: &Sample, views: &[View]) -> Vec<Vec<f32>> {
    let [means, ..] = sample.means();
    let of_group = |(group, view): (usize, &View)| {
        means[group].iter().zip(&view.mean).map(|(held_out, mean)| held_out - mean).collect()
    };
    views.par_iter().enumerate().map(of_group).collect()
}

/// What an expert changes, 0 where that is not finite.
fn change(expert: &dyn Expert, view: &View) -> Result<Vec<f32>, Error> {
    let mut estimates = vec![0.0; view.mean.len()];
    expert.estimate(&view.seen(), &mut estimates)?;
    to_changes(&mut estimates, &view.mean);
    Ok(estimates)
}

impl FittedGuard<'_> {
    /// What was found out about the experts.
    #[must_use]
    pub fn judgement(&self) -> &Judgement {
        &self.judgement
    }

    /// The same with a further note.
    pub(super) fn noting(mut self, note: String) -> Self {
        self.judgement.notes.push(note);
        self
    }

    /// What the blend changes in the lanes of the inner rows of a strip, without a group of folds;
    /// 0 where it fails. That group has taught nothing of it: the other half of the chessboard has.
    pub(super) fn changes(&self, strip: &SequenceBatch, grid: &Grid, group: usize) -> Vec<f32> {
        let statistics =
            self.learnt.as_ref().ok().and_then(|learnt| Statistics::new(learnt, strip));
        of_inner(grid, |lanes, changes| {
            let Some(statistics) = &statistics else { return };
            let Ok(blend) = self.blend(group, &statistics.of(lanes)) else { return };
            changes.copy_from_slice(&blend.values);
            to_changes(changes, &blend.lanes.mean);
            let unknown = changes.iter_mut().zip(blend.finite).filter(|(_, finite)| !finite);
            unknown.for_each(|(change, _)| *change = 0.0);
        })
    }

    /// The numbers of samples in the folds, the unit, and the number of the batch's pixels, if
    /// anything was learnt of a picture.
    pub(super) fn of_picture(&self) -> Option<([f64; FOLDS], f64, usize)> {
        let learnt = self.learnt.as_ref().ok().filter(|learnt| learnt.has_grid)?;
        Some((learnt.counts, learnt.unit, learnt.pixels))
    }

    /// Blends estimates of some lanes without a group; of all folds, if there is no such group.
    fn blend(&self, group: usize, chunk: &Chunk<'_>) -> Result<Blend, Error> {
        let Learnt { corrections, weights, unit, counts, .. } = chunk.learnt;
        let mut view = View::new(&chunk.means, &chunk.further, counts, group, Some(*unit));
        let finite = view.finite();
        if group == GROUPS {
            view.mean.copy_from_slice(chunk.last);
        }
        let of_experts = self.experts.iter().map(|expert| change(*expert, &view));
        let halves = &chunk.halves;
        let half = |lane: usize| usize::from(halves[lane]);
        let of_refits = self.refits.iter().map(|refit| refit.changes_of(&view, half));
        let of_experts = of_experts.chain(of_refits).collect::<Result<Vec<_>, _>>()?;
        let lanes = view.lanes();
        let mut changes = corrections.changes(&lanes, halves);
        changes.extend(of_experts);
        let strata = strata(&lanes, &changes[0]);
        let value = |(lane, &strata): (usize, &Strata)| {
            weights.blend(strata, half(lane), lanes.mean[lane], &changes, lane)
        };
        let values = strata.iter().enumerate().map(value).collect();
        Ok(Blend { values, finite, strata, lanes })
    }

    /// The estimates of all lanes of a strip, and their errors.
    fn estimate(&self, statistics: &Statistics<'_>, out: &mut Estimates) -> Result<(), Error> {
        let strip = statistics.strip;
        let (of_plane, starts) = strip.grid().map_or((strip.lanes(), vec![0]), inner_planes);
        let (values, status, errors) = out.reset_with_errors(of_plane * starts.len());
        let planes = values.par_chunks_mut(of_plane).zip(status.par_chunks_mut(of_plane));
        let planes = planes.zip(errors.par_chunks_mut(of_plane)).zip(starts);
        planes.try_for_each(|(((values, status), errors), start)| {
            let chunks = values.par_chunks_mut(CHUNK).zip(status.par_chunks_mut(CHUNK));
            let chunks = chunks.zip(errors.par_chunks_mut(CHUNK)).enumerate();
            chunks.try_for_each(|(number, ((values, status), errors))| {
                let first = start + number * CHUNK;
                let chunk = statistics.of(first..first + values.len());
                let blend = self.blend(GROUPS, &chunk)?;
                for (lane, value) in values.iter_mut().enumerate() {
                    if blend.finite[lane] && blend.values[lane].is_finite() {
                        *value = blend.values[lane];
                        errors[lane] = blend.error(lane, &chunk.learnt.errors);
                    } else {
                        (*value, status[lane]) = (chunk.last[lane], Status::NotFinite);
                    }
                }
                Ok(())
            })
        })
    }
}

/// What the guard says of some lanes, `[lane]`.
struct Blend {
    values: Vec<f32>,
    /// Whether all is finite that the values depend on.
    finite: Vec<bool>,
    strata: Vec<Strata>,
    lanes: Lanes,
}

impl Blend {
    /// The standard error of a value.
    fn error(&self, lane: usize, ratios: &ErrorRatios) -> f32 {
        self.lanes.variance[lane].sqrt() * ratios.at(self.strata[lane])
    }
}

/// A guard that takes its sample of strips as they come.
struct Learning<'a> {
    guard: &'a Guard,
    sample: Sample,
}

impl<'a> Fit<'a> for Learning<'a> {
    fn add(&mut self, strip: &SequenceBatch) -> Result<(), Error> {
        self.sample.add(strip);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Box<dyn Fitted + 'a>, Error> {
        Ok(Box::new(self.guard.learn(self.sample)))
    }
}

/// What is read of a strip.
struct Statistics<'a> {
    learnt: &'a Learnt,
    strip: &'a SequenceBatch,
    means: FoldMeans<'a>,
    further: FurtherMeans<'a>,
}

/// Lanes of a strip that follow each other.
struct Chunk<'a> {
    learnt: &'a Learnt,
    halves: Vec<u8>,
    last: &'a [f32],
    means: FoldMeans<'a>,
    further: FurtherMeans<'a>,
}

impl<'a> Statistics<'a> {
    /// `None` if the strip has no statistics of folds.
    fn new(learnt: &'a Learnt, strip: &'a SequenceBatch) -> Option<Self> {
        let further = further_means(strip, &learnt.powers);
        Some(Self { learnt, strip, means: fold_means(strip)?, further })
    }

    /// Those of some lanes.
    fn of(&self, lanes: Range<usize>) -> Chunk<'a> {
        Chunk {
            learnt: self.learnt,
            halves: self.strip.halves(lanes.clone()),
            means: self.means.map(|folds| folds.map(|fold| &fold[lanes.clone()])),
            further: part_of(&self.further, &lanes),
            last: &self.strip.last()[lanes],
        }
    }
}

impl Transform for Guard {
    fn requires(&self) -> Requirements {
        Requirements { powers: self.powers(), ..STATISTICS }
    }

    fn fit<'a>(&'a self, strips: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        Ok(Box::new(self.measure(strips)?))
    }

    fn start(&self) -> Option<Box<dyn Fit<'_> + '_>> {
        Some(Box::new(Learning { guard: self, sample: Sample::new(self.powers()) }))
    }
}

impl Fitted for FittedGuard<'_> {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let learnt = match &self.learnt {
            Ok(learnt) => learnt,
            Err(status) => {
                out.fall_back(strip, *status);
                return Ok(());
            }
        };
        let Some(statistics) = Statistics::new(learnt, strip) else {
            out.fall_back(strip, Status::NoFolds);
            return Ok(());
        };
        if self.estimate(&statistics, out).is_err() {
            out.fall_back(strip, Status::ExpertFailed);
            out.errors_unknown();
        }
        Ok(())
    }

    fn estimates_errors(&self) -> bool {
        self.learnt.is_ok()
    }

    fn judgement(&self) -> Option<&Judgement> {
        Some(&self.judgement)
    }
}

#[cfg(test)]
mod tests;

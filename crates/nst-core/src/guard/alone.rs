//! An expert without the guard.

use rayon::prelude::*;

use super::{
    sample::{CHUNK, GROUPS, Sample, fold_means, further_means, part_of},
    seen::{Expert, STATISTICS},
    view::View,
};
use crate::{
    Error, Estimates, FOLDS, Fit, Fitted, FurtherPowers, Power, Requirements, SequenceBatch,
    Status, Strips, Transform,
};

/// Estimates as an [`Expert`] makes them of all samples. Nothing measures whether they are better
/// than the plain ones: where that is not known, a [`Guard`](super::Guard) is for it. Lanes of which
/// all samples were 0 keep that, as most such lanes of pictures see no light at all.
pub struct Alone<E> {
    expert: E,
}

/// An expert, and what it must know of the batch as a whole.
struct FittedAlone<'a, E> {
    expert: &'a E,
    powers: Vec<Power>,
    /// How many samples are in each fold of a lane.
    counts: [f64; FOLDS],
    unit: f64,
}

/// An expert whose unit is taken from strips as they come.
struct Learning<'a, E> {
    expert: &'a E,
    powers: FurtherPowers,
    sample: Sample,
}

/// Why all lanes keep the plain estimate.
struct Plain(Status);

impl<E: Expert> Alone<E> {
    /// The expert's estimates.
    #[must_use]
    pub fn new(expert: E) -> Self {
        Self { expert }
    }

    fn powers(&self) -> FurtherPowers {
        FurtherPowers::of(self.expert.powers())
    }

    fn learning(&self) -> Learning<'_, E> {
        let powers = self.powers();
        Learning { expert: &self.expert, powers, sample: Sample::new(powers) }
    }
}

impl<E: Expert> Transform for Alone<E> {
    fn requires(&self) -> Requirements {
        Requirements { powers: self.powers(), ..STATISTICS }
    }

    /// Finds the unit, as the guard does.
    fn fit<'a>(&'a self, strips: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        let mut learning = self.learning();
        learning.sample.add_all(strips, 0)?;
        Box::new(learning).finish()
    }

    fn start(&self) -> Option<Box<dyn Fit<'_> + '_>> {
        Some(Box::new(self.learning()))
    }
}

impl<'a, E: Expert> Fit<'a> for Learning<'a, E> {
    fn add(&mut self, strip: &SequenceBatch) -> Result<(), Error> {
        self.sample.add(strip);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Box<dyn Fitted + 'a>, Error> {
        let Self { expert, powers, sample } = *self;
        let sample = match sample.finish() {
            Ok(sample) => sample,
            Err(status) => return Ok(Box::new(Plain(status))),
        };
        let view = View::new(&sample.means(), &Vec::new(), &sample.counts, GROUPS, None);
        if !(view.unit > 0.0 && view.unit.is_finite()) {
            return Ok(Box::new(Plain(Status::Constant)));
        }
        let (counts, unit) = (sample.counts, view.unit);
        Ok(Box::new(FittedAlone { expert, powers: powers.iter().collect(), counts, unit }))
    }
}

impl<E: Expert> FittedAlone<'_, E> {
    /// The estimates of some lanes, given as a view of all folds.
    fn estimate(
        &self,
        mut view: View,
        last: &[f32],
        values: &mut [f32],
        status: &mut [Status],
    ) -> Result<(), Error> {
        view.mean.copy_from_slice(last);
        let seen = view.seen();
        self.expert.estimate(&seen, values)?;
        for (lane, ((value, status), &plain)) in values.iter_mut().zip(status).zip(last).enumerate()
        {
            if [plain, seen.root[lane], seen.square[lane]] == [0.0; 3] {
                *value = plain;
            } else if !value.is_finite() {
                (*value, *status) = (plain, Status::NotFinite);
            }
        }
        Ok(())
    }
}

impl<E: Expert> Fitted for FittedAlone<'_, E> {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let Some(means) = fold_means(strip) else {
            out.fall_back(strip, Status::NoFolds);
            return Ok(());
        };
        let further = further_means(strip, &self.powers);
        let (values, status) = out.reset(strip.lanes());
        let chunks = values.par_chunks_mut(CHUNK).zip(status.par_chunks_mut(CHUNK));
        chunks.enumerate().try_for_each(|(number, (values, status))| {
            let first = number * CHUNK;
            let lanes = first..first + values.len();
            let means = means.map(|folds| folds.map(|fold| &fold[lanes.clone()]));
            let further = part_of(&further, &lanes);
            let view = View::new(&means, &further, &self.counts, GROUPS, Some(self.unit));
            self.estimate(view, &strip.last()[lanes], values, status)
        })
    }
}

impl Fitted for Plain {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        out.fall_back(strip, self.0);
        Ok(())
    }
}

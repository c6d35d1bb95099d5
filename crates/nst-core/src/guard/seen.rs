//! What an expert sees of the lanes: statistics of their samples, without those held out.

use crate::{
    Error, Estimates, FurtherPowers, Power, Requirements, SequenceBatch, Side, Support, Transform,
};

/// What experts need of a batch.
pub(super) const STATISTICS: Requirements = Requirements {
    window: 1,
    sides: Side::EVERY_OF_FOLDS,
    optional: &[],
    powers: FurtherPowers::NONE,
    support: Support::Lane,
    fits: true,
};

/// Means over some of the samples of each lane. Where a group of folds is held out, nothing
/// of its samples is in any of these numbers.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// How many samples of each lane.
    pub samples: f64,
    /// The mean of |y̅| over all lanes of the batch, not only over those here: a unit in which
    /// numbers of lanes have no dimension. Above 0.
    pub unit: f64,
    /// The mean y̅ of the samples, `[lane]`: the plain estimate.
    pub mean: &'a [f32],
    /// The mean of the [roots](crate::root), `[lane]`.
    pub root: &'a [f32],
    /// The mean of the squares, `[lane]`.
    pub square: &'a [f32],
    /// The [power means](Power) M_p of further powers that experts [need](Expert::powers), each
    /// `[lane]`; none that the batch does not have.
    pub further: &'a [(Power, Vec<f32>)],
}

impl Seen<'_> {
    /// The estimated variance of the mean of a lane.
    #[must_use]
    pub fn variance(&self, lane: usize) -> f64 {
        let (mean, square) = (f64::from(self.mean[lane]), f64::from(self.square[lane]));
        (square - mean * mean).max(0.0) / (self.samples - 1.0).max(1.0)
    }
}

/// Makes changes of the plain estimates out of estimates, 0 where they are not finite.
pub(super) fn to_changes(estimates: &mut [f32], plain: &[f32]) {
    for (estimate, plain) in estimates.iter_mut().zip(plain) {
        let change = *estimate - plain;
        *estimate = if change.is_finite() { change } else { 0.0 };
    }
}

/// What is noted of an expert that failed.
pub(super) fn left_out(name: &str, error: Error) -> String {
    let why = match error {
        Error::Batch(why) => why,
        error => error.to_string(),
    };
    format!("'{name}' is left out: {why}")
}

/// Estimates whose worth the [`Guard`](super::Guard) measures.
///
/// An expert may be wrong, biased, or made for other integrals: the guard finds out. But it
/// must be a function of what it [sees](Seen) alone, as samples that are held out judge it.
pub trait Expert: Send + Sync {
    /// What to call it.
    fn name(&self) -> &str;

    /// The powers of the samples whose means it needs, beside those that every batch has: ½, 1
    /// and 2, which may be among them.
    fn powers(&self) -> &[Power] {
        &[]
    }

    /// Its features, if the guard is to fit their coefficients again, to the very batch: as one
    /// more expert.
    fn adapts(&self) -> Option<&dyn Features> {
        None
    }

    /// Writes an estimate of each lane. What is not finite counts as the plain estimate.
    ///
    /// # Errors
    /// What concerns all lanes, such as a lost GPU; the guard then goes on without it.
    fn estimate(&self, seen: &Seen<'_>, out: &mut [f32]) -> Result<(), Error>;
}

/// Numbers of a lane, of which an expert's change of the plain estimate is a linear function:
/// those of a network's last hidden layer.
pub trait Features: Send + Sync {
    /// The coefficients of the expert's own change.
    fn coefficients(&self) -> &[f32];

    /// Writes the features, `[lane][feature]`; as for estimates, from what is seen alone.
    ///
    /// # Errors
    /// As for [`Expert::estimate`].
    fn features(&self, seen: &Seen<'_>, out: &mut [f32]) -> Result<(), Error>;
}

/// A [`Transform`] that looks at the plain estimate of each lane, and perhaps its variance.
pub struct OfTransform<T> {
    name: String,
    transform: T,
}

impl<T: Transform> OfTransform<T> {
    /// Takes a method as an expert.
    ///
    /// # Errors
    /// [`Error::Batch`] if it reads what cannot be formed without some of the samples: a window
    /// of terms, folds, other lanes; or if it learns from all samples of the batch.
    pub fn new(name: impl Into<String>, transform: T) -> Result<Self, Error> {
        let needs = transform.requires();
        let name = name.into();
        let why = if needs.window > 1 {
            "it reads a window of terms, and no term but the last is known without a fold"
        } else if needs.all_sides().iter().any(|side| *side != Side::Variance) {
            "it reads side channels that contain the samples held out"
        } else if needs.support != Support::Lane {
            "it reads other lanes"
        } else if needs.fits {
            "it learns from all samples of the batch"
        } else {
            return Ok(Self { name, transform });
        };
        Err(Error::Batch(format!("'{name}' cannot be an expert: {why}")))
    }
}

impl<T: Transform> Expert for OfTransform<T> {
    fn name(&self) -> &str {
        &self.name
    }

    fn estimate(&self, seen: &Seen<'_>, out: &mut [f32]) -> Result<(), Error> {
        let mut batch = SequenceBatch::from_last(seen.mean, seen.samples.round() as u32)?;
        let variance = (0..seen.mean.len()).map(|lane| seen.variance(lane) as f32).collect();
        batch.set_side(Side::Variance, variance)?;
        let mut estimates = Estimates::default();
        self.transform.transform(&batch, &mut estimates)?;
        out.copy_from_slice(estimates.values());
        Ok(())
    }
}

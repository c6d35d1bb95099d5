//! [`Transform`], the interface of every method; the type of its results; and the identity.

use std::borrow::Cow;

use crate::{Error, FurtherPowers, SequenceBatch, Side, Strips, Whole, guard::Judgement};

/// A method that maps each sequence of a batch to one estimate of its limit.
///
/// It works in two phases. [`fit`](Self::fit) looks at the batch as a whole, strip by
/// strip, and returns what [`applies`](Fitted::apply) to strips. So every bit of the
/// estimates is the same, whether the batch is in memory or comes in strips.
pub trait Transform: Send + Sync {
    /// What the method reads.
    fn requires(&self) -> Requirements;

    /// Learns what the method must know of the batch as a whole. Most methods need nothing,
    /// and return at once. The result depends on the batch, but not on how it is cut.
    ///
    /// # Errors
    /// Those of `strips`, and what concerns the whole batch, such as a lost GPU.
    fn fit<'a>(&'a self, strips: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error>;

    /// Begins to [`fit`](Self::fit) to strips that come one by one; `None` if the method learns
    /// nothing, or must go over them more than once.
    fn start(&self) -> Option<Box<dyn Fit<'_> + '_>> {
        None
    }

    /// Both phases for a batch in memory: see [`Fitted::apply`].
    ///
    /// # Errors
    /// Those of the two phases.
    fn transform(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        self.fit(&mut Whole::new(batch))?.apply(batch, out)
    }
}

/// A method that learns in one pass, while the strips of a batch come in.
pub trait Fit<'a>: Send {
    /// Learns from the next strip, which has no halo.
    ///
    /// # Errors
    /// Those of [`Transform::fit`].
    fn add(&mut self, strip: &SequenceBatch) -> Result<(), Error>;

    /// What [`Transform::fit`] returns for all strips so far.
    ///
    /// # Errors
    /// Those of [`Transform::fit`].
    fn finish(self: Box<Self>) -> Result<Box<dyn Fitted + 'a>, Error>;
}

/// A method after [`Transform::fit`], ready for the strips of the batch.
pub trait Fitted: Send + Sync {
    /// Writes one estimate per lane of a strip into `out`, whose previous content is
    /// dropped; lanes of a [halo](crate::Grid::with_halo) have none.
    ///
    /// Where the method breaks down on a lane, that lane falls back to S_n and
    /// its [`Status`] says why; finite terms never give a NaN or an infinity.
    ///
    /// # Errors
    /// Only for what concerns all lanes, such as a lost GPU.
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error>;

    /// Whether the estimates come with [errors](Estimates::errors).
    fn estimates_errors(&self) -> bool {
        false
    }

    /// Whether the estimates come with [weights](Estimates::weights), one for each expert of the
    /// [judgement](Self::judgement).
    fn has_weights(&self) -> bool {
        false
    }

    /// What a method that measures its own gain has found.
    fn judgement(&self) -> Option<&Judgement> {
        None
    }
}

impl<F: Fitted + ?Sized> Fitted for &F {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        (**self).apply(strip, out)
    }

    fn estimates_errors(&self) -> bool {
        (**self).estimates_errors()
    }

    fn has_weights(&self) -> bool {
        (**self).has_weights()
    }

    fn judgement(&self) -> Option<&Judgement> {
        (**self).judgement()
    }
}

/// What a method reads of a batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Requirements {
    /// How many of the last terms, at least 1. Where fewer are stored, all lanes keep S_n.
    pub window: usize,
    /// The side channels without which all lanes keep S_n. No others are read when the method
    /// is [applied](Fitted::apply), but for those that follow.
    pub sides: &'static [Side],
    /// Side channels that are read, too, where the batch has them.
    pub optional: &'static [Side],
    /// The powers of the samples whose [means of folds](Side::PowerMean) are read, too, where the
    /// batch has them.
    pub powers: FurtherPowers,
    /// The lanes that an estimate depends on, beside what was fitted.
    pub support: Support,
    /// Whether [`Transform::fit`] reads the whole batch.
    pub fits: bool,
}

/// The lanes that the estimate of a lane depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Support {
    /// The lane alone.
    Lane,
    /// All lanes of its pixel; needs a [`Grid`](crate::Grid).
    Pixel,
    /// All lanes of pixels at most this many columns and rows away; needs a grid, and
    /// strips with a halo of as many rows.
    Radius(u32),
    /// The whole picture, as one strip.
    Picture,
}

impl Requirements {
    /// The requirements of a method that reads the last `window` terms of each lane and
    /// nothing else.
    #[must_use]
    pub fn of_lane(window: usize) -> Self {
        let powers = FurtherPowers::NONE;
        Self { window, sides: &[], optional: &[], powers, support: Support::Lane, fits: false }
    }

    /// How many numbers of a lane are read.
    #[must_use]
    pub fn numbers_per_lane(&self) -> usize {
        self.window + self.sides.len() + self.powers.sides().count()
    }

    /// All side channels that are read.
    #[must_use]
    pub fn all_sides(&self) -> Vec<Side> {
        let named = self.sides.iter().chain(self.optional).cloned();
        named.chain(self.powers.sides()).collect()
    }

    /// Whether features are read, where the batch has them.
    #[must_use]
    pub fn reads_features(&self) -> bool {
        self.optional.iter().any(Side::is_feature)
    }

    /// The halo that strips need, in rows.
    #[must_use]
    pub fn halo(&self) -> u32 {
        match self.support {
            Support::Lane | Support::Pixel | Support::Picture => 0,
            Support::Radius(radius) => radius,
        }
    }

    /// The fewest rows of a strip that are worth a halo of theirs: with fewer, it would be most of
    /// what is read. Strips of a picture that is needed as a whole have all rows.
    #[must_use]
    pub fn least_rows(&self) -> u32 {
        match self.support {
            Support::Picture => u32::MAX,
            _ => self.halo().saturating_mul(2),
        }
    }
}

/// Whether a lane was transformed, or why it has S_n instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Status {
    /// Transformed.
    #[default]
    Ok,
    /// The window, or what the method made of it, is not finite.
    NotFinite,
    /// Fewer terms are stored than the method reads.
    TooShort,
    /// All numbers that the method reads are equal: the sequence has converged, or its
    /// samples have all been equal so far.
    Constant,
    /// A denominator of the method vanishes.
    ZeroDenominator,
    /// The result is too far from S_n to be anything but magnified noise.
    Clamped,
    /// The batch lacks the fold means that the method reads.
    NoFolds,
    /// An expert that others were weighed with has failed.
    ExpertFailed,
}

/// One estimate and one [`Status`] per lane, and an error where the method estimates it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimates {
    values: Vec<f32>,
    status: Vec<Status>,
    errors: Vec<f32>,
    weights: Vec<f32>,
}

impl Estimates {
    /// The estimates, `[lane]`.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The statuses, `[lane]`.
    #[must_use]
    pub fn status(&self) -> &[Status] {
        &self.status
    }

    /// The standard errors: the estimated roots of E[(T − I)²], `[lane]`. NaN where they are not
    /// known; empty if the method estimates none.
    #[must_use]
    pub fn errors(&self) -> &[f32] {
        &self.errors
    }

    /// How much each expert that looks at neighbours is trusted at each pixel, `[expert][pixel]`,
    /// from 0 to 1: its share of what surfaces reflect. Empty if the method weighs none.
    #[must_use]
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// How many lanes have the given status.
    #[must_use]
    pub fn count(&self, status: Status) -> usize {
        self.status.iter().filter(|&&lane| lane == status).count()
    }

    /// How many lanes have S_n because the method broke down on them. Constant lanes do not
    /// count: on them S_n is what the method is meant to return.
    #[must_use]
    pub fn fallen_back(&self) -> usize {
        self.status.len() - self.count(Status::Ok) - self.count(Status::Constant)
    }

    /// Sets every lane of a strip to S_n, with one status; lanes of a halo are left out.
    pub fn fall_back(&mut self, strip: &SequenceBatch, status: Status) {
        let last = strip.last();
        let last = strip.grid().map_or(Cow::Borrowed(last), |grid| grid.inner(last));
        self.values.clear();
        self.values.extend_from_slice(&last);
        self.status.clear();
        self.status.resize(last.len(), status);
        self.errors.clear();
        self.weights.clear();
    }

    /// Sets the errors of all lanes to NaN.
    pub(crate) fn errors_unknown(&mut self) {
        self.errors.clear();
        self.errors.resize(self.values.len(), f32::NAN);
    }

    /// Makes room for `lanes` lanes, all [`Status::Ok`]. Returns the values `[lane]`, which
    /// are still to be written, and the statuses `[lane]`.
    pub fn reset(&mut self, lanes: usize) -> (&mut [f32], &mut [Status]) {
        self.values.resize(lanes, 0.0);
        self.status.clear();
        self.status.resize(lanes, Status::Ok);
        self.errors.clear();
        self.weights.clear();
        (&mut self.values, &mut self.status)
    }

    /// As [`reset`](Self::reset); the [errors](Self::errors) come third, all NaN.
    pub fn reset_with_errors(&mut self, lanes: usize) -> (&mut [f32], &mut [Status], &mut [f32]) {
        self.reset(lanes);
        self.errors_unknown();
        (&mut self.values, &mut self.status, &mut self.errors)
    }

    /// Takes the [weights](Self::weights) of what was written last.
    pub(crate) fn set_weights(&mut self, weights: Vec<f32>) {
        self.weights = weights;
    }
}

/// T_n = S_n: the baseline that every method is measured against.
#[derive(Clone, Copy, Debug, Default)]
pub struct Identity;

impl Fitted for Identity {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        out.fall_back(strip, Status::Ok);
        Ok(())
    }
}

impl Transform for Identity {
    fn requires(&self) -> Requirements {
        Requirements::of_lane(1)
    }

    fn fit(&self, _: &mut dyn Strips) -> Result<Box<dyn Fitted + '_>, Error> {
        Ok(Box::new(self))
    }
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;

    #[test]
    fn identity_returns_the_last_term() -> Result<(), Error> {
        let batch = SequenceBatch::new(array![[1.0, 5.0], [2.0, 6.0]], vec![1, 2])?;
        let mut out = Estimates::default();
        Identity.transform(&batch, &mut out)?;
        assert_eq!(out.values(), [2.0, 6.0]);
        assert_eq!(out.count(Status::Ok), 2);
        Ok(())
    }
}

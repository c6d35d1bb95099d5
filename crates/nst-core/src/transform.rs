//! The [`Transform`] trait, its result type, and the identity.

use crate::{Error, SequenceBatch};

/// Maps each sequence of a batch to one estimate of its limit.
pub trait Transform {
    /// How many of the last terms the transformation reads.
    fn window(&self) -> usize;

    /// Writes one estimate per lane into `out`, whose previous content is dropped.
    ///
    /// Where the method breaks down on a lane, that lane falls back to S_n and
    /// its [`Status`] says why; finite terms never give a NaN or an infinity.
    ///
    /// # Errors
    /// Only for what concerns the whole batch, such as a lost GPU.
    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error>;
}

/// Whether a lane was transformed, or why it holds S_n instead.
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
    /// All that the method reads is equal: the sequence has converged, or has seen nothing yet.
    Constant,
    /// A denominator of the method vanishes.
    ZeroDenominator,
    /// The result is too far from S_n to be anything but magnified noise.
    Clamped,
    /// The batch lacks the fold means that the method reads.
    NoFolds,
}

/// One estimate and one [`Status`] per lane.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimates {
    values: Vec<f32>,
    status: Vec<Status>,
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

    /// How many lanes have the given status.
    #[must_use]
    pub fn count(&self, status: Status) -> usize {
        self.status.iter().filter(|&&lane| lane == status).count()
    }

    /// How many lanes hold S_n because the method broke down on them. Constant
    /// lanes do not count: on them S_n is what the method is meant to return.
    #[must_use]
    pub fn fallen_back(&self) -> usize {
        self.status.len() - self.count(Status::Ok) - self.count(Status::Constant)
    }

    /// Sets every lane to S_n with one status.
    pub(crate) fn fall_back(&mut self, batch: &SequenceBatch, status: Status) {
        self.values.clear();
        self.values.extend_from_slice(batch.last());
        self.status.clear();
        self.status.resize(batch.lanes(), status);
    }

    /// Makes room for so many lanes, all [`Status::Ok`], and lends values and statuses.
    pub(crate) fn reset(&mut self, lanes: usize) -> (&mut [f32], &mut [Status]) {
        self.values.resize(lanes, 0.0);
        self.status.clear();
        self.status.resize(lanes, Status::Ok);
        (&mut self.values, &mut self.status)
    }
}

/// T_n = S_n: the baseline that every method is measured against.
#[derive(Clone, Copy, Debug, Default)]
pub struct Identity;

impl Transform for Identity {
    fn window(&self) -> usize {
        1
    }

    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        out.fall_back(batch, Status::Ok);
        Ok(())
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
        Identity.apply(&batch, &mut out)?;
        assert_eq!(out.values(), [2.0, 6.0]);
        assert_eq!(out.count(Status::Ok), 2);
        Ok(())
    }
}

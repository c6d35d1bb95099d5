//! The [`Transform`] trait, its result type, and the identity.

use ndarray::ArrayView2;

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

    /// Takes the raw outputs of a method and replaces what must not stand:
    /// lanes whose window is constant, and lanes that are not finite.
    pub(crate) fn accept(&mut self, window: ArrayView2<'_, f32>, raw: Vec<f32>) {
        let (terms, lanes) = window.dim();
        debug_assert_eq!(raw.len(), lanes);
        let last = window.row(terms - 1);
        // One term alone says nothing about constancy.
        let initial = if terms > 1 { Status::Constant } else { Status::Ok };
        self.status.clear();
        self.status.resize(lanes, initial);
        // Row by row, because a term of all lanes is contiguous.
        for row in window.rows() {
            for ((status, value), last) in self.status.iter_mut().zip(row).zip(last) {
                if !value.is_finite() {
                    *status = Status::NotFinite;
                } else if value != last && *status == Status::Constant {
                    *status = Status::Ok;
                }
            }
        }
        self.values = raw;
        for ((status, value), last) in self.status.iter_mut().zip(&mut self.values).zip(last) {
            if *status == Status::Ok && !value.is_finite() {
                *status = Status::NotFinite;
            }
            if *status != Status::Ok {
                *value = *last;
            }
        }
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

    #[test]
    fn constant_and_non_finite_lanes_hold_s_n() {
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        //                       ok  constant  bad input  bad output  overflown last term
        let window = array![[1.0, 0.5, nan, 1.0, 1.0], [2.0, 0.5, 3.0, 2.0, inf]];
        let mut out = Estimates::default();
        out.accept(window.view(), vec![9.0, 9.0, 9.0, nan, 9.0]);
        assert_eq!(out.values(), [9.0, 0.5, 3.0, 2.0, inf]);
        use Status::{Constant, NotFinite, Ok};
        assert_eq!(out.status(), [Ok, Constant, NotFinite, NotFinite, NotFinite]);
        assert_eq!(out.fallen_back(), 3);
    }
}

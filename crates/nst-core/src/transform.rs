//! [`Transform`]: what every method is asked, its result type, and the identity.

use ndarray::ArrayView2;
#[cfg(feature = "gpu")]
use rayon::prelude::*;

use crate::{Error, SequenceBatch, Side, Strips, Whole};

/// A method that maps each sequence of a batch to one estimate of its limit.
///
/// It works in two phases. [`fit`](Self::fit) looks at the batch as a whole, strip by
/// strip, and returns what [`applies`](Fitted::apply) to strips. So a batch that is larger
/// than the memory gives the very bits that it gives in memory.
pub trait Transform: Send + Sync {
    /// What the method reads.
    fn requires(&self) -> Requirements;

    /// Learns from the batch what the method takes from it; many methods take nothing,
    /// and are fitted at once. The result depends on the batch, but not on how it is cut.
    ///
    /// # Errors
    /// Those of `strips`, and what concerns the whole batch, such as a lost GPU.
    fn fit<'a>(&'a self, strips: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error>;

    /// Both phases for a batch in memory: see [`Fitted::apply`].
    ///
    /// # Errors
    /// Those of the two phases.
    fn transform(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        self.fit(&mut Whole::new(batch))?.apply(batch, out)
    }
}

/// A method that knows what it has to know of the batch.
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
}

impl<F: Fitted + ?Sized> Fitted for &F {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        (**self).apply(strip, out)
    }
}

/// What a method reads of a batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Requirements {
    /// How many of the last terms, at least 1. Where fewer are stored, all lanes keep S_n.
    pub window: usize,
    /// The side channels without which all lanes keep S_n.
    pub sides: &'static [Side],
    /// The lanes that an estimate depends on, beside what was fitted.
    pub support: Support,
    /// Whether the whole batch is looked at before any estimate is made.
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
    /// Those of a method that reads the last `window` terms of each lane and nothing else.
    #[must_use]
    pub fn of_lane(window: usize) -> Self {
        Self { window, sides: &[], support: Support::Lane, fits: false }
    }

    /// How many numbers of a lane are read.
    #[must_use]
    pub fn numbers_per_lane(&self) -> usize {
        self.window + self.sides.len()
    }

    /// The halo that strips need, in rows.
    #[must_use]
    pub fn halo(&self) -> u32 {
        match self.support {
            Support::Lane | Support::Pixel | Support::Picture => 0,
            Support::Radius(radius) => radius,
        }
    }
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

    /// Lets `evaluate` compute the lanes that a network must see, one value each, and
    /// sets the others to S_n: those whose window is constant, and those that are not
    /// finite. A value that is not finite becomes S_n, too.
    ///
    /// # Errors
    /// Those of `evaluate`.
    #[cfg(feature = "gpu")]
    pub(crate) fn transform_active(
        &mut self,
        window: ArrayView2<'_, f32>,
        evaluate: impl FnOnce(Lanes<'_>, &mut [f32]) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let (values, status) = self.reset(window.ncols());
        let ok: usize = values
            .par_chunks_mut(CLASSIFY)
            .zip(status.par_chunks_mut(CLASSIFY))
            .enumerate()
            .map(|(i, (values, status))| classify(window, i * CLASSIFY, values, status))
            .sum();
        Compact::default().evaluate(window, 0, ok, values, status, evaluate)
    }
}

/// Lanes that are classified by one thread at a time.
#[cfg(feature = "gpu")]
const CLASSIFY: usize = 1 << 14;

/// Lanes that are looked at side by side, in vectors.
const SIDE_BY_SIDE: usize = 64;

/// Sets lanes `first ..` of the window `[term][lane]` to S_n, and to the status that
/// follows from the window alone. Returns how many are [`Status::Ok`], which all are before.
pub(crate) fn classify(
    window: ArrayView2<'_, f32>,
    first: usize,
    values: &mut [f32],
    status: &mut [Status],
) -> usize {
    let (terms, lanes) = window.dim();
    let window = window.to_slice().expect("a window is a run of whole rows");
    let mut ok = 0;
    let chunks = values.chunks_mut(SIDE_BY_SIDE).zip(status.chunks_mut(SIDE_BY_SIDE));
    for (i, (values, status)) in chunks.enumerate() {
        let lane = first + i * SIDE_BY_SIDE;
        let count = values.len();
        let row = |term: usize| &window[term * lanes + lane..][..count];
        let last = row(terms - 1);
        values.copy_from_slice(last);
        // All ones where a term differs from the last, and where all are finite.
        let mut differs = [0; SIDE_BY_SIDE];
        let mut finite = [u32::MAX; SIDE_BY_SIDE];
        let mask = |condition: bool| u32::from(condition).wrapping_neg();
        for term in 0..terms {
            let flags = differs.iter_mut().zip(&mut finite);
            for ((&value, &last), (differs, finite)) in row(term).iter().zip(last).zip(flags) {
                *differs |= mask(value != last);
                *finite &= mask(value.abs() < f32::INFINITY);
            }
        }
        // One term alone says nothing about constancy.
        if terms == 1 {
            differs.fill(u32::MAX);
        }
        let flags = || differs.iter().zip(&finite).take(count);
        if flags().fold(u32::MAX, |all, (differs, finite)| all & differs & finite) != 0 {
            ok += count; // as nearly everywhere: the statuses are so already
            continue;
        }
        for (status, (&differs, &finite)) in status.iter_mut().zip(flags()) {
            *status = match (finite, differs) {
                (0, _) => Status::NotFinite,
                (_, 0) => Status::Constant,
                _ => Status::Ok,
            };
            ok += usize::from(*status == Status::Ok);
        }
    }
    ok
}

/// Room for the lanes that a network must see, where not all are; reused.
#[derive(Default)]
pub(crate) struct Compact {
    list: Vec<u32>,
    /// `[lane of list]`.
    values: Vec<f32>,
}

impl Compact {
    /// Lets `evaluate` compute those of lanes `first ..` whose status is [`Status::Ok`],
    /// `ok` in number. A value that is not finite becomes S_n.
    ///
    /// # Errors
    /// Those of `evaluate`.
    pub(crate) fn evaluate<E>(
        &mut self,
        window: ArrayView2<'_, f32>,
        first: usize,
        ok: usize,
        values: &mut [f32],
        status: &mut [Status],
        evaluate: impl FnOnce(Lanes<'_>, &mut [f32]) -> Result<(), E>,
    ) -> Result<(), E> {
        if ok == values.len() {
            evaluate(Lanes::From(first), values)?;
        } else {
            let lanes = (first as u32..).zip(&*status).filter(|&(_, &s)| s == Status::Ok);
            self.list.clear();
            self.list.extend(lanes.map(|(lane, _)| lane));
            self.values.resize(ok, 0.0);
            evaluate(Lanes::These(&self.list), &mut self.values)?;
            for (&lane, &value) in self.list.iter().zip(&self.values) {
                values[lane as usize - first] = value;
            }
        }
        replace_non_finite(window, first, values, status);
        Ok(())
    }
}

/// Sets lanes `first ..` to S_n where a network's value is not finite.
fn replace_non_finite(
    window: ArrayView2<'_, f32>,
    first: usize,
    values: &mut [f32],
    status: &mut [Status],
) {
    let last = window.row(window.nrows() - 1);
    let last = &last.to_slice().expect("a window is a run of whole rows")[first..];
    let chunks = values.chunks_mut(SIDE_BY_SIDE).zip(status.chunks_mut(SIDE_BY_SIDE));
    for ((values, status), last) in chunks.zip(last.chunks(SIDE_BY_SIDE)) {
        // Nearly everywhere; without a branch per lane, this becomes vectors.
        if values.iter().fold(true, |all, value| all & value.is_finite()) {
            continue;
        }
        for ((status, value), last) in status.iter_mut().zip(values).zip(last) {
            if !value.is_finite() && *status == Status::Ok {
                *status = Status::NotFinite;
                *value = *last;
            }
        }
    }
}

/// Lanes of a batch that a network must see, so that its tiles are full of them.
#[derive(Clone, Copy)]
pub(crate) enum Lanes<'a> {
    /// All from this one on.
    From(usize),
    /// In increasing order.
    These(&'a [u32]),
}

impl Lanes<'_> {
    /// Copies lanes `start ..` of these from a term of all lanes to `out`.
    #[inline]
    pub(crate) fn gather(self, term: &[f32], start: usize, out: &mut [f32]) {
        match self {
            Self::From(first) => out.copy_from_slice(&term[first + start..][..out.len()]),
            Self::These(list) => {
                for (out, &lane) in out.iter_mut().zip(&list[start..]) {
                    *out = term[lane as usize];
                }
            }
        }
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

    #[cfg(feature = "gpu")]
    #[test]
    fn constant_and_non_finite_lanes_hold_s_n() {
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        //                       ok  constant  bad input  bad output  overflown last term
        let window = array![[1.0, 0.5, nan, 1.0, 1.0], [2.0, 0.5, 3.0, 2.0, inf]];
        let mut out = Estimates::default();
        // Lanes 0 and 3 are all that the network sees.
        let seen = out.transform_active(window.view(), |lanes, out| {
            let mut terms = [0.0; 2];
            lanes.gather(window.row(1).as_slice().expect("one row"), 0, &mut terms);
            assert_eq!(terms, [2.0, 2.0]);
            out.copy_from_slice(&[9.0, nan]);
            Result::Ok(())
        });
        assert!(seen.is_ok());
        assert_eq!(out.values(), [9.0, 0.5, 3.0, 2.0, inf]);
        use Status::{Constant, NotFinite, Ok};
        assert_eq!(out.status(), [Ok, Constant, NotFinite, NotFinite, NotFinite]);
        assert_eq!(out.fallen_back(), 3);
    }
}

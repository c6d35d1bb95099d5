//! Chooses the lanes that a network must compute, and gathers them side by side.
//!
//! A lane keeps S_n if its window is constant or not finite; the network computes the
//! others. Where it computes all, the usual case, nothing is copied.

use ndarray::ArrayView2;
#[cfg(feature = "gpu")]
use rayon::prelude::*;

use crate::Status;
#[cfg(feature = "gpu")]
use crate::{Error, Estimates};

/// Lanes that one task of the thread pool classifies: 512 KiB of a window of eight terms.
#[cfg(feature = "gpu")]
const CLASSIFY: usize = 1 << 14;

/// Lanes that a loop looks at together: four vectors of AVX-512, the widest there are.
const SIDE_BY_SIDE: usize = 64;

/// Calls `evaluate` for the lanes of a window `[term][lane]` that a network must compute;
/// it writes one value for each. The other lanes, whose window is constant or not finite,
/// get S_n. So do lanes for which `evaluate` writes a value that is not finite.
///
/// # Errors
/// Those of `evaluate`.
#[cfg(feature = "gpu")]
pub(crate) fn transform_active(
    window: ArrayView2<'_, f32>,
    out: &mut Estimates,
    evaluate: impl FnOnce(Selection<'_>, &mut [f32]) -> Result<(), Error>,
) -> Result<(), Error> {
    let (values, status) = out.reset(window.ncols());
    let ok: usize = values
        .par_chunks_mut(CLASSIFY)
        .zip(status.par_chunks_mut(CLASSIFY))
        .enumerate()
        .map(|(i, (values, status))| classify(window, i * CLASSIFY, values, status))
        .sum();
    Compact::default().evaluate(window, 0, ok, values, status, evaluate)
}

/// Sets lanes `first ..` of the window `[term][lane]` to S_n, and their status to what the
/// window alone says. All statuses must be [`Status::Ok`] before. Returns how many still
/// are.
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
            ok += count; // the usual case: their statuses are Ok already
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

/// Memory for the lanes that a network must compute, where these are not all. It is reused
/// from tile to tile.
#[derive(Default)]
pub(crate) struct Compact {
    /// Lanes of the batch, in increasing order.
    list: Vec<usize>,
    /// `[lane of list]`.
    values: Vec<f32>,
}

impl Compact {
    /// Calls `evaluate` for those of lanes `first ..` whose status is [`Status::Ok`]; `ok`
    /// is their number. A lane for which it writes a value that is not finite gets S_n.
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
        evaluate: impl FnOnce(Selection<'_>, &mut [f32]) -> Result<(), E>,
    ) -> Result<(), E> {
        if ok == values.len() {
            evaluate(Selection::From(first), values)?;
        } else {
            self.list_ok(first, status);
            self.values.resize(ok, 0.0);
            evaluate(Selection::These(&self.list), &mut self.values)?;
            for (&lane, &value) in self.list.iter().zip(&self.values) {
                values[lane - first] = value;
            }
        }
        replace_non_finite(window, first, values, status);
        Ok(())
    }

    /// Lists the lanes that are [`Status::Ok`]; `status[0]` is that of lane `first`.
    fn list_ok(&mut self, first: usize, status: &[Status]) {
        let lanes = (first..).zip(status).filter(|&(_, &status)| status == Status::Ok);
        self.list.clear();
        self.list.extend(lanes.map(|(lane, _)| lane));
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
        // The usual case. Without a branch for each lane, this becomes vector instructions.
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

/// The lanes of a batch that a network computes.
#[derive(Clone, Copy)]
pub(crate) enum Selection<'a> {
    /// All lanes from this one on.
    From(usize),
    /// In increasing order.
    These(&'a [usize]),
}

impl Selection<'_> {
    /// Fills `out` with the values of a term for these lanes, from number `start` of them
    /// on. `term` has the values of all lanes.
    #[inline]
    pub(crate) fn gather(self, term: &[f32], start: usize, out: &mut [f32]) {
        match self {
            Self::From(first) => out.copy_from_slice(&term[first + start..][..out.len()]),
            Self::These(list) => {
                for (out, &lane) in out.iter_mut().zip(&list[start..]) {
                    *out = term[lane];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(feature = "gpu")]
    #[test]
    fn constant_and_non_finite_lanes_keep_s_n() {
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        //                       ok  constant  bad input  bad output  overflown last term
        let window = ndarray::array![[1.0, 0.5, nan, 1.0, 1.0], [2.0, 0.5, 3.0, 2.0, inf]];
        let mut out = Estimates::default();
        // The network computes lanes 0 and 3 only.
        let seen = transform_active(window.view(), &mut out, |selection, out| {
            let mut terms = [0.0; 2];
            selection.gather(window.row(1).as_slice().expect("one row"), 0, &mut terms);
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

    /// Batches may have more lanes than 32 bits can count.
    #[cfg(target_pointer_width = "64")]
    #[test]
    fn lanes_beyond_32_bits() {
        use Status::{Constant, NotFinite, Ok};
        for first in [0, (1 << 32) - 2, 1 << 40] {
            let mut compact = Compact::default();
            compact.list_ok(first, &[Ok, Constant, Ok, NotFinite, Ok]);
            assert_eq!(compact.list, [first, first + 2, first + 4]);
        }
    }
}

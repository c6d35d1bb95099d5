//! What the classical methods share: tiles of lanes, and the rules that return S_n instead.

use rayon::prelude::*;

use crate::{Error, Estimates, Fitted, Requirements, SequenceBatch, Status, Strips, Transform};

/// Lanes that are extrapolated together: two vectors of AVX-512 or four of AVX2. The
/// innermost loops run over them, and compilers turn those into vector instructions.
pub const WIDTH: usize = 16;

/// One number for each lane of a tile.
pub type Tile = [f64; WIDTH];

/// No method reads more terms than this; it is the size of a tile on the stack.
pub(super) const MAX_TERMS: usize = 16;

/// Lanes per task of the thread pool: enough tiles that the cost of a task does not matter.
const CHUNK: usize = 64 * WIDTH;

/// How far a limit may lie from S_N, in units of n_N/(n_N − n_1) times the spread of the
/// window. A remainder that falls as 1/n lies within n_1/(n_N − n_1) spreads, and all
/// faster ones closer; ten leaves room for slower ones. A limit farther away is magnified
/// rounding or noise.
const FARTHEST: f64 = 10.0;

/// A method that computes the limit of a sequence from its last terms alone.
///
/// Everything inside is f64. The terms of a [`SequenceBatch`] are f32, however:
/// their rounding, relative to the differences between terms, bounds what any
/// extrapolation of them can reach. [`limit`](Self::limit) takes f64 terms.
///
/// On a batch, a lane falls back to S_n if a term of its window is not finite,
/// if the window is constant, if the denominators vanish, or if the limit is
/// farther away than a remainder ten times slower than 1/n would be
/// ([`Status::Clamped`]).
pub trait Extrapolation: Send + Sync {
    /// How many terms it reads, at most 16.
    fn terms(&self) -> usize;

    /// The limits of [`WIDTH`] lanes, NaN where the denominators vanish.
    ///
    /// `terms` are `[term][lane]`, oldest first, as many as [`terms`](Self::terms)
    /// says; they may be overwritten. `counts` are their sample counts.
    fn limits(&self, counts: &[f64], terms: &mut [Tile]) -> Tile;

    /// The limit of one sequence from its last terms in f64; `None` if there are
    /// too few, if counts and terms differ in number, or if the method breaks down.
    fn limit(&self, counts: &[u32], terms: &[f64]) -> Option<f64> {
        let first = terms.len().checked_sub(self.terms())?;
        let counts: Vec<_> = counts.get(first..)?.iter().map(|&n| f64::from(n)).collect();
        let mut tile = [[0.0; WIDTH]; MAX_TERMS];
        for (row, &term) in tile.iter_mut().zip(&terms[first..]) {
            *row = [term; WIDTH];
        }
        if counts.len() != self.terms() {
            return None;
        }
        let limit = self.limits(&counts, &mut tile[..counts.len()])[0];
        limit.is_finite().then_some(limit)
    }
}

impl<E: Extrapolation + ?Sized> Extrapolation for &E {
    fn terms(&self) -> usize {
        (**self).terms()
    }

    fn limits(&self, counts: &[f64], terms: &mut [Tile]) -> Tile {
        (**self).limits(counts, terms)
    }
}

impl<E: Extrapolation> Transform for E {
    fn requires(&self) -> Requirements {
        Requirements::of_lane(self.terms())
    }

    fn fit<'a>(&'a self, _: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        Ok(Box::new(FromTerms(self)))
    }
}

/// An extrapolation of every lane of a strip.
struct FromTerms<'a, E>(&'a E);

impl<E: Extrapolation> Fitted for FromTerms<'_, E> {
    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let method = self.0;
        let Some(window) = batch.window(method.terms()) else {
            out.fall_back(batch, Status::TooShort);
            return Ok(());
        };
        let first = batch.sample_counts().len() - method.terms();
        let counts: Vec<_> = batch.sample_counts()[first..].iter().map(|&n| f64::from(n)).collect();
        let (n_1, n_last) = (counts[0], counts[counts.len() - 1]);
        let farthest = FARTHEST * n_last / (n_last - n_1).max(1.0);

        let window = window.to_slice().expect("a window is a run of whole rows");
        let stride = batch.lanes();
        let (values, status) = out.reset(stride);
        let chunks = values.par_chunks_mut(CHUNK).zip(status.par_chunks_mut(CHUNK));
        chunks.enumerate().for_each(|(chunk, (values, status))| {
            let tiles = values.chunks_mut(WIDTH).zip(status.chunks_mut(WIDTH));
            for (tile, (values, status)) in tiles.enumerate() {
                let first = chunk * CHUNK + tile * WIDTH;
                let mut terms = [[0.0; WIDTH]; MAX_TERMS];
                for (row, terms) in terms[..counts.len()].iter_mut().zip(window.chunks(stride)) {
                    for (to, from) in row.iter_mut().zip(&terms[first..][..values.len()]) {
                        *to = f64::from(*from);
                    }
                }
                let terms = &mut terms[..counts.len()];
                let seen = Seen::of(terms);
                let limits = method.limits(&counts, terms);
                for (lane, (value, status)) in values.iter_mut().zip(status).enumerate() {
                    *status = seen.judge(lane, limits[lane], farthest);
                    *value =
                        if *status == Status::Ok { limits[lane] } else { seen.last[lane] } as f32;
                }
            }
        });
        Ok(())
    }
}

/// What the terms of a tile say about which limits are possible.
struct Seen {
    least: Tile,
    greatest: Tile,
    last: Tile,
    /// 0 where all terms are finite, else NaN.
    finite: Tile,
}

impl Seen {
    fn of(terms: &[Tile]) -> Self {
        let last = terms[terms.len() - 1];
        let mut seen = Self { least: last, greatest: last, last, finite: [0.0; WIDTH] };
        for row in terms {
            for lane in 0..WIDTH {
                seen.least[lane] = seen.least[lane].min(row[lane]);
                seen.greatest[lane] = seen.greatest[lane].max(row[lane]);
                seen.finite[lane] += 0.0 * row[lane];
            }
        }
        seen
    }

    fn judge(&self, lane: usize, limit: f64, farthest: f64) -> Status {
        let spread = self.greatest[lane] - self.least[lane];
        if self.finite[lane] != 0.0 {
            Status::NotFinite
        } else if spread == 0.0 {
            Status::Constant
        } else if limit.is_nan() {
            Status::ZeroDenominator
        } else if (limit - self.last[lane]).abs() > farthest * spread {
            Status::Clamped
        } else if (limit as f32).is_finite() {
            Status::Ok
        } else {
            Status::NotFinite
        }
    }
}

/// a − b, or 0 where the difference is only rounding: the operands of f32 terms are exact,
/// but those of later columns of a table carry a few units of f64's last place.
#[inline(always)]
pub(super) fn difference(a: f64, b: f64) -> f64 {
    let difference = a - b;
    if difference.abs() <= 4.0 * f64::EPSILON * a.abs().max(b.abs()) { 0.0 } else { difference }
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;
    use crate::methods::{Aitken, AnGn, Scale};

    #[test]
    fn statuses() -> Result<(), Error> {
        use Status::{Clamped, Constant, NotFinite, Ok as Done, ZeroDenominator};
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        // Geometric; linear (Δ² = 0); constant; not finite; nearly linear, so that
        // the limit is 5,000 away; a limit beyond f32.
        let terms = array![
            [1.0, 1.0, 7.0, nan, 1.0, inf, -3e38],
            [1.5, 2.0, 7.0, 1.0, 2.0, 1.0, -1e38],
            [1.75, 3.0, 7.0, 2.0, 2.9998, 1.0, 3e38]
        ];
        let batch = SequenceBatch::new(terms, vec![1, 2, 3])?;
        let mut out = Estimates::default();
        Aitken.transform(&batch, &mut out)?;
        assert_eq!(
            out.status(),
            [Done, ZeroDenominator, Constant, NotFinite, Clamped, NotFinite, NotFinite]
        );
        assert_eq!(out.values()[0], 2.0);
        assert_eq!(out.values()[1..], batch.last()[1..]);
        assert_eq!(out.fallen_back(), 5);

        let batch = SequenceBatch::new(array![[1.0, -3e38], [2.0, 3e38]], vec![1, 2])?;
        AnGn(Scale::Inverse).transform(&batch, &mut out)?;
        assert_eq!(out.status(), [Done, NotFinite]);
        assert_eq!(out.values(), [3.0, 3e38]);
        Ok(())
    }

    /// Lanes beside each other, tiles and chunks do not mix: every lane of a large
    /// batch has its own limit. All numbers on the way are short sums of powers of two,
    /// so that nothing is rounded.
    #[test]
    fn lanes_do_not_depend_on_their_neighbours() -> Result<(), Error> {
        let lanes = 2 * CHUNK + WIDTH + 3;
        let limit = |lane: usize| 1.0 + lane as f32;
        let term = |k: usize, lane: usize| limit(lane) + lane as f32 * 0.5_f32.powi(k as i32);
        let terms = ndarray::Array2::from_shape_fn((3, lanes), |(k, lane)| term(k, lane));
        let mut out = Estimates::default();
        Aitken.transform(&SequenceBatch::new(terms, vec![1, 2, 3])?, &mut out)?;
        for (lane, (value, status)) in out.values().iter().zip(out.status()).enumerate() {
            let expected = if lane == 0 { Status::Constant } else { Status::Ok };
            assert_eq!((*value, *status), (limit(lane), expected), "lane {lane}");
        }
        Ok(())
    }

    #[test]
    fn too_few_terms() -> Result<(), Error> {
        let batch = SequenceBatch::new(array![[1.0], [2.0]], vec![1, 2])?;
        let mut out = Estimates::default();
        Aitken.transform(&batch, &mut out)?;
        assert_eq!((out.values(), out.count(Status::TooShort)), (&[2.0][..], 1));
        assert_eq!(Aitken.limit(&[1, 2], &[1.0, 2.0]), None);
        assert_eq!(Aitken.limit(&[1, 2], &[1.0, 1.5, 1.75]), None);
        Ok(())
    }
}

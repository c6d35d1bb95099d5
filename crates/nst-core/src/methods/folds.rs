//! What the robust methods share: they map the means of the four folds of each lane.

use rayon::prelude::*;

use crate::{
    Error, Estimates, FOLDS, FurtherPowers, Requirements, SequenceBatch, Side, Status, Support,
};

/// Lanes per task of the thread pool: some 30 µs of work.
pub(super) const CHUNK: usize = 4096;

/// The requirements of a method that maps S_n and the fold means of each lane.
pub(super) const OF_FOLDS: Requirements = Requirements {
    window: 1,
    sides: Side::ALL_FOLDS,
    optional: &[],
    powers: FurtherPowers::NONE,
    support: Support::Lane,
    fits: false,
};

/// A method that maps S_n and the fold means of each lane, by [`map_folds`].
pub(super) trait OfFolds {
    /// The estimate of a lane.
    fn estimate(last: f64, folds: [f64; FOLDS]) -> f64;
}

/// Makes a type that is [`OfFolds`] a method. (A blanket implementation would collide with
/// the one for classical methods.)
macro_rules! of_folds {
    ($method:ty) => {
        impl crate::Transform for $method {
            fn requires(&self) -> crate::Requirements {
                $crate::methods::folds::OF_FOLDS
            }

            fn fit(
                &self,
                _: &mut dyn crate::Strips,
            ) -> Result<Box<dyn crate::Fitted + '_>, crate::Error> {
                Ok(Box::new(self))
            }
        }

        impl crate::Fitted for $method {
            fn apply(
                &self,
                strip: &crate::SequenceBatch,
                out: &mut crate::Estimates,
            ) -> Result<(), crate::Error> {
                $crate::methods::folds::map_folds(strip, out, Self::estimate)
            }
        }
    };
}
pub(super) use of_folds;

/// Sets each lane to `estimate` of S_n and of its fold means.
///
/// A lane falls back to S_n if one of these is not finite or if all fold means
/// are equal, and every lane does if the batch has no folds.
pub(super) fn map_folds(
    batch: &SequenceBatch,
    out: &mut Estimates,
    estimate: impl Fn(f64, [f64; FOLDS]) -> f64 + Sync,
) -> Result<(), Error> {
    let Some(folds) = batch.of_folds(Side::ALL_FOLDS) else {
        out.fall_back(batch, Status::NoFolds);
        return Ok(());
    };
    let last = batch.last();
    let (values, status) = out.reset(batch.lanes());
    let chunks = values.par_chunks_mut(CHUNK).zip(status.par_chunks_mut(CHUNK));
    chunks.enumerate().for_each(|(chunk, (values, status))| {
        let first = chunk * CHUNK;
        let length = values.len();
        let last = &last[first..][..length];
        let folds = folds.map(|fold| &fold[first..][..length]);
        for lane in 0..length {
            let means = folds.map(|fold| f64::from(fold[lane]));
            let value = estimate(f64::from(last[lane]), means) as f32;
            (values[lane], status[lane]) = judge(last[lane], means, value);
        }
    });
    Ok(())
}

/// The estimate and its status, or S_n and the reason for it.
pub(super) fn judge(last: f32, folds: [f64; FOLDS], value: f32) -> (f32, Status) {
    let [a, b, c, d] = folds;
    let finite = 0.0 * (a + b + c + d + f64::from(last)) == 0.0;
    if !finite || !value.is_finite() {
        (last, Status::NotFinite)
    } else if a == b && b == c && c == d {
        (last, Status::Constant)
    } else {
        (value, Status::Ok)
    }
}

/// The four numbers in increasing order of `key`.
#[inline(always)]
pub(super) fn sort_by(x: [f64; FOLDS], key: impl Fn(f64) -> f64) -> [f64; FOLDS] {
    let pair = |a: f64, b: f64| if key(b) < key(a) { (b, a) } else { (a, b) };
    let ((a, b), (c, d)) = (pair(x[0], x[1]), pair(x[2], x[3]));
    let ((least, e), (f, greatest)) = (pair(a, c), pair(b, d));
    let (second, third) = pair(e, f);
    [least, second, third, greatest]
}

/// The four numbers in increasing order.
#[inline(always)]
pub(super) fn sort(x: [f64; FOLDS]) -> [f64; FOLDS] {
    sort_by(x, |x| x)
}

#[cfg(test)]
pub(super) mod tests {
    use ndarray::Array2;

    use super::*;
    use crate::Transform;

    /// A batch of one term, the mean of the folds, for the folds `[lane][fold]`.
    pub(crate) fn batch(lanes: &[[f32; FOLDS]]) -> SequenceBatch {
        let means = lanes.iter().map(|folds| folds.iter().sum::<f32>() / 4.0).collect();
        let terms = Array2::from_shape_vec((1, lanes.len()), means).expect("one row");
        let mut batch = SequenceBatch::new(terms, vec![8]).expect("one term");
        for k in 0..FOLDS {
            let fold = lanes.iter().map(|folds| folds[k]).collect();
            batch.set_side(Side::Fold(k as u8), fold).expect("a value per lane");
        }
        batch
    }

    /// What a method makes of each of these lanes.
    pub(crate) fn estimates(method: &dyn Transform, lanes: &[[f32; FOLDS]]) -> Estimates {
        let mut out = Estimates::default();
        method.transform(&batch(lanes), &mut out).expect("no error concerns the batch");
        out
    }

    #[test]
    fn sorting_network() {
        for code in 0..256 {
            let x = [code & 3, code >> 2 & 3, code >> 4 & 3, code >> 6].map(f64::from);
            let mut sorted = x;
            sorted.sort_by(f64::total_cmp);
            assert_eq!(sort(x), sorted);
        }
    }

    #[test]
    fn statuses() -> Result<(), Error> {
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        let batch = batch(&[[1.0, 2.0, 3.0, 4.0], [5.0; 4], [nan, 1.0, 1.0, 1.0], [inf; 4]]);
        let mut out = Estimates::default();
        map_folds(&batch, &mut out, |_, _| 9.0)?;
        use Status::{Constant, NotFinite, Ok as Done};
        assert_eq!(out.status(), [Done, Constant, NotFinite, NotFinite]);
        assert_eq!(out.values()[..2], [9.0, 5.0]);
        map_folds(&batch, &mut out, |_, _| f64::MAX)?;
        assert_eq!((out.values()[0], out.status()[0]), (2.5, NotFinite));

        let bare = SequenceBatch::new(batch.terms().to_owned(), vec![8])?;
        map_folds(&bare, &mut out, |_, _| 9.0)?;
        assert_eq!(out.count(Status::NoFolds), 4);
        assert_eq!(out.values()[..2], [2.5, 5.0]);
        Ok(())
    }
}

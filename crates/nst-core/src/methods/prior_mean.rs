//! The baseline that every learned method must beat: one constant for all lanes.

use std::ops::Range;

use rayon::prelude::*;

use super::folds::CHUNK;
use crate::{
    Error, Estimates, Fitted, Requirements, SequenceBatch, Status, Strips, Transform, sum_in_order,
};

/// T = the mean of I over the family of integrals, whatever the samples say.
///
/// A method that gains no more than this constant has learned the family's mean and nothing
/// else. Its error does not fall with n.
#[derive(Clone, Copy, Debug)]
pub enum PriorMean {
    /// The mean is known, and finite.
    Given(f32),
    /// The mean is estimated by that of the finite S_n of the batch.
    OfTheBatch,
}

impl Transform for PriorMean {
    fn requires(&self) -> Requirements {
        Requirements { fits: matches!(self, Self::OfTheBatch), ..Requirements::of_lane(1) }
    }

    fn fit<'a>(&'a self, strips: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        Ok(Box::new(Constant(match self {
            Self::Given(mean) => *mean,
            Self::OfTheBatch => finite_mean(strips, f64::from)? as f32,
        })))
    }
}

/// The mean, once it is known.
struct Constant(f32);

impl Fitted for Constant {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let Self(mean) = *self;
        let last = strip.last();
        let (values, status) = out.reset(last.len());
        let chunks = values.par_chunks_mut(CHUNK).zip(status.par_chunks_mut(CHUNK));
        chunks.zip(last.par_chunks(CHUNK)).for_each(|((values, status), last)| {
            for ((value, status), &last) in values.iter_mut().zip(status).zip(last) {
                let finite = last.is_finite() && mean.is_finite();
                *value = if finite { mean } else { last };
                *status = if finite { Status::Ok } else { Status::NotFinite };
            }
        });
        Ok(())
    }
}

/// The mean of `of` the finite S_n, 0 if there are none.
pub(super) fn finite_mean(
    strips: &mut dyn Strips,
    of: impl Fn(f32) -> f64 + Sync,
) -> Result<f64, Error> {
    let sum = |strip: &SequenceBatch, lanes: &[Range<usize>]| {
        let values = lanes.iter().flat_map(|lanes| &strip.last()[lanes.clone()]);
        let finite = values.filter(|x| x.is_finite());
        finite.fold((0.0, 0.0), |(sum, count), &x| (sum + of(x), count + 1.0))
    };
    let (mut total, mut count) = (0.0, 0.0);
    sum_in_order(strips, sum, |(part, lanes)| {
        total += part;
        count += lanes;
    })?;
    Ok(if count > 0.0 { total / count } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;

    #[test]
    fn given_and_estimated() -> Result<(), Error> {
        let batch = SequenceBatch::new(array![[1.0, 2.0, f32::NAN, 6.0]], vec![4])?;
        let mut out = Estimates::default();
        PriorMean::OfTheBatch.transform(&batch, &mut out)?;
        assert_eq!((out.values()[0], out.values()[1], out.values()[3]), (3.0, 3.0, 3.0));
        assert_eq!((out.status()[2], out.fallen_back()), (Status::NotFinite, 1));
        PriorMean::Given(0.5).transform(&batch, &mut out)?;
        assert_eq!(out.values()[0], 0.5);
        Ok(())
    }
}

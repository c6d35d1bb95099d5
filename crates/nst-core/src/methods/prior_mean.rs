//! The baseline that every learned method must beat: one constant for all lanes.

use rayon::prelude::*;

use super::folds::CHUNK;
use crate::{Error, Estimates, SequenceBatch, Status, Transform};

/// T = the mean of I over the family of integrals, whatever the samples say.
///
/// A method whose gain this constant matches has learned the family's mean and
/// nothing else. Its error does not fall with n.
#[derive(Clone, Copy, Debug)]
pub enum PriorMean {
    /// The mean is known, and finite.
    Given(f32),
    /// The mean is estimated by that of the finite S_n of the batch.
    OfTheBatch,
}

impl Transform for PriorMean {
    fn window(&self) -> usize {
        1
    }

    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let last = batch.last();
        let mean = match self {
            Self::Given(mean) => *mean,
            Self::OfTheBatch => finite_mean(last) as f32,
        };
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

/// The mean of the finite values, 0 if there are none. Chunks are summed in
/// order, so that the result does not depend on the number of threads.
pub(super) fn finite_mean(values: &[f32]) -> f64 {
    let partial = |chunk: &[f32]| {
        let add = |(sum, count): (f64, f64), &x: &f32| {
            if x.is_finite() { (sum + f64::from(x), count + 1.0) } else { (sum, count) }
        };
        chunk.iter().fold((0.0, 0.0), add)
    };
    let partials: Vec<_> = values.par_chunks(CHUNK).map(partial).collect();
    let (sum, count) = partials.iter().fold((0.0, 0.0), |(s, c), (ds, dc)| (s + ds, c + dc));
    if count > 0.0 { sum / count } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;

    #[test]
    fn given_and_estimated() -> Result<(), Error> {
        let batch = SequenceBatch::new(array![[1.0, 2.0, f32::NAN, 6.0]], vec![4])?;
        let mut out = Estimates::default();
        PriorMean::OfTheBatch.apply(&batch, &mut out)?;
        assert_eq!((out.values()[0], out.values()[1], out.values()[3]), (3.0, 3.0, 3.0));
        assert_eq!((out.status()[2], out.fallen_back()), (Status::NotFinite, 1));
        PriorMean::Given(0.5).apply(&batch, &mut out)?;
        assert_eq!(out.values()[0], 0.5);
        Ok(())
    }
}

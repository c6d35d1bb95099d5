//! Error metrics of estimates x against reference values I.
//!
//! All are means over the lanes whose estimate and reference are finite; the
//! others are counted in [`ErrorSummary::nonfinite`].

use crate::Error;

/// Added to the denominator of [`ErrorSummary::relmse`] and [`ErrorSummary::smape`].
pub const EPSILON: f64 = 0.01;

/// The error of a set of estimates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorSummary {
    /// MSE = mean (x − I)².
    pub mse: f64,
    /// relMSE = mean (x − I)² / (I² + 0.01).
    pub relmse: f64,
    /// SMAPE = mean |x − I| / (|x| + |I| + 0.01).
    pub smape: f64,
    /// Lanes left out because x or I is not finite.
    pub nonfinite: usize,
}

/// Compares `estimates` with `reference`, lane by lane.
///
/// # Errors
/// [`Error::Lengths`] if the two differ in length.
pub fn error(estimates: &[f32], reference: &[f32]) -> Result<ErrorSummary, Error> {
    if estimates.len() != reference.len() {
        return Err(Error::Lengths(estimates.len(), reference.len()));
    }
    let (mut mse, mut relmse, mut smape, mut lanes) = (0.0, 0.0, 0.0, 0_usize);
    for (&x, &i) in estimates.iter().zip(reference) {
        if !(x.is_finite() && i.is_finite()) {
            continue;
        }
        let (x, i) = (f64::from(x), f64::from(i));
        let squared = (x - i) * (x - i);
        mse += squared;
        relmse += squared / (i * i + EPSILON);
        smape += (x - i).abs() / (x.abs() + i.abs() + EPSILON);
        lanes += 1;
    }
    let mean = |sum: f64| if lanes == 0 { f64::NAN } else { sum / lanes as f64 };
    Ok(ErrorSummary {
        mse: mean(mse),
        relmse: mean(relmse),
        smape: mean(smape),
        nonfinite: estimates.len() - lanes,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hand_computed_values() -> Result<(), Error> {
        let e = error(&[1.0, 0.0, f32::NAN], &[3.0, 1.0, 1.0])?;
        assert!((e.mse - 2.5).abs() < 1e-12);
        assert!((e.relmse - (4.0 / 9.01 + 1.0 / 1.01) / 2.0).abs() < 1e-12);
        assert!((e.smape - (2.0 / 4.01 + 1.0 / 1.01) / 2.0).abs() < 1e-12);
        assert_eq!(e.nonfinite, 1);
        assert!(error(&[1.0], &[]).is_err());
        Ok(())
    }
}

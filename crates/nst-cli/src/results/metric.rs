//! The measures of error.

use super::row::Row;

/// A measure of error: a column of the table, and its name in text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Metric {
    /// Mean squared error.
    Mse,
    /// Mean squared error relative to the squared reference.
    #[value(name = "relmse")]
    RelMse,
    /// Symmetric mean absolute percentage error.
    Smape,
    /// Mean squared error without the 0.1 % of lanes whose errors are the largest.
    MseTrimmed,
}

impl Metric {
    /// All, in the order of [`Summary::errors`](super::Summary::errors).
    pub(crate) const ALL: [Self; 4] = [Self::Mse, Self::RelMse, Self::Smape, Self::MseTrimmed];

    /// As in text.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Mse => "MSE",
            Self::RelMse => "relMSE",
            Self::Smape => "SMAPE",
            Self::MseTrimmed => "trimmed MSE",
        }
    }

    /// How the error of a plain estimate falls with n samples: as n to this power.
    pub(crate) fn slope(self) -> f64 {
        match self {
            Self::Smape => -0.5,
            Self::Mse | Self::RelMse | Self::MseTrimmed => -1.0,
        }
    }

    /// The error in a row.
    pub(crate) fn of(self, row: &Row) -> Option<f64> {
        match self {
            Self::Mse => row.mse,
            Self::RelMse => row.relmse,
            Self::Smape => row.smape,
            Self::MseTrimmed => row.mse_trimmed,
        }
    }
}

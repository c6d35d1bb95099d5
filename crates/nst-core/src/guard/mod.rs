//! The guard: blends any estimates with the plain one, and measures what that gains, without a
//! reference.
//!
//! The samples of a lane are in four folds. Without fold j, an expert E gives E_j, and the
//! plain mean of the same samples is S_j. The mean h_j of the fold held out has the
//! expectation I, and is independent of both. So for lanes that are alike, with the changes
//! d_j = E_j − S_j of all experts,
//!
//! ```text
//! A = Σ d_j d_jᵀ,   b = Σ d_j (h_j − S_j),   E[b] = E[Σ d_j (I − S_j)],
//! ```
//!
//! and the weights w = argmin wᵀA w − 2 bᵀw, w ≥ 0, Σw ≤ 1 estimate the best blend T = S + Σ w
//! (E − S), where E and S see all folds. An expert with the bias β beside S of the variance V
//! gets a weight of about V/(V + β²): much at few samples, nothing at many, so that T
//! converges with S whatever the experts do.
//!
//! Lanes are alike if their brightness is. Pixels are split as on a chessboard: what is learnt
//! from one half is applied to the other, so that the same sums say what T gains there.

mod alone;
mod hats;
mod judge;
mod lanes;
mod logarithm;
mod picture;
mod refit;
mod regression;
mod sample;
mod seen;
mod simplex;
mod table;
mod view;
mod weights;

pub use alone::Alone;
pub use judge::Judgement;
pub use lanes::{FittedGuard, Guard};
pub(crate) use picture::INPUTS;
pub use picture::{
    GuardMlp, PictureExpert, PictureGuard, SeenFeature, SeenPicture, TimeLimit, TrainingTable,
};
pub use seen::{Expert, Features, OfTransform, Seen};

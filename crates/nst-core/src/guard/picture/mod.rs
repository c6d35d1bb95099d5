//! The guard over experts that look at neighbours: filters and denoisers.
//!
//! It is the guard of [lanes](super), with other lanes that are alike: those near each other in
//! the picture, and as bright. The sums A and b are in cells of a few pixels and steps of
//! brightness, smoothed over both (a *bilateral grid*: Chen, Paris, Durand, *Real-time
//! Edge-aware Image Processing with the Bilateral Grid*, SIGGRAPH 2007), with a little of the
//! whole picture's sums at the same brightness. The weights that follow are blended with those of
//! the whole picture at that brightness (`weights.rs`), and interpolated.
//!
//! A is that of all folds. Without a group, S has a larger variance than with all folds, and b is
//! made smaller by that.
//!
//! The blend of the guard of lanes is one expert. It was learnt from the other half of the
//! chessboard, so that without a group of a lane's folds it knows nothing of that group.
//!
//! Emission that the camera sees directly is a layer with sums and weights of its own.

mod cells;
mod changes;
mod cost;
mod fits;
mod fitted;
mod guard;
mod kept;
mod layers;
mod learned;
mod near;
mod odd;
mod panel;
mod seen;
mod simplex;
mod training;
mod weights;

pub use cost::TimeLimit;
pub use guard::PictureGuard;
pub use learned::GuardMlp;
pub(crate) use learned::INPUTS;
pub use seen::{PictureExpert, SeenFeature, SeenPicture};
pub use training::TrainingTable;

#[cfg(test)]
mod tests;

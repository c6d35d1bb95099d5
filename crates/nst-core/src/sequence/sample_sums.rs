//! [`SampleSums`]: what a rendering is continued from, beside its terms.

use super::{FeatureSums, LaneSums, PowerSums};

/// All sums of the samples of the pixels of a picture, or of some of its rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SampleSums {
    /// `[lane]`
    pub lanes: Vec<LaneSums>,
    /// Those of the features, `[pixel]`, if they are kept.
    pub features: Option<Vec<FeatureSums>>,
    /// Those of further powers of the samples, of the same lanes; of no powers if none are kept.
    pub powers: PowerSums,
}

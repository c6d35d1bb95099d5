//! What a sequence file says about itself.

use nst_core::{FurtherPowers, Grid, Keep, Side};

use super::{feature_state, power_state, state};
use crate::{ColorModel, Error, layers::layer_channels, rows::Channel};

/// The version of the format that this module writes, and the only one it reads.
pub(super) const VERSION: &str = "1";

/// What the header of a sequence file says.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceInfo {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// The channels of each layer; lanes are planar, in their order.
    pub model: ColorModel,
    /// The number of samples behind each stored term, increasing.
    pub sample_counts: Vec<u32>,
    /// The side channels, sorted.
    pub sides: Vec<Side>,
    /// The scene's fingerprint; empty if unknown.
    pub scene: String,
    /// The sampler's name; empty if unknown.
    pub sampler: String,
    /// The seeds of the samples: one, several of a merged sequence, or none if unknown.
    pub seeds: Vec<u64>,
    /// How long the rendering took, in seconds; 0 if unknown.
    pub render_seconds: f32,
    /// How the rendering can be continued; the file then contains its sums, too.
    pub resume: Option<ResumeInfo>,
}

/// What continuing a rendering needs to know beside its scene, sampler and seed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResumeInfo {
    /// The terms to keep.
    pub keep: Keep,
    /// The renderer's name for how it chooses positions within a pixel.
    pub pixel_filter: String,
    /// The most vertices of a path after the camera.
    pub max_depth: u32,
    /// Whether Russian roulette may end paths early.
    pub russian_roulette: bool,
    /// The further powers of the samples whose sums there are.
    pub powers: FurtherPowers,
}

impl SequenceInfo {
    /// The number of samples behind the last term.
    #[must_use]
    pub fn samples(&self) -> u32 {
        self.sample_counts.last().copied().unwrap_or_default()
    }

    /// The place of each lane in the picture.
    ///
    /// # Errors
    /// [`Error::Core`] if there are none, or too many.
    pub fn grid(&self) -> Result<Grid, Error> {
        let [width, height] = self.size;
        Ok(Grid::new(width, height, self.model.channels().len() as u32, 0)?)
    }

    /// The f32 channels: the picture, the terms, the side channels.
    pub(super) fn channels(&self) -> Vec<Channel> {
        let lanes = self.model.channels();
        let terms = self.sample_counts.iter().map(|&count| term_name(count));
        let layers = [String::new()].into_iter().chain(terms).map(|layer| (layer, lanes));
        let sides =
            self.sides.iter().map(|side| (side.to_string(), self.model.side_channels(side)));
        layers
            .chain(sides)
            .flat_map(|(layer, channels)| layer_channels(&layer, channels).collect::<Vec<_>>())
            .collect()
    }

    /// The channels of the state, none if the rendering cannot be continued.
    pub(super) fn state_channels(&self) -> Vec<Channel> {
        let Some(resume) = &self.resume else { return Vec::new() };
        let mut channels = state::channels(self.model);
        if self.has_features() {
            channels.extend(feature_state::channels());
        }
        channels.extend(power_state::channels(resume.powers, self.model));
        channels
    }

    /// The further powers whose sums a state has.
    #[must_use]
    pub fn further_powers(&self) -> FurtherPowers {
        self.resume.as_ref().map_or(FurtherPowers::NONE, |resume| resume.powers)
    }

    /// Whether there are features, which a state then has, too.
    #[must_use]
    pub fn has_features(&self) -> bool {
        self.sides.iter().any(Side::is_feature)
    }
}

pub(super) fn term_name(sample_count: u32) -> String {
    format!("S{sample_count:04}")
}

//! What an expert sees that looks at neighbours, and the filter as such an expert.

use crate::{
    Error, Grid, Support, WelchFilter,
    filter::{Guide, Means, Planes, REACH},
};

/// Means over some of the samples of a picture, or of some of its rows: of what surfaces
/// reflect, of the emission that the camera sees directly, or of both together. Where a group of
/// folds is held out, nothing of its samples is in any of these numbers.
#[derive(Clone, Copy, Debug)]
pub struct SeenPicture<'a> {
    /// Where the lanes lie. Experts read its halo, too, and estimate its inner rows.
    pub grid: &'a Grid,
    /// Of which of the inner rows estimates are wanted. What is written of the others is not read.
    pub asked: &'a [bool],
    /// How many samples of each lane.
    pub samples: f64,
    /// The mean of |S| over all lanes of the picture. Above 0.
    pub unit: f64,
    /// The mean of the samples, `[lane]`: the plain estimate.
    pub mean: &'a [f32],
    /// The mean of their [roots](crate::root), `[lane]`; NaN where it is not known.
    pub root: &'a [f32],
    /// The reflectance of what the camera sees, `[lane]`.
    pub albedo: Option<SeenFeature<'a>>,
    /// The mean shading normal, `[coordinate][pixel]`.
    pub normal: Option<SeenFeature<'a>>,
}

/// A feature over the same samples.
#[derive(Clone, Copy, Debug)]
pub struct SeenFeature<'a> {
    /// Its means.
    pub mean: &'a [f32],
    /// The estimated variances of the means.
    pub variance: &'a [f32],
}

/// Estimates of pictures whose worth the [`PictureGuard`](super::PictureGuard) measures.
///
/// As with an [`Expert`](crate::guard::Expert), it must be a function of what it
/// [sees](SeenPicture) alone.
pub trait PictureExpert: Send + Sync {
    /// What to call it.
    fn name(&self) -> &str;

    /// How far it looks.
    fn support(&self) -> Support;

    /// Whether it estimates directly seen emission, too: by itself, and as what it says of all
    /// light more than of what surfaces reflect. Roots are not known of either.
    fn estimates_emission(&self) -> bool {
        false
    }

    /// Writes estimates of the lanes of the inner rows. What is not finite counts as the plain
    /// estimate.
    ///
    /// # Errors
    /// What concerns all lanes; the guard then goes on without it.
    fn estimate(&self, seen: &SeenPicture<'_>, out: &mut [f32]) -> Result<(), Error>;
}

/// By how much albedos and normals must differ to count as those of different surfaces.
const ALBEDO: f32 = 0.05;
const NORMAL: f32 = 0.15;

impl PictureExpert for WelchFilter {
    fn name(&self) -> &'static str {
        "filter"
    }

    fn support(&self) -> Support {
        Support::Radius(REACH)
    }

    fn estimate(&self, seen: &SeenPicture<'_>, out: &mut [f32]) -> Result<(), Error> {
        let SeenPicture { grid, samples, mean, root, .. } = *seen;
        let nothing = vec![0.0; grid.pixels()];
        let planes = Planes::new(grid, &Means { samples, mean, root }, &guides(seen, &nothing));
        self.run(&planes, out);
        Ok(())
    }
}

/// Three planes of each feature that there is. A picture with another number of channels than
/// three has the albedo of its first one.
fn guides<'a>(seen: &SeenPicture<'a>, nothing: &'a [f32]) -> Vec<Guide<'a>> {
    let pixels = seen.grid.pixels();
    let mut guides = Vec::new();
    for (feature, scale) in [(seen.albedo, ALBEDO), (seen.normal, NORMAL)] {
        let Some(SeenFeature { mean, variance }) = feature else { continue };
        let planes = mean.chunks_exact(pixels).zip(variance.chunks_exact(pixels));
        let planes = planes.take(if mean.len() == 3 * pixels { 3 } else { 1 });
        let planes = planes.chain([(nothing, nothing); 2]).take(3);
        guides.extend(planes.map(|(values, variances)| Guide { values, variances, scale }));
    }
    guides
}

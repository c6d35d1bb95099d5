//! What measures experts on a picture.

use super::{
    super::{
        lanes::Guard,
        sample::GROUPS,
        seen::{STATISTICS, left_out},
    },
    cells::{Cells, Division, Rows},
    fitted::FittedPicture,
    layers::Strip,
    panel::{Failure, Panel},
    seen::PictureExpert,
    simplex::MOST,
};
use crate::{Error, Fitted, Requirements, Side, Strips, Support, Transform};

/// The features that are read where there are any: by fold, as they are as noisy as radiance where
/// a pixel sees several surfaces.
const FEATURES: &[Side] = Side::FEATURES.split_at(4).1;

/// Blends the plain estimate with experts that look at neighbours, and with the [`Guard`] of
/// lanes, as far as samples that were held out support it. Without a [`Grid`](crate::Grid), it
/// is that guard alone.
pub struct PictureGuard {
    lane: Guard,
    /// Whether the guard of lanes is one of the experts.
    blends_lane: bool,
    experts: Vec<Box<dyn PictureExpert>>,
}

impl PictureGuard {
    /// The most experts that look at neighbours.
    pub const MOST_EXPERTS: usize = MOST - 1;

    /// A guard over these experts and the blend of a guard of lanes. The last expert is also the
    /// one by which brightness is told: that which leaves the least noise.
    ///
    /// # Errors
    /// [`Error::Batch`] if there are too many.
    pub fn new(lane: Guard, experts: Vec<Box<dyn PictureExpert>>) -> Result<Self, Error> {
        if experts.len() > Self::MOST_EXPERTS {
            let (count, most) = (experts.len(), Self::MOST_EXPERTS);
            let message =
                format!("{count} experts that look at neighbours; at most {most} can be blended");
            return Err(Error::Batch(message));
        }
        Ok(Self { lane, blends_lane: true, experts })
    }

    /// The same without the blend of the guard of lanes.
    #[must_use]
    pub fn without_lane(self) -> Self {
        Self { blends_lane: false, ..self }
    }

    /// How many rows beside a strip its experts read.
    fn halo(&self) -> u32 {
        let halos = self.experts.iter().map(|expert| match expert.support() {
            Support::Radius(radius) => radius,
            Support::Lane | Support::Pixel | Support::Picture => 0,
        });
        halos.max().unwrap_or(0)
    }

    /// Measures the experts on all strips: sums of each layer, or the expert that failed.
    fn measure(
        &self,
        panel: &Panel<'_>,
        strips: &mut dyn Strips,
        pixels: usize,
    ) -> Result<Result<Vec<Cells>, Failure>, Error> {
        let mut cells: Vec<Cells> = Vec::new();
        strips.rewind(self.halo())?;
        while let Some(batch) = strips.next_strip()? {
            let strip = Strip::new(&batch).expect("the guard of lanes has seen folds and a grid");
            // One by one: what they need meanwhile is not in memory for all of them.
            let views = (0..=GROUPS).map(|group| panel.look(&strip, group));
            let views = match views.collect::<Result<Vec<_>, _>>() {
                Ok(views) => views,
                Err(failure) => return Ok(Err(failure)),
            };
            let (width, inner) = (strip.grid.width(), strip.grid.inner_rows());
            if cells.is_empty() {
                let division = Division::new(width, pixels / width);
                cells.resize_with(views[0].len(), || Cells::new(division));
            }
            let halves = batch.halves(inner.start * width..inner.end * width);
            for (layer, cells) in cells.iter_mut().enumerate() {
                let rows = Rows {
                    width,
                    channels: strip.grid.channels(),
                    first: strip.grid.first_row() as usize + inner.start,
                    halves: &halves,
                    held: std::array::from_fn(|group| &views[group][layer]),
                };
                cells.add(&rows, &panel.counts);
            }
        }
        Ok(Ok(cells))
    }
}

impl Transform for PictureGuard {
    fn requires(&self) -> Requirements {
        let whole = self.experts.iter().any(|expert| expert.support() == Support::Picture);
        let support = if whole { Support::Picture } else { Support::Radius(self.halo()) };
        Requirements { support, optional: FEATURES, powers: self.lane.powers(), ..STATISTICS }
    }

    fn fit<'a>(&'a self, strips: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        let lane = self.lane.measure(strips)?;
        let Some((counts, unit, pixels)) = lane.of_picture() else {
            return Ok(Box::new(lane));
        };
        let mut notes = lane.judgement().notes.clone();
        let experts = self.experts.iter().map(|expert| &**expert).collect();
        let mut panel = Panel { lane, blends_lane: self.blends_lane, experts, counts, unit };
        loop {
            match self.measure(&panel, strips, pixels)? {
                Ok(cells) => return Ok(Box::new(FittedPicture::new(panel, &cells, notes))),
                Err(Failure { expert, error }) => {
                    let expert = panel.experts.remove(expert);
                    notes.push(left_out(expert.name(), error));
                }
            }
        }
    }
}

//! What measures experts on a picture.

use std::time::Instant;

use super::{
    super::{
        lanes::{FittedGuard, Guard},
        sample::GROUPS,
        seen::{STATISTICS, left_out},
    },
    cells::{Cells, Division, Rows},
    changes,
    cost::{TILE, TimeLimit, tile},
    fitted::FittedPicture,
    kept::Kept,
    layers::{FEATURES, Strip},
    learned::GuardMlp,
    odd::Odd,
    panel::{Failure, Panel, WAYS},
    seen::PictureExpert,
    simplex::MOST,
    training::TrainingTable,
};
use crate::{Error, FOLDS, Fitted, Requirements, SequenceBatch, Strips, Support, Transform, Whole};

/// Blends the plain estimate with experts that look at neighbours, and with the [`Guard`] of
/// lanes, as far as samples that were held out support it. Without a [`Grid`](crate::Grid), it
/// is that guard alone.
pub struct PictureGuard {
    lane: Guard,
    /// Whether the guard of lanes is one of the experts.
    blends_lane: bool,
    experts: Vec<Box<dyn PictureExpert>>,
    network: Option<GuardMlp>,
    limit: TimeLimit,
}

/// In pictures of fewer pixels, what neighbours say is too much alike to tell experts that are right
/// from such as are so by chance.
const LEAST_PIXELS: usize = 1024;

/// Pictures of fewer tiles take a second or two at most, and no measurement of time decides on
/// their bits.
const LEAST_TILES: usize = 16;

impl PictureGuard {
    /// The most experts that look at neighbours; one that estimates emission, too, says that in two
    /// ways, and there may be half as many of those.
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
        let of_emission = experts.iter().filter(|it| it.estimates_emission()).count();
        let most = Self::MOST_EXPERTS / WAYS;
        if of_emission > most {
            let message = format!("{of_emission} experts that estimate emission; at most {most}");
            return Err(Error::Batch(message));
        }
        let limit = TimeLimit::default();
        Ok(Self { lane, blends_lane: true, experts, network: None, limit })
    }

    /// The same without the blend of the guard of lanes.
    #[must_use]
    pub fn without_lane(self) -> Self {
        Self { blends_lane: false, ..self }
    }

    /// The same with a network that corrects the weights of the reflected layer, where it knows the
    /// experts and so many samples, and where nothing that was held out says that it loses.
    #[must_use]
    pub fn learned(self, network: GuardMlp) -> Self {
        Self { network: Some(network), ..self }
    }

    /// The same within a limit: where the experts would take longer for a large picture, by what they
    /// take for a tile, the guard of lanes goes on alone.
    #[must_use]
    pub fn within(self, limit: TimeLimit) -> Self {
        Self { limit, ..self }
    }

    /// All experts, for a picture with so many samples in its folds, whose mean is `unit`.
    fn panel<'a>(&'a self, lane: FittedGuard<'a>, counts: [f64; FOLDS], unit: f64) -> Panel<'a> {
        let experts = self.experts.iter().map(|expert| &**expert).collect();
        Panel { lane, blends_lane: self.blends_lane, experts, counts, unit }
    }

    /// What a network that corrects weights is trained with: its inputs and what experts change, in
    /// a whole picture. The slots of the network are those of the experts, in their order.
    ///
    /// # Errors
    /// [`Error::Batch`] if the batch is no picture with statistics of folds, those of experts, and
    /// as for [`Transform::fit`].
    pub fn training_table(&self, batch: &SequenceBatch) -> Result<TrainingTable, Error> {
        let mut strips = Whole::new(batch);
        let lane = self.lane.measure(&mut strips)?;
        let (counts, unit, pixels) = lane.of_picture().ok_or_else(|| {
            Error::Batch("no picture with statistics of folds that can be held out".into())
        })?;
        let panel = self.panel(lane, counts, unit);
        let measured = self.measure(&panel, &mut strips, pixels)?;
        let measured = measured.map_err(|failure| failure.error)?;
        TrainingTable::new(&panel, &measured.cells, batch)
    }

    /// How many rows beside a strip are read.
    fn halo(&self) -> u32 {
        let halos = self.experts.iter().map(|expert| match expert.support() {
            Support::Radius(radius) => radius,
            Support::Lane | Support::Pixel | Support::Picture => 0,
        });
        halos.fold(changes::REACH, u32::max)
    }

    /// Measures the experts on all strips; or returns the expert that failed.
    fn measure(
        &self,
        panel: &Panel<'_>,
        strips: &mut dyn Strips,
        pixels: usize,
    ) -> Result<Result<Measured, Failure>, Error> {
        let mut measured = Measured::default();
        let Measured { cells, kept, odd } = &mut measured;
        strips.rewind(self.requires().halo())?;
        while let Some(batch) = strips.next_strip()? {
            let strip = Strip::new(&batch).expect("the guard of lanes has seen folds and a grid");
            strip.count_odd(odd);
            // One by one: what they need meanwhile is not in memory for all of them.
            let views = (0..=GROUPS).map(|group| panel.look(&strip, group));
            let mut views = match views.collect::<Result<Vec<_>, _>>() {
                Ok(views) => views,
                Err(failure) => return Ok(Err(failure)),
            };
            let (width, inner) = (strip.grid.width(), strip.grid.inner_rows());
            if cells.is_empty() {
                let division = Division::new(width, pixels / width);
                cells.resize_with(views[0].len(), || Cells::new(division));
            }
            let in_picture = strip.grid.picture_rows();
            let halves = batch.halves(inner.start * width..inner.end * width);
            for (layer, cells) in cells.iter_mut().enumerate() {
                let rows = Rows {
                    width,
                    channels: strip.grid.channels(),
                    first: in_picture.start,
                    halves: &halves,
                    held: std::array::from_fn(|group| &views[group][layer]),
                };
                cells.add(&rows, &panel.counts);
            }
            kept.keep(in_picture, views.swap_remove(GROUPS), inner.len() * width == pixels);
        }
        Ok(Ok(measured))
    }

    /// Why the experts are left out of a picture of so many pixels, if they would take longer than
    /// they may.
    fn too_slow(&self, panel: &Panel<'_>, pixels: usize) -> Result<Option<String>, Error> {
        let Some(limit) = self.limit.get().filter(|_| pixels >= LEAST_TILES * TILE) else {
            return Ok(None);
        };
        let tile = tile()?;
        let start = Instant::now();
        if self.measure(panel, &mut Whole::new(&tile), TILE)?.is_err() {
            return Ok(None);
        }
        let time = start.elapsed().mul_f64(pixels as f64 / TILE as f64);
        let (names, [time, limit]) = (self.names(), [time, limit].map(|it| it.as_secs_f64()));
        Ok((time > limit).then(|| {
            format!(
                "left out: {names}, which would take about {time:.1} s, and may take {limit:.1} s"
            )
        }))
    }

    /// The experts that look at neighbours.
    fn names(&self) -> String {
        let names: Vec<&str> = self.experts.iter().map(|expert| expert.name()).collect();
        names.join(", ")
    }
}

/// What experts have said of a picture.
#[derive(Default)]
struct Measured {
    /// Sums of each layer.
    cells: Vec<Cells>,
    kept: Kept,
    odd: Odd,
}

impl Transform for PictureGuard {
    fn requires(&self) -> Requirements {
        let whole = self.experts.iter().any(|expert| expert.support() == Support::Picture);
        let support = if whole { Support::Picture } else { Support::Radius(self.halo()) };
        Requirements { support, optional: FEATURES, powers: self.lane.powers(), ..STATISTICS }
    }

    fn fit<'a>(&'a self, strips: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        // With the same halo each time, as strips may be kept as they are.
        let lane = self.lane.measure_within(strips, self.requires().halo())?;
        let Some((counts, unit, pixels)) = lane.of_picture() else {
            return Ok(Box::new(lane));
        };
        let mut notes = lane.judgement().notes.clone();
        let mut panel = self.panel(lane, counts, unit);
        if pixels < LEAST_PIXELS {
            let names = self.names();
            let why = format!("too few pixels to measure that ({pixels}, of {LEAST_PIXELS})");
            notes.push(format!("left out: {names}; the picture has {why}"));
            panel.experts.clear();
        }
        if let Some(why) = self.too_slow(&panel, pixels)? {
            return Ok(Box::new(panel.lane.noting(why)));
        }
        loop {
            match self.measure(&panel, strips, pixels)? {
                Ok(Measured { cells, kept, odd }) => {
                    notes.extend(odd.notes(pixels));
                    // It has only seen lists with such experts.
                    let network = self.network.as_ref().filter(|_| !panel.experts.is_empty());
                    return Ok(Box::new(FittedPicture::new(panel, (&cells, kept), network, notes)));
                }
                Err(Failure { expert, error }) => {
                    let expert = panel.experts.remove(expert);
                    notes.push(left_out(expert.name(), error));
                }
            }
        }
    }
}

//! What the experts are worth on a picture, and the estimates that follow.

use rayon::prelude::*;

use super::{
    super::{
        judge::{Judgement, interval},
        sample::GROUPS,
    },
    cells::{Cells, Held},
    kept::Kept,
    layers::{EMITTED, Strip},
    learned::GuardMlp,
    panel::Panel,
    weights::{Fit, Gain, Weights},
};
use crate::{Error, Estimates, Fitted, Grid, SequenceBatch, Status};

/// A [`PictureGuard`](super::PictureGuard) that has measured its experts on a picture.
pub(super) struct FittedPicture<'a> {
    panel: Panel<'a>,
    kept: Kept,
    /// Of the reflected layer, and of the emitted one if there is one.
    weights: Vec<Weights>,
    judgement: Judgement,
}

impl<'a> FittedPicture<'a> {
    /// With weights by the sums of each layer; a network may correct those of the reflected one. What
    /// the experts have said with all folds is kept.
    pub(super) fn new(
        panel: Panel<'a>,
        (cells, kept): (&[Cells], Kept),
        network: Option<&GuardMlp>,
        mut notes: Vec<String>,
    ) -> Self {
        let names = panel.names();
        let samples = panel.counts.iter().sum();
        let learned = network.map(|network| network.of(&names, samples, panel.unit)).transpose();
        let mut left_out =
            |why| notes.push(format!("left out: the network that weighs experts: {why}"));
        let learned = learned.unwrap_or_else(|why| {
            left_out(why);
            None
        });
        let learned = [learned.as_ref(), None];
        let fits = cells.iter().zip([names.len(), panel.count_of_emission()]).zip(learned);
        let fits = fits.map(|((cells, count), learned)| Fit::new(cells, count, learned));
        let (mut weights, mut gains, mut is_learned) = (Vec::new(), Vec::new(), false);
        for fit in fits {
            weights.push(fit.weights);
            gains.push(fit.gain);
            match fit.learned {
                Ok(learned) => is_learned |= learned,
                Err(why) => left_out(why),
            }
        }
        let mut fitted = Self { panel, kept, weights, judgement: Judgement::default() };
        fitted.judgement = Judgement { learned: is_learned, ..fitted.judge(&gains, notes) };
        fitted
    }

    /// What the weights of both layers gain.
    fn judge(&self, gains: &[Gain], notes: Vec<String>) -> Judgement {
        let mut blocks = gains[0].blocks.clone();
        for gain in &gains[1..] {
            let pairs = blocks.iter_mut().flatten().zip(gain.blocks.iter().flatten());
            pairs.for_each(|(sum, more)| *sum += more);
        }
        let samples = self.panel.counts.iter().sum();
        let trusted = gains.iter().flat_map(|gain| gain.trust).any(|trust| trust > 0.0);
        let (ratio, interval) = interval(&blocks, samples, trusted);
        let names = self.panel.names().into_iter().map(str::to_owned);
        let experts = names.zip(gains[0].trust).collect();
        Judgement { experts, ratio, interval, notes, learned: false }
    }

    /// Writes the estimates of the inner rows of a strip.
    fn estimate(&self, strip: &Strip<'_>, layers: &[Held], out: &mut Estimates) {
        let (grid, inner) = (strip.grid, strip.grid.inner_rows());
        let (width, pixels) = (grid.width(), inner.len() * grid.width());
        let last = grid.inner(strip.batch.last());
        let variances = strip.variances();
        let rows = Rows {
            layers,
            pixels,
            last: &last,
            variances: &variances,
            width,
            first: grid.picture_rows().start,
        };
        let (values, status, errors) = out.reset_with_errors(last.len());
        let mut weights = vec![0.0; self.judgement.experts.len() * pixels];
        let mut outputs: Vec<RowOutput<'_>> = Vec::new();
        outputs.resize_with(inner.len(), RowOutput::default);
        let planes = values.chunks_exact_mut(pixels).zip(status.chunks_exact_mut(pixels));
        for ((values, status), errors) in planes.zip(errors.chunks_exact_mut(pixels)) {
            let parts = values.chunks_exact_mut(width).zip(status.chunks_exact_mut(width));
            let parts = parts.zip(errors.chunks_exact_mut(width));
            for (row, ((values, status), errors)) in outputs.iter_mut().zip(parts) {
                row.channels.push(Output { values, status, errors });
            }
        }
        for plane in weights.chunks_exact_mut(pixels) {
            let parts = outputs.iter_mut().zip(plane.chunks_exact_mut(width));
            parts.for_each(|(row, weights)| row.weights.push(weights));
        }
        let outputs = outputs.into_par_iter().enumerate();
        outputs.for_each(|(y, mut out)| self.estimate_row(&rows, y, &mut out));
        out.set_weights(weights);
    }

    /// Leaves the plain estimates of a strip, where no expert is trusted.
    fn keep_plain(&self, batch: &SequenceBatch, status: Status, out: &mut Estimates) {
        out.fall_back(batch, status);
        out.errors_unknown();
        let pixels = out.values().len() / batch.grid().map_or(1, Grid::channels);
        out.set_weights(vec![0.0; self.judgement.experts.len() * pixels]);
    }

    /// Writes the estimates of one of some rows.
    fn estimate_row(&self, rows: &Rows<'_>, y: usize, out: &mut RowOutput<'_>) {
        let (pixels, channels) = (rows.pixels, out.channels.len());
        let mut changes = vec![0.0; channels];
        for x in 0..rows.width {
            let pixel = y * rows.width + x;
            let lanes = (pixel..channels * pixels).step_by(pixels);
            changes.fill(0.0);
            let mut variance = 0.0;
            for (number, (layer, weights)) in rows.layers.iter().zip(&self.weights).enumerate() {
                let (w, of_layer) = weights.at(x, rows.first + y, layer.places[pixel]);
                // Where a layer has no lanes it has no variance, either, and that is a NaN.
                variance += of_layer.max(0.0);
                for (sum, lane) in changes.iter_mut().zip(lanes.clone()) {
                    *sum += layer.changes.iter().zip(w).map(|(of, w)| w * of[lane]).sum::<f32>();
                }
                if number != EMITTED {
                    out.weights.iter_mut().zip(w).for_each(|(weights, w)| weights[x] = w);
                }
            }
            // Of its lanes, the one whose samples differ more has more of it.
            let sum: f32 = lanes.clone().map(|lane| rows.variances[lane]).sum();
            for ((out, lane), change) in out.channels.iter_mut().zip(lanes).zip(&changes) {
                let share = channels as f32 * rows.variances[lane] / sum;
                let share = if share.is_finite() { share } else { 1.0 };
                out.values[x] = rows.last[lane] + change;
                out.errors[x] = (variance * share).sqrt();
                if !out.values[x].is_finite() {
                    out.values[x] = rows.last[lane];
                    (out.status[x], out.errors[x]) = (Status::NotFinite, f32::NAN);
                }
            }
        }
    }
}

/// Rows that are estimated.
struct Rows<'a> {
    layers: &'a [Held],
    pixels: usize,
    /// S and its variance, `[lane]`.
    last: &'a [f32],
    variances: &'a [f32],
    width: usize,
    /// In the picture.
    first: usize,
}

/// Where the estimates of a row are written.
#[derive(Default)]
struct RowOutput<'a> {
    channels: Vec<Output<'a>>,
    /// The experts' weights, `[expert][x]`.
    weights: Vec<&'a mut [f32]>,
}

/// Those of one channel.
struct Output<'a> {
    values: &'a mut [f32],
    status: &'a mut [Status],
    errors: &'a mut [f32],
}

impl Fitted for FittedPicture<'_> {
    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let Some(strip) = Strip::new(batch) else {
            self.keep_plain(batch, Status::NoFolds, out);
            return Ok(());
        };
        if let Some(layers) = self.kept.of(&strip.grid.picture_rows()) {
            self.estimate(&strip, layers, out);
            return Ok(());
        }
        match self.panel.look(&strip, GROUPS) {
            Ok(layers) => self.estimate(&strip, &layers, out),
            Err(_) => self.keep_plain(batch, Status::ExpertFailed, out),
        }
        Ok(())
    }

    fn estimates_errors(&self) -> bool {
        true
    }

    fn has_weights(&self) -> bool {
        true
    }

    fn judgement(&self) -> Option<&Judgement> {
        Some(&self.judgement)
    }
}

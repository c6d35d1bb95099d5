//! What a network that corrects weights is trained with.

use ndarray::{Array, Array2, Array3, Array4, Array5};

use super::{
    super::sample::GROUPS,
    cells::{Cells, HALVES, KNOTS},
    fits::Fits,
    layers::{EMITTED, Strip},
    learned::{INPUTS, Inputs},
    panel::Panel,
    weights::Fit,
};
use crate::{Error, SequenceBatch};

/// A picture, as a network sees it that corrects the weights of the reflected layer.
///
/// With weights w that are bilinear between the centres of cells, linear between knots of
/// brightness, and each the mean of both halves, T = `rest` + Σ w · `changes`.
#[derive(Clone, Debug)]
pub struct TrainingTable {
    /// The names of the experts.
    pub experts: Vec<String>,
    /// The width and height of a cell, in pixels.
    pub cell: usize,
    /// How many samples of each lane.
    pub samples: u32,
    /// What the network reads, `[cells down][cells across][knot][half][input]`; 0 where nothing is
    /// near.
    pub inputs: Array5<f32>,
    /// The closed form's weights, learnt from that half,
    /// `[cells down][cells across][knot][half][expert]`.
    pub closed: Array5<f32>,
    /// Where the brightness of a pixel lies between the knots, `[y][x]`.
    pub places: Array2<f32>,
    /// What each expert changes in the reflected layer, `[expert][channel][y][x]`.
    pub changes: Array4<f32>,
    /// S, and what the guard changes in the layer of emission, `[channel][y][x]`.
    pub rest: Array3<f32>,
}

impl TrainingTable {
    /// Of a whole picture.
    pub(super) fn new(
        panel: &Panel<'_>,
        cells: &[Cells],
        batch: &SequenceBatch,
    ) -> Result<Self, Error> {
        let strip = Strip::new(batch).expect("the guard of lanes has seen folds and a grid");
        let layers = panel.look(&strip, GROUPS).map_err(|failure| failure.error)?;
        let (names, division) = (panel.names(), cells[0].division);
        let (width, height) = (strip.grid.width(), strip.grid.pixels() / strip.grid.width());
        let channels = strip.grid.channels();

        let fits = Fits::new(&cells[0], names.len());
        let slots: Vec<usize> = (0..names.len()).collect();
        let of_rows = Inputs::new(&fits, &slots, panel.unit);
        let shape = |numbers: usize| (division.down, division.across, KNOTS, HALVES, numbers);
        let mut inputs = Array5::zeros(shape(INPUTS));
        let mut closed = Array5::zeros(shape(names.len()));
        let mut near = Vec::new();
        for row in 0..division.down {
            fits.near(row, &mut near);
            let weights = fits.by_both(row);
            let mut of_row = of_rows.row(row, &near);
            of_rows.blend(&mut of_row, &weights);
            for input in of_row {
                for (number, x) in input.numbers.into_iter().enumerate() {
                    inputs[[row, input.column, input.knot, input.half, number]] = x;
                }
            }
            for (column, weights) in weights.iter().enumerate() {
                for (half, weights) in weights.iter().enumerate() {
                    for (knot, weights) in weights.iter().enumerate() {
                        for (expert, w) in weights.iter().take(names.len()).enumerate() {
                            closed[[row, column, knot, half, expert]] = *w as f32;
                        }
                    }
                }
            }
        }

        let mut rest = Array3::from_shape_vec((channels, height, width), batch.last().to_vec())
            .expect("the lanes of a picture");
        if let (Some(held), Some(cells)) = (layers.get(EMITTED), cells.get(EMITTED)) {
            let fit = Fit::new(cells, panel.count_of_emission(), None);
            for ((channel, y, x), value) in rest.indexed_iter_mut() {
                let (w, _) = fit.weights.at(x, y, held.places[y * width + x]);
                let lane = (channel * height + y) * width + x;
                *value += held.changes.iter().zip(w).map(|(of, w)| w * of[lane]).sum::<f32>();
            }
        }
        let [held, ..] = &layers[..] else { unreachable!("surfaces are a layer") };
        let places = held.places.iter().map(|place| place.in_knots());
        let changes = held.changes.iter().flatten().copied();
        Ok(Self {
            experts: names.into_iter().map(str::to_owned).collect(),
            cell: division.size,
            samples: panel.counts.iter().sum::<f64>() as u32,
            inputs,
            closed,
            places: Array::from_iter(places)
                .into_shape_with_order((height, width))
                .expect("pixels"),
            changes: Array::from_iter(changes)
                .into_shape_with_order((held.changes.len(), channels, height, width))
                .expect("lanes of each expert"),
            rest,
        })
    }
}

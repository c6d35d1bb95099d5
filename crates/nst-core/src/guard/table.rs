//! The table: an expert that learns from the very batch by how much the plain estimate errs
//! in lanes of one brightness and one spread.
//!
//! In the cell c of a grid of hat functions φ_c over brightness and spread it changes S by
//! g_c s, where s is the lane's scale. Least squares against means h that are held out give
//!
//! ```text
//! g_c = Σ φ_c s (h − S) / Σ φ_c s²,
//! ```
//!
//! and g_c is drawn towards 0 by as much of it as may be noise. What half of the chessboard
//! teaches is applied to the other half.

use std::ops::Range;

use super::{
    hats::grid_cells,
    sample::Sample,
    simplex::certainty,
    view::{BRIGHTNESS, Lanes, SPREAD},
};

const COLUMNS: usize = SPREAD.knots();
const CELLS: usize = BRIGHTNESS.knots() * COLUMNS;

/// How many variances of the noise are taken off a gain.
const CAUTION: f64 = 2.0;

/// g of the cells, for each half that they were learnt from.
#[derive(Clone, Debug)]
pub(super) struct Table {
    changes: [[f32; CELLS]; 2],
}

/// Sums of the cells, by the half that the pixels are in.
#[derive(Clone)]
struct Sums {
    /// Σ φ s²
    scales: [[f64; CELLS]; 2],
    /// Σ φ s (h − S)
    products: [[f64; CELLS]; 2],
    /// Σ over pixels of (Σ φ s (h − S))², the sum inside over channels and groups: channels
    /// share samples, and what is held out of a pixel in turn adds to 0.
    noise: [[f64; CELLS]; 2],
}

impl Table {
    /// Learns from views without each of the groups, and the means of those groups minus the
    /// plain estimates, `[group][lane]`.
    pub(super) fn fit(sample: &Sample, views: &[Lanes], missing: &[Vec<f32>]) -> Self {
        let parts = sample.in_tasks(|pixels| Sums::of(sample, views, missing, pixels));
        let mut sums = Sums::default();
        parts.iter().for_each(|part| sums.add(part));
        let change = |half: usize, cell: usize| {
            let (product, scale) = (sums.products[half][cell], sums.scales[half][cell]);
            let gain = product / scale * certainty(product, sums.noise[half][cell], CAUTION);
            if gain.is_finite() { gain as f32 } else { 0.0 }
        };
        Self { changes: [0, 1].map(|half| std::array::from_fn(|cell| change(half, cell))) }
    }

    /// What it changes, `[lane]`, by the half that each lane is in: the other half teaches.
    pub(super) fn changes(&self, lanes: &Lanes, halves: &[u8]) -> Vec<f32> {
        let change = |(lane, (scale, &half)): (usize, (f32, &u8))| {
            let changes = &self.changes[1 - usize::from(half)];
            let sum: f32 =
                cells(lanes, lane).map(|(cell, share)| share * changes[cell]).iter().sum();
            sum * scale
        };
        lanes.scales(0..halves.len()).zip(halves).enumerate().map(change).collect()
    }
}

/// The four cells that a lane lies between, and its shares of them.
#[inline(always)]
fn cells(lanes: &Lanes, lane: usize) -> [(usize, f32); 4] {
    grid_cells(lanes.brightness(lane), lanes.spread(lane), COLUMNS)
}

impl Default for Sums {
    fn default() -> Self {
        let zeros = [[0.0; CELLS]; 2];
        Self { scales: zeros, products: zeros, noise: zeros }
    }
}

impl Sums {
    /// Those of a task's pixels.
    fn of(sample: &Sample, views: &[Lanes], missing: &[Vec<f32>], pixels: Range<usize>) -> Self {
        let mut sums = Self::default();
        let mut touched: Vec<(usize, f64)> = Vec::new();
        for pixel in pixels {
            let half = usize::from(sample.pixels[pixel].half);
            touched.clear();
            for (view, missing) in views.iter().zip(missing) {
                for lane in sample.lanes_of(pixel) {
                    let scale = view.scale(lane);
                    for (cell, share) in cells(view, lane) {
                        let share = f64::from(share);
                        let product = share * scale * f64::from(missing[lane]);
                        sums.scales[half][cell] += share * scale * scale;
                        sums.products[half][cell] += product;
                        match touched.iter_mut().find(|(known, _)| *known == cell) {
                            Some((_, sum)) => *sum += product,
                            None => touched.push((cell, product)),
                        }
                    }
                }
            }
            for &(cell, sum) in &touched {
                sums.noise[half][cell] += sum * sum;
            }
        }
        sums
    }

    fn add(&mut self, other: &Self) {
        let pairs = [
            (&mut self.scales, &other.scales),
            (&mut self.products, &other.products),
            (&mut self.noise, &other.noise),
        ];
        for (sums, more) in pairs {
            let more = more.iter().flatten();
            sums.iter_mut().flatten().zip(more).for_each(|(sum, more)| *sum += more);
        }
    }
}

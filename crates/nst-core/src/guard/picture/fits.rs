//! Weights that follow from sums: the closed form.
//!
//! What is near fits best where experts differ from place to place, and what the whole picture
//! says at a brightness has less noise, least where it weighs one expert alone. Weights of these
//! three kinds are blended in turn, by brightness, as each half of the chessboard judges those
//! that were fitted to the other (stacking: Wolpert, *Stacked Generalization*, Neural Networks
//! 1992). Where none helps, S stays.

use rayon::prelude::*;

use super::{
    cells::{Cells, Division, HALVES, KNOTS, Sums},
    near::{Near, of_all, over_brightness},
    simplex::MOST,
};

/// The weight of the whole picture at the same brightness, relative to what is near.
const OF_ALL: f64 = 0.05;

/// Kinds of weights: near a cell, of the whole picture, and of the last expert alone there.
const KINDS: usize = 3;

/// What is fitted to a half of the whole picture at a brightness.
#[derive(Clone, Copy)]
pub(super) struct Whole {
    pub(super) sums: Sums,
    /// Those of the last two kinds.
    pub(super) weights: [[f64; MOST]; KINDS - 1],
}

/// `[half][knot]`
pub(super) type Wholes = [[Whole; KNOTS]; HALVES];

/// Weights of a cell, learnt from a half, `[half][knot]`.
pub(super) type OfCell = [[[f64; MOST]; KNOTS]; HALVES];

/// The closed form's weights of a picture, in its parts.
pub(super) struct Fits<'a> {
    cells: &'a Cells,
    near: Near<'a>,
    whole: Wholes,
    rows: Vec<RowFit>,
    shares: Shares,
}

impl<'a> Fits<'a> {
    /// Fits weights of the first `count` experts to what each half says.
    pub(super) fn new(cells: &'a Cells, count: usize) -> Self {
        let whole: Wholes = of_all(cells).map(|half| half.map(|sums| Whole::new(sums, count)));
        let near = Near::new(cells);
        let rows: Vec<RowFit> = (0..cells.division.down)
            .into_par_iter()
            .map_init(Vec::new, |buffer, row| {
                near.row(row, buffer);
                RowFit::new(cells.row(row), buffer, &whole, count)
            })
            .collect();
        let shares = Shares::new(&rows);
        Self { cells, near, whole, rows, shares }
    }

    /// Sums of a view three times as wide.
    pub(super) fn wide(&self) -> Near<'a> {
        self.near.wide()
    }

    /// Writes the sums near a row of cells.
    pub(super) fn near(&self, row: usize, out: &mut Vec<Sums>) {
        self.near.row(row, out);
    }

    /// The weights of a row of cells, `[column]`, by what both halves say of their kinds.
    pub(super) fn by_both(&self, row: usize) -> Vec<OfCell> {
        self.blended(row, [&self.shares.both; HALVES])
    }

    /// The same, by what one half says: the other half has seen nothing that judges them.
    pub(super) fn by_one(&self, row: usize) -> Vec<OfCell> {
        self.blended(row, self.shares.one.each_ref())
    }

    /// The weights of a row of cells by what is near, `[column]`.
    pub(super) fn by_near(&self, row: usize) -> &[OfCell] {
        &self.rows[row].weights
    }

    /// What is fitted to the whole picture.
    pub(super) fn whole(&self) -> &Wholes {
        &self.whole
    }

    /// The sums.
    pub(super) fn cells(&self) -> &'a Cells {
        self.cells
    }

    /// The weights of all kinds, blended.
    fn blended(&self, row: usize, shares: [&OfKinds; HALVES]) -> Vec<OfCell> {
        let cells = self.rows[row].weights.iter();
        cells.map(|near| blended(near, &self.whole, shares)).collect()
    }
}

impl Whole {
    fn new(sums: Sums, count: usize) -> Self {
        let moments = sums.moments;
        let mut alone = [0.0; MOST];
        if let Some(last) = count.checked_sub(1) {
            alone[last] = moments.best_weight(last);
        }
        Self { sums, weights: [moments.best_weights(count), alone] }
    }
}

/// Weights by what is near, of a row of cells.
struct RowFit {
    /// `[column]`
    weights: Vec<OfCell>,
    /// The kinds of weights as experts, by what a half says of those fitted to the other.
    kinds: [[Sums; KNOTS]; HALVES],
}

/// Shares of the kinds of weights, then zeros, `[knot]`.
type OfKinds = [[f64; MOST]; KNOTS];

/// How the kinds of weights are blended.
struct Shares {
    /// By what both halves say of the weights fitted to the other.
    both: OfKinds,
    /// By what this half alone says, `[half]`. Weights learnt from a half with shares that it
    /// said are judged by the other: the shares of both halves have seen what judges them.
    one: [OfKinds; HALVES],
}

impl RowFit {
    /// To the sums near a row of cells; `own` are those of the cells themselves.
    fn new(own: &[Sums], near: &[Sums], whole: &Wholes, count: usize) -> Self {
        let columns = near.len() / (HALVES * KNOTS);
        let mut row = Self { weights: Vec::with_capacity(columns), kinds: Default::default() };
        for column in 0..columns {
            let mut weights = OfCell::default();
            for half in 0..HALVES {
                for knot in 0..KNOTS {
                    let near = &near[Division::place(column, half, knot)];
                    weights[half][knot] = best(near, &whole[half][knot], count);
                }
            }
            for half in 0..HALVES {
                for (knot, kinds) in row.kinds[half].iter_mut().enumerate() {
                    let own = &own[Division::place(column, half, knot)];
                    if !own.is_empty() {
                        let [all, alone] = whole[1 - half][knot].weights;
                        let of_kinds = [weights[1 - half][knot], all, alone];
                        let moments = own.moments.of_blends(&of_kinds);
                        kinds.add(&Sums { moments, ..*own }, 1.0);
                    }
                }
            }
            row.weights.push(weights);
        }
        row
    }
}

impl Shares {
    fn new(fits: &[RowFit]) -> Self {
        let mut kinds = [[Sums::default(); KNOTS]; HALVES];
        for fit in fits {
            let sums = kinds.as_flattened_mut().iter_mut().zip(fit.kinds.as_flattened());
            sums.for_each(|(sum, of_row)| sum.add(of_row, 1.0));
        }
        let best = |sums| over_brightness(sums).map(|sums| sums.moments.best_weights(KINDS));
        let one = kinds.each_ref().map(best);
        let [mut both, other] = kinds;
        both.iter_mut().zip(&other).for_each(|(sum, other)| sum.add(other, 1.0));
        Self { both: best(&both), one }
    }
}

/// The weights of a cell: those of all kinds, blended.
fn blended(near: &OfCell, whole: &Wholes, shares: [&OfKinds; HALVES]) -> OfCell {
    let mut blend = OfCell::default();
    for half in 0..HALVES {
        for (knot, weights) in blend[half].iter_mut().enumerate() {
            let [all, alone] = &whole[half][knot].weights;
            for (of_kind, share) in
                [&near[half][knot], all, alone].into_iter().zip(shares[half][knot])
            {
                weights.iter_mut().zip(of_kind).for_each(|(sum, w)| *sum += share * w);
            }
        }
    }
    blend
}

/// The weights of a cell, by what is near it and some of the whole picture's sums.
fn best(near: &Sums, whole: &Whole, count: usize) -> [f64; MOST] {
    let Whole { sums: Sums { moments: of_all, .. }, weights: [prior, _] } = whole;
    if near.moments.trace() <= 1e-9 * of_all.trace() {
        return *prior;
    }
    let mut moments = near.moments;
    let of_prior = of_all.times(prior);
    moments.a.iter_mut().zip(&of_all.a).for_each(|(sum, all)| *sum += OF_ALL * all);
    moments.b.iter_mut().zip(&of_prior).for_each(|(sum, all)| *sum += OF_ALL * all);
    moments.best_weights(count)
}

//! Strata with soft edges: hat functions on a line and on a grid.

/// Evenly spaced knots of hat functions from `low` to `high`; numbers beyond count as the
/// nearest of the two.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hats<const N: usize> {
    pub(super) low: f32,
    pub(super) high: f32,
}

/// The two knots beside a number: the first, and the share of the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    first: u8,
    share: f32,
}

impl<const N: usize> Hats<N> {
    /// How many knots there are.
    pub(super) const fn knots(&self) -> usize {
        N
    }

    /// The number at a knot.
    pub(super) fn knot(&self, knot: usize) -> f32 {
        self.low + (self.high - self.low) * knot as f32 / (N - 1) as f32
    }

    /// Where a number lies; a NaN lies at the low end.
    #[inline(always)]
    pub(super) fn place(&self, x: f32) -> Place {
        let per_step = (N - 1) as f32 / (self.high - self.low);
        let at = (x.max(self.low).min(self.high) - self.low) * per_step;
        // By way of 32 bits, as vector instructions have it.
        let first = (at as i32).min(N as i32 - 2);
        Place { first: first as u8, share: at - first as f32 }
    }
}

impl Place {
    /// Where it lies between the knots 0 and N − 1.
    pub(super) fn in_knots(&self) -> f32 {
        f32::from(self.first) + self.share
    }

    /// Both knots with their shares.
    #[inline(always)]
    pub(super) fn knots(&self) -> [(usize, f32); 2] {
        let first = usize::from(self.first);
        [(first, 1.0 - self.share), (first + 1, self.share)]
    }
}

/// The four cells of a grid that a pair of places lies between, with its shares of them; cells
/// are numbered row by row.
#[inline(always)]
pub(super) fn grid_cells(row: Place, column: Place, columns: usize) -> [(usize, f32); 4] {
    let ([(top, a), (bottom, b)], [(left, c), (right, d)]) = (row.knots(), column.knots());
    let (top, bottom) = (top * columns, bottom * columns);
    [(top + left, a * c), (top + right, a * d), (bottom + left, b * c), (bottom + right, b * d)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_add_up_and_ends_are_kept() {
        let hats = Hats::<5> { low: -2.0, high: 2.0 };
        for (x, first, share) in [
            (-9.0, 0, 0.0),
            (-2.0, 0, 0.0),
            (-1.25, 0, 0.75),
            (0.5, 2, 0.5),
            (2.0, 3, 1.0),
            (f32::INFINITY, 3, 1.0),
            (f32::NAN, 0, 0.0),
        ] {
            assert_eq!(hats.place(x), Place { first, share }, "{x}");
        }
        // What is linear between knots is found again.
        let line = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|x| 3.0 * x + 1.0);
        for x in [-1.9_f32, -0.3, 0.0, 1.7] {
            let between: f64 = hats
                .place(x)
                .knots()
                .iter()
                .map(|(knot, share)| f64::from(*share) * line[*knot])
                .sum();
            // Shares are in f32.
            assert!((between - (3.0 * f64::from(x) + 1.0)).abs() < 1e-6);
        }
    }
}

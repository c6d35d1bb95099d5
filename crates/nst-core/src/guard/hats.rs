//! Strata with soft edges: hat functions on a line and on a grid.

/// Evenly spaced knots of hat functions from `low` to `high`; numbers beyond count as the
/// nearest of the two.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hats<const N: usize> {
    pub(super) low: f64,
    pub(super) high: f64,
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

    /// Where a number lies; a NaN lies at the low end.
    pub(super) fn place(&self, x: f64) -> Place {
        let steps = (N - 1) as f64;
        let x = if x.is_nan() { self.low } else { x.clamp(self.low, self.high) };
        let at = (x - self.low) / (self.high - self.low) * steps;
        let first = (at as usize).min(N - 2);
        Place { first: first as u8, share: (at - first as f64) as f32 }
    }
}

impl Place {
    /// Both knots with their shares.
    pub(super) fn knots(&self) -> [(usize, f64); 2] {
        let (first, share) = (usize::from(self.first), f64::from(self.share));
        [(first, 1.0 - share), (first + 1, share)]
    }
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
            (f64::INFINITY, 3, 1.0),
            (f64::NAN, 0, 0.0),
        ] {
            assert_eq!(hats.place(x), Place { first, share }, "{x}");
        }
        // What is linear between knots is found again.
        let line = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|x| 3.0 * x + 1.0);
        for x in [-1.9, -0.3, 0.0, 1.7] {
            let between: f64 =
                hats.place(x).knots().iter().map(|(knot, share)| share * line[*knot]).sum();
            // Shares are in f32.
            assert!((between - (3.0 * x + 1.0)).abs() < 1e-6);
        }
    }
}

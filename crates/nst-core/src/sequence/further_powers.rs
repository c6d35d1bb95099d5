//! [`FurtherPowers`]: of which powers of samples means are kept that most batches do not have.

use super::{Power, Side};

/// A set of powers beside those that [every batch has](Power::is_usual).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FurtherPowers {
    /// Bit i is the i-th of [`Power::all`].
    bits: u16,
}

impl FurtherPowers {
    /// None.
    pub const NONE: Self = Self { bits: 0 };

    /// Those of some powers that not every batch has.
    #[must_use]
    pub fn of(powers: &[Power]) -> Self {
        let wanted = |power: &Power| powers.contains(power) && !power.is_usual();
        let wanted = Power::all().enumerate().filter(|(_, power)| wanted(power));
        Self { bits: wanted.fold(0, |bits, (i, _)| bits | 1 << i) }
    }

    /// The powers, ascending.
    pub fn iter(self) -> impl Iterator<Item = Power> {
        Power::all().enumerate().filter(move |(i, _)| self.bits >> i & 1 == 1).map(|it| it.1)
    }

    /// How many there are.
    #[must_use]
    pub fn count(self) -> usize {
        self.bits.count_ones() as usize
    }

    /// These and others.
    #[must_use]
    pub fn with(self, others: Self) -> Self {
        Self { bits: self.bits | others.bits }
    }

    /// Their means of all folds, power by power.
    pub fn sides(self) -> impl Iterator<Item = Side> {
        self.iter().flat_map(Side::power_means)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_have_further_powers_alone() {
        let [eighth, four] = [0.125, 4.0].map(|p| Power::of_value(p).expect("a power of two"));
        let set = FurtherPowers::of(&[four, Power::ONE, Power::ROOT, eighth, four]);
        assert!(set.iter().eq([eighth, four]) && set.count() == 2);
        assert_eq!(set.sides().map(|side| side.to_string()).nth(5).as_deref(), Some("power4fold1"));
        assert_eq!(FurtherPowers::of(&[four]).with(FurtherPowers::of(&[eighth])), set);
        assert_eq!(FurtherPowers::of(&[Power::SQUARE]), FurtherPowers::NONE);
        assert_eq!(FurtherPowers::NONE.with(set), set);
    }
}

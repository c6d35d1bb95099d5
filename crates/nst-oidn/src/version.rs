//! Versions of the library.

use std::fmt;

/// A version of the library.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// 2.
    pub major: i32,
    /// The second number.
    pub minor: i32,
    /// The third number.
    pub patch: i32,
}

impl Version {
    /// From "two decimal digits per component" (the library's documentation).
    pub(crate) fn from_digits(digits: i32) -> Self {
        Self { major: digits / 10_000, minor: digits / 100 % 100, patch: digits % 100 }
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}.{}", self.major, self.minor, self.patch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_have_three_numbers() {
        assert_eq!(Version::from_digits(20_501).to_string(), "2.5.1");
        assert_eq!(Version::from_digits(21_299).to_string(), "2.12.99");
    }
}

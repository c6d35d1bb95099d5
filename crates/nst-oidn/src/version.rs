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

    /// From the end of a file's name, as in `so.2.5.1` or `2.5.1.dylib`.
    pub(crate) fn of_name(end: &str) -> Option<Self> {
        let end = end.strip_prefix("so.").or_else(|| end.strip_suffix(".dylib"))?;
        let numbers: Vec<i32> = end.split('.').map(|it| it.parse().ok()).collect::<Option<_>>()?;
        let [major, minor, patch] = numbers.try_into().ok()?;
        Some(Self { major, minor, patch })
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
        let named = |end| Version::of_name(end).map(|version| version.to_string());
        assert_eq!(named("so.2.5.1"), Some("2.5.1".into()));
        assert_eq!(named("2.12.99.dylib"), Some("2.12.99".into()));
        for end in ["so.2", "so.2.5", "so.2.5.1.4", "so.2.x.1", "2.5.1", "so", ""] {
            assert_eq!(named(end), None, "{end}");
        }
    }
}

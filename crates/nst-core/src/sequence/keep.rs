//! [`Keep`]: which terms of a sequence are kept.

use std::{fmt, str::FromStr};

/// Which terms of a sequence to keep. As text: `all`, `window 8`, `pow2 8`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// The last terms: this number of them, at least 1.
    Window(u32),
    /// All: S_1 … S_N.
    All,
    /// S_1, S_2, S_4, …, and the last terms: this number of them, at least 1.
    Pow2(u32),
}

impl Keep {
    /// The sample counts of the terms that are kept of n samples, increasing.
    #[must_use]
    pub fn sample_counts(self, n: u32) -> Vec<u32> {
        let window = n.saturating_sub(self.window_length(n) - 1).max(1);
        let powers = (0..self.powers(n)).map(|power| 1 << power);
        powers.take_while(|&count| count < window).chain(window..=n).collect()
    }

    /// How many of the last terms of n samples are kept: from 1 to n.
    #[must_use]
    pub fn window_length(self, n: u32) -> u32 {
        match self {
            Self::All => n.max(1),
            Self::Window(length) | Self::Pow2(length) => length.clamp(1, n.max(1)),
        }
    }

    /// How many of S_1, S_2, S_4, … up to S_n are kept, including those that the window
    /// contains too.
    #[must_use]
    pub fn powers(self, n: u32) -> u32 {
        if matches!(self, Self::Pow2(_)) { n.max(1).ilog2() + 1 } else { 0 }
    }
}

impl fmt::Display for Keep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all"),
            Self::Window(length) => write!(f, "window {length}"),
            Self::Pow2(length) => write!(f, "pow2 {length}"),
        }
    }
}

impl FromStr for Keep {
    type Err = String;

    /// Reads what `to_string` writes.
    fn from_str(text: &str) -> Result<Self, String> {
        let length = |name| {
            let number = text.strip_prefix(name)?.strip_prefix(' ')?;
            number.parse().ok().filter(|&length| length > 0)
        };
        match text {
            "all" => Some(Self::All),
            _ => length("window").map(Self::Window).or_else(|| length("pow2").map(Self::Pow2)),
        }
        .ok_or_else(|| format!("'{text}' is not 'all', 'window N' or 'pow2 N'"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_read_as_they_are_written() {
        for keep in [Keep::All, Keep::Window(8), Keep::Pow2(16)] {
            assert_eq!(keep.to_string().parse(), Ok(keep));
        }
        for bad in ["", "window", "window 0", "window x", "pow2", "some"] {
            assert!(bad.parse::<Keep>().is_err(), "{bad}");
        }
    }

    #[test]
    fn kept_terms() {
        let kept = |n, keep: Keep| keep.sample_counts(n);
        assert_eq!(kept(64, Keep::Window(8)), Vec::from_iter(57..=64));
        assert_eq!(kept(64, Keep::All), Vec::from_iter(1..=64));
        assert_eq!(kept(5, Keep::Window(8)), [1, 2, 3, 4, 5]);
        assert_eq!(kept(5, Keep::Window(0)), [5]);
        assert_eq!(kept(64, Keep::Pow2(2)), [1, 2, 4, 8, 16, 32, 63, 64]);
        assert_eq!(kept(40, Keep::Pow2(8)), [1, 2, 4, 8, 16, 32, 33, 34, 35, 36, 37, 38, 39, 40]);
        assert_eq!(kept(3, Keep::Pow2(8)), [1, 2, 3]);
        assert_eq!(kept(u32::MAX, Keep::Window(2)), [u32::MAX - 1, u32::MAX]);
    }
}

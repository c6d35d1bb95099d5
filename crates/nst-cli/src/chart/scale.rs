//! Logarithmic axes.

use crate::results::text;

/// An axis must span at least this factor, so that it has two ticks, of one point too.
const LEAST_SPAN: f64 = 6.0;

/// Room beyond the data, as a share of the axis.
const MARGIN: f64 = 0.05;

/// Maps numbers above 0 to pixels, by their logarithms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LogScale {
    /// Natural logarithms of the ends.
    ends: [f64; 2],
    /// Pixels of the ends.
    pixels: [f64; 2],
}

/// A place on an axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tick {
    pub(super) value: f64,
    /// `None` for the small ones between.
    pub(super) label: Option<Label>,
}

/// The text of a tick; a power has an exponent.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Label {
    pub(super) text: String,
    pub(super) exponent: String,
}

impl LogScale {
    /// An axis on which all `values` have a place; those that are not above 0 are left out.
    pub(super) fn over(values: impl IntoIterator<Item = f64>, pixels: [f64; 2]) -> Self {
        let usable = |value: &f64| *value > 0.0 && value.is_finite();
        let logs: Vec<f64> = values.into_iter().filter(usable).map(f64::ln).collect();
        let (mut low, mut high) = (0.0, 0.0);
        if !logs.is_empty() {
            low = logs.iter().copied().fold(f64::INFINITY, f64::min);
            high = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        }
        let margin = ((high - low) * MARGIN).max((LEAST_SPAN.ln() - (high - low)) / 2.0);
        Self { ends: [low - margin, high + margin], pixels }
    }

    pub(super) fn pixels(&self) -> [f64; 2] {
        self.pixels
    }

    /// The pixel of a number above 0.
    pub(super) fn at(&self, value: f64) -> f64 {
        let share = (value.ln() - self.ends[0]) / (self.ends[1] - self.ends[0]);
        self.pixels[0] + share * (self.pixels[1] - self.pixels[0])
    }

    pub(super) fn contains(&self, value: f64) -> bool {
        value > 0.0 && (self.ends[0]..=self.ends[1]).contains(&value.ln())
    }

    /// The number, or the nearest end of the axis.
    pub(super) fn clamp(&self, value: f64) -> f64 {
        // The ends of an axis may be beyond the range of f64.
        let [low, high] = self.ends.map(|end| end.exp().clamp(f64::MIN_POSITIVE, f64::MAX));
        value.clamp(low, high)
    }

    /// Powers of ten with labels, and small ticks between them; on short axes 1, 2 and 5 have
    /// labels; on very long ones, some powers only.
    pub(super) fn ticks(&self) -> Vec<Tick> {
        let [low, high] = self.ends.map(|end| end / std::f64::consts::LN_10);
        let (first, last) = (low.floor() as i32, high.ceil() as i32);
        let decades = high - low;
        let every = (decades / 7.0).ceil().max(1.0) as i32;
        let digits: &[u8] = if decades > 8.0 { &[1] } else { &[1, 2, 3, 4, 5, 6, 7, 8, 9] };
        let powers = (first..=last).filter(|power| (low..=high).contains(&f64::from(*power)));
        let powers = powers.count();
        let labelled = |digit: u8, power: i32| match digit {
            1 => power.rem_euclid(every) == 0,
            2 | 5 => powers < 2,
            3 | 7 => decades < 0.8,
            _ => false,
        };
        let all = (first..=last).flat_map(|power| digits.iter().map(move |&digit| (digit, power)));
        let values = all.map(|(digit, power)| {
            // Read, as powi is not exact: 0.1 must be 0.1.
            let value = format!("{digit}e{power}").parse().unwrap_or(0.0);
            (digit, power, value)
        });
        let inside: Vec<_> = values.filter(|&(.., value)| self.contains(value)).collect();
        let in_full = inside
            .iter()
            .filter(|(digit, power, _)| labelled(*digit, *power))
            .all(|(_, power, _)| (-2..=4).contains(power));
        let tick = |(digit, power, value): (u8, i32, f64)| Tick {
            value,
            label: labelled(digit, power).then(|| Label::of(digit, power, in_full)),
        };
        inside.into_iter().map(tick).collect()
    }
}

impl Label {
    /// Of digit · 10^power, in full or as a power.
    fn of(digit: u8, power: i32, in_full: bool) -> Self {
        if in_full {
            let value: f64 = format!("{digit}e{power}").parse().unwrap_or(0.0);
            return Self::plain(value);
        }
        let text = if digit == 1 { "10".to_owned() } else { format!("{digit}·10") };
        Self { text, exponent: power.to_string().replace('-', "−") }
    }

    /// A whole number, or three digits of another.
    pub(super) fn plain(value: f64) -> Self {
        let whole = value.fract() == 0.0 && value < 1e6;
        let text = if whole { value.to_string() } else { text::number(value, 3) };
        Self { text, exponent: String::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(values: &[f64]) -> Vec<String> {
        let ticks = LogScale::over(values.iter().copied(), [0.0, 1.0]).ticks();
        let labels = ticks.into_iter().filter_map(|tick| tick.label);
        labels.map(|label| format!("{}^{}", label.text, label.exponent)).collect()
    }

    #[test]
    fn values_have_places() {
        // ln 10 of data, and 5 % of it on both sides: 1 is at 0.05 / 1.1 of the axis.
        let scale = LogScale::over([1.0, 10.0, -3.0, 0.0, f64::INFINITY], [100.0, 0.0]);
        for (value, place) in [(1.0, 0.05 / 1.1), (10.0, 1.05 / 1.1), (10_f64.sqrt(), 0.5)] {
            assert!((scale.at(value) - 100.0 * (1.0 - place)).abs() < 1e-9, "{value}");
        }
        assert!(scale.contains(1.0) && !scale.contains(0.8) && !scale.contains(0.0));
        assert!((scale.at(scale.clamp(1e9)) - 0.0).abs() < 1e-9);
    }

    #[test]
    fn ticks_are_powers_of_ten() {
        assert_eq!(labels(&[0.5, 200.0]), ["1^", "10^", "100^"]);
        assert_eq!(labels(&[2e-6, 3e-3]), ["10^−5", "10^−4", "10^−3"]);
        let minor = LogScale::over([0.5, 200.0], [0.0, 1.0]).ticks();
        assert!(minor.iter().any(|tick| tick.value == 20.0 && tick.label.is_none()));
        assert!(minor.iter().any(|tick| tick.value == 0.9));
    }

    #[test]
    fn labels_of_given_ticks() {
        for (value, expected) in [(2048.0, "2048"), (1.0 / 3.0, "0.333"), (0.5, "0.5")] {
            assert_eq!(Label::plain(value).text, expected);
        }
    }

    #[test]
    fn short_and_long_axes() {
        assert_eq!(labels(&[3.0]), ["2^", "3^", "5^", "7^"]);
        assert_eq!(labels(&[3e-7]), ["2·10^−7", "3·10^−7", "5·10^−7", "7·10^−7"]);
        assert_eq!(labels(&[1.1, 9.0]), ["1^", "2^", "5^"]);
        assert_eq!(labels(&[0.2, 7.0]), ["0.2^", "0.5^", "1^", "2^", "5^"]);
        let long = labels(&[1e-300, 1e300]);
        assert!((4..=8).contains(&long.len()), "{long:?}");
        assert!(LogScale::over([1e-300, 1e300], [0.0, 1.0]).ticks().len() < 700);
        // Nothing at all.
        assert!(!labels(&[]).is_empty());
    }
}

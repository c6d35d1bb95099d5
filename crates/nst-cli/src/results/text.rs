//! Numbers as people read them.

/// A number with up to `digits` significant digits: `1234`, `0.035`, `1.2e-5`.
pub(crate) fn number(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let scientific = format!("{value:.*e}", digits.saturating_sub(1));
    let (mantissa, exponent) = scientific.split_once('e').expect("Rust writes an e");
    let power: i32 = exponent.parse().expect("Rust writes a number");
    if (-3..=5).contains(&power) {
        // Rounded to the digits, and then written in full.
        let rounded: f64 = scientific.parse().expect("Rust reads what it writes");
        return rounded.to_string();
    }
    let mantissa = if mantissa.contains('.') {
        mantissa.trim_end_matches('0').trim_end_matches('.')
    } else {
        mantissa
    };
    format!("{mantissa}e{exponent}")
}

/// A time, as in `0.35 s`.
pub(crate) fn seconds(value: f64) -> String {
    format!("{} s", number(value, 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        for (value, digits, expected) in [
            (1234.4, 2, "1200"),
            (0.034_99, 2, "0.035"),
            (1.0, 3, "1"),
            (0.999, 2, "1"),
            (1.23e-5, 2, "1.2e-5"),
            (2.0e-5, 3, "2e-5"),
            (1e7, 1, "1e7"),
            (-0.25, 2, "-0.25"),
            (0.0, 2, "0"),
            (f64::NAN, 2, "NaN"),
        ] {
            assert_eq!(number(value, digits), expected);
        }
        assert_eq!(seconds(0.354), "0.35 s");
    }
}

//! Words and numbers of OBJ statements, read fast.

/// The words of a statement, up to a comment.
#[derive(Clone)]
pub(super) struct Words<'a> {
    rest: &'a str,
}

impl<'a> Words<'a> {
    /// Of a text whose white space is ASCII's.
    pub(super) fn new(text: &'a str) -> Self {
        Self { rest: text }
    }
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a str;

    #[inline]
    fn next(&mut self) -> Option<&'a str> {
        let bytes = self.rest.as_bytes();
        let begin = bytes.iter().position(|&byte| !is_space(byte))?;
        let mut end = begin;
        while end < bytes.len() && !is_space(bytes[end]) {
            // Comments need no space before them, but `1.#IND` is one word.
            if bytes[end] == b'#' && (end == begin || bytes[end - 1] != b'.') {
                let word = &self.rest[begin..end];
                self.rest = "";
                return (end > begin).then_some(word);
            }
            end += 1;
        }
        let word = &self.rest[begin..end];
        self.rest = &self.rest[end..];
        Some(word)
    }
}

#[inline]
fn is_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r')
}

/// A number, which may be NaN or infinite; `None` if the word is none. Rounded to f32, it
/// is the f32 that is nearest to what the file says.
pub(super) fn number_f64(word: &str) -> Option<f64> {
    let Ok(number) = word.parse::<f64>() else { return unusual(word) };
    // Rounding twice goes wrong where the first rounding comes to lie in the middle
    // between two f32; the neighbour on the right side does not.
    let nearest = number as f32;
    if number.to_bits() & 0x0fff_ffff != 0 || f64::from(nearest) == number {
        return Some(number);
    }
    let wanted = word.parse::<f32>().unwrap_or(nearest);
    Some(match wanted.partial_cmp(&nearest) {
        Some(std::cmp::Ordering::Less) => number.next_down(),
        Some(std::cmp::Ordering::Greater) => number.next_up(),
        _ => number,
    })
}

/// The f32 that is nearest to what the file says, or NaN or an infinity; `None` if the word
/// is no number.
pub(super) fn number_f32(word: &str) -> Option<f32> {
    word.parse().ok().or_else(|| unusual(word).map(|number| number as f32))
}

/// NaN and infinities as C99 and Microsoft's libraries write them: `-nan(ind)`, `1.#INF00`,
/// `-1.#IND`, `1.#QNAN`, or `1.#J` where that was rounded.
fn unusual(word: &str) -> Option<f64> {
    let word = word.trim_start_matches(['+', '-']).to_ascii_lowercase();
    if word.starts_with("nan(") {
        return Some(f64::NAN);
    }
    let name = word
        .strip_prefix("1.#")
        .filter(|name| name.starts_with(|c: char| c.is_ascii_alphabetic()))?;
    Some(if name.starts_with("inf") { f64::INFINITY } else { f64::NAN })
}

/// A face's corner: the numbers of its vertex, its texture coordinate and its normal.
pub(super) type Corner = [Option<i64>; 3];

/// Reads `1`, `1/2`, `1//3`, `1/2/3`, or one of these with slashes behind it.
///
/// # Errors
/// What is wrong with the word, in words that go behind it.
#[inline]
pub(super) fn corner(word: &str) -> Result<Corner, &'static str> {
    let mut numbers = [None; 3];
    let mut rest = word.as_bytes();
    for (kind, number) in numbers.iter_mut().enumerate() {
        let (integer, behind) = integer(rest).ok_or("is not made of numbers")?;
        if kind == 0 && integer.is_none() {
            return Err("is not made of numbers");
        }
        *number = integer;
        match behind {
            [] => return Ok(numbers),
            [b'/', behind @ ..] => rest = behind,
            _ => return Err("is not made of numbers"),
        }
    }
    if rest.is_empty() { Ok(numbers) } else { Err("has more than three numbers") }
}

/// An integer, if there is one, and what is behind it; `None` if i64 has no place for it.
#[inline]
fn integer(text: &[u8]) -> Option<(Option<i64>, &[u8])> {
    let (negative, digits) = match text {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] => (false, digits),
        _ => (false, text),
    };
    let mut number = 0_i64;
    let mut count = 0;
    while let Some(digit @ b'0'..=b'9') = digits.get(count) {
        // Downwards, as there is one more negative number than there are positive ones.
        number = number.checked_mul(10)?.checked_sub(i64::from(digit - b'0'))?;
        count += 1;
    }
    if count == 0 {
        return (digits.len() == text.len()).then_some((None, text));
    }
    Some((Some(if negative { number } else { number.checked_neg()? }), &digits[count..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_end_at_spaces_and_comments() {
        let words = |text| Words::new(text).collect::<Vec<_>>();
        assert_eq!(words(" \tf  1/2 3\u{b}4 \r"), ["f", "1/2", "3", "4"]);
        assert_eq!(words("v 1 # 2 3"), ["v", "1"]);
        assert_eq!(words("v 1 2#3 4"), ["v", "1", "2"]);
        assert_eq!(words("v 1.#IND -1.#QNAN0 é"), ["v", "1.#IND", "-1.#QNAN0", "é"]);
        assert!(words("").is_empty() && words("  ").is_empty() && words("#x").is_empty());
    }

    /// Digits around the middle of two f32, where rounding to f64 first would be wrong.
    #[test]
    fn numbers_round_to_the_nearest_f32() {
        let mut twice_is_wrong = 0;
        for i in 0..20_000_u32 {
            let x = f32::from_bits((0.5_f32).to_bits() + i * 977);
            let middle = (f64::from(x) + f64::from(x.next_up())) / 2.0;
            // 25 bits below 1 have 25 digits at most; one more decides.
            for word in
                [format!("{middle:.25}1"), format!("-{middle:.25}1"), format!("{middle:.25}")]
            {
                let number = number_f64(&word).expect("a number");
                let nearest: f32 = word.parse().expect("a number");
                assert_eq!(number as f32, nearest, "{word}");
                assert!((number - word.parse::<f64>().expect("a number")).abs() < 1e-15);
                twice_is_wrong +=
                    u32::from(word.parse::<f64>().expect("a number") as f32 != nearest);
            }
        }
        assert!(twice_is_wrong > 10_000, "{twice_is_wrong}");
        for word in ["0", "-0", "1", "1e-45", "3e-39", "1e39", "0.1", "16777217", "123456.789"] {
            let number = number_f64(word).expect("a number");
            let nearest: f32 = word.parse().expect("a number");
            assert_eq!((number as f32).to_bits(), nearest.to_bits(), "{word}");
        }
    }

    #[test]
    fn numbers_that_are_none() {
        for nan in ["nan", "-NaN", "1.#IND", "-1.#IND00", "1.#QNAN", "-1.#J", "-nan(ind)"] {
            assert!(number_f64(nan).is_some_and(f64::is_nan), "{nan}");
            assert!(number_f32(nan).is_some_and(f32::is_nan), "{nan}");
        }
        for infinity in ["inf", "-Infinity", "1.#INF", "-1.#INF00"] {
            assert!(number_f32(infinity).is_some_and(f32::is_infinite), "{infinity}");
        }
        for word in ["", "x", "1,5", "0x10", "1.5f", "--1", "1.#"] {
            assert_eq!((number_f64(word), number_f32(word)), (None, None), "{word}");
        }
    }

    #[test]
    fn corners() {
        let (a, b, c) = (Some(1), Some(-2), Some(3));
        let cases = [
            ("1", [a, None, None]),
            ("1/", [a, None, None]),
            ("1//", [a, None, None]),
            ("1/-2", [a, b, None]),
            ("1/-2/", [a, b, None]),
            ("1//3", [a, None, c]),
            ("1/-2/3", [a, b, c]),
            ("+1/-2/3/", [a, b, c]),
            ("-9223372036854775808", [Some(i64::MIN), None, None]),
        ];
        for (word, expected) in cases {
            assert_eq!(corner(word), Ok(expected), "{word}");
        }
        for word in ["", "/1", "c", "1/c", "1.5", "1-2", "-", "1/-", "9223372036854775808"] {
            assert_eq!(corner(word), Err("is not made of numbers"), "{word}");
        }
        assert_eq!(corner("1/2/3/4"), Err("has more than three numbers"));
    }
}

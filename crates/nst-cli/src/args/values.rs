//! Values of several options.

use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, TypedValueParser};

pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    text.split_once('x')
        .and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]))
        .filter(|size| !size.contains(&0))
        .ok_or_else(|| "a size is two numbers above 0, as in 512x512".to_owned())
}

/// A whole number from 1 on, as of samples.
pub(super) fn count(text: &str) -> Result<u32, String> {
    let number: Result<u32, _> = text.parse();
    if let Ok(number @ 1..) = number {
        return Ok(number);
    }
    match text.parse::<f64>() {
        // As in 1e6 or 64.0.
        Ok(number) if number >= 1.0 && number <= f64::from(u32::MAX) && number.fract() == 0.0 => {
            Err(format!("write it in full: {}", number as u32))
        }
        Ok(number) if number >= 1.0 && number.fract() == 0.0 => {
            Err(format!("the most is {}", u32::MAX))
        }
        _ => Err("it must be a whole number from 1 on, as in 64".to_owned()),
    }
}

/// A seed of random numbers.
pub(super) fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("a seed is a whole number from 0 to {}", u64::MAX))
}

/// Three numbers.
pub(super) fn point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|x| x.trim().parse().ok()).collect();
    numbers
        .and_then(|numbers| <[f64; 3]>::try_from(numbers).ok())
        .filter(|point| point.iter().all(|x| x.is_finite()))
        .ok_or_else(|| {
            "a point is three numbers with commas between them, as in 0,1.5,4".to_owned()
        })
}

/// Takes a path with one of these extensions; file names need not be UTF-8.
pub(super) fn ending_in<const N: usize>(
    extensions: [&'static str; N],
) -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(move |path| {
        let fits = extensions.iter().any(|extension| has_extension(&path, extension));
        if fits {
            Ok(path)
        } else {
            Err(format!("the name must end in .{}", extensions.join(" or .")))
        }
    })
}

/// Whether a path ends in the extension, in upper or lower case.
pub(crate) fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::args::Args;

    #[test]
    fn sizes_and_paths() {
        assert_eq!(size("640x480"), Ok([640, 480]));
        for bad in ["640", "640x", "0x3", "-1x3", "1x2x3"] {
            assert!(size(bad).is_err(), "{bad}");
        }
        assert_eq!((count("64"), seed("0")), (Ok(64), Ok(0)));
        let message = |text| count(text).expect_err(text);
        assert_eq!(message("1e6"), "write it in full: 1000000");
        assert_eq!(message("64.0"), "write it in full: 64");
        assert!(message("1e10").contains("the most is 4294967295"));
        for bad in ["0", "-1", "1.5", "many", "nan", ""] {
            assert!(message(bad).contains("whole number from 1 on"), "{bad}");
        }
        assert!(
            seed("-1").is_err_and(|message| message.contains("from 0 to 18446744073709551615"))
        );
        assert_eq!(point("0,-1.5, 4e2"), Ok([0.0, -1.5, 400.0]));
        for bad in ["1,2", "1,2,3,4", "1,2,x", "1,2,inf", ""] {
            assert!(point(bad).is_err(), "{bad}");
        }
        let transform = |output| Args::try_parse_from(["nst", "transform", "s.exr", "-o", output]);
        assert!(
            transform("x.EXR").is_ok() && transform("x.png").is_ok() && transform("x.jpg").is_err()
        );
    }
}

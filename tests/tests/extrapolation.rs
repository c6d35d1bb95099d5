//! The classical methods on textbook series, against mpmath at 50 digits.

use nst_core::methods::{Extrapolation, extrapolation};

/// A row of the table that `tests/peers/mpmath_extrapolation.py` writes.
struct Case {
    name: String,
    method: &'static dyn Extrapolation,
    limit: f64,
    /// What the method gives in 50 digits, from terms rounded to f64.
    transformed: f64,
    counts: Vec<u32>,
    terms: Vec<f64>,
}

fn cases() -> Vec<Case> {
    let table = include_str!("../data/reference/extrapolation.csv");
    let case = |line: &str| {
        let cells: Vec<_> = line.split(',').collect();
        let number = |text: &str| text.parse::<f64>().expect("a number");
        Case {
            name: format!("{} by {} from n = {}", cells[0], cells[1], cells[4]),
            method: extrapolation(cells[1]).expect("a classical method"),
            limit: number(cells[2]),
            transformed: number(cells[3]),
            counts: cells[4].split(' ').map(|n| n.parse().expect("a count")).collect(),
            terms: cells[5].split(' ').map(number).collect(),
        }
    };
    table.lines().skip(1).map(case).collect()
}

/// Whether a result is as near to the limit as mpmath's, but for one digit. Both
/// start from the same rounded terms. mpmath's error may happen to be far below
/// what their rounding is worth, so that a few units in the last place of a term,
/// times the method's condition number, are admitted too.
fn as_good(case: &Case, result: Option<f64>) -> bool {
    let by_mpmath = 10.0 * (case.transformed - case.limit).abs();
    let rounding = 16.0 * f64::EPSILON * case.limit.abs() * condition(case);
    result.is_some_and(|result| (result - case.limit).abs() <= by_mpmath.max(rounding))
}

/// The relative change of the result over that of a term, the largest of all terms.
fn condition(case: &Case) -> f64 {
    const STEP: f64 = 1.0 / (1_u64 << 40) as f64;
    let limit = |terms: &[f64]| case.method.limit(&case.counts, terms).unwrap_or(case.limit);
    let base = limit(&case.terms);
    let change = |k: usize| {
        let mut terms = case.terms.clone();
        terms[k] *= 1.0 + STEP;
        ((limit(&terms) - base) / base).abs() / STEP
    };
    (0..case.terms.len()).map(change).fold(1.0, f64::max)
}

#[test]
fn every_method_reaches_mpmaths_digits() {
    let cases = cases();
    assert_eq!(cases.len(), 120);
    for case in &cases {
        let result = case.method.limit(&case.counts, &case.terms);
        assert!(
            as_good(case, result),
            "{}: {result:?} from mpmath's {}, condition {}",
            case.name,
            case.transformed,
            condition(case)
        );
    }
}

/// Terms in f32 must not pass where a method finds more digits than f32 has.
#[test]
fn the_comparison_rejects_rounded_terms() {
    let precise = |case: &&Case| ((case.transformed - case.limit) / case.limit).abs() < 1e-10;
    let cases = cases();
    let precise: Vec<_> = cases.iter().filter(precise).collect();
    assert!(precise.len() > 20);
    for case in precise {
        let rounded: Vec<_> = case.terms.iter().map(|&term| f64::from(term as f32)).collect();
        let result = case.method.limit(&case.counts, &rounded);
        assert!(!as_good(case, result), "{}: {result:?}", case.name);
    }
}

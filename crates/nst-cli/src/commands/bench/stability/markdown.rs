//! The tables of `docs/stability.md`.

use std::fmt::Write;

use nst_core::methods::{METHODS, extrapolation};

use super::{
    Row,
    regimes::{REGIMES, Regime, SERIES, window},
};

/// The sample counts of the tables; the CSV file has more.
const SHOWN: [u32; 5] = [8, 64, 1024, 4096, 1_000_000];

/// The whole page.
pub(super) fn document(rows: &[Row]) -> String {
    let mut page = include_str!("intro.md").to_owned();
    overview(&mut page, rows);
    precision(&mut page);
    cost(&mut page, rows);
    page += "\n## Regime by regime\n";
    for regime in REGIMES {
        section(&mut page, regime, rows);
    }
    page
}

/// MSE ratios of all methods and regimes at n = 64.
fn overview(page: &mut String, rows: &[Row]) {
    page.push_str(
        "\n## At 64 samples\n\nMSE ratios; a star where over half of the lanes fell back to S.\n\n",
    );
    let methods: Vec<_> = methods(rows).collect();
    line(page, ["regime"].into_iter().chain(methods.iter().copied()).map(str::to_owned));
    line(page, std::iter::repeat_n("---".to_owned(), methods.len() + 1));
    for regime in REGIMES {
        let cells = methods.iter().map(|method| match find(rows, method, regime.name, 64) {
            Some(row) if row.fallback_share > 0.5 => number(row.mse_ratio) + "\\*",
            Some(row) => number(row.mse_ratio),
            None => String::new(),
        });
        line(page, [regime.name.to_owned()].into_iter().chain(cells));
    }
}

/// What is lost by terms in f32.
fn precision(page: &mut String) {
    const N: u32 = 16;
    let _ = write!(
        page,
        "\n## What f32 costs\n\nErrors |T − I| on the four series at n = {N}, with terms in f64 and \
         rounded to f32 as\nin a batch. An extrapolation magnifies the rounding of its terms. *none*: it broke \
         down, here\nbecause all terms are equal.\n\n"
    );
    let heads =
        SERIES.iter().flat_map(|series| [format!("{}, f64", series.name), "f32".to_owned()]);
    line(page, ["method".to_owned()].into_iter().chain(heads));
    line(page, std::iter::repeat_n("---".to_owned(), 1 + 2 * SERIES.len()));
    let row = |method: &str| {
        let cells = SERIES.iter().flat_map(move |series| {
            let counts = window(N);
            let (_, terms) = series.at(&counts);
            let rounded: Vec<_> = terms.iter().map(|&term| f64::from(term as f32)).collect();
            [terms, rounded].map(|terms| {
                let result = match extrapolation(method) {
                    Some(method) => method.limit(&counts, &terms),
                    None => terms.last().copied(),
                };
                result.map_or_else(
                    || "*none*".to_owned(),
                    |t| format!("{:.1e}", (t - series.limit).abs()),
                )
            })
        });
        [method.to_owned()].into_iter().chain(cells).collect::<Vec<_>>()
    };
    line(page, row("S_n").into_iter());
    for (method, _) in METHODS.iter().filter(|(name, _)| extrapolation(name).is_some()) {
        line(page, row(method).into_iter());
    }
}

/// Time per lane.
fn cost(page: &mut String, rows: &[Row]) {
    let _ = write!(
        page,
        "\n## Cost\n\nThe best of five applications to 2¹⁸ lanes in memory, {} threads. A lane-term is a \
         term or\na fold mean that the method reads.\n\n\
         | method | ns per lane | million lane-terms per second |\n|---|---|---|\n",
        rayon::current_num_threads()
    );
    for method in methods(rows) {
        if let Some(row) = rows.iter().find(|row| row.method == method) {
            let rate = row.lane_terms_per_second / 1e6;
            let _ = writeln!(page, "| {method} | {:.1} | {rate:.0} |", row.nanoseconds_per_lane);
        }
    }
}

fn section(page: &mut String, regime: &Regime, rows: &[Row]) {
    let _ = write!(page, "\n### {}\n\n{} {}\n\n", regime.name, regime.what, regime.why);
    let of_regime = |row: &&Row| row.regime == regime.name;
    let counts: Vec<_> = SHOWN
        .into_iter()
        .filter(|&n| rows.iter().filter(of_regime).any(|row| row.n == n))
        .collect();
    let heads = counts.iter().map(|n| format!("n = {n}"));
    let rest = ["worst lane", "bias²", "not finite", "ns per lane"].map(str::to_owned);
    line(page, ["method".to_owned()].into_iter().chain(heads).chain(rest));
    line(page, std::iter::repeat_n("---".to_owned(), counts.len() + 5));
    for method in methods(rows) {
        let ratios = counts.iter().map(|&n| match find(rows, method, regime.name, n) {
            Some(row) => cell(row),
            None => String::new(),
        });
        let all = || rows.iter().filter(of_regime).filter(|row| row.method == method);
        let greatest = |value: fn(&Row) -> f64| number(all().map(value).fold(0.0, f64::max));
        let rest = [
            greatest(|row| row.worst_ratio),
            greatest(|row| row.bias2_ratio),
            all().map(|row| row.nonfinite).sum::<usize>().to_string(),
            greatest(|row| row.nanoseconds_per_lane),
        ];
        line(page, [method.to_owned()].into_iter().chain(ratios).chain(rest));
    }
}

/// An MSE ratio, and the share of lanes that fell back if it shows.
fn cell(row: &Row) -> String {
    let ratio = number(row.mse_ratio);
    match (100.0 * row.fallback_share).round() {
        0.0 => ratio,
        percent => format!("{ratio} ({percent} %)"),
    }
}

/// The methods, in the order of the rows.
fn methods(rows: &[Row]) -> impl Iterator<Item = &str> {
    let first = rows.first().map(|row| (row.regime, row.n));
    rows.iter().filter(move |row| Some((row.regime, row.n)) == first).map(|row| row.method.as_str())
}

fn find<'a>(rows: &'a [Row], method: &str, regime: &str, n: u32) -> Option<&'a Row> {
    rows.iter().find(|row| row.method == method && row.regime == regime && row.n == n)
}

fn line(page: &mut String, cells: impl Iterator<Item = String>) {
    for cell in cells {
        let _ = write!(page, "| {cell} ");
    }
    page.push_str("|\n");
}

/// Three digits.
fn number(x: f64) -> String {
    match x.abs() {
        _ if x.is_infinite() => "∞".to_owned(),
        0.0 => "0".to_owned(),
        size if !(1e-3..1e4).contains(&size) => format!("{x:.1e}"),
        size if size < 10.0 => format!("{x:.3}"),
        _ => format!("{x:.0}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers() {
        let cases = [(0.0, "0"), (0.12345, "0.123"), (1.0, "1.000"), (123.4, "123")];
        assert!(cases.iter().all(|&(x, text)| number(x) == text));
        assert_eq!((number(1.234e-5), number(6.7e9)), ("1.2e-5".into(), "6.7e9".into()));
        assert_eq!(number(f64::INFINITY), "∞");
    }
}

//! Numbers in documents are those of the tables beside them, to the last digit shown.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use nst_core::methods::of_single_lanes;

fn read(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name);
    std::fs::read_to_string(&path).expect("the document is part of the repository")
}

/// Rows of a CSV file, by the names of its columns.
struct Rows(Vec<BTreeMap<String, String>>);

impl Rows {
    fn read(name: &str) -> Self {
        let text = read(name);
        let rows = csv::Reader::from_reader(text.as_bytes()).into_deserialize();
        Self(rows.collect::<Result<_, _>>().expect("a table"))
    }

    /// The numbers in a column of the rows that have these cells.
    fn numbers(&self, column: &str, cells: &[(&str, &str)]) -> Vec<f64> {
        let fits =
            |row: &&BTreeMap<String, String>| cells.iter().all(|(key, cell)| row[*key] == *cell);
        let found: Vec<_> =
            self.0.iter().filter(fits).map(|row| row[column].parse().expect("a number")).collect();
        assert!(!found.is_empty(), "no row has {cells:?}");
        found
    }

    /// The only such number.
    fn number(&self, column: &str, cells: &[(&str, &str)]) -> f64 {
        let found = self.numbers(column, cells);
        assert_eq!(found.len(), 1, "{cells:?}");
        found[0]
    }

    fn sum(&self, column: &str, cells: &[(&str, &str)]) -> f64 {
        self.numbers(column, cells).iter().sum()
    }

    fn greatest(&self, column: &str, cells: &[(&str, &str)]) -> f64 {
        self.numbers(column, cells).into_iter().fold(0.0, f64::max)
    }

    /// Of an odd number of runs.
    fn median(&self, column: &str, cells: &[(&str, &str)]) -> f64 {
        let mut found = self.numbers(column, cells);
        assert_eq!(found.len() % 2, 1, "{cells:?}");
        found.sort_by(f64::total_cmp);
        found[found.len() / 2]
    }
}

/// The first Markdown table whose head begins so: its rows, the head first.
fn table(page: &str, head: &str) -> Vec<Vec<String>> {
    let lines: Vec<_> = page.lines().skip_while(|line| !line.starts_with(head)).collect();
    assert!(!lines.is_empty(), "there is no table '{head}'");
    let rows = lines.into_iter().take_while(|line| line.starts_with('|'));
    let cells = |line: &str| -> Vec<String> {
        line.trim_matches('|').split('|').map(|cell| cell.trim().replace('`', "")).collect()
    };
    let mut rows: Vec<_> = rows.map(cells).collect();
    rows.remove(1); // |---|---|
    rows
}

/// A number of a document, and what it was rounded from.
struct Quote {
    place: String,
    shown: String,
    value: f64,
}

fn quote(place: &[&str], shown: &str, value: f64) -> Quote {
    Quote { place: place.join(", "), shown: shown.to_owned(), value }
}

/// Half a unit of the last digit shown, as of 6.0e-14, 1,024, or 766.
fn half_unit(shown: &str) -> f64 {
    let (mantissa, exponent) = shown.split_once('e').unwrap_or((shown, "0"));
    let decimals = mantissa.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    let exponent: i32 = exponent.parse().expect("an exponent");
    0.5 * 10_f64.powi(exponent - decimals as i32)
}

/// Whether a value rounds to what is shown; `slack` is what the value itself was rounded
/// by, relative.
fn rounds_to(value: f64, shown: &str, slack: f64) -> bool {
    if shown == "∞" || value.is_infinite() {
        return shown == "∞" && value.is_infinite();
    }
    let number: f64 = shown.parse().unwrap_or_else(|_| panic!("'{shown}' is not a number"));
    (number - value).abs() <= half_unit(shown) * (1.0 + 1e-9) + slack * value.abs()
}

/// At least `least` quotes, all of them right; values three times as large would be noticed.
fn check(quotes: &[Quote], least: usize, slack: f64) {
    let wrong = |factor: f64| -> Vec<String> {
        let wrong = quotes.iter().filter(|q| !rounds_to(factor * q.value, &q.shown, slack));
        wrong.map(|q| format!("{}: {}, measured {}", q.place, q.shown, q.value)).collect()
    };
    assert!(quotes.len() >= least, "{} numbers", quotes.len());
    assert_eq!(wrong(1.0), [""; 0]);
    let noticeable = quotes.iter().filter(|q| !["0", "∞"].contains(&q.shown.as_str())).count();
    assert!(noticeable > least / 2);
    assert_eq!(wrong(3.0).len(), noticeable);
}

#[test]
fn rounding() {
    for (value, shown) in [(7.062, "7.1"), (16384.0, "1.6e4"), (0.0018, "1.8e-3"), (766.4, "766")] {
        assert!(rounds_to(value, shown, 0.0), "{value}, {shown}");
        let unit = 2.0 * half_unit(shown);
        assert!(!rounds_to(value + unit, shown, 0.0) && !rounds_to(value - unit, shown, 0.0));
    }
    assert!(rounds_to(f64::INFINITY, "∞", 0.0) && !rounds_to(1.0, "∞", 0.0));
    assert!(!rounds_to(f64::INFINITY, "1", 0.0) && !rounds_to(f64::NAN, "1", 0.0));
}

/// The suite's CSV file has four digits.
const FOUR_DIGITS: f64 = 5e-4;

#[test]
fn the_readme_quotes_the_stability_suite() {
    let suite = Rows::read("docs/stability.csv");
    let rows = table(&read("README.md"), "| MSE ratio, n = 64 |");
    let mut quotes = Vec::new();
    for row in &rows[1..] {
        for (shown, regime) in row.iter().zip(&rows[0]).skip(1) {
            let cells = [("method", row[0].as_str()), ("regime", regime.as_str()), ("n", "64")];
            let value = suite.number("mse_ratio", &cells);
            // Two digits, without zeros at the end: 1 may be 1.0.
            let shown = if shown.len() == 1 { format!("{shown}.0") } else { shown.clone() };
            quotes.push(quote(&[&row[0], regime], &shown, value));
        }
    }
    check(&quotes, 80, FOUR_DIGITS);
}

/// A cell of `docs/stability.md`, with or without its star or share: the number and the rest.
fn parts(cell: &str) -> (&str, &str) {
    cell.find([' ', '\\']).map_or((cell, ""), |at| cell.split_at(at))
}

#[test]
fn the_overview_of_the_stability_page_is_the_suites() {
    let suite = Rows::read("docs/stability.csv");
    let rows = table(&read("docs/stability.md"), "| regime |");
    let mut quotes = Vec::new();
    for row in &rows[1..] {
        for (cell, method) in row.iter().zip(&rows[0]).skip(1) {
            let cells = [("method", method.as_str()), ("regime", row[0].as_str()), ("n", "64")];
            let (shown, star) = parts(cell);
            quotes.push(quote(&[&row[0], method], shown, suite.number("mse_ratio", &cells)));
            let fallen_back = suite.number("fallback_share", &cells) > 0.5;
            assert_eq!(star, if fallen_back { "\\*" } else { "" }, "{cells:?}");
        }
    }
    let regimes: BTreeSet<_> = suite.0.iter().map(|row| &row["regime"]).collect();
    assert!(rows[1..].iter().map(|row| &row[0]).eq(suite_order(&suite)));
    assert_eq!(rows.len() - 1, regimes.len());
    assert!(of_single_lanes().all(|method| rows[0].iter().any(|head| head == method)));
    check(&quotes, 300, FOUR_DIGITS);
}

/// The regimes, in the order of the rows.
fn suite_order(suite: &Rows) -> impl Iterator<Item = &String> {
    let first = &suite.0[0]["method"];
    suite
        .0
        .iter()
        .filter(move |row| row["method"] == *first && row["n"] == "64")
        .map(|row| &row["regime"])
}

#[test]
fn the_regimes_of_the_stability_page_are_the_suites() {
    let (suite, page) = (Rows::read("docs/stability.csv"), read("docs/stability.md"));
    let mut quotes = Vec::new();
    for regime in suite_order(&suite) {
        let section = page.split_once(&format!("\n### {regime}\n")).expect("a section").1;
        let rows = table(section, "| method |");
        for row in &rows[1..] {
            let all = [("method", row[0].as_str()), ("regime", regime.as_str())];
            for (cell, head) in row.iter().zip(&rows[0]).skip(1) {
                let (shown, share) = parts(cell);
                let value = match head.as_str() {
                    "worst lane" => suite.greatest("worst_ratio", &all),
                    "bias²" => suite.greatest("bias2_ratio", &all),
                    "not finite" => suite.sum("nonfinite", &all),
                    "ns per lane" => suite.greatest("nanoseconds_per_lane", &all),
                    n => {
                        let n = n.strip_prefix("n = ").expect("a sample count");
                        let cells = [all[0], all[1], ("n", n)];
                        let fallen_back = 100.0 * suite.number("fallback_share", &cells);
                        let shown = share.trim_matches([' ', '(', ')', '%']);
                        let shown = if shown.is_empty() { "0" } else { shown };
                        assert!(rounds_to(fallen_back, shown, FOUR_DIGITS), "{cells:?}: {cell}");
                        suite.number("mse_ratio", &cells)
                    }
                };
                quotes.push(quote(&[regime, &row[0], head], shown, value));
            }
        }
    }
    check(&quotes, 3000, FOUR_DIGITS);
}

#[test]
fn the_costs_of_the_stability_page_are_the_suites() {
    let suite = Rows::read("docs/stability.csv");
    let rows = table(&read("docs/stability.md"), "| method | ns per lane |");
    let mut quotes = Vec::new();
    for row in &rows[1..] {
        let cells = [("method", row[0].as_str()), ("regime", "zero"), ("n", "64")];
        let rate = 1e-6 * suite.number("lane_terms_per_second", &cells);
        quotes.push(quote(&[&row[0]], &row[1], suite.number("nanoseconds_per_lane", &cells)));
        quotes.push(quote(&[&row[0]], &row[2], rate));
    }
    check(&quotes, 30, FOUR_DIGITS);
}

#[test]
fn the_speed_beside_mitsuba_is_measured() {
    let runs = Rows::read("docs/speed.csv");
    let mut quotes = Vec::new();
    let rows = table(&read("docs/renderer.md"), "| scene | nst |");
    for row in &rows[1..] {
        let scene = row[0].split(',').next().expect("a name");
        let [ours, theirs] = ["nst", "mitsuba"].map(|renderer| {
            1e-6 * runs.median("paths_per_second", &[("scene", scene), ("renderer", renderer)])
        });
        for (shown, value) in row[1..].iter().zip([ours, theirs, ours / theirs]) {
            quotes.push(quote(&[scene], shown, value));
        }
    }
    check(&quotes, 6, 0.0);
}

#[test]
fn the_speed_of_reading_is_measured() {
    let runs = Rows::read("docs/load.csv");
    let rows = table(&read("docs/renderer.md"), "| reader |");
    let median = |reader| runs.median("milliseconds", &[("reader", reader)]);
    let quotes: Vec<_> = rows[1..]
        .iter()
        .map(|row| {
            let reader = row[0].split(',').next().expect("a name");
            quote(&[reader], &row[1], median(reader))
        })
        .collect();
    check(&quotes, 2, 0.0);
}

#[test]
fn the_profile_is_measured() {
    let profile = Rows::read("docs/profile.csv");
    let mut quotes = Vec::new();
    let rows = table(&read("docs/renderer.md"), "| part |");
    for row in &rows[1..] {
        // The names in the file, where the page has longer ones.
        let parts = match row[0].as_str() {
            "what is hit: emission, queues by material" => vec!["hits: emission, queues"],
            "camera rays, recording of samples" => vec!["camera rays and records"],
            "scattering, Russian roulette" => vec!["scattering, roulette"],
            "reading the scene, building the tree" => {
                vec!["reading the scene", "building the tree"]
            }
            "writing files" => vec!["files and summary"],
            same => vec![same],
        };
        for (shown, scene) in row.iter().zip(&rows[0]).skip(1) {
            let share = |part| profile.number("share", &[("scene", scene), ("part", part)]);
            quotes.push(quote(
                &[&row[0], scene],
                shown,
                100.0 * parts.iter().copied().map(share).sum::<f64>(),
            ));
        }
    }
    check(&quotes, 20, 0.0);
}

#[test]
fn growth_of_time_and_memory_is_measured() {
    let runs = Rows::read("docs/render.csv");
    // What varies, scene, width, spp, threads: the rows of the page.
    let measured = [
        ["threads", "cornell", "256", "32", "1"],
        ["threads", "cornell", "256", "32", "2"],
        ["pixels", "cornell", "128", "32", "2"],
        ["pixels", "cornell", "512", "32", "2"],
        ["pixels", "cornell", "1024", "32", "2"],
        ["spp", "cornell", "256", "8", "2"],
        ["spp", "cornell", "256", "128", "2"],
        ["triangles", "teapot-diffuse", "256", "32", "2"],
        ["triangles", "big", "256", "32", "2"],
        ["large", "cornell", "3840", "64", "2"],
    ];
    let rows = table(&read("docs/renderer.md"), "| what varies |");
    assert_eq!(rows.len() - 1, measured.len());
    let mut quotes = Vec::new();
    for (row, [vary, scene, width, spp, threads]) in rows[1..].iter().zip(measured) {
        let cells = [
            ("vary", vary),
            ("scene", scene),
            ("width", width),
            ("spp", spp),
            ("threads", threads),
        ];
        for (shown, (column, unit)) in row[2..].iter().zip([
            ("render_seconds", 1.0),
            ("paths_per_second", 1e-6),
            ("peak_mebibytes", 1.0),
        ]) {
            quotes.push(quote(&[&row[1], column], shown, unit * runs.median(column, &cells)));
        }
    }
    check(&quotes, 30, 0.0);
}

#[test]
fn sizes_and_times_of_sequences_are_measured() {
    let runs = Rows::read("docs/sequence.csv");
    let rows = table(&read("docs/sequence-exr.md"), "| `--keep` |");
    let columns = [
        ("terms", 1.0),
        ("raw_bytes", 1e-6),
        ("file_bytes", 1e-6),
        ("write_seconds", 1.0),
        ("read_seconds", 1.0),
        ("transform_peak_mebibytes", 1.0),
    ];
    let mut quotes = Vec::new();
    for row in &rows[1..] {
        let width = row[1].split('×').next().expect("a width");
        for (shown, (column, unit)) in row[2..].iter().zip(columns) {
            let value = runs.number(column, &[("keep", &row[0]), ("width", width)]);
            quotes.push(quote(&[&row[0], &row[1], column], shown, unit * value));
        }
    }
    check(&quotes, 24, 0.0);
}

#[test]
fn the_default_networks_scores_are_measured() {
    let scores = Rows::read("weights/cornell.csv");
    let mut quotes = Vec::new();
    let rows = table(&read("weights/README.md"), "| spp | MSE |");
    for row in &rows[1..] {
        for (shown, metric) in row[1..].iter().zip(["mse", "relmse", "smape"]) {
            let [t, s] = ["cornell", "none"]
                .map(|method| scores.sum(metric, &[("method", method), ("spp", &row[0])]));
            quotes.push(quote(&[&row[0], metric], shown, t / s));
        }
    }
    check(&quotes, 12, 0.0);
}

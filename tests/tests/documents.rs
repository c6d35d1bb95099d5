//! Numbers in documents are those of the tables beside them.

use std::{collections::HashMap, path::Path};

use nst_core::methods::METHODS;

fn read(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name);
    std::fs::read_to_string(&path).expect("the document is part of the repository")
}

/// MSE ratios at n = 64 by (method, regime).
fn ratios() -> HashMap<(String, String), f64> {
    let table = read("docs/stability.csv");
    let rows = table.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>());
    rows.filter(|row| row[2] == "64")
        .map(|row| ((row[0].into(), row[1].into()), row[3].parse().expect("a number")))
        .collect()
}

/// The cells of the README's table of methods and regimes that differ from the
/// suite's by more than the rounding to two digits, 5 %, and how many cells it has.
fn differences(readme: &str, ratios: &HashMap<(String, String), f64>) -> (Vec<String>, usize) {
    let cells = |line: &str| -> Vec<String> {
        line.trim_matches('|').split('|').map(|cell| cell.trim().replace('`', "")).collect()
    };
    let mut lines = readme.lines().skip_while(|line| !line.starts_with("| MSE ratio, n = 64 |"));
    let regimes = cells(lines.next().expect("the README has the table"));
    let (mut wrong, mut count) = (Vec::new(), 0);
    for row in lines.skip(1).take_while(|line| line.starts_with('|')).map(cells) {
        for (cell, regime) in row.iter().zip(&regimes).skip(1) {
            count += 1;
            let shown: f64 = cell.parse().expect("a number");
            let ratio = ratios[&(row[0].clone(), regime.clone())];
            if (shown - ratio).abs() > 0.05 * ratio {
                wrong.push(format!("{} on {regime}: {shown}, measured {ratio}", row[0]));
            }
        }
    }
    (wrong, count)
}

#[test]
fn the_readme_quotes_the_stability_suite() {
    let (readme, ratios) = (read("README.md"), ratios());
    let (wrong, count) = differences(&readme, &ratios);
    assert!(wrong.is_empty() && count > 30, "{count} cells, {wrong:#?}");
    // It would notice other numbers.
    let other = ratios.into_iter().map(|(key, ratio)| (key, 2.0 * ratio)).collect();
    assert_eq!(differences(&readme, &other).0.len(), count);
}

/// Rows of the committed table that break a promise: a result that is not finite
/// without need, or a method without a network below 20 million lane-terms a second.
fn broken_promises(table: &str) -> Vec<&str> {
    let breaks = |line: &&str| {
        let row: Vec<_> = line.split(',').collect();
        let rate: f64 = row[row.len() - 1].parse().expect("lane-terms per second");
        row[6] != "0" || (METHODS.contains(&row[0]) && rate < 20e6)
    };
    table.lines().skip(1).filter(breaks).collect()
}

#[test]
fn the_stability_table_keeps_its_promises() {
    let table = read("docs/stability.csv");
    assert!(table.lines().next().is_some_and(|head| {
        head.starts_with("method,regime,n,mse_ratio,fallback_share,worst_ratio,nonfinite,")
            && head.ends_with(",lane_terms_per_second")
    }));
    assert_eq!(broken_promises(&table), [""; 0]);
    assert!(METHODS.iter().all(|method| table.contains(&format!("\n{method},"))));
    let slow = "head\ngmon,zero,8,1,0,1,0,0,0,0,900,5e6\n";
    let rubbish = "head\nfamilies,zero,8,1,0,1,3,0,0,0,900,1e9\n";
    assert_eq!((broken_promises(slow).len(), broken_promises(rubbish).len()), (1, 1));
}

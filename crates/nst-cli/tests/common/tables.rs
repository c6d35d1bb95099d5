//! Runs `nst bench scene`, and reads its tables.

use std::{collections::BTreeMap, process::Command};

use super::Bench;

/// Rows by method, samples and run; each by column.
pub(crate) type Table = BTreeMap<(String, u32, u32), BTreeMap<String, String>>;

pub(crate) fn table(bench: &Bench, name: &str) -> Table {
    let mut reader = csv::Reader::from_path(bench.path(name)).expect("a table");
    let rows = reader.deserialize::<BTreeMap<String, String>>();
    rows.map(|row| {
        let row = row.expect("a row");
        let number = |column: &str| row[column].parse().expect("a number");
        ((row["method"].clone(), number("spp"), number("run")), row)
    })
    .collect()
}

pub(crate) fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} is '{}'", row[column]))
}

/// All that is not a time.
pub(crate) fn errors(table: &Table) -> Vec<String> {
    let columns = ["mse", "relmse", "smape", "mse_trimmed", "bias2", "reference_mse", "seed"];
    table.iter().map(|(key, row)| format!("{key:?} {:?}", columns.map(|it| &row[it]))).collect()
}

/// Runs `nst` with the caches in the test's folder.
pub(crate) fn nst(bench: &Bench, args: &str) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_nst"))
        .args(args.split_whitespace())
        .current_dir(bench.path(""))
        .env("XDG_CACHE_HOME", bench.path("caches"))
        .output()
        .expect("the binary runs");
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    (output.status.code(), text(output.stdout), text(output.stderr))
}

pub(crate) fn succeed(bench: &Bench, args: &str) -> String {
    let (code, said, complained) = nst(bench, args);
    assert_eq!(code, Some(0), "{args}: {complained}");
    said
}

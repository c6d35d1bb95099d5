//! Runs `nst bench scene`, and reads its tables.

use std::{
    collections::BTreeMap,
    process::{Child, Command, Output, Stdio},
};

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

/// `nst` with the caches in the test's folder.
fn command(bench: &Bench, args: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_nst"));
    command.args(args.split_whitespace()).current_dir(bench.path(""));
    command.env("XDG_CACHE_HOME", bench.path("caches"));
    command
}

/// Runs `nst`: its exit code, and what it says and complains about.
pub(crate) fn nst(bench: &Bench, args: &str) -> (Option<i32>, String, String) {
    ended(command(bench, args).output().expect("the binary runs"))
}

/// Starts `nst`.
pub(crate) fn start(bench: &Bench, args: &str) -> Child {
    let mut command = command(bench, args);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the binary runs")
}

/// Ends it by SIGTERM; as [`nst`].
#[cfg(unix)]
pub(crate) fn terminate(child: Child) -> (Option<i32>, String, String) {
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &pid]).status().expect("kill runs").success());
    ended(child.wait_with_output().expect("it ends"))
}

fn ended(output: Output) -> (Option<i32>, String, String) {
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    (output.status.code(), text(output.stdout), text(output.stderr))
}

pub(crate) fn succeed(bench: &Bench, args: &str) -> String {
    let (code, said, complained) = nst(bench, args);
    assert_eq!(code, Some(0), "{args}: {complained}");
    said
}

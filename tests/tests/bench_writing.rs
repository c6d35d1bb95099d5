//! The program that times how pictures are written.

use std::process::Command;

#[test]
fn a_row_for_each_writer() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = Command::new(env!("CARGO_BIN_EXE_bench-writing"))
        .args(["--size", "40", "--runs", "3", "-o", "rows.csv"])
        .current_dir(folder.path())
        .output()
        .expect("the program runs");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    let table = std::fs::read_to_string(folder.path().join("rows.csv")).expect("the table");
    // Two names have a comma, and are quoted.
    let mut rows = csv::Reader::from_reader(table.as_bytes());
    assert_eq!(rows.headers().expect("a line"), vec!["what", "seconds", "ratio", "bytes"]);
    let rows: Vec<_> = rows.records().map(|row| row.expect("a row")).collect();
    let expected = [
        "nst, EXR and PNG",
        "nst, EXR",
        "nst, PNG",
        "exr crate, zip",
        "exr crate, piz",
        "exr crate, uncompressed",
        "copy of nst's EXR",
    ];
    assert_eq!(rows.iter().map(|row| &row[0]).collect::<Vec<_>>(), expected);
    let number = |row: usize, column: usize| rows[row][column].parse::<f64>().expect("a number");
    assert!((0..rows.len()).all(|row| number(row, 1) > 0.0));
    assert_eq!(number(3, 2), 1.0);
    assert_eq!(number(0, 3), number(1, 3) + number(2, 3));
    // 40×40 pixels of nine channels.
    assert!(number(5, 3) > 40.0 * 40.0 * 9.0 * 4.0 && number(1, 3) < number(5, 3));
}

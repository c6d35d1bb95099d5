//! The program that times renderings with and without overlap.

use std::process::Command;

#[test]
fn both_ways_of_each_method_and_the_bands() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = Command::new(env!("CARGO_BIN_EXE_bench-overlap"))
        .args(["--size", "100", "--spp", "9", "--runs", "2", "-o", "rows.csv"])
        .current_dir(folder.path())
        .output()
        .expect("the program runs");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    let table = |name: &str| -> Vec<csv::StringRecord> {
        let table = csv::Reader::from_path(folder.path().join(name)).expect("a table");
        table.into_records().map(|row| row.expect("a row")).collect()
    };
    let rows = table("rows.csv");
    let number =
        |row: &csv::StringRecord, column: usize| -> f64 { row[column].parse().expect("a number") };
    let methods = rows.len() / 4;
    assert!((2..=3).contains(&methods) && rows.len() == 4 * methods, "{rows:?}");
    for (i, row) in rows.iter().enumerate() {
        assert_eq!(&row[1], if i % 2 == 0 { "false" } else { "true" });
        let bands = number(row, 5);
        assert!(0.0 < number(row, 3) && number(row, 3) <= number(row, 4), "{row:?}");
        // Without overlap none is handed; with it, at most all seven.
        assert!(if i % 2 == 0 { bands == 0.0 } else { bands <= 7.0 }, "{row:?}");
    }
    for row in table("rows-bands.csv") {
        let [traced, handed, done] = [2, 3, 4].map(|column| number(&row, column));
        assert!(0.0 < traced && traced <= handed && handed <= done, "{row:?}");
    }
}

//! The program that times how scenes are read.

use std::process::Command;

#[test]
fn a_row_per_turn_of_each_reader() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = Command::new(env!("CARGO_BIN_EXE_bench-load"))
        .args(["--squares", "20", "--runs", "3", "-o", "rows.csv"])
        .current_dir(folder.path())
        .output()
        .expect("the program runs");
    let stderr = String::from_utf8_lossy(&output.stderr);
    let stdout = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && stdout.contains("800 triangles"), "{stdout}{stderr}");
    let table = std::fs::read_to_string(folder.path().join("rows.csv")).expect("the table");
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("run,reader,triangles,megabytes,milliseconds"));
    let rows: Vec<Vec<_>> = lines.map(|line| line.split(',').collect()).collect();
    let readers: Vec<_> = rows.iter().map(|row| (row[0], row[1], row[2])).collect();
    let expected = ["0", "1", "2"].map(|run| [(run, "nst", "800"), (run, "tobj", "800")]);
    assert_eq!(readers, expected.concat());
    assert!(rows.iter().all(|row| row[4].parse().is_ok_and(|time: f64| time > 0.0)), "{rows:?}");
}

//! The program that times networks.

use std::process::Command;

#[test]
fn a_row_per_backend_network_and_batch() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = Command::new(env!("CARGO_BIN_EXE_bench-inference"))
        .args(["--shapes", "1x8,2x16", "--lanes", "1,100", "--backend", "cpu", "--runs", "1"])
        .args(["-q", "-o", "rows.csv"])
        .current_dir(folder.path())
        .output()
        .expect("the program runs");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && output.stdout.is_empty(), "{stderr}");
    let table = std::fs::read_to_string(folder.path().join("rows.csv")).expect("the table");
    let mut lines = table.lines();
    assert_eq!(
        lines.next(),
        Some("backend,adapter,layers,hidden,lanes,milliseconds,gflops,share_of_peak,threads")
    );
    let rows: Vec<Vec<_>> = lines.map(|line| line.split(',').collect()).collect();
    let cpu: Vec<_> = rows.iter().filter(|row| row[0] == "cpu").map(|row| &row[2..5]).collect();
    let expected = [["1", "8", "1"], ["1", "8", "100"], ["2", "16", "1"], ["2", "16", "100"]];
    assert_eq!(cpu, expected);
    assert_eq!(rows.iter().filter(|row| row[0] == "gemm").count(), 4);
}

#[test]
fn bad_arguments_are_named() {
    for (args, words) in [
        (&["--shapes", "4x0"][..], "hidden layers × neurons"),
        (&["--lanes", "0"], "0 is not in 1.."),
        (&["--weights", "missing.safetensors"], "missing.safetensors: cannot read weights"),
    ] {
        let program = env!("CARGO_BIN_EXE_bench-inference");
        let output = Command::new(program).args(args).output().expect("the program runs");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && stderr.contains(words), "{args:?}: {stderr}");
    }
}

use std::path::PathBuf;

use super::*;
use crate::results::{Metric, Results};

/// A table in a temporary folder, and its path.
fn stored(content: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("results.csv");
    std::fs::write(&path, content).expect("a file in it");
    (folder, path)
}

fn row(scene: &str, method: &str, run: u32, mse: f64) -> Row {
    Row {
        scene: scene.into(),
        method: method.into(),
        spp: 8,
        run,
        mse: Some(mse),
        width: 4,
        height: 2,
        machine: "inf, nan and \"others\"".into(),
        schema: SCHEMA,
        ..Row::default()
    }
}

fn text(rows: &[Row]) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row).expect("a row");
    }
    String::from_utf8(writer.into_inner().expect("a table")).expect("UTF-8")
}

/// Reading must fail with all of the words.
fn fails(content: impl AsRef<[u8]>, words: &[&str]) {
    let (_folder, path) = stored(content);
    let error = read_rows(&path).expect_err("a table with a fault").to_string();
    for word in [&["results.csv"], words].concat() {
        assert!(error.contains(word), "'{word}' is not in: {error}");
    }
}

#[test]
fn what_was_written_is_read() -> Result<(), Error> {
    let failure = Some("it has <b>, \"quotes\" and\nlines".to_owned());
    let mut rows = vec![
        row("a", "none", 0, 0.1 + 0.2),
        Row { failure, mse: None, ..row("a", "b", 1, 0.0) },
        Row { bias2: Some(-1e-300), threads: Some(2), ..row("a", "b", 2, f64::MIN_POSITIVE) },
    ];
    let (_folder, path) = stored(text(&rows));
    assert_eq!(read_rows(&path)?, rows);
    assert_eq!(Results::read(&[path], None)?.rows(), rows);
    // Columns in another order, more of them, and a byte order mark.
    let moved = "\u{feff}new,".to_owned() + &text(&rows[..1]).replacen("\nscene", "\n1,", 1);
    let moved = moved.replacen("\na,", "\nsomething,a,", 1);
    let (_folder, path) = stored(moved);
    assert_eq!(read_rows(&path)?, rows[..1]);
    rows[0].run = 7;
    assert_ne!(read_rows(&path)?, rows[..1]);
    Ok(())
}

#[test]
fn tables_of_other_versions() {
    let table = text(&[row("a", "none", 0, 1.0)]);
    let version = |number: u32| table.replace(&format!(",{SCHEMA},"), &format!(",{number},"));
    let (known, later) = (format!("version {SCHEMA}"), format!("version '{}'", SCHEMA + 1));
    fails(version(SCHEMA + 1), &[&later, &known, "nst bench scene"]);
    fails(version(1), &["version '1'"]);
    let old = "scene,method,spp,run,mse,relmse,smape,render_seconds,transform_seconds,io_seconds,\
               total_seconds\na,none,8,0,1,1,1,1,1,1,1\n";
    fails(old, &["missing", "schema", "mse_trimmed", "earlier version", "nst bench scene"]);
    fails("a,b\n1,2\n", &["missing", "scene", "no table of nst bench scene"]);
    let second = text(&[row("a", "none", 0, 1.0), Row { schema: 9, ..row("a", "b", 0, 1.0) }]);
    fails(second, &["line 3", "version 9"]);
}

#[test]
fn damaged_tables() {
    let table = text(&[row("a", "none", 0, 1.0), row("a", "none", 1, 2.5)]);
    let header = table.lines().next().expect("a header").to_owned();
    fails("", &["empty", "nst bench scene"]);
    fails(&header, &["no rows"]);
    fails(header.replace(",mse,", ",") + "\n", &["missing: mse;"]);
    fails(table.replace("2.5", "2.5x"), &["line 3", "column mse", "'2.5x' is no number"]);
    fails(table.replace("2.5", "inf"), &["line 3", "column mse", "'inf' is not finite"]);
    fails(table.replace("2.5", "NaN"), &["line 3", "column mse", "'NaN' is not finite"]);
    fails(table.replace(",8,1,", ",8.5,1,"), &["line 3", "column spp", "'8.5' is no whole number"]);
    fails(table.replace(",8,1,", ",-8,1,"), &["line 3", "column spp", "'-8' is no whole number"]);
    fails(table.replace(",8,1,", ",,1,"), &["line 3", "column spp"]);
    // Lines that end as on Windows, an empty one, and old Macs'.
    let windows = table.replace("2.5", "x").replace('\n', "\r\n");
    fails(&windows, &["line 3", "column mse"]);
    fails(windows.replacen("\r\n", "\r\n\r\n", 1), &["line 4", "column mse"]);
    fails(windows.replace("\r\n", "\r"), &["line 3", "column mse"]);
    fails(windows.replace(",x,", ",1,2,"), &["line 3", "fields"]);
    let cut = &table[..table.len() - 5];
    fails(cut, &["line 3", "fields"]);
    let mut bytes = table.clone().into_bytes();
    let last = bytes.len() - 3;
    bytes[last] = 0xff;
    fails(&bytes, &["line 3", "UTF-8"]);
    fails([0xff, b'a', b',', b'\n'], &["UTF-8"]);
    fails(b"\x76\x2f\x31\x01\0\0\0", &["no table of nst bench scene"]);
    let missing = read_rows(Path::new("gone.csv")).expect_err("no file").to_string();
    assert!(missing.contains("gone.csv"), "{missing}");
    assert!(read_rows(Path::new(".")).is_err());
}

#[test]
fn one_scene_is_chosen() {
    let (_folder, path) = stored(text(&[row("a", "none", 0, 1.0), row("b <", "none", 0, 2.0)]));
    let paths = [path];
    let read = |scene| Results::read(&paths, scene);
    let error = read(None).expect_err("two scenes").to_string();
    assert!(error.contains("--scene") && error.contains("'a', 'b <'"), "{error}");
    let error = read(Some("c")).expect_err("no such scene").to_string();
    assert!(error.contains("'c'") && error.contains("'a', 'b <'"), "{error}");
    let chosen = read(Some("b <")).expect("a scene");
    assert_eq!((chosen.scene(), chosen.rows().len(), chosen.size()), ("b <", 1, [4, 2]));
}

#[test]
fn tables_are_joined() {
    let (_first, a) = stored(text(&[row("a", "none", 0, 1.0), row("a", "none", 1, 2.0)]));
    let (_second, b) = stored(text(&[row("a", "none", 0, 1.0), row("a", "new", 0, 3.0)]));
    let both = Results::read(&[a.clone(), b], None).expect("tables that fit together");
    assert_eq!(both.rows().len(), 3);
    assert_eq!(both.distinct(|row| &row.method), ["none", "new"]);
    let (_third, other) = stored(text(&[row("a", "none", 1, 2.5)]));
    let error = Results::read(&[a.clone(), other], None).expect_err("another run 1").to_string();
    assert!(error.contains("run 1 of 'none' at 8 spp is there twice"), "{error}");
    let (_fourth, large) = stored(text(&[Row { width: 8, ..row("a", "none", 2, 2.5) }]));
    let error = Results::read(&[a, large], None).expect_err("another film").to_string();
    assert!(error.contains("4x2") && error.contains("8x2"), "{error}");
}

/// What `nst bench scene` would not write into one table is not joined either.
#[test]
fn tables_that_do_not_fit_together() {
    let (_first, a) = stored(text(&[row("a", "none", 0, 1.0)]));
    let other = row("a", "none", 1, 2.0);
    let joined = |changed: Row| {
        let (_second, b) = stored(text(&[changed]));
        Results::read(&[a.clone(), b], None)
    };
    for (what, changed) in [
        ("fingerprint", Row { fingerprint: "a:v2:1".into(), ..other.clone() }),
        ("sampler", Row { sampler: "halton".into(), ..other.clone() }),
        ("reference", Row { reference_mse: Some(1e-3), ..other.clone() }),
        ("size", Row { height: 3, ..other.clone() }),
    ] {
        let error = joined(changed).expect_err(what).to_string();
        assert!(error.contains(what) && error.contains("one bench"), "{error}");
    }
    let elsewhere = Row { machine: "another".into(), version: "9.9".into(), ..other.clone() };
    let notes = joined(elsewhere).expect("only times differ").notes().join(" ");
    assert!(notes.contains("several machines") && notes.contains("several versions"), "{notes}");
    let other = Row { threads: Some(2), ..other };
    let (_third, c) = stored(text(&[other.clone(), Row { threads: Some(3), run: 2, ..other }]));
    let notes = Results::read(&[c], None).expect("a table").notes().join(" ");
    assert!(notes.contains("2 to 3 threads"), "{notes}");
}

/// Runs of two benches have the same numbers, but other seeds.
#[test]
fn runs_are_told_apart_by_their_seeds() {
    let of_seeds = |seeds: [u64; 2]| {
        let rows = seeds
            .into_iter()
            .zip(0..)
            .map(|(seed, run)| Row { seed: Some(seed), ..row("a", "none", run, seed as f64) });
        stored(text(&rows.collect::<Vec<_>>()))
    };
    let ((_first, a), (_second, b)) = (of_seeds([7, 8]), of_seeds([8, 9]));
    let both = Results::read(&[a.clone(), b], None).expect("three runs");
    let runs: Vec<_> = both.rows().iter().map(|row| (row.run, row.seed)).collect();
    assert_eq!(runs, [(0, Some(7)), (1, Some(8)), (2, Some(9))]);
    assert_eq!(both.summaries()[0].error(Metric::Mse).map(|mse| mse.mean), Some(8.0));
    let (_third, c) = stored(text(&[Row { seed: Some(7), ..row("a", "none", 5, 7.5) }]));
    let error = Results::read(&[a, c], None).expect_err("another run of seed 7").to_string();
    assert!(error.contains("twice"), "{error}");
}

#[test]
fn large_tables() -> Result<(), Error> {
    let rows: Vec<Row> = (0..100_000).map(|run| row("a", "none", run, f64::from(run))).collect();
    let (_folder, path) = stored(text(&rows));
    let results = Results::read(&[path], None)?;
    let summaries = results.summaries();
    let mean = summaries[0].error(Metric::Mse).map(|mse| mse.mean);
    assert_eq!((summaries[0].runs, mean), (100_000, Some(49_999.5)));
    Ok(())
}

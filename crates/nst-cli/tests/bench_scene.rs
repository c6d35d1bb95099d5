//! `nst bench scene`: its table, its references, and what is left of one that is cut off.

mod common;

use std::path::PathBuf;

use common::{
    Bench, cornell, read_layer,
    tables::{errors, nst, number, start, succeed, table, terminate},
};
use nst_core::{Estimates, methods::method, metrics};
use nst_files::sequence_file::SequenceFile;

fn references(bench: &Bench) -> Vec<PathBuf> {
    let folder = std::fs::read_dir(bench.path("caches/nst/references")).expect("the folder");
    folder.map(|file| file.expect("a file").path()).collect()
}

const METHODS: &str = "--transform gmon ridge families auto";

#[test]
fn errors_are_those_that_a_slow_program_computes() {
    let bench = Bench::new();
    let scene = format!("--scene {} --size 24x16", cornell());
    let said = succeed(
        &bench,
        &format!("bench scene {scene} --spp 8 16 --runs 3 --backend cpu {METHODS} -o t.csv"),
    );
    assert!(said.contains("24x16 pixels, 3 runs") && said.contains("wrote      t.csv, t.exr"));
    let rows = table(&bench, "t.csv");
    assert_eq!(rows.len(), 5 * 2 * 3);
    // The halves, and a run, rendered by another command.
    let mut halves = references(&bench);
    halves.sort();
    let halves: Vec<Vec<f32>> = halves.iter().map(|path| read_layer(path, "").1).collect();
    let seed = rows[&("none".to_owned(), 16, 1)]["seed"].clone();
    assert_eq!(seed, "1000001");
    succeed(
        &bench,
        &format!("render {scene} --spp 16 --seed {seed} --sequence s.exr -o x.exr --quiet"),
    );
    let batch = SequenceFile::read(&bench.path("s.exr")).expect("a sequence").batch;
    for name in ["none", "gmon", "ridge"] {
        let mut estimates = Estimates::default();
        let values = match method(name) {
            None => batch.last(),
            Some(method) => {
                method.transform(&batch, &mut estimates).expect("it transforms");
                estimates.values()
            }
        };
        let products = values.iter().zip(&halves[0]).zip(&halves[1]);
        let products = products
            .map(|((&x, &a), &b)| (f64::from(x) - f64::from(a)) * (f64::from(x) - f64::from(b)));
        let expected = products.sum::<f64>() / values.len() as f64;
        let row = &rows[&(name.to_owned(), 16, 1)];
        // Sums in another order.
        assert!((number(row, "mse") / expected - 1.0).abs() < 1e-9, "{name}: {expected}");
        // The mean of both halves is another reference, whose noise counts.
        let mean: Vec<f32> = halves[0].iter().zip(&halves[1]).map(|(a, b)| (a + b) / 2.0).collect();
        let other = metrics::error(values, &mean).expect("of one length").mse;
        assert!((number(row, "mse") / other - 1.0).abs() > 1e-6, "{name}");
    }
    // Only pairs have a squared bias; that of plain sampling is 0, up to noise.
    assert_eq!(rows[&("none".to_owned(), 8, 2)]["bias2"], "");
    let none = &rows[&("none".to_owned(), 8, 0)];
    assert_eq!(none["bias2"], rows[&("none".to_owned(), 8, 1)]["bias2"]);
    assert!(number(none, "bias2").abs() < 0.5 * number(none, "mse"), "{none:?}");
    // The variance that plain sampling itself measures.
    assert!((0.1..10.0).contains(&(number(none, "predicted_mse") / number(none, "mse"))));
    let parts = ["load", "render", "transform", "io"];
    let whole: f64 = parts.iter().map(|it| number(none, &format!("{it}_seconds"))).sum();
    assert!((number(none, "total_seconds") - whole).abs() < 1e-6);
    // Pictures for a report: the reference, and the first runs.
    let (size, mean) = read_layer(&bench.path("t.exr"), "");
    assert_eq!((size, mean.len()), ([24, 16], halves[0].len()));
    let plain = read_layer(&bench.path("t.exr"), "none.16").1;
    assert_ne!(plain, batch.last(), "it is run 0, not run 1");
}

#[test]
fn the_same_seeds_give_the_same_errors_in_one_go_or_in_two() {
    let bench = Bench::new();
    let scene = format!("--scene {} --size 16x12 --backend cpu --quiet", cornell());
    let whole = format!("bench scene {scene} --spp 8 9 --runs 4 {METHODS}");
    succeed(&bench, &format!("{whole} -o whole.csv"));
    // The reference is taken from the first bench.
    let before: Vec<_> = references(&bench);
    assert_eq!(before.len(), 2);
    succeed(
        &bench,
        &format!(
            "bench scene {scene} --spp 9 --runs 2 --transform gmon --reference-spp 144 -o part.csv"
        ),
    );
    let first = errors(&table(&bench, "part.csv"));
    succeed(&bench, &format!("{whole} -o part.csv"));
    assert_eq!(references(&bench).len(), 2, "the reference is of an earlier bench");
    assert_eq!(errors(&table(&bench, "part.csv")), errors(&table(&bench, "whole.csv")));
    assert!(first.iter().all(|row| errors(&table(&bench, "whole.csv")).contains(row)));
    // Nothing is left to do.
    let time = |bench: &Bench| table(bench, "part.csv").values().next().expect("a row").clone();
    let old = time(&bench);
    succeed(&bench, &format!("{whole} -o part.csv"));
    assert_eq!(time(&bench), old);
    // Other seeds give other errors.
    succeed(&bench, &format!("{whole} --seed 5 -o other.csv"));
    assert_ne!(errors(&table(&bench, "other.csv")), errors(&table(&bench, "whole.csv")));
}

#[test]
fn methods_that_fail_and_errors_below_the_references_have_a_reason() {
    let bench = Bench::new();
    let scene = format!("--scene {} --size 40x30 --backend cpu --runs 2", cornell());
    let args = format!("bench scene {scene} --spp 4 256 --transform cornell --reference-spp 8");
    let said = succeed(&bench, &format!("{args} -o t.csv"));
    let rows = table(&bench, "t.csv");
    let failure = |name: &str, spp: u32| rows[&(name.to_owned(), spp, 0)]["failure"].clone();
    assert!(failure("cornell", 4).contains("reads the last 8 terms, but there are 4"));
    assert_eq!(rows[&("cornell".to_owned(), 4, 0)]["mse"], "");
    // 256 samples against the 16 of the reference: the rows have errors, the mean is not judged.
    assert_eq!([failure("none", 256), failure("none", 4)], ["", ""]);
    let own = number(&rows[&("none".to_owned(), 256, 0)], "reference_mse");
    assert!([0, 1].iter().all(|&run| number(&rows[&("none".to_owned(), 256, run)], "mse") < own));
    let why = "failed     none at 256 spp: its mean MSE";
    assert_eq!(said.matches(why).count(), 1, "{said}");
    assert!(
        said.contains("below the reference's own") && said.contains("--reference-spp"),
        "{said}"
    );
}

#[test]
fn other_programs_files_are_judged() {
    let bench = Bench::new();
    let render = format!("render --scene {} --size 12x10 --transform none --quiet", cornell());
    for seed in [1, 2, 3] {
        let files = format!("--sequence s{seed}.exr -o x{seed}.exr");
        succeed(&bench, &format!("{render} --spp 16 --seed {seed} {files}"));
    }
    succeed(&bench, &format!("{render} --spp 2000 --seed 9 -o ref.exr"));
    let args = "bench scene --sequence s1.exr s2.exr --reference ref.exr --transform gmon --quiet";
    // The pictures of this program say what a bench must know.
    succeed(&bench, "transform s3.exr --transform none -o y3.exr --quiet");
    succeed(&bench, &format!("{args} --picture other=x3.exr --picture again=y3.exr -o t.csv"));
    let rows = table(&bench, "t.csv");
    let expected = |file: &str| {
        let [x, reference] = [file, "ref.exr"].map(|file| read_layer(&bench.path(file), "").1);
        metrics::error(&x, &reference).expect("of one length").mse
    };
    for (row, file) in [
        (("none", 0), "x1.exr"),
        (("none", 1), "x2.exr"),
        (("other", 0), "x3.exr"),
        (("again", 0), "x3.exr"),
    ] {
        let row = &rows[&(row.0.to_owned(), 16, row.1)];
        assert!((number(row, "mse") / expected(file) - 1.0).abs() < 1e-9, "{file}");
        assert_eq!(row["reference_mse"], "", "one picture does not know its own error");
        assert!(number(row, "render_seconds") > 0.0);
    }
    assert_eq!(rows.len(), 2 * 2 + 2);
    let layer = read_layer(&bench.path("t.exr"), "other.16").1;
    assert_eq!(layer, read_layer(&bench.path("x3.exr"), "").1);
}

#[test]
fn tables_of_another_bench_are_left_alone() {
    let bench = Bench::new();
    let scene = format!("bench scene --scene {} --size 8x8 --backend cpu --quiet", cornell());
    let args = format!("{scene} --spp 8 --runs 2 --transform gmon");
    succeed(&bench, &format!("{args} -o t.csv"));
    let precious = std::fs::read(bench.path("t.csv")).expect("the table");
    bench.write("notes.csv", "a,b\n1,2\n");
    for (args, words) in [
        (format!("{args} --seed 7 -o t.csv"), ["another --seed", "name another file"]),
        (
            format!("{args} --reference-spp 9 -o t.csv"),
            ["another reference", "--reference-spp 128"],
        ),
        (args.replace("8x8", "9x8") + " -o t.csv", ["another size", "another file"]),
        (format!("{args} --max-depth 2 -o t.csv"), ["another scene", "another file"]),
        (format!("{args} -o notes.csv"), ["notes.csv", "another file"]),
    ] {
        let (code, _, complained) = nst(&bench, &args);
        assert_eq!(code, Some(1), "{args}");
        assert!(words.iter().all(|word| complained.contains(word)), "{args}: {complained}");
    }
    assert!(std::fs::read(bench.path("t.csv")).expect("the table") == precious);
    for (args, word) in [
        (format!("{scene} --sequence s.exr -o t.csv"), "cannot be used with"),
        ("bench scene -o t.csv".to_owned(), "--scene"),
        ("bench scene --sequence s.exr -o t.csv".to_owned(), "--reference"),
        (format!("{scene} --picture oidn -o t.csv"), "oidn=denoised.exr"),
        (
            format!("{scene} --picture {}=x.exr -o t.csv", "x".repeat(101)),
            "more than 100 characters",
        ),
        (format!("{scene} -o t.exr"), "must end in .csv"),
    ] {
        let (code, _, complained) = nst(&bench, &args);
        assert_eq!(code, Some(2), "{args}: {complained}");
        assert!(complained.contains(word), "{args}: {complained}");
    }
}

/// A signal keeps what was measured, and the same command goes on.
#[cfg(unix)]
#[test]
fn a_bench_that_is_cut_off_goes_on() {
    let bench = Bench::new();
    let scene = format!("--scene {} --size 40x30 --backend cpu --quiet", cornell());
    let args = |runs: u32| {
        format!(
            "bench scene {scene} --spp 32 --reference-spp 64 --transform gmon --runs {runs} -o t.csv"
        )
    };
    let mut child = start(&bench, &args(1_000_000));
    // The table is there as soon as a pair of runs is measured.
    while !bench.path("t.csv").is_file() {
        assert!(child.try_wait().expect("a child").is_none(), "it ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let (code, _, complained) = terminate(child);
    assert_eq!(code, Some(143), "{complained}");
    assert!(complained.contains("the same command goes on from there"), "{complained}");
    let stopped = table(&bench, "t.csv");
    // Two rows for each run, of the plain estimates and of gmon.
    let pairs = format!("{} of 500000 pairs of runs are in 't.csv'", stopped.len() / 4);
    assert!(complained.contains(&pairs), "{complained}: {}", stopped.len());
    let runs = stopped.len() as u32 / 2 + 2;
    succeed(&bench, &args(runs));
    let continued = table(&bench, "t.csv");
    assert_eq!(continued.len() as u32, 2 * runs);
    assert!(stopped.iter().all(|(key, row)| continued[key] == *row));
    succeed(&bench, &args(runs).replace("t.csv", "whole.csv"));
    assert_eq!(errors(&continued), errors(&table(&bench, "whole.csv")));
    assert_eq!(bench.files(), ["caches", "t.csv", "t.exr", "whole.csv", "whole.exr"]);
}

#[test]
fn networks_of_files_are_measured_anew() {
    let bench = Bench::new();
    let put = |network: &str| {
        let weights = concat!(env!("CARGO_MANIFEST_DIR"), "/../nst-core/weights");
        let file = format!("{weights}/{network}.safetensors");
        std::fs::copy(file, bench.path("mine.safetensors")).expect("a network");
    };
    let scene = format!("--scene {} --size 8x8 --spp 8 --runs 2 --backend cpu", cornell());
    let args = format!("bench scene {scene} --transform families --weights mine.safetensors");
    let mse = |method: &str| table(&bench, "t.csv")[&(method.to_owned(), 8, 1)]["mse"].clone();
    put("families");
    succeed(&bench, &format!("{args} -o t.csv"));
    let families = mse("families");
    assert_eq!(mse("mine"), families);
    put("cornell");
    succeed(&bench, &format!("{args} -o t.csv"));
    assert_eq!(mse("families"), families);
    assert_ne!(mse("mine"), families, "the file changed");
    for (file, code, words) in [
        ("families.safetensors", 2, "another method 'families'"),
        ("gone.safetensors", 1, "gone.safetensors"),
    ] {
        let (found, _, complained) =
            nst(&bench, &format!("{} -o t.csv", args.replace("mine.safetensors", file)));
        assert_eq!(found, Some(code), "{complained}");
        assert!(complained.contains(words), "{complained}");
    }
}

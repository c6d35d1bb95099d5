//! Standard output and standard error that are closed, full, or read by nobody; and file
//! names that are no text.
#![cfg(target_os = "linux")]

mod common;

use std::{
    ffi::OsStr,
    fs::File,
    os::unix::{ffi::OsStrExt, process::ExitStatusExt},
    process::{Command, Output, Stdio},
};

use common::Bench;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
const RENDER: &str = "render --scene plain.obj --spp 4 --size 6x5 --transform none";

/// A scene, sequences `s1.exr` and `s2.exr`, and pictures `r1.exr` and `r2.exr`.
fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("plain.obj", TRIANGLE);
    for seed in [1, 2] {
        let files = format!("--sequence s{seed}.exr -o r{seed}.exr");
        bench.succeed(&format!("{RENDER} --seed {seed} --quiet {files}"));
    }
    bench
}

/// A command of each kind, and what it writes.
fn jobs() -> Vec<(String, &'static [&'static str])> {
    let scene = "bench scene --scene plain.obj --reference r1.exr --spp 1 --runs 1";
    vec![
        (format!("{RENDER} -o new.exr --sequence new_s.exr"), &["new.exr", "new.png", "new_s.exr"]),
        (format!("{RENDER} --runs 2 -o new.safetensors"), &["new.safetensors"]),
        ("transform s1.exr -o new.exr".to_owned(), &["new.exr", "new.png"]),
        ("pack r1.exr r2.exr --as samples --spp 4 -o new.exr".to_owned(), &["new.exr"]),
        ("pack s1.exr s2.exr --as runs -o new.safetensors".to_owned(), &["new.safetensors"]),
        ("merge s1.exr s2.exr -o new.exr".to_owned(), &["new.exr"]),
        ("info s1.exr".to_owned(), &[]),
        ("info plain.obj".to_owned(), &[]),
        ("compare r1.exr r2.exr --error-map new.png".to_owned(), &["new.png"]),
        (format!("{scene} -o new.csv"), &["new.csv", "new.exr"]),
        ("bench stability --short -o new.csv --markdown new.md".to_owned(), &["new.csv", "new.md"]),
    ]
}

/// What jobs have written.
fn outputs(bench: &Bench) -> Vec<String> {
    bench.files().into_iter().filter(|name| name.starts_with("new")).collect()
}

fn remove_outputs(bench: &Bench) {
    for name in outputs(bench) {
        std::fs::remove_file(bench.path(&name)).expect("an earlier output");
    }
}

fn nst(bench: &Bench, args: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_nst"));
    command.args(args.split_whitespace()).current_dir(bench.path(""));
    command
}

/// A pipe that nobody reads.
fn unread() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

/// A disk on which there is no room.
fn full() -> Stdio {
    File::options().write(true).open("/dev/full").expect("Linux has it").into()
}

/// The exit code, of a process that no signal and no panic has ended.
fn code(output: &Output, args: &str) -> i32 {
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!stderr.contains("panicked"), "nst {args}: {stderr}");
    assert_eq!(output.status.signal(), None, "nst {args}: {stderr}");
    output.status.code().expect("it has ended by itself")
}

/// Runs all jobs with a standard output of some kind, as text and as JSON; each must write
/// its files, end with `expected` and say `words` on standard error.
fn check_jobs(stdout: impl Fn() -> Stdio, expected: i32, words: &str) {
    let bench = bench();
    for (job, files) in jobs() {
        for option in ["", " --json"] {
            let args = format!("{job}{option}");
            remove_outputs(&bench);
            let mut command = nst(&bench, &args);
            let output = command.stdout(stdout()).stderr(Stdio::piped()).spawn();
            let output = output.and_then(std::process::Child::wait_with_output);
            let output = output.expect("the binary runs");
            assert_eq!(code(&output, &args), expected, "nst {args}");
            let stderr = String::from_utf8(output.stderr).expect("UTF-8");
            assert_eq!(stderr.is_empty(), words.is_empty(), "nst {args}: {stderr}");
            assert!(stderr.contains(words), "nst {args}: {stderr}");
            assert_eq!(outputs(&bench), files, "nst {args}");
        }
    }
}

#[test]
fn a_reader_that_has_heard_enough_ends_no_job() {
    check_jobs(unread, 0, "");
}

#[test]
fn a_full_standard_output_is_an_error_after_the_files_are_written() {
    check_jobs(full, 1, "error: cannot write to standard output");
}

#[test]
fn a_closed_standard_output_is_no_error() {
    let bench = bench();
    for (job, files) in jobs() {
        for option in ["", "--json"] {
            remove_outputs(&bench);
            let script = format!("exec \"$0\" {job} {option} >&-");
            let mut command = Command::new("sh");
            command.args(["-c", &script, env!("CARGO_BIN_EXE_nst")]).current_dir(bench.path(""));
            let output = command.output().expect("sh runs");
            assert_eq!(code(&output, &job), 0, "{job}");
            assert!(output.stderr.is_empty(), "{job}");
            assert_eq!(outputs(&bench), files, "{job}");
        }
    }
}

#[test]
fn errors_that_nobody_hears_have_their_exit_codes() {
    let bench = bench();
    for (args, expected) in [
        ("transform gone.exr", 1),
        ("transform s1.exr -o s1.exr", 2),
        ("transform s1.exr --transform magic", 2),
        ("render --scene plain.obj --spp 1 --size 2x2 -q --sequence gone/s.exr", 1),
        ("info s1.exr", 0),
    ] {
        for stderr in [unread as fn() -> Stdio, full] {
            let mut command = nst(&bench, args);
            let output = command.stdout(Stdio::null()).stderr(stderr()).output();
            assert_eq!(code(&output.expect("the binary runs"), args), expected, "nst {args}");
        }
        let script = format!("exec \"$0\" {args} 2>&-");
        let mut command = Command::new("sh");
        command.args(["-c", &script, env!("CARGO_BIN_EXE_nst")]).current_dir(bench.path(""));
        assert_eq!(code(&command.output().expect("sh runs"), args), expected, "nst {args} 2>&-");
    }
}

/// Unix has file names of any bytes. In `args`, `%` stands for one that is no UTF-8.
fn nst_with_bytes(bench: &Bench, args: &str) -> Output {
    let bytes = |arg: &str| arg.bytes().map(|b| if b == b'%' { 0xff } else { b }).collect();
    let args = args.split_whitespace().map(bytes);
    let mut command = nst(bench, "");
    args.for_each(|arg: Vec<u8>| {
        command.arg(OsStr::from_bytes(&arg));
    });
    command.output().expect("the binary runs")
}

#[test]
fn file_names_need_not_be_text() {
    let bench = bench();
    let there = |name: &[u8]| bench.path("").join(OsStr::from_bytes(name)).is_file();
    std::fs::copy(bench.path("plain.obj"), bench.path("").join(OsStr::from_bytes(b"m\xff.obj")))
        .expect("a copy");
    let render = "render --scene m%.obj --size 6x5 --transform none";
    let jobs: [(&str, &[&[u8]]); 12] = [
        // The name of the scene is text; the default name is made of it.
        (&format!("{render} --spp 4"), &["m\u{fffd}.exr".as_bytes(), "m\u{fffd}.png".as_bytes()]),
        (
            &format!("{render} --spp 4 -o x%.exr --sequence s%.exr"),
            &[b"x\xff.exr", b"x\xff.png", b"s\xff.exr"],
        ),
        (&format!("{render} --spp 5 --resume s%.exr -o x%.exr"), &[b"x\xff.exr"]),
        (&format!("{render} --spp 4 --seed 7 --sequence t%.exr -o t.exr"), &[b"t\xff.exr"]),
        (&format!("{render} --spp 5 --seed 7 --resume t%.exr -o t.exr"), &[b"t\xff.exr"]),
        (&format!("{render} --spp 4 --runs 1 -o d%.safetensors"), &[b"d\xff.safetensors"]),
        ("transform s%.exr", &[b"s\xff.nst.exr"]),
        ("merge s%.exr t%.exr -o m%.exr", &[b"m\xff.exr"]),
        ("pack x%.exr --as samples --spp 4 -o p%.exr", &[b"p\xff.exr"]),
        ("info s%.exr", &[]),
        ("compare x%.exr r1.exr --error-map e%.png", &[b"e\xff.png"]),
        (
            "bench scene --scene m%.obj --reference x%.exr --spp 1 --runs 1 -o b%.csv",
            &[b"b\xff.csv"],
        ),
    ];
    for (job, files) in jobs {
        for option in ["--json", ""] {
            let output = nst_with_bytes(&bench, &format!("{job} {option}"));
            let stderr = String::from_utf8(output.stderr.clone()).expect("UTF-8");
            // A rendering that has been continued cannot be continued to where it is.
            if job.contains("--resume") && option.is_empty() {
                assert_eq!(code(&output, job), 2, "nst {job}: {stderr}");
                assert!(stderr.contains("5 spp already"), "nst {job}: {stderr}");
                continue;
            }
            assert_eq!(code(&output, job), 0, "nst {job}: {stderr}");
            let stdout = String::from_utf8(output.stdout).expect("UTF-8");
            let json = serde_json::from_str::<serde_json::Value>(&stdout);
            assert_eq!(json.is_ok(), option == "--json", "nst {job}: {stdout}");
            assert!(files.iter().all(|name| there(name)), "nst {job}: {:?}", bench.files());
        }
    }
    let output = nst_with_bytes(&bench, "transform gone%.exr");
    assert_eq!(code(&output, "transform"), 1);
    let stderr = String::from_utf8(output.stderr).expect("UTF-8");
    assert!(stderr.contains("'gone\u{fffd}.exr'"), "{stderr}");
}

//! Renderings that are stopped, killed and continued.
#![cfg(unix)]

mod common;

use std::{
    io::{BufRead, BufReader},
    os::unix::process::ExitStatusExt,
    path::Path,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use common::{Bench, cornell, heed_signals, read_layer};
use nst_core::random::SplitMix64;
use nst_files::sequence_file::SequenceFile;
use safetensors::SafeTensors;

fn sequence(bench: &Bench, name: &str) -> SequenceFile {
    SequenceFile::read(&bench.path(name)).expect("a sequence")
}

/// A sequence but for the time that it took.
fn same(a: &SequenceFile, b: &SequenceFile) -> bool {
    let mut info = a.info.clone();
    info.render_seconds = b.info.render_seconds;
    info == b.info && a.batch == b.batch && a.sums == b.sums
}

fn layers(path: &Path) -> Vec<Vec<u32>> {
    let bits = |layer| {
        let lanes = read_layer(path, layer).1;
        lanes.into_iter().map(f32::to_bits).collect()
    };
    ["", "S", "Variance"].map(bits).into()
}

#[test]
fn a_resumed_rendering_is_the_uninterrupted_one() {
    let bench = Bench::new();
    let scene = format!("render --scene {} --quiet --backend cpu", cornell());
    let cases = [
        ("", "--keep window --seed 7"),
        ("--transform none", "--keep pow2 --sampler halton --pixel center"),
        ("--transform none", "--keep all --integrator direct"),
    ];
    for (method, options) in cases {
        let first = format!("{scene} {method} {options} --size 33x20");
        bench.succeed(&format!("{first} --spp 21 --sequence whole.exr -o whole_x.exr"));
        bench.succeed(&format!("{first} --spp 3 --sequence part.exr -o part_x.exr"));
        // What the file says need not be repeated, but may be.
        bench.succeed(&format!("{scene} {method} --resume part.exr --spp 12 -o part_x.exr"));
        assert!(!same(&sequence(&bench, "part.exr"), &sequence(&bench, "whole.exr")));
        let rest = format!("{first} --resume part.exr --spp 21 --sequence new.exr -o part_x.exr");
        bench.succeed(&rest);
        assert_eq!(
            sequence(&bench, "part.exr").info.samples(),
            12,
            "--sequence names another file"
        );
        assert!(same(&sequence(&bench, "new.exr"), &sequence(&bench, "whole.exr")), "{options}");
        assert_eq!(layers(&bench.path("part_x.exr")), layers(&bench.path("whole_x.exr")));
    }
}

/// Starts `nst` and waits until it has begun to render.
fn start(bench: &Bench, args: &str) -> Child {
    heed_signals();
    let mut child = Command::new(env!("CARGO_BIN_EXE_nst"))
        .args(args.split_whitespace())
        .current_dir(bench.path(""))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary runs");
    let said = BufReader::new(child.stdout.as_mut().expect("a pipe"));
    assert!(said.lines().any(|line| line.expect("text").starts_with("film")));
    child
}

fn signal(child: &Child, name: &str) {
    let status = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status();
    assert!(status.expect("kill runs").success());
}

/// The exit code and the standard error of a process that ends by itself.
fn end(child: Child) -> (Option<i32>, String) {
    let output = child.wait_with_output().expect("it ends");
    (output.status.code(), String::from_utf8(output.stderr).expect("UTF-8"))
}

#[test]
fn signals_leave_files_to_go_on_from() {
    for (name, code) in [("INT", 130), ("TERM", 143), ("HUP", 129)] {
        stop_and_go_on(name, code);
    }
}

fn stop_and_go_on(name: &str, expected: i32) {
    let bench = Bench::new();
    let scene = format!("render --scene {} --backend cpu --size 40x30", cornell());
    let child = start(&bench, &format!("{scene} --spp 1000000 --sequence seq.exr -o x.exr"));
    let begin = Instant::now();
    signal(&child, name);
    let (code, said) = end(child);
    assert_eq!(code, Some(expected), "{said}");
    // A pass takes 0.6 s, and the files are small; other tests run at the same time.
    assert!(begin.elapsed() < Duration::from_secs(10), "{:?}", begin.elapsed());
    let stopped = sequence(&bench, "seq.exr");
    let samples = stopped.info.samples();
    assert!(
        said.contains(&format!("{samples} of 1000000 spp")) && said.contains("--resume 'seq.exr'")
    );
    assert!((1..1_000_000).contains(&samples), "{samples}");
    assert_eq!(layers(&bench.path("x.exr"))[1].len(), 40 * 30 * 3);
    assert_eq!(bench.files(), ["seq.exr", "x.exr", "x.png"]);

    let more = samples + 3;
    bench.succeed(&format!("{scene} --quiet --resume seq.exr --spp {more} -o x.exr"));
    bench.succeed(&format!("{scene} --quiet --spp {more} --sequence whole.exr -o y.exr"));
    assert!(same(&sequence(&bench, "seq.exr"), &sequence(&bench, "whole.exr")));
    assert_eq!(layers(&bench.path("x.exr")), layers(&bench.path("y.exr")));
}

#[test]
fn a_second_ctrl_c_ends_at_once() {
    let bench = Bench::new();
    bench.succeed(&format!("render --scene {} --size 8x8 --spp 1 -o x.exr -q", cornell()));
    let precious = std::fs::read(bench.path("x.exr")).expect("a picture");
    // One pass takes many seconds.
    let scene = format!("render --scene {} --size 6000x6000 --spp 2 -o x.exr", cornell());
    let child = start(&bench, &scene);
    signal(&child, "INT");
    std::thread::sleep(Duration::from_millis(200));
    let begin = Instant::now();
    signal(&child, "INT");
    let (code, said) = end(child);
    assert_eq!(code, Some(130), "{said}");
    assert!(begin.elapsed() < Duration::from_secs(5), "{said}");
    assert_eq!(bench.files(), ["x.exr", "x.png"], "no temporary file is left");
    assert!(std::fs::read(bench.path("x.exr")).expect("the old file") == precious);
}

/// Jobs that have nothing to save end at once, and leave nothing behind.
#[test]
fn other_jobs_end_at_the_first_signal() {
    let bench = Bench::new();
    let scene = format!("render --scene {} --backend cpu --quiet --transform none", cornell());
    bench.succeed(&format!("{scene} --spp 8 --size 600x600 --sequence seq.exr -o x.exr"));
    let args = "transform seq.exr --transform ridge --backend cpu -o y.exr";
    heed_signals();
    let mut child = Command::new(env!("CARGO_BIN_EXE_nst"))
        .args(args.split_whitespace())
        .current_dir(bench.path(""))
        .spawn()
        .expect("the binary runs");
    // Until it has opened its outputs.
    let begin = Instant::now();
    while !bench.files().iter().any(|name| name.ends_with(".tmp")) {
        assert!(begin.elapsed() < Duration::from_secs(60), "no output was opened");
        assert!(child.try_wait().expect("it runs").is_none(), "it has ended before the signal");
        std::thread::sleep(Duration::from_millis(1));
    }
    signal(&child, "TERM");
    assert_eq!(child.wait().expect("it ends").code(), Some(143));
    assert_eq!(bench.files(), ["seq.exr", "x.exr", "x.png"]);
}

/// A shell's `nohup` makes programs outlive their terminal.
#[test]
fn ignored_signals_stay_ignored() {
    let bench = Bench::new();
    let job = format!("render --scene {} --size 64x64 --spp 256 -o x.exr", cornell());
    let script = format!("trap '' HUP; exec {} {job}", env!("CARGO_BIN_EXE_nst"));
    let mut child = Command::new("sh")
        .args(["-c", &script])
        .current_dir(bench.path(""))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("sh runs");
    let said = BufReader::new(child.stdout.as_mut().expect("a pipe"));
    assert!(said.lines().any(|line| line.expect("text").starts_with("film")));
    signal(&child, "HUP");
    let (code, said) = end(child);
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn ctrl_c_drops_the_run_in_progress() {
    let bench = Bench::new();
    let scene = format!("render --scene {} --size 8x8 --spp 9", cornell());
    let child = start(&bench, &format!("{scene} --runs 1000000 -o runs.safetensors"));
    std::thread::sleep(Duration::from_millis(300));
    signal(&child, "INT");
    let (code, said) = end(child);
    assert_eq!(code, Some(130), "{said}");
    let bytes = std::fs::read(bench.path("runs.safetensors")).expect("the dataset");
    let tensors = SafeTensors::deserialize(&bytes).expect("a safetensors file");
    let shape = tensors.tensor("sequences").expect("the tensor").shape().to_vec();
    assert!((1..1_000_000).contains(&shape[0]), "{shape:?}");
    assert!(said.contains(&format!("{} of 1000000 runs", shape[0])), "{said}");
}

/// kill -9 at 50 moments of a job that overwrites a file: what the name stands for
/// is the old file or the new one, whole.
#[test]
fn a_killed_process_leaves_the_old_file_or_the_new_one() {
    let bench = Bench::new();
    // Short paths: most of the time goes into writing.
    let scene = format!("render --scene {} --size 160x100 --spp 8 --quiet", cornell());
    let render = |seed: usize| {
        let args =
            format!("{scene} --seed {seed} --max-depth 2 --keep all --sequence seq.exr -o x.exr");
        let mut command = Command::new(env!("CARGO_BIN_EXE_nst"));
        command.args(args.split_whitespace()).current_dir(bench.path(""));
        command
    };
    let begin = Instant::now();
    let wanted = [0, 1].map(|seed| {
        assert!(render(seed).status().expect("the binary runs").success());
        (sequence(&bench, "seq.exr"), layers(&bench.path("x.exr")))
    });
    let mut whole_job = begin.elapsed() / 2;
    // Which of the two renderings the files are, if they are whole.
    let found = || {
        let stored = SequenceFile::read(&bench.path("seq.exr")).ok()?;
        let picture = layers(&bench.path("x.exr"));
        assert!(wanted.iter().any(|(_, layers)| *layers == picture), "the picture is another");
        wanted.iter().position(|(sequence, _)| same(sequence, &stored))
    };
    assert_eq!(found(), Some(1));

    let mut random = SplitMix64(1);
    let (mut killed, mut ended, mut current) = (0, 0, 1);
    while killed < 50 {
        let mut child = render(1 - current).spawn().expect("the binary runs");
        std::thread::sleep(whole_job.mul_f64(random.uniform()));
        child.kill().expect("it can be killed, or has ended");
        if child.wait().expect("it ends").signal() == Some(9) {
            killed += 1;
        } else {
            // The machine is less busy than it was.
            ended += 1;
            whole_job = whole_job.mul_f64(0.95);
        }
        current = found().unwrap_or_else(|| panic!("no whole file after {killed} kills"));
    }
    println!("50 processes were killed, {ended} ended before");
    assert!(ended < 200, "most processes end before they are killed");
    for name in bench.files() {
        let known = ["seq.exr", "x.exr", "x.png"].contains(&name.as_str());
        assert!(known || (name.starts_with(".nst-") && name.ends_with(".tmp")), "{name}");
    }
    // The check must see a file that is cut off.
    let bytes = std::fs::read(bench.path("seq.exr")).expect("the file");
    bench.write("seq.exr", &bytes[..bytes.len() - 100]);
    assert_eq!(found(), None);
}

#[test]
fn a_full_disk_harms_nothing() {
    let bench = Bench::new();
    let job = format!(
        "{} render --scene {} --size 64x64 --spp 8 --quiet --sequence seq.exr -o x.exr",
        env!("CARGO_BIN_EXE_nst"),
        cornell()
    );
    let shell = |script: &str| {
        let output = Command::new("sh").args(["-c", script]).current_dir(bench.path("")).output();
        output.expect("sh runs")
    };
    assert!(shell(&format!("{job} --seed 5")).status.success());
    let content = || ["seq.exr", "x.exr", "x.png"].map(|name| std::fs::read(bench.path(name)).ok());
    let precious = content();
    // No file may be longer than this many blocks: not even the picture fits, or all but
    // the sequence. Without the trap, the signal would kill the process.
    for limit in [1, 100, 400] {
        let output = shell(&format!("trap '' XFSZ; ulimit -f {limit}; exec {job}"));
        let said = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(1), "{limit}: {said}");
        assert!(said.contains("error: cannot write") && said.contains(".exr'"), "{said}");
        assert_eq!(bench.files(), ["seq.exr", "x.exr", "x.png"], "no temporary file is left");
        assert!(content() == precious, "{limit}: an old file has changed");
    }
    assert!(shell(&format!("trap '' XFSZ; ulimit -f 100000; exec {job}")).status.success());
    assert!(content() != precious);
    assert_eq!(sequence(&bench, "seq.exr").info.seeds, [0]);
}

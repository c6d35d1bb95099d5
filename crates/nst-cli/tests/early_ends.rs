//! Early ends: jobs that a signal, a full disk or a closed pipe meets at a random moment.
//! Afterwards every output is the old file, or none, or a whole new one; no input has changed;
//! and a rendering whose sequence was asked for can be continued, with the bits of one that
//! nobody has stopped.
//!
//! `NST_EARLY_ENDS=1000 cargo test --release -p nst-cli --test early_ends -- --nocapture` does
//! this a thousand times, and prints how many jobs of each kind ended in which way. The full
//! disk is a small tmpfs if this runs as root; otherwise no file may become long.
#![cfg(unix)]

mod common;

use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufReader, Write},
    os::unix::process::ExitStatusExt,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    time::{Duration, Instant, SystemTime},
};

use common::{Bench, cornell, heed_signals};
use nst_core::random::SplitMix64;
use nst_files::{picture::Picture, sequence_file::SequenceFile};

/// What pictures consist of.
const PICTURE_LAYERS: [&str; 3] = ["", "S", "Variance"];

/// Without the environment variable.
const SHORT: usize = 24;

/// Far longer than any job takes; a job that has not ended by then hangs.
const LIMIT: Duration = Duration::from_secs(60);

/// Why a job's result is wrong.
type Judged<T = ()> = Result<T, String>;

/// A folder's files by name.
type Files = BTreeMap<String, Vec<u8>>;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum End {
    Signal(&'static str, i32),
    /// Two signals.
    CtrlCTwice,
    FullDisk,
    ClosedPipe,
}

impl End {
    const ALL: [Self; 7] = [
        Self::Signal("INT", 130),
        Self::Signal("TERM", 143),
        Self::Signal("HUP", 129),
        Self::Signal("KILL", 137),
        Self::CtrlCTwice,
        Self::FullDisk,
        Self::ClosedPipe,
    ];

    /// The exit codes that are right, but for that of success, as a shell reports them.
    fn code(self) -> Option<i32> {
        match self {
            Self::Signal(_, code) => Some(code),
            Self::CtrlCTwice => Some(130),
            Self::FullDisk => Some(1),
            Self::ClosedPipe => None,
        }
    }
}

/// A command; its folder for outputs is `{out}`.
struct Job {
    name: &'static str,
    args: String,
    outputs: &'static [&'static str],
    /// Whether it saves what it has done when it is asked to end.
    saves: bool,
    /// How long it takes.
    time: Duration,
    /// What it writes if nothing ends it.
    expected: Files,
}

impl Job {
    /// What may be there before it begins.
    fn old(&self, stage: &Stage) -> Files {
        let old = |&name: &&str| {
            let input = match name {
                // This one is continued.
                "seq.exr" if self.name == "resume" => "part.exr",
                "seq.exr" => "s2.exr",
                "x.exr" => "p2.exr",
                _ => "p2.png",
            };
            (name.to_owned(), stage.inputs[input].clone())
        };
        self.outputs.iter().map(old).collect()
    }
}

/// How a job has ended.
struct Ended {
    /// As a shell reports it.
    code: i32,
    stderr: String,
}

/// The folders `in`, `out` and `disk`, which has little room.
struct Stage {
    /// The file system `disk`, where it may be mounted; unmounted before its folder is deleted.
    disk: Option<Mounted>,
    bench: Bench,
    inputs: Files,
    /// When each input was written.
    times: BTreeMap<String, SystemTime>,
}

struct Mounted(PathBuf);

impl Drop for Mounted {
    fn drop(&mut self) {
        let unmounted = Command::new("umount").arg(&self.0).status();
        let unmounted = unmounted.is_ok_and(|status| status.success());
        assert!(unmounted || std::thread::panicking(), "'{}' stays", self.0.display());
    }
}

impl Mounted {
    fn new(folder: &Path) -> Option<Self> {
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", "size=16m", "tmpfs"]).arg(folder).stderr(Stdio::null());
        mount.status().is_ok_and(|status| status.success()).then(|| Self(folder.to_owned()))
    }

    /// Leaves room for this many bytes.
    fn leave(&self, room: u64) {
        let mut ballast = File::create(self.0.join("ballast")).expect("a file");
        let page = [0; 4096];
        while ballast.write_all(&page).is_ok() {}
        let length = ballast.metadata().expect("a length").len();
        ballast.set_len(length.saturating_sub(room)).expect("it becomes shorter");
    }
}

fn files(folder: &Path) -> Files {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("a file"));
    let content = |entry: std::fs::DirEntry| {
        let bytes = std::fs::read(entry.path()).expect("a file");
        (entry.file_name().to_string_lossy().into_owned(), bytes)
    };
    entries.map(content).collect()
}

fn times(folder: &Path) -> BTreeMap<String, SystemTime> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("a file"));
    let time = |entry: std::fs::DirEntry| {
        let modified = entry.metadata().and_then(|data| data.modified()).expect("a time");
        (entry.file_name().to_string_lossy().into_owned(), modified)
    };
    entries.map(time).collect()
}

/// Whether a file is whole: every row of an EXR file and of a PNG can be read.
fn is_whole(name: &str, path: &Path) -> bool {
    match name {
        "seq.exr" => SequenceFile::read(path).is_ok(),
        "x.exr" => PICTURE_LAYERS.into_iter().all(|layer| {
            let layer = (!layer.is_empty()).then_some(layer);
            Picture::open(path, layer).and_then(|picture| picture.read()).is_ok()
        }),
        _ => {
            let decoder = png::Decoder::new(BufReader::new(File::open(path).expect("it is there")));
            decoder.read_info().is_ok_and(|mut reader| {
                let mut pixels = vec![0; reader.output_buffer_size().unwrap_or_default()];
                reader.next_frame(&mut pixels).is_ok() && reader.finish().is_ok()
            })
        }
    }
}

/// Sequences without how long their rendering took.
fn same_sequence(a: &Path, b: &[u8]) -> bool {
    let folder = tempfile::tempdir().expect("a folder");
    let other = folder.path().join("seq.exr");
    std::fs::write(&other, b).expect("a file");
    let [Ok(mut a), Ok(b)] = [a, &other].map(SequenceFile::read) else { return false };
    a.info.render_seconds = b.info.render_seconds;
    a.info == b.info && a.batch == b.batch && a.sums == b.sums
}

/// Whether a picture is another one but for the time that it took.
fn same_picture(a: &Path, b: &[u8]) -> bool {
    let folder = tempfile::tempdir().expect("a folder");
    let other = folder.path().join("x.exr");
    std::fs::write(&other, b).expect("a file");
    let read = |path: &Path| -> Option<Vec<(u32, Vec<f32>)>> {
        let layers = PICTURE_LAYERS.into_iter().map(|layer| {
            let picture = Picture::open(path, Some(layer)).ok()?;
            Some((picture.samples_per_pixel?, picture.read().ok()?))
        });
        layers.collect()
    };
    read(a).is_some_and(|a| read(&other) == Some(a))
}

/// Whether an output is the one that is expected.
fn is_finished(name: &str, path: &Path, expected: &[u8]) -> bool {
    match name {
        "seq.exr" => same_sequence(path, expected),
        "x.exr" => same_picture(path, expected),
        _ => std::fs::read(path).is_ok_and(|found| found == expected),
    }
}

fn is_temporary(name: &str) -> bool {
    name.starts_with(".nst-") && name.ends_with(".tmp")
}

impl Stage {
    /// Makes the inputs.
    fn new() -> Self {
        let bench = Bench::new();
        for folder in ["in", "out", "disk"] {
            std::fs::create_dir(bench.path(folder)).expect("a new folder");
        }
        let scene = format!("render --scene {} --quiet --backend cpu --max-depth 3", cornell());
        for seed in [1, 2] {
            let files = format!("--sequence in/s{seed}.exr -o in/p{seed}.exr");
            bench.succeed(&format!("{scene} --size 160x120 --spp 8 --seed {seed} {files}"));
        }
        let part = "--size 96x64 --spp 5 --keep pow2 --sequence in/part.exr -o in/q.exr";
        bench.succeed(&format!("{scene} {part}"));
        let folder = bench.path("in");
        let (inputs, times) = (files(&folder), times(&folder));
        let disk = Mounted::new(&bench.path("disk"));
        let how = if disk.is_some() { "a small tmpfs" } else { "a limit for the size of files" };
        println!("the full disk is {how}");
        Self { disk, bench, inputs, times }
    }

    fn jobs(&self) -> Vec<Job> {
        let scene = format!("render --scene {} --backend cpu --max-depth 3", cornell());
        let render = "--size 96x64 --spp 300 --keep pow2 --sequence {out}/seq.exr -o {out}/x.exr";
        let resume = "--resume {out}/seq.exr --spp 300 -o {out}/x.exr";
        let all = &["seq.exr", "x.exr", "x.png"][..];
        let jobs = [
            ("render", format!("{scene} {render}"), all),
            ("resume", format!("{scene} {resume}"), all),
            (
                "transform",
                "transform in/s1.exr --transform ridge --backend cpu -o {out}/x.exr".to_owned(),
                &all[1..],
            ),
            ("merge", "merge in/s1.exr in/s2.exr -o {out}/seq.exr".to_owned(), &all[..1]),
            (
                "pack",
                "pack in/p1.exr in/p2.exr --as samples --spp 8 -o {out}/seq.exr".to_owned(),
                &all[..1],
            ),
        ];
        jobs.map(|(name, args, outputs)| self.try_out(name, args, outputs)).into()
    }

    /// Runs a job to its end, to see what it writes and how long it takes.
    fn try_out(&self, name: &'static str, args: String, outputs: &'static [&'static str]) -> Job {
        let saves = ["render", "resume"].contains(&name);
        let (time, expected) = (Duration::ZERO, Files::new());
        let mut job = Job { name, args, outputs, saves, time, expected };
        let out = self.bench.path("out");
        self.prepare(&out, &job.old(self));
        let begin = Instant::now();
        self.bench.succeed(&job.args.replace("{out}", "out"));
        job.time = begin.elapsed();
        job.expected = files(&out);
        assert!(job.expected.keys().eq(outputs), "{name}: {:?}", job.expected.keys());
        job
    }

    /// Makes these the only files of a folder.
    fn prepare(&self, folder: &Path, content: &Files) {
        for name in files(folder).keys() {
            std::fs::remove_file(folder.join(name)).expect("it can be deleted");
        }
        for (name, bytes) in content {
            std::fs::write(folder.join(name), bytes).expect("there is room");
        }
    }

    /// Starts a job; the largest size of a file is in blocks of the shell.
    fn start(&self, job: &Job, out: &str, most: Option<u64>) -> Child {
        let args = job.args.replace("{out}", out);
        let limit = most.map_or_else(String::new, |most| format!("ulimit -f {most};"));
        // Without the trap, the signal would kill the process.
        let script = format!("trap '' XFSZ; {limit} exec {} {args}", env!("CARGO_BIN_EXE_nst"));
        heed_signals();
        let mut shell = Command::new("sh");
        shell.args(["-c", &script]).current_dir(self.bench.path(""));
        shell.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("sh runs")
    }

    /// Runs a job that meets this end at a random moment.
    fn run(&self, job: &Job, end: End, out: &str, random: &mut SplitMix64) -> Judged<Ended> {
        let needed: usize = job.expected.values().map(Vec::len).sum();
        let room = (1.1 * needed as f64 * random.uniform()) as u64;
        let mut most = None;
        if end == End::FullDisk {
            match &self.disk {
                Some(disk) => disk.leave(room),
                // Of the units that shells count in, 512 and 1024 bytes, the smaller.
                None => most = Some(room / 512),
            }
        }
        let mut child = self.start(job, out, most);
        let signal = |child: &Child, name: &str| {
            let mut kill = Command::new("kill");
            kill.args([&format!("-{name}"), &child.id().to_string()]).stderr(Stdio::null());
            kill.status().expect("kill runs");
        };
        let mut pause = || std::thread::sleep(job.time.mul_f64(random.uniform()));
        match end {
            End::Signal(name, _) => {
                pause();
                signal(&child, name);
            }
            End::CtrlCTwice => {
                pause();
                signal(&child, "INT");
                pause();
                signal(&child, "INT");
            }
            End::ClosedPipe => {
                pause();
                drop(child.stdout.take());
                drop(child.stderr.take());
            }
            End::FullDisk => {}
        }
        let begin = Instant::now();
        while child.try_wait().expect("it is there").is_none() {
            if begin.elapsed() > LIMIT {
                child.kill().expect("it is there");
                return Err("it does not end".into());
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        let output = child.wait_with_output().expect("it has ended");
        let code = output.status.code().or(output.status.signal().map(|number| 128 + number));
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        Ok(Ended { code: code.expect("one of the two"), stderr })
    }

    /// Fails if an input is not what it was.
    fn judge_inputs(&self) -> Judged {
        let folder = self.bench.path("in");
        if files(&folder) != self.inputs || times(&folder) != self.times {
            return Err("an input has changed".into());
        }
        Ok(())
    }

    /// Judges what a job has left; returns whether outputs are new, and whole or not finished.
    fn judge(&self, job: &Job, end: End, out: &str, old: &Files, ended: &Ended) -> Judged<Left> {
        let Ended { code, stderr } = ended;
        let early = *code != 0;
        if early && Some(*code) != end.code() || stderr.contains("panicked") {
            return Err(format!("exit code {code}"));
        }
        if end == End::FullDisk && early && !stderr.contains("error: cannot write") {
            return Err("it does not say that it cannot write".into());
        }
        let folder = self.bench.path(out);
        let mut left = Left::default();
        for name in files(&folder).keys() {
            let killed = end == End::Signal("KILL", 137);
            let known = job.outputs.contains(&name.as_str()) || name == "ballast";
            if !(known || killed && is_temporary(name)) {
                return Err(format!("'{name}' is left"));
            }
        }
        for &name in job.outputs {
            let path = folder.join(name);
            let found = std::fs::read(&path).ok();
            if found.as_ref() == old.get(name) {
                left.old += 1;
                continue;
            }
            if found.is_none() || !is_whole(name, &path) {
                return Err(format!("'{name}' is gone or damaged"));
            }
            // The order of a file's attributes is random.
            let finished = is_finished(name, &path, &job.expected[name]);
            left.new += 1;
            left.unfinished += usize::from(!finished);
        }
        let asked = matches!(end, End::Signal(_, 129 | 130 | 143) | End::CtrlCTwice);
        if left.unfinished > 0 && !(job.saves && asked && early) {
            return Err("an output is whole, but another one".into());
        }
        if !early && left.old > 0 {
            return Err("it has ended well, and an output is not there".into());
        }
        // One signal lets a rendering finish all of its files, or comes before it begins.
        if left.old > 0 && left.new > 0 && matches!(end, End::Signal(_, 129 | 130 | 143)) {
            return Err("some outputs are new, and some are not".into());
        }
        self.judge_inputs().map(|()| left)
    }

    /// Continues a rendering, and compares the result with one that nobody has stopped.
    fn judge_resumed(&self, job: &Job, out: &str) -> Judged {
        let scene = format!("render --scene {} --backend cpu --max-depth 3 --quiet", cornell());
        let args = format!("{scene} --resume {out}/seq.exr --spp 300 -o {out}/x.exr");
        let output = self.bench.nst(&args);
        if !output.status.success() {
            return Err(format!("not resumed: {}", String::from_utf8_lossy(&output.stderr)));
        }
        let folder = self.bench.path(out);
        let whole = |name: &&str| is_finished(name, &folder.join(name), &job.expected[*name]);
        match ["seq.exr", "x.exr", "x.png"].iter().all(whole) {
            true => Ok(()),
            false => Err("the continued rendering has other bits".into()),
        }
    }

    /// The next job in a folder deletes the temporary files of a dead process; those that are
    /// very young may be about to be locked, and are made older here.
    fn judge_next(&self, out: &str) -> Judged {
        let folder = self.bench.path(out);
        for name in files(&folder).into_keys().filter(|name| is_temporary(name)) {
            let file = File::options().append(true).open(folder.join(name)).expect("a file");
            let past = SystemTime::now() - Duration::from_secs(60);
            file.set_modified(past).expect("it can be set");
        }
        self.bench.succeed(&format!("merge in/s1.exr in/s2.exr -o {out}/next.exr"));
        match files(&folder).into_keys().find(|name| is_temporary(name)) {
            Some(name) => Err(format!("'{name}' outlives the next job")),
            None => Ok(()),
        }
    }
}

/// How many outputs a job has left as they were, and how many are new; of these, some may
/// contain less than was asked for.
#[derive(Debug, Default, PartialEq, Eq)]
struct Left {
    old: usize,
    new: usize,
    unfinished: usize,
}

/// One early end; returns how it ended.
fn meet(stage: &Stage, job: &mut Job, end: End, random: &mut SplitMix64) -> Judged<&'static str> {
    let full = end == End::FullDisk && stage.disk.is_some();
    let out = if full { "disk" } else { "out" };
    let overwrites = random.uniform() < 0.5 || job.name == "resume";
    let old = if overwrites { job.old(stage) } else { Files::new() };
    stage.prepare(&stage.bench.path(out), &old);
    let ended = stage.run(job, end, out, random)?;
    let left = stage.judge(job, end, out, &old, &ended);
    let left = left.map_err(|why| format!("{why}; it said: {}", ended.stderr))?;
    if left.unfinished > 0 && stage.bench.path(out).join("seq.exr").exists() && left.old == 0 {
        stage.judge_resumed(job, out)?;
    }
    if end == End::Signal("KILL", 137) {
        stage.judge_next(out)?;
    }
    if ended.code == 0 && matches!(end, End::Signal(..)) {
        // The machine is less busy than it was.
        job.time = job.time.mul_f64(0.9);
    }
    Ok(match (ended.code, left.new, left.old) {
        (0, ..) => "finished",
        (_, 0, _) => "nothing new",
        (_, _, 0) => "all saved",
        _ => "some saved",
    })
}

#[test]
fn early_ends_leave_whole_files_or_none() {
    let count = match std::env::var("NST_EARLY_ENDS") {
        Ok(count) => count.parse().expect("NST_EARLY_ENDS is a number"),
        Err(_) => SHORT,
    };
    let begin = Instant::now();
    let stage = Stage::new();
    let mut jobs = stage.jobs();
    let mut random = SplitMix64(1);
    let mut counts = BTreeMap::<_, usize>::new();
    for i in 0..count {
        let job = random.below(jobs.len());
        let end = End::ALL[random.below(End::ALL.len())];
        let how = meet(&stage, &mut jobs[job], end, &mut random);
        let name = jobs[job].name;
        let how = how.unwrap_or_else(|why| panic!("number {i}, {name}, {end:?}: {why}"));
        *counts.entry((end, name, how)).or_default() += 1;
    }
    for ((end, name, how), count) in &counts {
        println!("{end:?}, {name}: {count} {how}");
    }
    let early: usize =
        counts.iter().filter(|((.., how), _)| *how != "finished").map(|(_, count)| count).sum();
    println!("{early} of {count} ended early; {:.0?}", begin.elapsed());
    // Of seven kinds, a closed pipe ends nothing; moments are random, and jobs are at times
    // faster than when they were tried out.
    assert!(early * 6 > count, "only {early} of {count} jobs ended early");
}

/// What the test above must see.
#[test]
fn wrong_results_are_recognised() {
    let stage = Stage::new();
    let jobs = stage.jobs();
    let (render, transform) = (&jobs[0], &jobs[2]);
    let out = stage.bench.path("out");
    let interrupt = End::Signal("INT", 130);
    let judge = |job: &Job, end: End, code: i32| {
        let ended = Ended { code, stderr: "error: cannot write".into() };
        stage.judge(job, end, "out", &Files::new(), &ended)
    };
    let cut = |name: &str, end: usize| {
        let mut content = render.expected.clone();
        let bytes = content.get_mut(name).expect("an output");
        bytes.truncate(bytes.len() - end);
        content
    };
    stage.prepare(&out, &render.expected);
    assert_eq!(judge(render, interrupt, 0), Ok(Left { old: 0, new: 3, unfinished: 0 }));
    assert!(judge(render, interrupt, 1).is_err(), "another exit code");
    for (name, end) in [("seq.exr", 1), ("x.exr", 1), ("x.png", 20)] {
        stage.prepare(&out, &cut(name, end));
        let error = judge(render, interrupt, 0).expect_err("it is cut off");
        assert!(error.contains("damaged"), "{error}");
    }
    let mut content = render.expected.clone();
    content.insert(".nst-x.tmp".into(), Vec::new());
    stage.prepare(&out, &content);
    assert!(judge(render, interrupt, 0).is_err_and(|error| error.contains("is left")));
    assert!(judge(render, End::Signal("KILL", 137), 137).is_ok());

    // A sequence of fewer samples is allowed after a signal alone, and can be continued.
    content = render.expected.clone();
    content.insert("seq.exr".into(), stage.inputs["part.exr"].clone());
    stage.prepare(&out, &content);
    assert_eq!(judge(render, interrupt, 130), Ok(Left { old: 0, new: 3, unfinished: 1 }));
    assert!(judge(render, End::FullDisk, 1).is_err() && judge(render, interrupt, 0).is_err());
    assert_eq!(stage.judge_resumed(render, "out"), Ok(()));
    content.insert("seq.exr".into(), stage.inputs["s1.exr"].clone());
    stage.prepare(&out, &content);
    assert!(stage.judge_resumed(render, "out").is_err(), "of another size and seed");
    content.remove("x.png");
    stage.prepare(&out, &content);
    assert!(judge(render, interrupt, 130).is_err(), "one output is missing");

    stage.prepare(&out, &transform.expected);
    assert!(judge(transform, interrupt, 130).is_ok());
    assert!(judge(transform, End::ClosedPipe, 130).is_err(), "a closed pipe ends nothing");
    let input = stage.bench.path("in").join("s1.exr");
    let mut bytes = stage.inputs["s1.exr"].clone();
    *bytes.last_mut().expect("it is not empty") ^= 1;
    std::fs::write(&input, bytes).expect("it can be written");
    assert!(judge(transform, interrupt, 130).is_err_and(|error| error.contains("input")));
}

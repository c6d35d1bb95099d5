//! Bad input gets one clear error, and harms nothing that is there.

mod common;

use std::time::{Duration, Instant};

use common::{Bench, cornell};
use nst_files::{
    ColorModel,
    output::OutputFile,
    picture_writer::{PictureInfo, write_exr},
    sequence_file::SequenceFile,
};

/// A file that no failing command may change.
struct Precious {
    name: &'static str,
    content: Vec<u8>,
}

impl Precious {
    fn of(bench: &Bench, name: &'static str) -> Self {
        Self { name, content: std::fs::read(bench.path(name)).expect("a file") }
    }

    fn assert_is_there(&self, bench: &Bench) {
        let content = std::fs::read(bench.path(self.name)).expect("it is still there");
        assert!(content == self.content, "{} has changed", self.name);
    }
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

/// Runs `nst`, which must fail with `code` and one error that contains all of
/// `words`; no file may appear or vanish.
fn fails(bench: &Bench, args: &str, code: i32, words: &[&str]) {
    fails_with(bench, args, &[], code, words);
}

fn fails_with(bench: &Bench, args: &str, variables: &[(&str, &str)], code: i32, words: &[&str]) {
    let before = bench.files();
    let output = bench.nst_with(args, variables);
    let stderr = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!(output.status.code(), Some(code), "nst {args}\n{stderr}");
    assert!(!stderr.contains("panicked"), "nst {args}\n{stderr}");
    let errors = stderr.lines().filter(|line| line.starts_with("error:")).count();
    assert_eq!(errors, 1, "nst {args}\n{stderr}");
    for word in words {
        assert!(stderr.contains(word), "nst {args}\n'{word}' is not in: {stderr}");
    }
    assert_eq!(bench.files(), before, "nst {args}");
}

#[test]
fn scenes() {
    let bench = Bench::new();
    let cases: [(&str, &str, &[&str]); 12] = [
        ("range.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", &["range.obj", "line 4", "vertex 9"]),
        ("back.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -4\n", &["back.obj", "line 4", "-4"]),
        ("nan.obj", "v 0 0 0\nv 1 nan 0\n", &["nan.obj", "line 2", "vertex", "not finite"]),
        ("inf.obj", "v 0 0 0\nv 1 inf 0\n", &["inf.obj", "line 2", "not finite"]),
        ("large.obj", "v 0 0 0\nv 1 1e99 0\n", &["large.obj", "line 2", "3.4e38"]),
        ("short.obj", "v 0 0\n", &["short.obj", "line 1", "2 numbers"]),
        ("empty.obj", "", &["empty.obj", "no faces"]),
        ("points.obj", "v 0 0 0\nv 1 0 0\n", &["points.obj", "no faces"]),
        ("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", &["flat.obj", "zero area"]),
        ("word.obj", "v 0 zero 0\nf 1 1 1\n", &["word.obj", "line 1", "'zero'"]),
        ("binary.obj", "\u{7f}ELF\0\0", &["binary.obj", "no text"]),
        ("toml.obj", TRIANGLE, &["toml.toml", "vertical_fo", "line 4", "'vertical_fov'"]),
    ];
    bench.write(
        "toml.toml",
        "[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\nvertical_fo = 40.0\n",
    );
    for (name, content, _) in &cases {
        bench.write(name, content);
    }
    for (name, _, words) in cases {
        fails(&bench, &format!("render --scene {name} --spp 8"), 1, words);
    }
    fails(&bench, "render --scene gone.obj", 1, &["gone.obj", "read"]);
    fails(&bench, "render --scene .", 1, &["'.'"]);
}

/// Faults whose meaning is plain are noted, or refused with --strict.
#[test]
fn scenes_with_faults() {
    let bench = Bench::new();
    let cases: [(&str, &[&str]); 6] = [
        ("Kd red", &["line 2", "'m'", "'red'"]),
        ("Kd 2 0 0", &["line 2", "'m'", "Kd"]),
        ("Ke -1 0 0", &["line 2", "'m'", "Ke"]),
        ("Kd 0.5 0.5", &["line 2", "'m'", "Kd"]),
        ("map_Kd gone.png", &["line 2", "gone.png"]),
        ("map_Kd text.png", &["text.png"]),
    ];
    bench.write("text.png", "no image");
    bench.write("x.obj", format!("mtllib x.mtl\nusemtl m\n{TRIANGLE}"));
    let render = "render --scene x.obj --spp 1 --size 4x4";
    for (statement, words) in cases {
        bench.write("x.mtl", format!("newmtl m\n{statement}\n"));
        fails(&bench, &format!("{render} --strict"), 1, words);
        let said = bench.succeed(&format!("{render} -o {}.exr", statement.len()));
        let note = said.lines().find(|line| words.iter().all(|word| line.contains(word)));
        assert!(note.is_some_and(|line| line.contains("note")), "{statement}:\n{said}");
    }
    fails(&bench, &format!("{render} --strict"), 1, &["text.png"]);
}

#[test]
fn sidecars() {
    let bench = Bench::new();
    bench.write("x.obj", TRIANGLE);
    let camera = |rest: &str| format!("[camera]\nposition = [0, 0, 5]\n{rest}");
    let cases = [
        ("[film]\nsize = [0, 4]\n".to_owned(), "[film] size"),
        ("[integrator]\nkind = \"path\"\nmax_depth = 0\n".to_owned(), "max_depth"),
        ("[integrator]\nkind = \"bidirectional\"\nmax_depth = 4\n".to_owned(), "bidirectional"),
        ("[environment]\nradiance = [-1, 0, 0]\n".to_owned(), "[environment]"),
        ("[environment]\nimage = \"gone.exr\"\n".to_owned(), "gone.exr"),
        ("[environmint]\nradiance = [1, 0, 0]\n".to_owned(), "did you mean 'environment'?"),
        ("[materials.glass]\nior = 1.5\n".to_owned(), "no material 'glass'"),
        ("[materials.default]\nroughness = 2\n".to_owned(), "line 2"),
        (camera("target = [0, 0, 5]\nvertical_fov = 40\n"), "differ"),
        (camera("target = [0, 0, 0]\nvertical_fov = 180\n"), "vertical_fov"),
        (camera("target = [0, 0, 0]\nup = [0, 0, 1]\nvertical_fov = 40\n"), "up"),
        ("size = ".to_owned(), "line 1"),
    ];
    for (content, word) in cases {
        bench.write("x.toml", &content);
        fails(&bench, "render --scene x.obj --spp 8", 1, &["x.toml", word]);
    }
}

#[test]
fn command_lines() {
    let bench = Bench::new();
    bench.write("x.obj", TRIANGLE);
    let cases: [(&str, &[&str]); 18] = [
        ("--spp 0", &["--spp", "0"]),
        ("--spp many", &["--spp"]),
        ("--size 10", &["--size", "512x512"]),
        ("--size 0x10", &["--size"]),
        ("--transform magic", &["magic", "cornell"]),
        ("--backend quantum", &["--backend"]),
        ("--threads 0", &["--threads"]),
        ("--max-depth 0", &["--max-depth"]),
        ("-o picture.jpg", &[".exr or .png"]),
        ("--runs 2 -o picture.exr", &[".safetensors"]),
        ("--runs 0", &["--runs"]),
        ("--runs 2 --sequence seq.exr", &["--runs", "--sequence"]),
        ("--runs 2 --experts lane", &["--runs", "--experts"]),
        ("--runs 2 --guard closed", &["--runs", "--guard"]),
        ("--integrator direct --max-depth 8", &["--integrator", "--max-depth"]),
        ("--runs 2 --weights w.safetensors", &["--runs", "--weights"]),
        ("--keep all", &["--sequence"]),
        ("--transform none --weights w.safetensors", &["--weights"]),
    ];
    for (args, words) in cases {
        fails(&bench, &format!("render --scene x.obj {args}"), 2, words);
    }
    fails(&bench, "render", 2, &["--scene"]);
    // Only the network sets a lower bound on spp.
    fails(&bench, "render --scene x.obj --spp 7 --transform cornell", 2, &["--spp 8", "none"]);
    fails(&bench, "render --scene x.obj --size 60000x60000", 1, &["too many"]);
}

/// They are refused before anything is allocated, and before the first sample.
#[cfg(target_os = "linux")]
#[test]
fn renderings_that_no_memory_can_contain() {
    let bench = Bench::new();
    bench.write("x.obj", TRIANGLE);
    bench.succeed("render --scene x.obj --spp 4 --size 8x8 --keep all --sequence s.exr -q");
    let all = "--keep all --sequence seq.exr";
    let begin = Instant::now();
    for (args, words) in [
        (format!("--spp 4000000000 --size 16000x16000 {all}"), ["GiB of memory", "would fit"]),
        ("--spp 4000000000 --size 16000x16000 --runs 2".to_owned(), ["GiB of memory", "would fit"]),
        (
            format!("--spp 4294967295 --size 8x8 {all}"),
            ["GiB of memory", "stored terms of each pixel would fit"],
        ),
        (
            "--spp 4294967295 --resume s.exr".to_owned(),
            ["GiB of memory", "stored terms of each pixel would fit"],
        ),
        (
            "--spp 4294967295 --size 8x8 --runs 4000000000".to_owned(),
            ["GiB of memory", "stored terms of each pixel would fit"],
        ),
        ("--spp 8 --size 4294967295x4294967295".to_owned(), ["4294967295x4294967295", "too many"]),
    ] {
        fails(&bench, &format!("render --scene x.obj {args}"), 1, &words);
    }
    // One rendering alone would take hours; to refuse them all takes milliseconds.
    assert!(begin.elapsed() < Duration::from_secs(5));
}

#[test]
fn seeds_that_are_too_large_for_the_runs() {
    let bench = Bench::new();
    bench.write("x.obj", TRIANGLE);
    bench.succeed("render --scene x.obj --spp 1 --size 4x4 -o ref.exr -q");
    let (last, runs) = (u64::MAX, ["--runs 2", "--runs 4294967295"]);
    let scene = "bench scene --scene x.obj --reference ref.exr --spp 1";
    for (args, seed, runs) in [
        ("render --scene x.obj --spp 1 --size 4x4", last, runs[0]),
        ("render --scene x.obj --spp 1 --size 4x4", last - 1, runs[1]),
        (scene, last, runs[0]),
        (scene, last - 1, runs[1]),
    ] {
        let args = format!("{args} --seed {seed} {runs}");
        let args = if args.starts_with("bench") { args + " -o t.csv" } else { args };
        let words = [&*format!("--seed {seed}"), "too large", runs.trim_start_matches("--runs ")];
        fails(&bench, &args, 2, &words);
    }
    // A seed alone may be the last.
    bench.succeed(&format!("render --scene x.obj --spp 1 --size 4x4 -q --seed {last}"));
    bench.succeed(&format!("{scene} --runs 1 -q -o one.csv --seed {last}"));
    bench.succeed(&format!("{scene} --runs 2 -q -o two.csv --seed {}", last - 1));
}

#[test]
fn outputs_that_cannot_be_written() {
    let bench = Bench::new();
    bench.write("x.obj", TRIANGLE);
    bench.succeed("render --scene x.obj --spp 1 --size 8x8 --transform none -q");
    let precious = Precious::of(&bench, "x.exr");
    std::fs::create_dir(bench.path("folder.exr")).expect("a folder");
    let render = "render --scene x.obj --spp 8 --size 8x8";
    fails(&bench, &format!("{render} -o gone/x.exr"), 1, &["gone/x.exr", "write"]);
    fails(&bench, &format!("{render} -o folder.exr"), 1, &["folder.exr"]);
    // A folder in which nobody can create files, not even root.
    #[cfg(target_os = "linux")]
    fails(&bench, &format!("{render} -o /proc/x.exr"), 1, &["/proc/x.exr", "write"]);
    fails(&bench, &format!("{render} --sequence new.exr -o new.exr"), 2, &["new.exr", "an output"]);
    // The sequence cannot be written, so the picture must not be replaced either.
    fails(&bench, &format!("{render} --sequence gone/s.exr"), 1, &["gone/s.exr"]);
    fails(&bench, &format!("{render} --weights gone.safetensors"), 1, &["gone.safetensors"]);
    precious.assert_is_there(&bench);
}

#[test]
fn sequences() {
    let bench = Bench::new();
    let scene = cornell();
    bench.succeed(&format!(
        "render --scene {scene} --spp 8 --size 8x8 --sequence seq.exr -o plain.exr --quiet"
    ));
    fails(&bench, "transform gone.exr", 1, &["gone.exr", "read"]);
    fails(&bench, "transform plain.exr", 1, &["plain.exr", "no sequence", "--sequence"]);
    bench.write("text.exr", "this is no image");
    fails(&bench, "transform text.exr", 1, &["text.exr", "EXR"]);
    let whole = std::fs::read(bench.path("seq.exr")).expect("the sequence");
    bench.write("cut.exr", &whole[..whole.len() / 2]);
    fails(&bench, "transform cut.exr", 1, &["cut.exr"]);
    bench.succeed(&format!(
        "render --scene {scene} --spp 4 --size 8x8 --sequence short.exr -o short_plain.exr --quiet"
    ));
    fails(&bench, "transform short.exr --transform cornell", 2, &["short.exr", "last 8", "4"]);
    fails(&bench, "transform seq.exr -o gone/x.exr", 1, &["gone/x.exr"]);
}

#[test]
fn resumed_renderings() {
    let bench = Bench::new();
    bench.write("x.obj", TRIANGLE);
    bench.write("other.obj", TRIANGLE.replace("0 1 0", "0 2 0"));
    let first = "render --scene x.obj --spp 8 --quiet --size 8x8 -o x.exr --sequence seq.exr";
    bench.succeed(first);
    let resume = |options: &str| {
        let scene = if options.contains("--scene") { "" } else { "--scene x.obj" };
        format!("render {scene} --resume seq.exr -o x.exr {options}")
    };
    let cases: [(&str, &[&str]); 11] = [
        ("--spp 8", &["8 spp already", "--spp 8"]),
        ("--spp 7", &["8 spp already", "--spp 7"]),
        ("--spp 9 --seed 1", &["--seed says 1", "the file says 0"]),
        ("--spp 9 --sampler halton", &["--sampler says halton", "says random"]),
        ("--spp 9 --size 9x8", &["--size says 9x8", "says 8x8"]),
        ("--spp 9 --keep all", &["--keep says all", "says window"]),
        ("--spp 9 --pixel center", &["--pixel says center", "says box"]),
        ("--spp 9 --max-depth 3", &["--max-depth says 3", "says 8"]),
        ("--spp 9 --integrator direct", &["--integrator says 2", "says 8"]),
        ("--spp 9 --scene other.obj", &["its scene is 'x:", "other.obj", "'other:"]),
        ("--spp 9 --runs 2", &["--runs", "cannot be used with"]),
    ];
    for (options, words) in cases {
        fails(&bench, &resume(options), 2, &[words, &["--resume"]].concat());
    }
    bench.write("x.toml", "[integrator]\nrussian_roulette = false\n");
    fails(&bench, &resume("--spp 9"), 2, &["seq.exr", "russian_roulette"]);
    bench.write("x.toml", "");

    let seq = bench.path("seq.exr");
    let mut file = SequenceFile::read(&seq).expect("the sequence");
    // As packed and merged sequences are.
    (file.info.resume, file.sums) = (None, None);
    let mut output = OutputFile::create(&bench.path("packed.exr")).expect("a file");
    file.write(&mut output).expect("it can be written");
    output.commit().expect("it can be renamed");
    let instead = |name: &str| resume("--spp 9").replace("seq.exr", name);
    fails(&bench, &instead("packed.exr"), 2, &["packed.exr", "sums", "cannot be continued"]);
    fails(&bench, &instead("gone.exr"), 1, &["gone.exr", "read"]);
    fails(&bench, &instead("x.exr"), 1, &["x.exr", "no sequence"]);
    // A sum that contradicts the fold's mean.
    let mut file = SequenceFile::read(&seq).expect("the sequence");
    file.sums.as_mut().expect("its sums").lanes[7].folds[2] *= 1.5;
    let mut output = OutputFile::create(&bench.path("wrong.exr")).expect("a file");
    file.write(&mut output).expect("it can be written");
    output.commit().expect("it can be renamed");
    let words = ["wrong.exr", "column 7, row 0", "contradict", "damaged"];
    fails(&bench, &instead("wrong.exr"), 1, &words);
    let whole = std::fs::read(&seq).expect("the sequence");
    bench.write("cut.exr", &whole[..whole.len() - 200]);
    fails(&bench, &instead("cut.exr"), 1, &["cut.exr", "cut off or damaged"]);
    bench.succeed(&resume("--spp 9 --quiet"));
}

#[test]
fn weights() {
    let bench = Bench::new();
    bench.write("x.obj", TRIANGLE);
    let bytes = nst_core::Network::builtins().next().expect("there are networks").file();
    bench.write("cut.safetensors", &bytes[..bytes.len() - 4]);
    bench.write("text.safetensors", "no weights at all");
    // A header that promises more than there is.
    bench.write("huge.safetensors", [&u64::MAX.to_le_bytes()[..], b"{}"].concat());
    let key = b"\"window\":\"";
    let position =
        bytes.windows(key.len()).position(|part| part == key).expect("the key") + key.len();
    let mut window = bytes.to_vec();
    window[position] = b'9';
    bench.write("window.safetensors", window);
    let render = "render --scene x.obj --spp 9 --size 4x4 --weights";
    fails(&bench, &format!("{render} cut.safetensors"), 1, &["cut.safetensors"]);
    fails(&bench, &format!("{render} text.safetensors"), 1, &["text.safetensors"]);
    fails(&bench, &format!("{render} huge.safetensors"), 1, &["huge.safetensors"]);
    fails(
        &bench,
        &format!("{render} window.safetensors"),
        1,
        &["window.safetensors", "layer 0", "9"],
    );
}

#[test]
fn no_adapter() {
    let bench = Bench::new();
    let args = format!(
        "render --scene {} --spp 8 --size 8x8 --backend gpu --transform families",
        cornell()
    );
    let none = [("VK_DRIVER_FILES", "/nonexistent"), ("VK_ICD_FILENAMES", "/nonexistent")];
    fails_with(&bench, &args, &none, 1, &["--backend gpu", "adapter", "--backend cpu"]);
}

#[test]
fn references() {
    let bench = Bench::new();
    let scene = cornell();
    let args = format!("bench scene --scene {scene} --spp 8 --runs 1 -o out.csv --reference");
    fails(&bench, &format!("{args} gone.exr"), 1, &["gone.exr"]);
    // A table of something else is left alone.
    bench.succeed(&format!("render --scene {scene} --spp 8 --size 4x4 -o ref.exr --quiet"));
    bench.write("out.csv", "scene,mse\n");
    let precious = Precious::of(&bench, "out.csv");
    fails(&bench, &format!("{args} ref.exr"), 1, &["out.csv", "missing", "another file"]);
    precious.assert_is_there(&bench);
}

/// Sequences `s1.exr` … and pictures `r1.exr` … with as many seeds, of the Cornell box.
fn render(bench: &Bench, seeds: std::ops::RangeInclusive<u32>, options: &str) {
    for seed in seeds {
        bench.succeed(&format!(
            "render --scene {} --seed {seed} --sequence s{seed}.exr -o r{seed}.exr --quiet {options}",
            cornell()
        ));
    }
}

#[test]
fn comparisons() {
    let bench = Bench::new();
    render(&bench, 1..=1, "--spp 8 --size 8x8");
    render(&bench, 2..=2, "--spp 8 --size 8x9");
    bench.succeed("pack r1.exr --layer S.R --as samples --spp 8 -o mono.exr -q");
    bench.write("text.exr", "this is no image");
    let precious = Precious::of(&bench, "r1.png");
    fails(&bench, "compare", 2, &["EXR"]);
    fails(&bench, "compare r1.exr", 2, &["reference"]);
    fails(&bench, "compare r1.exr ./r1.exr r2.exr", 2, &["./r1.exr", "twice"]);
    fails(&bench, "compare r1.exr gone.exr", 1, &["gone.exr", "read"]);
    fails(&bench, "compare text.exr r1.exr", 1, &["text.exr", "EXR"]);
    fails(&bench, "compare r1.exr r2.exr", 1, &["r1.exr", "8x8", "r2.exr", "8x9"]);
    fails(&bench, "compare r1.exr mono.exr", 1, &["R, G, B", "mono.exr", "of Y"]);
    fails(
        &bench,
        "compare r1.exr r1.exr --layer T",
        1,
        &["r1.exr", "'T'", "S, StdError, Variance"],
    );
    fails(&bench, "compare r1.exr r1.exr --error-map map.jpg", 2, &["--error-map", ".png"]);
    fails(&bench, "compare r1.exr r1.exr --error-map gone/map.png", 1, &["gone/map.png"]);
    fails(&bench, "compare r1.exr r2.exr --error-map r1.png", 1, &["8x9"]);
    precious.assert_is_there(&bench);
}

#[test]
fn files_that_info_does_not_know() {
    let bench = Bench::new();
    render(&bench, 1..=1, "--spp 8 --size 8x8");
    bench.succeed(&format!(
        "render --scene {} --spp 2 --size 4x4 --runs 2 -o d.safetensors -q",
        cornell()
    ));
    let cut = |name: &str, from: &str, length: usize| {
        let whole = std::fs::read(bench.path(from)).expect("a file");
        bench.write(name, &whole[..length.min(whole.len() - 1)]);
    };
    cut("header.exr", "s1.exr", 300);
    cut("cut.safetensors", "d.safetensors", usize::MAX);
    bench.write("notes.txt", "nothing to see");
    bench.write("empty", "");
    bench.write("text.safetensors", "no weights at all");
    bench.write("huge.safetensors", [&u64::MAX.to_le_bytes()[..], b"{}"].concat());
    bench.write("other.safetensors", [&2_u64.to_le_bytes()[..], b"{}"].concat());
    bench.write("bad.obj", "v 0 0\n");
    for name in ["notes.txt", "empty"] {
        fails(&bench, &format!("info {name}"), 1, &[name, "EXR", ".obj", ".safetensors"]);
    }
    fails(&bench, "info", 2, &["FILE"]);
    fails(&bench, "info gone.exr", 1, &["gone.exr", "read"]);
    fails(&bench, "info .", 1, &["'.'"]);
    fails(&bench, "info header.exr", 1, &["header.exr", "EXR"]);
    fails(&bench, "info bad.obj", 1, &["bad.obj", "line 1"]);
    fails(&bench, "info text.safetensors", 1, &["text.safetensors"]);
    fails(&bench, "info huge.safetensors", 1, &["huge.safetensors", "damaged"]);
    fails(&bench, "info other.safetensors", 1, &["other.safetensors", "format"]);
    fails(&bench, "info cut.safetensors", 1, &["cut.safetensors", "damaged"]);
}

#[test]
fn packs() {
    let bench = Bench::new();
    render(&bench, 1..=3, "--spp 8 --size 8x8");
    render(&bench, 4..=4, "--spp 8 --size 8x9");
    render(&bench, 5..=5, "--spp 9 --size 8x8");
    let whole = std::fs::read(bench.path("r1.exr")).expect("a picture");
    bench.write("cut.exr", &whole[..whole.len() - 100]);
    bench.write("text.exr", "this is no image");
    bench.write("empty.exr", "");
    bench.write("start.exr", &whole[..100]);
    let mut bare = OutputFile::create(&bench.path("bare.exr")).expect("a new file");
    let layers: [(&str, &[f32]); 1] = [("", &[0.5; 3 * 64])];
    write_exr(&mut bare, [8, 8], ColorModel::Rgb, &layers, &PictureInfo::default())
        .expect("a picture");
    bare.commit().expect("a disk with room");
    std::fs::copy(bench.path("s5.exr"), bench.path("seq.exr")).expect("a copy");
    std::fs::copy(bench.path("s1.exr"), bench.path("again.exr")).expect("a copy");
    let precious = Precious::of(&bench, "seq.exr");
    let cases: [(&str, i32, &[&str]); 28] = [
        ("bare.exr", 2, &["bare.exr", "samplesPerPixel", "--spp"]),
        ("--as samples", 2, &["EXR"]),
        ("r1.exr --as pictures", 2, &["pictures", "samples", "estimates", "runs"]),
        ("bare.exr r2.exr --as samples", 2, &["bare.exr", "samplesPerPixel", "--spp"]),
        ("r1.exr --as samples --spp 0", 2, &["--spp"]),
        ("r1.exr --as samples --spp-list 1", 2, &["--spp-list", "--as estimates"]),
        ("r1.exr --as estimates --spp 1", 2, &["--spp", "--as samples"]),
        ("r1.exr r2.exr --as estimates --spp-list 1", 2, &["1 number for 2 files"]),
        ("r1.exr r2.exr --as estimates --spp-list 4,4", 1, &["r1.exr", "r2.exr", "both have 4"]),
        ("r1.exr --as estimates --layer T", 1, &["r1.exr", "'T'", "S, StdError, Variance"]),
        ("s1.exr s2.exr --as estimates", 1, &["s1.exr", "s2.exr", "both have 8"]),
        ("s1.exr s5.exr --as samples", 1, &["s1.exr", "s5.exr", "8", "9"]),
        ("r1.exr r4.exr --as samples --spp 8", 1, &["r4.exr", "8x9", "r1.exr", "8x8"]),
        ("r1.exr gone.exr --as samples --spp 8", 1, &["gone.exr", "read"]),
        ("r1.exr text.exr --as samples --spp 8", 1, &["'text.exr': not an EXR file"]),
        ("r1.exr empty.exr --as samples --spp 8", 1, &["'empty.exr': the file is empty"]),
        ("r1.exr start.exr --as samples --spp 8", 1, &["'start.exr': not a readable", "cut off"]),
        ("r1.exr cut.exr --as samples --spp 8", 1, &["cut.exr"]),
        ("r1.exr r2.exr r1.exr --as samples --spp 8", 1, &["r1.exr", "same pixels", "seeds"]),
        ("r1.exr r2.exr --as samples --spp 4294967295", 1, &["too many"]),
        ("s1.exr --as runs", 2, &["seq.exr", ".safetensors"]),
        ("r1.exr --as runs -o d.safetensors", 1, &["r1.exr", "no sequence"]),
        ("s1.exr s4.exr --as runs -o d.safetensors", 1, &["s1.exr", "s4.exr", "sizes"]),
        ("s1.exr s5.exr --as runs -o d.safetensors", 1, &["s5.exr", "nst.terms"]),
        ("s1.exr s2.exr ./s1.exr --as runs -o d.safetensors", 2, &["./s1.exr", "twice"]),
        ("s1.exr s2.exr again.exr --as runs -o d.safetensors", 1, &["again.exr", "seed 1"]),
        ("s1.exr --as runs --scene x -o d.safetensors", 2, &["--scene", "--as runs"]),
        ("r1.exr --as samples --spp 8 -o gone/seq.exr", 1, &["gone/seq.exr", "write"]),
    ];
    for (args, code, words) in cases {
        let output = if args.contains("-o ") { "" } else { "-o seq.exr" };
        fails(&bench, &format!("pack {args} {output}"), code, words);
    }
    fails(&bench, "pack r1.exr --as samples --spp 8", 2, &["--output"]);
    fails(&bench, "pack r1.exr --as samples --spp 8 -o seq.png", 2, &["seq.png", ".exr"]);
    precious.assert_is_there(&bench);
}

#[test]
fn merges() {
    let bench = Bench::new();
    render(&bench, 1..=3, "--spp 8 --size 8x8");
    render(&bench, 4..=4, "--spp 8 --size 8x9");
    render(&bench, 5..=5, "--spp 9 --size 8x8");
    render(&bench, 6..=6, "--spp 8 --size 8x8 --sampler halton");
    render(&bench, 7..=7, "--spp 8 --size 8x8 --max-depth 3");
    render(&bench, 8..=8, "--spp 2 --size 8x8");
    bench.succeed("merge s1.exr s2.exr -o merged.exr -q");
    bench.succeed("pack r1.exr r2.exr --as samples --spp 1 -o packed.exr -q");
    bench.succeed("pack r1.exr r2.exr --as samples --spp 1 --layer S.R --seed 1 -o mono.exr -q");
    bench.succeed("pack r1.exr r3.exr --as samples --spp 1 --seed 9 -o seeded.exr -q");
    std::fs::copy(bench.path("s5.exr"), bench.path("out.exr")).expect("a copy");
    let precious = Precious::of(&bench, "out.exr");
    let cases: [(&str, i32, &[&str]); 13] = [
        ("", 2, &["EXR"]),
        ("s1.exr", 2, &["two or more"]),
        ("s1.exr s1.exr", 2, &["s1.exr", "named twice"]),
        ("s1.exr s4.exr", 1, &["s4.exr", "size is 8x9", "s1.exr", "8x8"]),
        ("s1.exr s5.exr", 1, &["s5.exr", "nst.terms", "2,3,4", "s1.exr", "1,2,3"]),
        ("s1.exr s6.exr", 1, &["s6.exr", "nst.sampler", "halton", "random"]),
        ("s1.exr s7.exr", 1, &["s7.exr", "nst.scene", "cornell:"]),
        ("s1.exr s8.exr", 1, &["s8.exr", "side channels", "fold0"]),
        ("s3.exr merged.exr s2.exr", 1, &["s2.exr", "seed 2", "merged.exr"]),
        ("packed.exr seeded.exr", 1, &["packed.exr", "nst.seed", "pack --seed"]),
        ("seeded.exr mono.exr", 1, &["mono.exr", "channels", "R, G, B"]),
        ("s1.exr r2.exr", 1, &["r2.exr", "no sequence"]),
        ("s1.exr gone.exr", 1, &["gone.exr", "read"]),
    ];
    for (args, code, words) in cases {
        fails(&bench, &format!("merge {args} -o out.exr"), code, words);
    }
    fails(&bench, "merge s1.exr s2.exr", 2, &["--output"]);
    fails(&bench, "merge s1.exr s2.exr -o out.png", 2, &["--output", ".exr"]);
    fails(&bench, "merge s1.exr s2.exr -o gone/out.exr", 1, &["gone/out.exr", "write"]);
    // A file whose rows turn out to be damaged does no harm either.
    let mut damaged = std::fs::read(bench.path("s2.exr")).expect("a sequence");
    let end = damaged.len() - 1000;
    damaged[end..].fill(0);
    bench.write("damaged.exr", damaged);
    fails(&bench, "merge s1.exr damaged.exr -o out.exr", 1, &["damaged.exr"]);
    precious.assert_is_there(&bench);
}

#[test]
fn stability_tables() {
    let bench = Bench::new();
    bench.write("old.csv", "method,regime\n");
    let precious = Precious::of(&bench, "old.csv");
    let short = "bench stability --short";
    fails(&bench, &format!("{short} -o gone/x.csv"), 1, &["gone/x.csv", "write"]);
    fails(&bench, &format!("{short} -o old.csv --markdown gone/x.md"), 1, &["gone/x.md"]);
    fails(&bench, &format!("{short} -o old.csv --markdown old.csv"), 2, &["old.csv"]);
    fails(&bench, short, 2, &["--output"]);
    precious.assert_is_there(&bench);
}

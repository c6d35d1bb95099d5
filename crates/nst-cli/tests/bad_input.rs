//! Bad input gets one clear error, and harms nothing that is there.

mod common;

use common::{Bench, cornell};

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
    let cases: [(&str, &str, &[&str]); 19] = [
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
        (
            "no_mtl.obj",
            &format!("mtllib gone.mtl\n{TRIANGLE}"),
            &["no_mtl.obj", "line 1", "gone.mtl"],
        ),
        (
            "bad_mtl.obj",
            &format!("mtllib bad.mtl\n{TRIANGLE}"),
            &["bad.mtl", "line 2", "'m'", "'red'"],
        ),
        ("bad_kd.obj", &format!("mtllib kd.mtl\nusemtl m\n{TRIANGLE}"), &["kd.mtl", "'m'", "Kd"]),
        ("bad_ke.obj", &format!("mtllib ke.mtl\nusemtl m\n{TRIANGLE}"), &["ke.mtl", "'m'", "Ke"]),
        ("short_kd.obj", &format!("mtllib short.mtl\n{TRIANGLE}"), &["short.mtl", "line 2", "Kd"]),
        ("no_map.obj", &format!("mtllib map.mtl\n{TRIANGLE}"), &["map.mtl", "line 2", "gone.png"]),
        ("bad_map.obj", &format!("mtllib bad_map.mtl\n{TRIANGLE}"), &["text.png"]),
        ("toml.obj", TRIANGLE, &["toml.toml", "vertical_fo", "line 4", "'vertical_fov'"]),
    ];
    bench.write("bad.mtl", "newmtl m\nKd red\n");
    bench.write("kd.mtl", "newmtl m\nKd 2 0 0\n");
    bench.write("ke.mtl", "newmtl m\nKe -1 0 0\n");
    bench.write("short.mtl", "newmtl m\nKd 0.5 0.5\n");
    bench.write("map.mtl", "newmtl m\nmap_Kd gone.png\n");
    bench.write("bad_map.mtl", "newmtl m\nmap_Kd text.png\n");
    bench.write("text.png", "no image");
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
    let cases: [(&str, &[&str]); 14] = [
        ("--spp 0", &["--spp", "0"]),
        ("--spp many", &["--spp"]),
        ("--size 10", &["--size", "512x512"]),
        ("--size 0x10", &["--size"]),
        ("--transform magic", &["magic", "cornell"]),
        ("--backend quantum", &["--backend"]),
        ("--threads 0", &["--threads"]),
        ("--max-depth 0", &["--max-depth"]),
        ("-o picture.png", &[".exr"]),
        ("--runs 2 -o picture.exr", &[".safetensors"]),
        ("--runs 0", &["--runs"]),
        ("--runs 2 --sequence seq.exr", &["--runs", "--sequence"]),
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

#[test]
fn outputs_that_cannot_be_written() {
    let bench = Bench::new();
    bench.write("x.obj", TRIANGLE);
    bench.write("x.exr", "precious");
    std::fs::create_dir(bench.path("folder.exr")).expect("a folder");
    let render = "render --scene x.obj --spp 8 --size 8x8";
    fails(&bench, &format!("{render} -o gone/x.exr"), 1, &["gone/x.exr", "write"]);
    fails(&bench, &format!("{render} -o folder.exr"), 1, &["folder.exr"]);
    // The sequence cannot be written, so the picture must not be replaced either.
    fails(&bench, &format!("{render} --sequence gone/s.exr"), 1, &["gone/s.exr"]);
    fails(&bench, &format!("{render} --weights gone.safetensors"), 1, &["gone.safetensors"]);
    assert_eq!(std::fs::read_to_string(bench.path("x.exr")).expect("still there"), "precious");
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
fn weights() {
    let bench = Bench::new();
    bench.write("x.obj", TRIANGLE);
    let (_, bytes) = nst_core::BUILTIN[0];
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
    // A run that fails after it has begun leaves the old results alone.
    bench.succeed(&format!("render --scene {scene} --spp 8 --size 4x4 -o ref.exr --quiet"));
    bench.write("out.csv", "precious");
    let short =
        args.replace("--spp 8", "--spp 8,4").replace("--runs", "--transform cornell --runs");
    fails(&bench, &format!("{short} ref.exr"), 2, &["cornell", "--spp"]);
    assert_eq!(std::fs::read_to_string(bench.path("out.csv")).expect("still there"), "precious");
}

#[test]
fn stability_tables() {
    let bench = Bench::new();
    bench.write("old.csv", "precious");
    let short = "bench stability --short";
    fails(&bench, &format!("{short} -o gone/x.csv"), 1, &["gone/x.csv", "write"]);
    fails(&bench, &format!("{short} -o old.csv --markdown gone/x.md"), 1, &["gone/x.md"]);
    fails(&bench, &format!("{short} -o old.csv --markdown old.csv"), 2, &["old.csv"]);
    fails(&bench, short, 2, &["--output"]);
    assert_eq!(std::fs::read_to_string(bench.path("old.csv")).expect("still there"), "precious");
}

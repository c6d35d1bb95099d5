//! What an output may replace, and what it may not: nothing that the job reads, nothing of
//! another kind, and under a name that nobody gave only what `nst` has written.

mod common;

use common::{Bench, read_layer};
use nst_files::sequence_file::SequenceFile;

/// A grey pixel, by no program that says its name.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x00\x00\x00\x01\x00\x00\x00\x01\x08\
    \x00\x00\x00\x00:~\x9bU\x00\x00\x00\rIDATx\x01\x01\x02\x00\xfd\xff\x00\x80\x00\x82\x00\x81\
    \xc3n%\xe0\x00\x00\x00\x00IEND\xaeB`\x82";

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n";

/// What nearly all these renderings have in common.
const RENDER: &str = "render --spp 4 --size 6x5 --transform none --quiet";

/// A scene of several files, `model.obj` with the texture `model.png` and the environment
/// `sky.exr`; and a scene of one, `plain.obj`.
fn scenes() -> Bench {
    let bench = Bench::new();
    bench.write("plain.obj", TRIANGLE);
    foreign(&bench, "sky.exr");
    bench.write("model.obj", format!("# a, b\nmtllib model.mtl\nusemtl m\n{TRIANGLE}"));
    bench.write("model.mtl", "# a, b\nnewmtl m\nmap_Kd model.png\n");
    bench.write("model.toml", "film = { size = [6, 5] }\nenvironment = { image = \"sky.exr\" }\n");
    bench.write("model.png", PNG);
    bench
}

/// An EXR picture by another program.
fn foreign(bench: &Bench, name: &str) {
    bench.succeed(&format!("{RENDER} --scene plain.obj -o foreign.exr"));
    std::fs::remove_file(bench.path("foreign.png")).expect("the picture as PNG");
    let mut bytes = std::fs::read(bench.path("foreign.exr")).expect("the picture");
    let ours = b"nst ";
    let place = bytes.windows(4).position(|part| part == ours).expect("the program's name");
    bytes[place..place + 4].copy_from_slice(b"oxe ");
    bench.write("foreign.exr", bytes);
    std::fs::rename(bench.path("foreign.exr"), bench.path(name)).expect("another name");
}

/// Sequences `s1.exr` and `s2.exr`, pictures `r1.exr` and `r2.exr`.
fn sequences(bench: &Bench) {
    for seed in [1, 2] {
        bench.succeed(&format!(
            "{RENDER} --scene plain.obj --seed {seed} --sequence s{seed}.exr -o r{seed}.exr"
        ));
    }
}

#[test]
fn a_rendering_does_not_replace_the_files_of_its_scene() {
    let bench = scenes();
    let weights = nst_core::Network::builtins().next().expect("there are networks").file();
    bench.write("w.safetensors", weights);
    let cases = [
        // The picture and its PNG are named after the scene, as is the texture.
        ("", "'model.png'", "an input"),
        ("-o model.exr", "'model.png'", "an input"),
        ("-o ./model.exr", "'./model.png'", "an input"),
        ("-o sky.exr", "'sky.exr'", "an input"),
        ("-o x.exr --sequence sky.exr", "'sky.exr'", "an input"),
        ("-o w.safetensors --runs 1", "'w.safetensors'", "another kind of file"),
    ];
    for (options, file, why) in cases {
        let render = RENDER.replace("--transform none", "");
        let args = format!("{render} --scene model.obj {options}");
        bench.refuses(&args, &[file, why, "give another name"]);
    }
    bench.succeed(&format!("{RENDER} --scene model.obj -o other.exr"));
}

#[test]
fn two_outputs_are_two_files() {
    let bench = scenes();
    for (sequence, picture) in [("x.exr", "x.exr"), ("./x.exr", "x.exr"), ("x.exr", "./x.exr")] {
        let args = format!("{RENDER} --scene plain.obj --sequence {sequence} -o {picture}");
        bench.refuses(&args, &[picture, "an output too", "give another name"]);
    }
    sequences(&bench);
    let args = "render --scene plain.obj -q --resume s1.exr --spp 5 -o ./s1.exr";
    bench.refuses(args, &["'./s1.exr'", "an output too, as 's1.exr'", "give another name"]);
    let args = "bench stability --short -o t.csv --markdown ./t.csv";
    bench.refuses(args, &["'./t.csv'", "an output too", "give another name"]);
}

#[test]
fn what_a_command_reads_is_not_what_it_writes() {
    let bench = scenes();
    sequences(&bench);
    for name in ["exr.png", "exr.csv"] {
        std::fs::copy(bench.path("r1.exr"), bench.path(name)).expect("a copy");
    }
    let scene = "bench scene --scene model.obj --spp 1 --runs 1 --transform none";
    let cases = [
        ("transform s1.exr -o s1.exr", "'s1.exr'"),
        ("transform s1.exr -o ./s1.exr", "'./s1.exr'"),
        ("merge s1.exr s2.exr -o s1.exr", "'s1.exr'"),
        ("merge s1.exr s2.exr -o s2.exr", "'s2.exr'"),
        ("pack r1.exr r2.exr --as samples --spp 4 -o r2.exr", "'r2.exr'"),
        ("compare exr.png r2.exr --error-map exr.png", "'exr.png'"),
        ("compare r2.exr exr.png --error-map ./exr.png", "'./exr.png'"),
        (&format!("{scene} --reference exr.csv -o exr.csv"), "'exr.csv'"),
        // The pictures beside the table have their name from it.
        (&format!("{scene} --reference r1.exr -o r1.csv"), "'r1.exr'"),
        (&format!("{scene} --reference r1.exr -o sky.csv"), "'sky.exr'"),
    ];
    for (args, file) in cases {
        bench.refuses(args, &[file, "an input", "give another name"]);
    }
}

#[test]
fn a_second_pack_of_all_files_leaves_the_first_alone() {
    let bench = scenes();
    sequences(&bench);
    let pack = |files: &str| format!("pack {files} --as samples --spp 4 -o seq.exr");
    bench.succeed(&pack("r1.exr r2.exr"));
    // As the shell makes of *.exr.
    bench.refuses(&pack("r1.exr r2.exr seq.exr"), &["'seq.exr'", "an input", "another name"]);
    // Without itself among its inputs it may be packed again.
    bench.succeed(&pack("r2.exr r1.exr"));
}

#[test]
fn files_of_another_kind_are_not_replaced() {
    let bench = scenes();
    sequences(&bench);
    let scene = "bench scene --scene plain.obj --spp 1 --runs 1 --reference r1.exr";
    let cases = [
        ("transform s1.exr -o s2.exr", "'s2.exr'", "a sequence"),
        ("merge s1.exr s2.exr -o r1.exr", "'r1.exr'", "an EXR picture"),
        ("bench stability --short -o r1.exr", "'r1.exr'", "an EXR picture"),
        ("bench stability --short -o s1.exr", "'s1.exr'", "a sequence"),
        // Texts that begin as a table, or as a document.
        ("bench stability --short -o model.obj", "'model.obj'", "another kind"),
        ("bench stability --short -o model.toml", "'model.toml'", "another kind"),
        ("bench stability --short -o x.csv --markdown model.mtl", "'model.mtl'", "another kind"),
        (&format!("{scene} -o s1.csv"), "'s1.exr'", "a sequence"),
        (&format!("{RENDER} --scene plain.obj --sequence r1.exr"), "'r1.exr'", "an EXR picture"),
        (&format!("{RENDER} --scene plain.obj -o s1.exr"), "'s1.exr'", "a sequence"),
    ];
    for (args, file, why) in cases {
        bench.refuses(args, &[file, why, "give another name"]);
    }
}

#[test]
fn default_names_replace_no_files_of_other_programs() {
    let bench = scenes();
    sequences(&bench);
    foreign(&bench, "plain.exr");
    foreign(&bench, "s1.nst.exr");
    bench.write("x.png", PNG);
    let words = ["nst did not write", "another name with --output", "move it away"];
    for (args, file) in [
        (format!("{RENDER} --scene plain.obj"), "'plain.exr'"),
        ("transform s1.exr --transform none".to_owned(), "'s1.nst.exr'"),
        // The name of the PNG follows from that of the picture.
        (format!("{RENDER} --scene plain.obj -o x.exr"), "'x.png'"),
    ] {
        bench.refuses(&args, &[&[file], &words[..]].concat());
    }
    // The user has named them.
    bench.succeed(&format!("{RENDER} --scene plain.obj -o plain.exr"));
    bench.succeed("transform s1.exr --transform none -o s1.nst.exr --quiet");
    for name in ["plain.exr", "s1.nst.exr"] {
        assert_eq!(read_layer(&bench.path(name), "S").0, [6, 5], "{name}");
    }
    // And now they are nst's own.
    for _ in 0..2 {
        bench.succeed(&format!("{RENDER} --scene plain.obj"));
        bench.succeed("transform s1.exr --transform none --quiet");
    }
}

#[test]
fn own_files_are_replaced_under_their_default_names() {
    let bench = scenes();
    let render = |seed: u32| {
        bench.succeed(&format!("{RENDER} --scene plain.obj --seed {seed}"));
        bench.succeed(&format!("{RENDER} --scene plain.obj --seed {seed} --runs 2"));
        ["plain.exr", "plain.png", "plain.safetensors"]
            .map(|name| std::fs::read(bench.path(name)).expect("an output"))
    };
    let (first, second) = (render(1), render(2));
    assert!(first.iter().zip(&second).all(|(first, second)| first != second));
}

#[cfg(unix)]
#[test]
fn links_are_what_they_lead_to() {
    let bench = scenes();
    sequences(&bench);
    std::fs::create_dir(bench.path("folder")).expect("a folder");
    for (link, file) in [
        ("link.exr", "s1.exr"),
        ("link.png", "r1.exr"),
        ("link", "."),
        ("folder/link.exr", "../link.exr"),
        ("later.exr", "x.exr"),
    ] {
        std::os::unix::fs::symlink(file, bench.path(link)).expect("a link");
    }
    for (args, words) in [
        ("transform s1.exr -o link.exr", ["'link.exr'", "as 's1.exr'"]),
        ("transform link.exr -o s1.exr", ["'s1.exr'", "as 'link.exr'"]),
        ("transform s1.exr -o folder/link.exr", ["'folder/link.exr'", "as 's1.exr'"]),
        ("transform s1.exr -o link/s1.exr", ["'link/s1.exr'", "as 's1.exr'"]),
        ("merge s1.exr s2.exr -o link.exr", ["'link.exr'", "as 's1.exr'"]),
        ("compare r1.exr r2.exr --error-map link.png", ["'link.png'", "as 'r1.exr'"]),
    ] {
        bench.refuses(args, &[&words[..], &["an input", "give another name"]].concat());
    }
    let both = format!("{RENDER} --scene plain.obj --sequence later.exr -o x.exr");
    bench.refuses(&both, &["'x.exr'", "an output too, as 'later.exr'", "give another name"]);
    // A link that leads elsewhere stays one.
    bench.succeed("merge s1.exr s2.exr -o later.exr -q");
    assert!(bench.path("later.exr").is_symlink() && bench.path("x.exr").is_file());
}

/// Each command says so before it computes anything, and in which folder it could not write.
#[cfg(unix)]
#[test]
fn places_where_nothing_can_be_written() {
    let bench = scenes();
    sequences(&bench);
    let scene = "bench scene --scene plain.obj --reference r1.exr --spp 1 --runs 1";
    let jobs = [
        (format!("{RENDER} --scene plain.obj -o @.exr"), "exr"),
        (format!("{RENDER} --scene plain.obj -o free.exr --sequence @.exr"), "exr"),
        (format!("{RENDER} --scene plain.obj --runs 2 -o @.safetensors"), "safetensors"),
        ("transform s1.exr -o @.exr".to_owned(), "exr"),
        ("pack r1.exr r2.exr --as samples --spp 4 -o @.exr".to_owned(), "exr"),
        ("pack s1.exr s2.exr --as runs -o @.safetensors".to_owned(), "safetensors"),
        ("merge s1.exr s2.exr -o @.exr".to_owned(), "exr"),
        ("compare r1.exr r2.exr --error-map @.png".to_owned(), "png"),
        (format!("{scene} -o @.csv"), "csv"),
        ("bench stability --short -o @.csv".to_owned(), "csv"),
        ("bench stability --short -o free.csv --markdown @.md".to_owned(), "md"),
    ];
    for extension in ["exr", "safetensors", "png", "csv", "md"] {
        let path = |name: &str| bench.path(&format!("{name}.{extension}"));
        std::fs::create_dir(path("folder")).expect("a folder");
        std::os::unix::fs::symlink(format!("gone/x.{extension}"), path("lost")).expect("a link");
        std::os::unix::fs::symlink(path("folder"), path("link")).expect("a link");
        let status = std::process::Command::new("mkfifo").arg(path("pipe")).status();
        assert!(status.expect("mkfifo runs").success());
    }
    let names = || bench.files();
    let before = names();
    for (job, extension) in jobs {
        for (name, code, words) in [
            ("folder", 1, "it is a folder; give another name"),
            ("link", 1, "it is a folder; give another name"),
            ("pipe", 2, "it is not an ordinary file; give another name"),
            ("gone/x", 1, "there is no folder 'gone'; create it, or give another name"),
            ("lost", 1, "there is no folder './gone'; create it, or give another name"),
            ("plain.obj/x", 1, "'plain.obj' is no folder; give another name"),
        ] {
            let args = job.replace('@', name);
            let output = bench.nst(&args);
            let stderr = String::from_utf8(output.stderr).expect("UTF-8");
            assert_eq!(output.status.code(), Some(code), "nst {args}\n{stderr}");
            assert!(stderr.contains(words), "nst {args}\n{stderr}");
            assert!(stderr.contains(&format!("'{name}.{extension}'")), "nst {args}\n{stderr}");
            assert!(!stderr.contains(".nst-"), "a temporary file's name is no help: {stderr}");
            assert_eq!(names(), before, "nst {args}");
        }
    }
}

#[test]
fn only_the_sequence_that_is_continued_may_be_brought_up_to_date() {
    let bench = scenes();
    sequences(&bench);
    let samples = |name: &str| SequenceFile::read(&bench.path(name)).expect(name).info.samples();
    let resume = |options: &str| {
        bench.succeed(&format!("render --scene plain.obj -q -o x.exr --resume s1.exr {options}"));
    };
    resume("--spp 5");
    assert_eq!(samples("s1.exr"), 5);
    resume("--spp 6 --sequence ./s1.exr");
    assert_eq!(samples("s1.exr"), 6);
    let before = std::fs::read(bench.path("s1.exr")).expect("the sequence");
    resume("--spp 7 --sequence other.exr");
    assert_eq!((samples("s1.exr"), samples("other.exr")), (6, 7));
    assert!(std::fs::read(bench.path("s1.exr")).expect("the sequence") == before);
    // But not twice in one job.
    let args = "render --scene plain.obj -q --resume s1.exr --spp 8 -o ./s1.exr --sequence y.exr";
    bench.refuses(args, &["'./s1.exr'", "an input", "give another name"]);
}

//! `nst report`: which pictures the page has, how large it is, and what is refused. What it
//! looks like and does, `tests/peers/test_report.py` looks at in a browser.

mod common;

use common::Bench;
use nst_core::random::SplitMix64;
use nst_files::{
    ColorModel,
    output::OutputFile,
    picture_writer::{PictureInfo, write_exr},
};

const HEADER: &str = "scene,method,spp,run,mse,relmse,smape,mse_trimmed,bias2,predicted_mse,\
    load_seconds,render_seconds,transform_seconds,transform_warm_seconds,io_seconds,total_seconds,\
    width,height,reference_mse,threads,machine,adapter,version,schema,failure,\
    fingerprint,seed,sampler,predicted_ratio,predicted_low,predicted_high,reference,reference_spp\n";

/// What the table and the pictures of scene `a` say of their reference.
const REFERENCE: &str = "0123456789abcdef";

/// A table of these scenes, methods at 8 spp.
fn table(scenes: &[&str], methods: &[&str], [width, height]: [u32; 2]) -> String {
    let rows = scenes.iter().flat_map(|scene| {
        methods.iter().enumerate().map(move |(place, method)| {
            let (mse, seconds) = (1.0 / (place + 1) as f64, 1 + place);
            format!(
                "{scene},{method},8,0,{mse},,,,,,,,,,,{seconds},{width},{height},,,,,0.0.0,6,,\
                 {scene}:v2:0,,,,,,{REFERENCE},\n"
            )
        })
    });
    HEADER.to_owned() + &rows.collect::<String>()
}

/// Writes a picture with these layers, each a constant, as those of a table of scene `a`.
fn picture(bench: &Bench, name: &str, size: [u32; 2], model: ColorModel, layers: &[&str]) {
    let [scene, reference] = ["a:v2:0", REFERENCE].map(|text| Some(text.to_owned()));
    let info = PictureInfo { scene, reference, ..PictureInfo::default() };
    picture_of(bench, name, (size, model), layers, &info);
}

fn picture_of(
    bench: &Bench,
    name: &str,
    (size, model): ([u32; 2], ColorModel),
    layers: &[&str],
    info: &PictureInfo,
) {
    let lanes = vec![0.5; (size[0] * size[1]) as usize * model.channels().len()];
    let layers: Vec<(&str, &[f32])> = layers.iter().map(|layer| (*layer, &lanes[..])).collect();
    let mut output = OutputFile::create(&bench.path(name)).expect("a new file");
    write_exr(&mut output, size, model, &layers, info).expect("a picture");
    output.commit().expect("a disk with room");
}

/// The page's data.
fn data(bench: &Bench, page: &str) -> serde_json::Value {
    let page = std::fs::read_to_string(bench.path(page)).expect("a page");
    let (_, rest) = page.split_once("id=\"data\">").expect("the data");
    serde_json::from_str(rest.split_once("</script>").expect("its end").0).expect("JSON")
}

/// What the page says of its pictures, and their names.
fn notes_and_names(data: &serde_json::Value) -> (String, Vec<&str>) {
    let comparer = &data["comparer"];
    let notes = comparer["notes"].as_array().expect("notes").iter();
    let notes: Vec<_> = notes.map(|note| note.as_str().expect("text")).collect();
    let pictures = comparer["pictures"].as_array().expect("pictures").iter();
    (notes.join("\n"), pictures.map(|it| it["name"].as_str().expect("a name")).collect())
}

/// A table of two methods on a film of 4 by 2, with its pictures.
fn small() -> Bench {
    let bench = Bench::new();
    bench.write("results.csv", table(&["a"], &["none", "auto"], [4, 2]));
    picture(&bench, "results.exr", [4, 2], ColorModel::Rgb, &["", "none.8", "auto.8", "S"]);
    bench
}

#[test]
fn pages_and_their_names() {
    let bench = small();
    let report = bench.succeed("report results.csv --json --picture b=results.exr:S");
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!((&report["scene"], &report["pictures"]), (&"a".into(), &5.into()));
    assert_eq!(report["files"], serde_json::json!(["results.html"]));
    let bytes = std::fs::metadata(bench.path("results.html")).expect("a page").len();
    assert_eq!(report["bytes"], bytes);
    let data = data(&bench, "results.html");
    let (_, names) = notes_and_names(&data);
    assert_eq!(names, ["reference", "none (plain)", "auto", "b", "S"]);
    // It may be written again, and under another name.
    bench.succeed("report results.csv");
    bench.succeed("report results.csv -o other.html");
    std::fs::remove_file(bench.path("results.exr")).expect("the pictures");
    let said = bench.succeed("report results.csv");
    assert!(said.contains("'results.exr' is missing"), "{said}");
}

#[test]
fn what_a_page_does_not_replace() {
    let bench = small();
    bench.write("mine.csv", table(&["a"], &["none"], [4, 2]));
    bench.write("mine.html", "<!doctype html>\n<title>mine</title>");
    bench.refuses("report mine.csv", &["'mine.html'", "nst did not write"]);
    bench.write("text.html", "a text");
    bench.refuses("report results.csv -o text.html", &["'text.html'", "another kind of file"]);
    bench.refuses("report results.csv -o results.csv", &["must end in .html"]);
    std::fs::copy(bench.path("results.exr"), bench.path("x.html")).expect("a copy");
    let args = "report results.csv --picture a=x.html -o x.html";
    bench.refuses(args, &["'x.html'", "an input"]);
    bench.succeed("report results.csv -o mine.html");
}

#[test]
fn what_is_refused() {
    let fails = |bench: &Bench, args: &str, code: i32, words: &[&str]| {
        let before = bench.files();
        let output = bench.nst(args);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "nst {args}\n{stderr}");
        for word in words {
            assert!(stderr.contains(word), "nst {args}\n'{word}' is not in: {stderr}");
        }
        assert_eq!(bench.files(), before);
    };
    let bench = small();
    fails(&bench, "report gone.csv", 1, &["'gone.csv'"]);
    bench.write("other.csv", "a,b\n1,2\n");
    fails(&bench, "report other.csv", 1, &["'other.csv'", "no table of nst bench scene"]);
    bench.write("two.csv", table(&["a", "b"], &["none"], [4, 2]));
    fails(&bench, "report two.csv", 2, &["--scene", "'a', 'b'"]);
    fails(&bench, "report two.csv --scene c", 2, &["'c'", "'a', 'b'"]);
    fails(&bench, "report two.csv --scene a --picture x=results.exr", 2, &["'two.exr' is missing"]);

    fails(&bench, "report results.csv --picture results.exr", 2, &["as in oidn=denoised.exr"]);
    let again = "report results.csv --picture";
    for name in ["reference", "auto", "none", "S"] {
        let args = format!("{again} {name}=results.exr:S");
        fails(&bench, &args, 2, &[name, "another picture of this name"]);
    }
    let args = format!("{again} x=results.exr:S --picture x=results.exr");
    fails(&bench, &args, 2, &["--picture x=", "another picture of this name"]);
    fails(&bench, "report results.csv --picture x=gone.exr", 1, &["'gone.exr'"]);
    let args = "report results.csv --picture x=results.exr:depth";
    fails(&bench, args, 1, &["'results.exr'", "no layer 'depth'", "none.8"]);
    bench.write("text.exr", "no picture");
    fails(&bench, "report results.csv --picture x=text.exr", 1, &["'text.exr'"]);
    picture(&bench, "wide.exr", [5, 2], ColorModel::Rgb, &[""]);
    fails(&bench, "report results.csv --picture x=wide.exr", 1, &["'wide.exr'", "5x2", "4x2"]);
    picture(&bench, "other.exr", [4, 2], ColorModel::Rgb, &["none.8"]);
    std::fs::copy(bench.path("results.csv"), bench.path("other.csv")).expect("a copy");
    fails(&bench, "report other.csv", 1, &["'other.exr'", "main picture"]);
    std::fs::copy(bench.path("wide.exr"), bench.path("other.exr")).expect("a copy");
    fails(&bench, "report other.csv", 1, &["'other.exr'", "5x2", "4x2"]);
    let mut damaged = std::fs::read(bench.path("results.exr")).expect("a picture");
    damaged.truncate(damaged.len() - 20);
    bench.write("other.exr", damaged);
    fails(&bench, "report other.csv", 1, &["'other.exr'"]);
}

#[test]
fn a_page_stays_below_ten_megabytes() {
    let bench = Bench::new();
    // The first two are on the Pareto front by their errors; the table lists the plain one last.
    let methods = ["m0", "m1", "m2", "m3", "m4", "m5", "m6", "m7", "m8", "auto", "none"];
    bench.write("results.csv", table(&["a"], &methods, [512, 512]));
    let mut random = SplitMix64::of_stream(1, 0);
    // Noise over two orders of magnitude, which is hard to compress.
    let pixels: Vec<f32> = (0..3 << 18).map(|_| 100_f64.powf(random.uniform()) as f32).collect();
    let names: Vec<String> = methods.iter().map(|method| format!("{method}.8")).collect();
    let layers = names.iter().map(|name| (&**name, &pixels[..]));
    let layers: Vec<(&str, &[f32])> = [("", &pixels[..])].into_iter().chain(layers).collect();
    let mut output = OutputFile::create(&bench.path("results.exr")).expect("a new file");
    let [scene, reference] = ["a:v2:0", REFERENCE].map(|text| Some(text.to_owned()));
    let info = PictureInfo { scene, reference, ..PictureInfo::default() };
    write_exr(&mut output, [512, 512], ColorModel::Rgb, &layers, &info).expect("a picture");
    output.commit().expect("a disk with room");
    bench.succeed("report results.csv --picture other=results.exr:m8.8");
    let bytes = std::fs::metadata(bench.path("results.html")).expect("a page").len();
    assert!((7_000_000..10_000_000).contains(&bytes), "{bytes}");
    let data = data(&bench, "results.html");
    let (notes, names) = notes_and_names(&data);
    for kept in ["reference", "none (plain)", "auto", "other"] {
        assert!(names.contains(&kept), "{kept} is not in {names:?}");
    }
    assert!(names.len() < methods.len(), "{names:?}");
    for method in methods {
        let left_out = notes.contains(&format!("{method} at 8 spp"));
        assert!(method == "none" || names.contains(&method) != left_out, "{method}: {notes}");
    }
}

#[test]
fn large_films_are_reduced() {
    let bench = Bench::new();
    bench.write("results.csv", table(&["a"], &["none", "b"], [1030, 600]));
    picture(&bench, "results.exr", [1030, 600], ColorModel::Mono, &["", "none.8"]);
    bench.succeed("report results.csv");
    let data = data(&bench, "results.html");
    let comparer = &data["comparer"];
    assert_eq!((&comparer["width"], &comparer["height"]), (&515.into(), &300.into()));
    let (notes, names) = notes_and_names(&data);
    assert_eq!(names, ["reference", "none (plain)"]);
    assert!(notes.contains("means of 2 × 2 pixels of the film of 1030 × 600"), "{notes}");
    assert!(notes.contains("Without a picture: b at 8 spp"), "{notes}");
}

/// Pictures of another bench have the same layers.
#[test]
fn pictures_of_another_table_are_not_shown() {
    let bench = small();
    let write = |scene: Option<&str>, reference: Option<&str>| {
        let [scene, reference] = [scene, reference].map(|text| text.map(str::to_owned));
        let info = PictureInfo { scene, reference, ..PictureInfo::default() };
        let film = ([4, 2], ColorModel::Rgb);
        picture_of(&bench, "results.exr", film, &["", "none.8", "auto.8"], &info);
    };
    for (scene, reference) in [("a:v2:0", "other"), ("a:v2:1", REFERENCE)] {
        write(Some(scene), Some(reference));
        for args in ["report results.csv", "report results.csv --picture x=results.exr:auto.8"] {
            let output = bench.nst(args);
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{stderr}");
            assert!(stderr.contains("pictures of another table"), "{stderr}");
        }
    }
    // Those that do not say whose they are count if the user names them.
    write(None, None);
    let said = bench.succeed("report results.csv");
    assert!(said.contains("does not say") && said.contains("0 pictures"), "{said}");
    let said = bench.succeed("report results.csv --picture x=results.exr:auto.8");
    assert!(said.contains("4 pictures"), "{said}");
    let said = bench.succeed("report results.csv --json");
    let said: serde_json::Value = serde_json::from_str(&said).expect("JSON");
    let advice: Vec<_> = said["advice"].as_array().expect("an array").iter().collect();
    assert_eq!(advice.len(), 2);
    assert!(advice[0].as_str().is_some_and(|text| text.contains("MSE")), "{advice:?}");
}

//! `nst chart`: the marks of a chart stand where its axes say, and what it may replace.

mod common;

use std::collections::BTreeMap;

use common::Bench;
use roxmltree::{Document, Node};

/// Two methods at three sample counts, two runs each; means are easily found by hand. The
/// network needs 16 samples.
const TABLE: &str = "\
scene,method,spp,run,mse,relmse,smape,mse_trimmed,bias2,predicted_mse,load_seconds,render_seconds,\
transform_seconds,transform_warm_seconds,io_seconds,total_seconds,width,height,reference_mse,\
fingerprint,seed,threads,machine,adapter,version,schema,failure,\
sampler,predicted_ratio,predicted_low,predicted_high,reference,reference_spp
box,none,8,0,0.012,0.12,0.1,0.01,0,,0.1,0.8,0,0,0.1,1,64,32,1e-6,box:v2:0,7,2,a machine,,0.1.0,6,,,,,,,
box,none,8,1,0.008,0.08,0.1,0.01,0,,0.1,0.8,0,0,0.1,1,64,32,1e-6,box:v2:0,8,2,a machine,,0.1.0,6,,,,,,,
box,none,16,0,0.006,0.06,0.1,0.01,0,,0.1,1.8,0,0,0.1,2,64,32,1e-6,box:v2:0,7,2,a machine,,0.1.0,6,,,,,,,
box,none,16,1,0.004,0.04,0.1,0.01,0,,0.1,1.8,0,0,0.1,2,64,32,1e-6,box:v2:0,8,2,a machine,,0.1.0,6,,,,,,,
box,none,32,0,0.003,0.03,0.1,0.01,0,,0.1,3.8,0,0,0.1,4,64,32,1e-6,box:v2:0,7,2,a machine,,0.1.0,6,,,,,,,
box,none,32,1,0.002,0.02,0.1,0.01,0,,0.1,3.8,0,0,0.1,4,64,32,1e-6,box:v2:0,8,2,a machine,,0.1.0,6,,,,,,,
box,<net>,8,0,,,,,,,,,,,,,64,32,1e-6,box:v2:0,7,2,a machine,,0.1.0,6,\"it needs <16> samples, & has 8.\",,,,,,
box,<net>,16,0,0.003,0.2,0.1,0.01,0,,0.1,1.8,0.5,0.1,0.1,2.5,64,32,1e-6,box:v2:0,7,2,a machine,,0.1.0,6,,,,,,,
box,<net>,16,1,0.001,0.2,0.1,0.01,0,,0.1,1.8,0.5,0.1,0.1,2.5,64,32,1e-6,box:v2:0,8,2,a machine,,0.1.0,6,,,,,,,
box,<net>,32,0,0.002,0.2,0.1,0.01,0,,0.1,3.8,0.5,0.1,0.1,4.5,64,32,1e-6,box:v2:0,7,2,a machine,,0.1.0,6,,,,,,,
box,<net>,32,1,0.0008,0.2,0.1,0.01,0,,0.1,3.8,0.5,0.1,0.1,4.5,64,32,1e-6,box:v2:0,8,2,a machine,,0.1.0,6,,,,,,,
";

/// The only texts of a node, and of those in it.
fn text_of(node: &Node) -> String {
    node.descendants().filter(Node::is_text).filter_map(|node| node.text()).collect()
}

fn number(node: &Node, name: &str) -> f64 {
    node.attribute(name).and_then(|text| text.parse().ok()).expect("a number")
}

fn corners(node: &Node) -> Vec<[f64; 2]> {
    let parse = |text: &str| text.parse::<f64>().expect("a number");
    let points = node.attribute("points").expect("a line or polygon").split(' ');
    points
        .map(|point| point.split_once(',').expect("x,y"))
        .map(|(x, y)| [parse(x), parse(y)])
        .collect()
}

/// The marks of a chart: what they say, and where their centre is.
fn marks(document: &Document) -> Vec<(String, [f64; 2])> {
    let marks = document.descendants().filter(|node| node.attribute("class") == Some("mark"));
    let place = |node: Node| {
        let center = match node.tag_name().name() {
            "circle" => ["cx", "cy"].map(|name| number(&node, name)),
            _ => {
                let corners = corners(&node);
                [0, 1].map(|axis| {
                    corners.iter().map(|it| it[axis]).sum::<f64>() / corners.len() as f64
                })
            }
        };
        (text_of(&node), center)
    };
    marks.map(place).collect()
}

/// The number that an axis names at a tick: `5`, or `2·10` with an exponent.
fn tick_value(node: &Node) -> Option<f64> {
    let text = node.text()?;
    let exponent = node.children().find(|child| child.has_tag_name("tspan"));
    let Some(exponent) = exponent else { return text.parse().ok() };
    let digit: f64 = text.strip_suffix("10")?.trim_end_matches('·').parse().unwrap_or(1.0);
    let power: i32 = exponent.text()?.replace('−', "-").parse().ok()?;
    Some(digit * 10_f64.powi(power))
}

/// As a reader does: how an axis of a plot maps logarithms to pixels, by its first and last
/// labels. `frame` is the line of the axes.
struct Axes {
    x: [[f64; 2]; 2],
    y: [[f64; 2]; 2],
}

impl Axes {
    fn read(document: &Document, frame: &Node) -> Self {
        let [top, corner, right] = corners(frame)[..] else { panic!("an axis has three points") };
        let ticks = document.descendants().filter(|node| node.has_tag_name("text"));
        let ticks: Vec<_> = ticks
            .filter_map(|node| Some((number(&node, "x"), number(&node, "y"), tick_value(&node)?)))
            .collect();
        let below = |&(x, y, _): &(f64, f64, f64)| {
            (corner[0]..=right[0]).contains(&x) && (0.0..25.0).contains(&(y - corner[1]))
        };
        let left = |&(x, y, _): &(f64, f64, f64)| {
            (top[1] - 9.0..=corner[1] + 9.0).contains(&y) && (0.0..25.0).contains(&(corner[0] - x))
        };
        let ends = |mut places: Vec<[f64; 2]>| {
            places.sort_by(|a, b| a[0].total_cmp(&b[0]));
            assert!(places.len() > 1, "an axis has two labels or more: {places:?}");
            [places[0], places[places.len() - 1]]
        };
        let x = ticks.iter().filter(|tick| below(tick)).map(|tick| [tick.2, tick.0]);
        // The baseline of a label is 4 pixels below its tick.
        let y = ticks.iter().filter(|tick| left(tick)).map(|tick| [tick.2, tick.1 - 4.0]);
        Self { x: ends(x.collect()), y: ends(y.collect()) }
    }

    fn at(&self, value: [f64; 2]) -> [f64; 2] {
        let map = |[first, last]: [[f64; 2]; 2], value: f64| {
            let share = (value / first[0]).ln() / (last[0] / first[0]).ln();
            first[1] + share * (last[1] - first[1])
        };
        [map(self.x, value[0]), map(self.y, value[1])]
    }
}

/// The values on both axes of the marks of a plot, by what the marks say.
type Expected<'a> = BTreeMap<&'a str, [f64; 2]>;

/// Whether the marks within a plot are those expected, each where its axes have its values.
fn agrees(document: &Document, frame: &Node, expected: &Expected) -> bool {
    let axes = Axes::read(document, frame);
    let [top, _, right] = corners(frame)[..] else { panic!("an axis has three points") };
    let left_bottom = corners(frame)[1];
    let inside = |place: &[f64; 2]| {
        (left_bottom[0]..=right[0]).contains(&place[0])
            && (top[1]..=left_bottom[1]).contains(&place[1])
    };
    let marks: Vec<_> = marks(document).into_iter().filter(|(_, place)| inside(place)).collect();
    marks.len() == expected.len()
        && marks.iter().all(|(label, place)| {
            expected.get(label.as_str()).is_some_and(|&value| {
                let wanted = axes.at(value);
                // Places are rounded to hundredths of a pixel, those of the labels too.
                (wanted[0] - place[0]).abs() < 0.1 && (wanted[1] - place[1]).abs() < 0.1
            })
        })
}

fn expected(samples: bool) -> Expected<'static> {
    // Medians of the times, means of the errors; Student's t for two runs is 12.7062, and the
    // standard error of their mean is half their distance.
    let points = [
        (
            "plain sampling at 8 spp: MSE 0.01 (95 %: -0.0154 to 0.0354), 1 s, on the Pareto front",
            8,
            1.0,
            0.01,
        ),
        (
            "plain sampling at 16 spp: MSE 0.005 (95 %: -0.00771 to 0.0177), 2 s, on the Pareto front",
            16,
            2.0,
            0.005,
        ),
        ("plain sampling at 32 spp: MSE 0.0025 (95 %: -0.00385 to 0.00885), 4 s", 32, 4.0, 0.0025),
        (
            "<net> at 16 spp: MSE 0.002 (95 %: -0.0107 to 0.0147), 2.5 s, on the Pareto front",
            16,
            2.5,
            0.002,
        ),
        (
            "<net> at 32 spp: MSE 0.0014 (95 %: -0.00622 to 0.00902), 4.5 s, on the Pareto front",
            32,
            4.5,
            0.0014,
        ),
    ];
    let at = |spp: i32, seconds: f64| if samples { f64::from(spp) } else { seconds };
    points.into_iter().map(|(label, spp, time, mse)| (label, [at(spp, time), mse])).collect()
}

#[test]
fn marks_stand_where_the_axes_say() {
    let bench = Bench::new();
    bench.write("results.csv", TABLE);
    bench.succeed("chart results.csv -o chart.svg --metric mse");
    let svg = std::fs::read_to_string(bench.path("chart.svg")).expect("the chart");
    let document = Document::parse(&svg).expect("XML");
    let frames = document.descendants().filter(|node| node.attribute("class") == Some("axis"));
    let frames: Vec<Node> = frames.collect();
    let [time, samples, equal] = frames[..] else { panic!("three plots: {}", frames.len()) };
    assert!(agrees(&document, &time, &expected(false)));
    assert!(agrees(&document, &samples, &expected(true)));
    // There is no round budget from 2.5 s on to 4.5 s, up to which the network was measured. The errors of the two
    // are lines in the logarithms: at 2.5 s, plain sampling has 0.01 / 2.5, and at 4 s, the
    // network 0.002 · 0.7^(ln 1.6 / ln 1.8). After 4 s, of which 0.2 s are no samples, plain
    // sampling goes on as 1/n.
    let late = 0.002 * 0.7_f64.powf(1.6_f64.ln() / 1.8_f64.ln()) / 0.0025;
    let last = 0.0014 / (0.0025 * 3.8 / 4.3);
    let labels = [
        "plain sampling in 2.5 s: 1 of the plain estimate's MSE".to_owned(),
        "plain sampling in 4 s: 1 of the plain estimate's MSE".to_owned(),
        "plain sampling in 4.5 s: 1 of the plain estimate's MSE".to_owned(),
        "<net> in 2.5 s: 0.5 of the plain estimate's MSE".to_owned(),
        format!("<net> in 4 s: {late:.3} of the plain estimate's MSE"),
        format!("<net> in 4.5 s: {last:.3} of the plain estimate's MSE"),
    ];
    let places = [[2.5, 1.0], [4.0, 1.0], [4.5, 1.0], [2.5, 0.5], [4.0, late], [4.5, last]];
    let slices: Expected = labels.iter().map(String::as_str).zip(places).collect();
    assert!(agrees(&document, &equal, &slices));

    // The comparison sees a wrong value, a missing mark, and a mark in another place.
    let mut wrong = expected(false);
    *wrong.values_mut().next().expect("a mark") = [4.5, 0.00145];
    assert!(!agrees(&document, &time, &wrong));
    wrong.pop_first();
    assert!(!agrees(&document, &time, &wrong));
    assert!(!agrees(&document, &samples, &expected(false)));
    assert!(!agrees(&document, &equal, &expected(false)));
    let plain = marks(&document).into_iter().find(|(label, _)| label.starts_with("plain"));
    let (_, [x, _]) = plain.expect("a mark of plain sampling");
    let moved = svg.replace(&format!("cx=\"{x}\""), &format!("cx=\"{}\"", x + 3.0));
    assert!(moved != svg);
    let moved = Document::parse(&moved).expect("XML");
    let mut frames = moved.descendants().filter(|node| node.attribute("class") == Some("axis"));
    assert!(!agrees(&moved, &frames.next().expect("a plot"), &expected(false)));
}

#[test]
fn a_chart_says_what_it_shows() {
    let bench = Bench::new();
    bench.write("results.csv", TABLE);
    let printed = bench.succeed("chart results.csv --json");
    let report: serde_json::Value = serde_json::from_str(&printed).expect("JSON");
    assert_eq!(report["files"], serde_json::json!(["results.svg", "results.png"]));
    assert_eq!(report["methods"], serde_json::json!(["none", "<net>"]));
    let svg = std::fs::read_to_string(bench.path("results.svg")).expect("the chart");
    let document = Document::parse(&svg).expect("XML");
    let texts = document.descendants().filter(|node| node.has_tag_name("text"));
    let texts = texts.map(|node| text_of(&node)).collect::<Vec<_>>().join(" ");
    for words in [
        "box: error against time and samples",
        "64 × 32 pixels · 2 runs per point · a machine · 2 threads · nst 0.1.0",
        report["advice"][0].as_str().expect("a sentence").split(':').next().expect("a part"),
        report["advice"][1].as_str().expect("a sentence").split(':').next().expect("a part"),
        "times are medians over the runs",
        "pick '<net>'",
        "On this scene, pick plain sampling:",
        "MSE against time",
        "MSE against samples",
        "relMSE against time",
        "relMSE against samples",
        "relMSE at equal time, relative to plain sampling",
        "seconds for the whole job: load, render, transform, write",
        "samples per pixel",
        "Pareto front",
        "slope −1 of plain sampling",
        "Failed: <net> at 8 spp: it needs <16> samples, & has 8.",
    ] {
        assert!(texts.contains(words), "'{words}' is not in: {texts}");
    }
    let root = document.root_element();
    assert_eq!(root.attribute("role"), Some("img"));
    assert_eq!(root.attribute("aria-label"), Some("box: error against time and samples"));
}

/// The PNG has the marks of the SVG, twice as large.
#[test]
fn the_png_shows_the_same() {
    let bench = Bench::new();
    bench.write("results.csv", TABLE);
    bench.succeed("chart results.csv -q");
    let svg = std::fs::read_to_string(bench.path("results.svg")).expect("the chart");
    let document = Document::parse(&svg).expect("XML");
    let file = std::io::BufReader::new(
        std::fs::File::open(bench.path("results.png")).expect("the picture"),
    );
    let mut reader = png::Decoder::new(file).read_info().expect("a PNG file");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a small picture")];
    let frame = reader.next_frame(&mut bytes).expect("its pixels");
    let root = document.root_element();
    assert_eq!(f64::from(frame.width), 2.0 * number(&root, "width"));
    assert_eq!(f64::from(frame.height), 2.0 * number(&root, "height"));
    let color = |[x, y]: [f64; 2]| {
        let place = (2.0 * y) as usize * frame.width as usize + (2.0 * x) as usize;
        format!("#{:02X}{:02X}{:02X}", bytes[3 * place], bytes[3 * place + 1], bytes[3 * place + 2])
    };
    let marks: Vec<_> = marks(&document);
    assert_eq!(marks.len(), 2 * (5 + 5) + 2 * 6);
    // Marks of plain sampling are drawn last; nothing lies above them.
    let plain: Vec<_> = marks.iter().filter(|(label, _)| label.starts_with("plain")).collect();
    assert_eq!(plain.len(), 2 * (3 + 3) + 2 * 3);
    for (label, place) in plain {
        assert_eq!(color(*place), "#1B1F24", "{label}");
        // Beside it, away from curves and intervals.
        assert_ne!(color([place[0] - 9.0, place[1] + 9.0]), "#1B1F24", "{label}");
    }
}

#[test]
fn charts_replace_only_charts() {
    let bench = Bench::new();
    bench.write("results.csv", TABLE);
    // Its own, under the default names, as often as one likes.
    bench.succeed("chart results.csv");
    bench.succeed("chart results.csv");
    assert_eq!(bench.files(), ["results.csv", "results.png", "results.svg"]);
    bench.write("drawing.csv", TABLE);
    bench.write("drawing.svg", "<svg xmlns=\"http://www.w3.org/2000/svg\"/>\n");
    bench.refuses("chart drawing.csv", &["'drawing.svg'", "nst did not write", "--output"]);
    bench.succeed("chart drawing.csv -o drawing.svg");
    bench.write("table.svg", TABLE);
    bench.refuses("chart table.svg -o table.svg", &["'table.svg'", "an input", "another name"]);
    bench.refuses("chart table.svg", &["'table.svg'", "an input", "another name"]);
    bench.refuses("chart results.csv -o table.svg", &["'table.svg'", "another kind of file"]);
    std::fs::copy(bench.path("results.png"), bench.path("x.svg")).expect("a copy");
    bench.refuses("chart results.csv -o x.svg", &["'x.svg'", "a PNG picture is there"]);
    bench.refuses("chart results.csv -o chart.pdf", &["chart.pdf", ".svg or .png"]);
    bench.refuses("chart results.csv results.csv", &["'results.csv'", "named twice"]);
}

/// The advice by each metric is printed, and what to know of tables that are joined.
#[test]
fn advice_and_notes_are_printed() {
    let bench = Bench::new();
    bench.write("a.csv", TABLE);
    let other = TABLE.replace("a machine", "another").replace("box:v2:0,7", "box:v2:0,17");
    bench.write("b.csv", other.replace("box:v2:0,8", "box:v2:0,18"));
    let said = bench.succeed("chart a.csv");
    let lines: Vec<_> = said.lines().filter(|line| line.starts_with("by ")).collect();
    let [mse, relmse] = lines[..] else { panic!("two sentences: {said}") };
    assert!(mse.starts_with("by MSE     For a budget of"), "{said}");
    assert!(relmse.starts_with("by relMSE  On this scene, pick plain sampling"), "{said}");
    assert!(!said.contains("note"), "{said}");
    let said = bench.succeed("chart a.csv b.csv -o both.svg --json");
    let said: serde_json::Value = serde_json::from_str(&said).expect("JSON");
    assert_eq!(said["rows"], 22, "runs of other seeds are other runs");
    assert_eq!(said["advice"].as_array().map(Vec::len), Some(2));
    let note = said["notes"][0].as_str().expect("a note");
    assert!(note.contains("several machines") && note.contains("another"), "{note}");
    bench.write("c.csv", TABLE.replace("box:v2:0", "box:v2:1"));
    let output = bench.nst("chart a.csv c.csv -o both.svg");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("fingerprint") && stderr.contains("'box:v2:1'"), "{stderr}");
}

#[test]
fn tables_that_cannot_be_drawn() {
    let bench = Bench::new();
    let two = TABLE.to_owned() + &TABLE.lines().nth(1).expect("a row").replacen("box", "<c>", 1);
    for (name, content) in [
        ("two.csv", two.as_str()),
        ("empty.csv", ""),
        ("old.csv", "scene,method,spp,run,mse\nbox,none,8,0,1\n"),
        ("later.csv", &TABLE.replace("0.1.0,6,", "0.2.0,7,")),
        ("word.csv", &TABLE.replace("0.006,", "much,")),
    ] {
        bench.write(name, content);
    }
    bench.refuses("chart two.csv", &["--scene", "'box'", "'<c>'"]);
    bench.refuses("chart two.csv --scene no", &["'no'", "'box'", "'<c>'"]);
    let before = bench.snapshot();
    for (name, words) in [
        ("empty.csv", ["is empty", "nst bench scene"]),
        ("old.csv", ["columns are missing: relmse, ", "nst bench scene"]),
        ("later.csv", ["version '7'", "version 6"]),
        ("word.csv", ["line 4, column mse", "'much' is no number"]),
        ("gone.csv", ["cannot read", "gone.csv"]),
    ] {
        let output = bench.nst(&format!("chart {name}"));
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{name}: {stderr}");
        for word in [&[name], &words[..]].concat() {
            assert!(stderr.contains(word), "'{word}' is not in: {stderr}");
        }
    }
    assert!(bench.snapshot() == before);
    std::fs::create_dir(bench.path("folder")).expect("a folder");
    for folder in [".", "folder"] {
        let output = bench.nst(&format!("chart {folder}"));
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{stderr}");
        assert!(stderr.contains(&format!("cannot read '{folder}': it is a folder")), "{stderr}");
    }
    bench.succeed("chart two.csv --scene <c> --metric smape");
    assert!(bench.files().contains(&"two.svg".to_owned()));
}

/// The charts of the documentation are what its tables say, and so are the sentences.
#[test]
fn the_documentation_shows_its_tables() {
    let docs = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
    let page = std::fs::read_to_string(docs.join("work-precision.md")).expect("the page");
    let bench = Bench::new();
    let mut scenes = 0;
    for file in std::fs::read_dir(docs.join("work-precision")).expect("the tables") {
        let table = file.expect("a file").path();
        if table.extension().is_none_or(|extension| extension != "csv") {
            continue;
        }
        scenes += 1;
        let name = table.file_stem().and_then(|stem| stem.to_str()).expect("a scene");
        bench.write("t.csv", std::fs::read(&table).expect("a table"));
        bench.succeed("chart t.csv -q -o t.svg");
        let drawn = std::fs::read_to_string(bench.path("t.svg")).expect("a chart");
        let shown = std::fs::read_to_string(table.with_extension("svg")).expect("a chart");
        assert!(drawn == shown, "{name}.svg is not what nst chart draws of {name}.csv");
        assert!(page.contains(&format!("](work-precision/{name}.svg)")), "{name} is not shown");
        for metric in ["mse", "relmse"] {
            let said = bench.succeed(&format!("chart t.csv -o t.svg --json --metric {metric}"));
            let said: serde_json::Value = serde_json::from_str(&said).expect("JSON");
            let sentence = said["advice"][0].as_str().expect("a sentence");
            assert!(page.contains(sentence), "{name}: the page does not say: {sentence}");
        }
    }
    assert_eq!(scenes, page.matches("](work-precision/").count(), "charts without a table");
}

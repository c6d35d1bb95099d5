use roxmltree::{Document, Node};

use super::*;
use crate::results::Row;

fn row(method: &str, spp: u32, run: u32, mse: f64, seconds: f64) -> Row {
    Row {
        scene: "box".into(),
        method: method.into(),
        spp,
        run,
        mse: Some(mse),
        total_seconds: Some(seconds),
        width: 64,
        height: 32,
        ..Row::default()
    }
}

/// Plain sampling and `others` methods, all as good, at three sample counts.
fn table(others: usize) -> Vec<Row> {
    let names = (0..others).map(|i| format!("method-{i}"));
    let all = ["none".to_owned()].into_iter().chain(names).enumerate();
    let of_method = |(i, name): (usize, String)| {
        let worse = 1.0 + i as f64 / 10.0;
        [8_u32, 32, 128].map(|spp| row(&name, spp, 0, worse / f64::from(spp), f64::from(spp)))
    };
    all.flat_map(of_method).collect()
}

fn draw(rows: Vec<Row>, metrics: &[Metric]) -> Chart {
    Chart::draw(&Results::of(rows).expect("rows that fit together"), metrics)
}

fn of_class<'a>(document: &'a Document, class: &str) -> Vec<Node<'a, 'a>> {
    let nodes = document.descendants();
    nodes.filter(|node| node.attribute("class") == Some(class)).collect()
}

fn number(text: &str) -> f64 {
    text.parse().expect("a number")
}

/// The mean of the corners of a polygon.
fn center(corners: &str) -> [f64; 2] {
    let corners = corners.split(' ').map(|corner| corner.split_once(',').expect("x,y"));
    let corners: Vec<_> = corners.map(|(x, y)| [number(x), number(y)]).collect();
    [0, 1].map(|axis| corners.iter().map(|corner| corner[axis]).sum::<f64>() / corners.len() as f64)
}

fn texts(document: &Document) -> String {
    let nodes = document.descendants().filter(|node| node.has_tag_name("text"));
    let lines = nodes.map(|node| {
        node.descendants().filter(Node::is_text).filter_map(|it| it.text()).collect::<String>()
    });
    lines.collect::<Vec<_>>().join("\n")
}

#[test]
fn marks_are_where_the_svg_has_them() {
    let chart = draw(table(2), &[Metric::Mse]);
    let document = Document::parse(&chart.svg).expect("XML");
    let discs: Vec<_> = of_class(&document, "mark");
    // 3 methods at 3 sample counts in two plots, and at 3 budgets of 10, 20, 50, 100 s.
    assert_eq!(chart.marks.len(), 2 * 9 + 3 * 4);
    assert_eq!(discs.len(), chart.marks.len());
    let agree = |node: &Node, mark: &Mark| {
        let title = node.children().find(|child| child.has_tag_name("title"));
        let place = match node.attribute("points") {
            None => ["cx", "cy"].map(|name| number(node.attribute(name).expect("a disc"))),
            Some(corners) => center(corners),
        };
        title.and_then(|title| title.text()) == Some(&*mark.label)
            && (place[0] - mark.x).abs() < 0.02
            && (place[1] - mark.y).abs() < 0.02
    };
    for (node, mark) in discs.iter().zip(&chart.marks) {
        assert!(agree(node, mark), "{node:?} {mark:?}");
        assert!(!agree(node, &Mark { x: mark.x + 0.1, ..mark.clone() }));
        assert!(!agree(node, &Mark { label: "another".into(), ..mark.clone() }));
    }
    let label = "method-1 at 32 spp: MSE 0.0375, 32 s";
    assert_eq!(chart.marks.iter().filter(|mark| mark.label == label).count(), 2);
}

#[test]
fn of_many_methods_few_are_named() {
    let chart = draw(table(25), &[Metric::Mse]);
    let document = Document::parse(&chart.svg).expect("XML");
    let all = texts(&document);
    for name in ["plain sampling", "method-0", "method-5"] {
        assert_eq!(all.lines().filter(|line| *line == name).count(), 3, "{name}");
    }
    assert!(!all.lines().any(|line| line == "method-6"), "{all}");
    assert!(
        all.replace('\n', " ").contains("In grey, where within a plot: method-6, method-7,"),
        "{all}"
    );
    // Thin lines: 19 methods in three plots, as far as they are within.
    let grey = of_class(&document, "curve").into_iter();
    let grey = grey.filter(|node| node.attribute("stroke") == Some(Ink::Muted.light()));
    assert!((19..=3 * 19).contains(&grey.count()));
}

/// Named methods fill the plots, however bad the others are.
#[test]
fn bad_methods_do_not_press_the_others_together() {
    let mut rows = table(8);
    let bad = rows.iter_mut().filter(|row| row.method == "method-7");
    // Its last point alone is as good as the others'.
    bad.take(2).for_each(|row| row.mse = Some(1e6));
    let chart = draw(rows, &[Metric::Mse]);
    let height = |label: &str| {
        let mark = chart.marks.iter().find(|mark| mark.label.starts_with(label));
        mark.map(|mark| mark.y)
    };
    let [first, last] = ["plain sampling at 8", "plain sampling at 128"].map(height);
    assert!(last.zip(first).is_some_and(|(last, first)| last - first > 200.0));
    assert_eq!(height("method-7 at 8 "), None);
    assert!(height("method-7 at 128 ").is_some());
    let document = Document::parse(&chart.svg).expect("XML");
    let corners = of_class(&document, "curve").into_iter().flat_map(|node| {
        let points = node.attribute("points").expect("a line").split(' ');
        points.map(|point| number(point.split_once(',').expect("x,y").1)).collect::<Vec<_>>()
    });
    assert!(corners.fold(f64::INFINITY, f64::min) > 100.0);
}

#[test]
fn what_is_left_out_is_said() {
    let mut rows = table(2);
    rows[8].mse = Some(-1e-9);
    rows.push(Row { mse: Some(0.0), ..row("zero", 8, 0, 0.0, 1.0) });
    rows.push(Row { total_seconds: None, ..row("other program", 8, 0, 0.1, 1.0) });
    rows.push(Row { failure: Some("no <picture> & more.".into()), mse: None, ..rows[0].clone() });
    rows.last_mut().expect("a row").method = "failed".into();
    rows.push(Row { machine: "another".into(), ..row("none", 8, 1, 0.2, 9.0) });
    rows[0].machine = "one".into();
    let chart = draw(rows, &[Metric::Mse, Metric::RelMse]);
    let document = Document::parse(&chart.svg).expect("XML");
    let all = texts(&document).replace('\n', " ");
    for words in [
        "method-1 at 128 spp, zero at 8 spp",
        "0 or less",
        "Without a time, and so only against samples: other program.",
        "Failed: failed at 8 spp: no <picture> & more.",
        "one; another",
        "several machines",
        "times are medians over the runs",
        "64 × 32 pixels · 1 to 2 runs per point",
        "8 s",
    ] {
        assert!(all.contains(words), "'{words}' is not in: {all}");
    }
    // Nobody measured it.
    assert!(!all.contains("relMSE"), "{all}");
    assert!(!chart.svg.contains("NaN") && !chart.svg.contains("inf"));
}

#[test]
fn nothing_and_one_point() {
    let one = draw(vec![row("none", 8, 0, 0.5, 2.0)], &[Metric::Mse, Metric::RelMse]);
    let document = Document::parse(&one.svg).expect("XML");
    assert_eq!(of_class(&document, "mark").len(), 2);
    assert!(texts(&document).contains("Only plain sampling was measured"));
    let why = Some("the lights are out.".to_owned());
    let failed = Row { mse: None, failure: why, ..row("none", 8, 0, 0.5, 2.0) };
    let none = draw(vec![failed], &[Metric::Mse, Metric::RelMse]);
    let document = Document::parse(&none.svg).expect("XML");
    assert!(of_class(&document, "mark").is_empty());
    assert!(texts(&document).contains("Failed: plain sampling at 8 spp: the lights are out."));
    for chart in [&one, &none] {
        assert!(!chart.svg.contains("NaN") && !chart.svg.contains("inf"), "{}", chart.svg);
        let (size, pixels) = chart.pixels();
        assert_eq!((size[0], pixels.len()), (1920, (size[0] * size[1] * 3) as usize));
    }
}

#[test]
fn numbers_of_all_sizes() {
    for scale in [1e-300, 1e-30, 1.0, 1e30, 1e290, f64::MAX] {
        let rows = [8, 32].into_iter().flat_map(|spp| {
            // Their sum is beyond the range of f64, and so is the ratio of both methods' errors.
            let runs = [scale / f64::from(spp / 8), 0.9 * scale];
            let of = |method: &str, run: u32, mse: f64| row(method, spp, run, mse, scale);
            [of("none", 0, runs[0]), of("none", 1, runs[1]), of("a", 0, 1e-308)]
        });
        let chart = draw(rows.collect(), &[Metric::Mse]);
        let odd = |line: &&str| line.contains("NaN") || line.contains("inf");
        assert_eq!(chart.svg.lines().find(odd), None, "{scale}");
        assert!(chart.marks.iter().all(|mark| (0.0..WIDTH).contains(&mark.x)), "{scale}");
    }
}

/// Runs are averaged, and points of one place are drawn once.
#[test]
fn large_tables_give_small_charts() {
    let runs = (0..50_000).map(|run| row("none", 8, run, 1.0 + f64::from(run), 1.0));
    let counts = (1..50_000).map(|spp| row("a", spp, 0, 1.0 / f64::from(spp), f64::from(spp)));
    let chart = draw(runs.chain(counts).collect(), &[Metric::Mse]);
    assert!(chart.svg.len() < 1 << 20, "{} bytes", chart.svg.len());
    assert!(chart.marks.len() < 5000, "{} marks", chart.marks.len());
    let methods = (0..1000).flat_map(|i| {
        [8_u32, 16, 32].map(|spp| row(&i.to_string(), spp, 0, f64::from(i + 1), f64::from(spp)))
    });
    let chart = draw(table(0).into_iter().chain(methods).collect(), &[Metric::Mse]);
    assert!(chart.svg.len() < 1 << 22, "{} bytes", chart.svg.len());
}

#[test]
fn guides_are_drawn_where_there_is_room() {
    let keys = |reference: f64| {
        let mut rows = table(1);
        rows.iter_mut().for_each(|row| row.reference_mse = Some(reference));
        // Falls by less than in theory, so that the line of theory leaves the plot.
        rows[2].mse = Some(0.1);
        rows[5].mse = Some(0.1);
        let chart = draw(rows, &[Metric::Mse]);
        let document = Document::parse(&chart.svg).expect("XML");
        let bottom = |node: &Node| node.attribute("points").map(str::to_owned);
        let guides: Vec<_> = of_class(&document, "guide").iter().filter_map(bottom).collect();
        (guides, texts(&document))
    };
    let (guides, text) = keys(0.05);
    assert_eq!(guides.len(), 3);
    assert_eq!(text.matches("the reference's own MSE").count(), 2);
    assert!(text.contains("slope −1 of plain sampling"), "{text}");
    let (guides, text) = keys(1e-9);
    assert_eq!((guides.len(), text.matches("own MSE").count()), (1, 0));
}

#[test]
fn every_color_has_a_dark_twin() {
    let chart = draw(table(25), &[Metric::Mse]);
    let document = Document::parse(&chart.svg).expect("XML");
    let style = document.descendants().find(|node| node.has_tag_name("style"));
    let style = style.and_then(|style| style.text()).expect("a style");
    assert!(style.starts_with("@media (prefers-color-scheme:dark)"), "{style}");
    let mut seen = 0;
    for node in document.descendants() {
        for property in ["fill", "stroke"] {
            let Some(color) = node.attribute(property).filter(|it| *it != "none") else { continue };
            let rule = format!(".nst-chart [{property}='{color}']{{{property}:#");
            assert!(style.contains(&rule), "{rule}");
            seen += 1;
        }
    }
    assert!(seen > 100, "{seen}");
}

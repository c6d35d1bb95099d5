//! Work-precision diagrams out of a table of results: error against time, against samples, and
//! at equal time.
//!
//! A [`canvas::Canvas`] is a list of shapes, which [`svg`] writes and [`paint`] turns
//! into pixels; so both show the same.

mod canvas;
mod font;
mod notes;
mod paint;
mod palette;
mod panels;
mod plot;
mod scale;
mod select;
mod svg;

pub(crate) use canvas::Mark;

use canvas::{Anchor, Canvas};
use font::Font;
use palette::Ink;
use plot::{Area, Plot};
use select::Styles;

use crate::results::{Curves, Metric, Results, advice};

/// Pixels of the whole width, so that texts of 12 pixels can be read where it is shown 900
/// wide; of the border, and between plots.
const WIDTH: f64 = 960.0;
const BORDER: f64 = 24.0;
const GAP: f64 = 20.0;

/// Heights of plots in pixels: the first of a single metric, and all others.
const LARGE: f64 = 420.0;
const SMALL: f64 = 310.0;

/// Pixels of the PNG per pixel of the SVG, for sharp screens and for print.
const PNG_SCALE: f64 = 2.0;

/// A chart.
#[derive(Clone, Debug)]
pub(crate) struct Chart {
    /// A whole SVG document.
    pub(crate) svg: String,
    /// All marks, plot by plot, and method by method; places are in the SVG's units.
    pub(crate) marks: Vec<Mark>,
    canvas: Canvas,
}

impl Chart {
    /// Draws the results by these metrics; of a metric that was not measured, nothing, if
    /// another was.
    pub(crate) fn draw(results: &Results, metrics: &[Metric]) -> Self {
        Self::make(results, metrics, true)
    }

    /// The same without title and advice, for pages that say both.
    pub(crate) fn without_heading(results: &Results, metrics: &[Metric]) -> Self {
        Self::make(results, metrics, false)
    }

    fn make(results: &Results, metrics: &[Metric], headed: bool) -> Self {
        let mut all: Vec<Curves> = metrics.iter().map(|metric| results.curves(*metric)).collect();
        let measured = |curves: &Curves| !curves.curves.is_empty();
        if all.iter().any(measured) {
            all.retain(measured);
        } else {
            all.truncate(1);
        }
        let styles = Styles::choose(&all);
        let mut canvas = Canvas::new(WIDTH);
        let title = format!("{}: error against time and samples", results.scene());
        let mut sentences: Vec<_> =
            all.iter().map(|curves| advice(results, curves.metric)).collect();
        sentences.dedup();
        let mut y = BORDER;
        if headed {
            heading(&mut canvas, &mut y, results, &title, &sentences);
        }
        plots(&mut canvas, &mut y, results, &all, &styles);
        for note in notes::below(results, &all, &styles) {
            paragraph(&mut canvas, &mut y, &note, (Font::regular(12.0), Ink::Soft), 4);
            y += 4.0;
        }
        canvas.size[1] = (y + BORDER - 10.0).ceil();
        // The paper, whose height is known only now, is below all that is drawn on it.
        canvas.rectangle("paper", [0.0, WIDTH], [0.0, canvas.size[1]], Ink::Paper);
        canvas.shapes.rotate_right(1);
        let svg = svg::write(&canvas, &title, &sentences.join(" "));
        Self { svg, marks: canvas.marks.clone(), canvas }
    }

    /// The chart as pixels on light paper: width and height, and bytes `[y][x][rgb]`.
    pub(crate) fn pixels(&self) -> ([u32; 2], Vec<u8>) {
        paint::paint(&self.canvas, PNG_SCALE).expect("charts are some thousand pixels high")
    }
}

fn heading(canvas: &mut Canvas, y: &mut f64, results: &Results, title: &str, advice: &[String]) {
    *y += 6.0;
    paragraph(canvas, y, title, (Font::bold(20.0), Ink::Text), 1);
    *y += 2.0;
    paragraph(canvas, y, &notes::subtitle(results), (Font::regular(12.5), Ink::Soft), 2);
    *y += 6.0;
    for sentence in advice {
        paragraph(canvas, y, sentence, (Font::regular(14.0), Ink::Text), 3);
        *y += 3.0;
    }
    *y += 12.0;
}

/// Lines of text over the whole width, at most `most`; `y` moves below them.
fn paragraph(canvas: &mut Canvas, y: &mut f64, text: &str, (font, ink): (Font, Ink), most: usize) {
    for line in font.wrap(text, WIDTH - 2.0 * BORDER, most) {
        *y += font.size * 1.3;
        canvas.text([BORDER, *y - font.size * 0.3], line, (font, Anchor::Start, ink));
    }
}

/// Two columns; `y` moves below them. One metric alone has a large plot against time above
/// them.
fn plots(canvas: &mut Canvas, y: &mut f64, results: &Results, all: &[Curves], styles: &Styles) {
    let reference_mse = |curves: &Curves| {
        let of_mse = curves.metric == Metric::Mse;
        results.rows().iter().find_map(|row| row.reference_mse).filter(|_| of_mse)
    };
    let time = |curves| panels::against_time(curves, styles, reference_mse(curves));
    let samples = |curves| panels::against_samples(curves, styles, reference_mse(curves));
    let equal = |curves| panels::at_equal_time(curves, styles);
    let whole = WIDTH - 2.0 * BORDER;
    let mut rows: Vec<(f64, Vec<Plot>)> = Vec::new();
    if let [only] = all {
        rows.push((LARGE, vec![time(only)]));
        rows.push((SMALL, vec![samples(only), equal(only)]));
    } else {
        rows.extend(all.iter().map(|curves| (SMALL, vec![time(curves), samples(curves)])));
        rows.push((SMALL, all.iter().map(equal).collect()));
    }
    // Without a second method, for instance, nothing is at equal time.
    rows.retain(|(_, plots)| !plots.iter().all(Plot::is_empty));
    for (height, plots) in rows {
        let width = (whole - GAP * (plots.len() - 1) as f64) / plots.len() as f64;
        for (place, plot) in plots.into_iter().enumerate() {
            let x = BORDER + place as f64 * (width + GAP);
            plot.draw(canvas, Area { x, y: *y, width, height });
        }
        *y += height + GAP;
    }
}

#[cfg(test)]
mod tests;

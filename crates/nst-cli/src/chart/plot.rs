//! One plot: two logarithmic axes, the methods' curves with their names at the ends.

use std::collections::BTreeSet;

use super::{
    canvas::{Anchor, Canvas, Shape, Stroke, Text},
    font::Font,
    palette::{Ink, Style},
    scale::{Label, LogScale, Tick},
};

/// Pixels around the axes: for the title, the numbers and names of the axes, and the methods'
/// names.
const TOP: f64 = 26.0;
const BOTTOM: f64 = 40.0;
const LEFT: f64 = 50.0;
const RIGHT: f64 = 120.0;

const TITLE: Font = Font::bold(14.0);
const NUMBERS: Font = Font::regular(12.0);
const NAMES: Font = Font::regular(12.0);
/// Width and height in pixels of the corner that explains lines.
const KEY: [f64; 2] = [170.0, 44.0];
/// Pixels between the baselines of names.
const LINE: f64 = 15.0;

/// A point of a curve.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Dot {
    /// Values on both axes, above 0.
    pub(super) at: [f64; 2],
    /// A 95 % interval on the vertical axis.
    pub(super) interval: Option<[f64; 2]>,
    pub(super) on_front: bool,
    /// What it stands for.
    pub(super) label: String,
}

/// A method's curve.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Series {
    pub(super) name: String,
    pub(super) style: Style,
    /// From left to right.
    pub(super) dots: Vec<Dot>,
}

/// A line that is no method's.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Guide {
    pub(super) name: String,
    /// Values on both axes.
    pub(super) ends: [[f64; 2]; 2],
    pub(super) stroke: Stroke,
}

/// What a plot shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Plot {
    pub(super) title: String,
    pub(super) x_title: &'static str,
    /// Where the horizontal axis has its ticks, if not at powers of ten.
    pub(super) x_ticks: Option<Vec<f64>>,
    pub(super) series: Vec<Series>,
    pub(super) guides: Vec<Guide>,
    /// Whether the Pareto front is drawn through the dots that are on it.
    pub(super) front: bool,
    /// Below this value, methods are better than the plain estimate.
    pub(super) better_below: Option<f64>,
    /// What is said if there are no dots.
    pub(super) empty: &'static str,
}

/// A rectangle of the canvas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Area {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) width: f64,
    pub(super) height: f64,
}

impl Plot {
    pub(super) fn is_empty(&self) -> bool {
        self.series.iter().all(|series| series.dots.is_empty())
    }

    pub(super) fn draw(self, canvas: &mut Canvas, area: Area) {
        let (left, right) = (area.x + LEFT, area.x + area.width - RIGHT);
        let (top, bottom) = (area.y + TOP, area.y + area.height - BOTTOM);
        let dots = || self.series.iter().flat_map(|series| &series.dots);
        // Methods without a name may be worse by powers of ten; they must not press the others
        // together.
        let named = || self.series.iter().filter(|series| !series.style.is_muted());
        let of_named = || named().flat_map(|series| &series.dots);
        let tall: Vec<&Dot> =
            if of_named().next().is_some() { of_named().collect() } else { dots().collect() };
        let heights = tall.into_iter().flat_map(|dot| {
            // Intervals that reach far down would press the curves together.
            let [low, high] = dot.interval.unwrap_or([dot.at[1]; 2]);
            [dot.at[1], low.max(dot.at[1] / 3.0), high]
        });
        let x = LogScale::over(dots().map(|dot| dot.at[0]), [left, right]);
        let y = LogScale::over(heights.chain(self.better_below), [bottom, top]);
        let mut drawing = Drawing { canvas, x, y };
        drawing.canvas.text(
            [area.x, area.y + 12.0],
            TITLE.shorten(&self.title, area.width),
            (TITLE, Anchor::Start, Ink::Text),
        );
        if self.is_empty() {
            let middle = [area.x + area.width / 2.0, (top + bottom) / 2.0];
            drawing.canvas.text(middle, self.empty, (NAMES, Anchor::Middle, Ink::Soft));
            return;
        }
        if let Some(level) = self.better_below {
            let level = drawing.y.at(level);
            drawing.canvas.rectangle("better", [left, right], [level, bottom], Ink::Better);
        }
        drawing.axes(self.x_title, self.x_ticks.as_deref());
        if self.front {
            drawing.front(&self.series);
        }
        drawing.guides(&self.guides, self.front, &self.series);
        drawing.muted(&self.series);
        // The plain estimate comes first, and is drawn last.
        for series in self.series.iter().rev().filter(|series| !series.style.is_muted()) {
            drawing.curve(series);
        }
        drawing.names(&self.series);
    }
}

/// A plot that is being drawn.
struct Drawing<'a> {
    canvas: &'a mut Canvas,
    x: LogScale,
    y: LogScale,
}

impl Drawing<'_> {
    fn at(&self, value: [f64; 2]) -> [f64; 2] {
        [self.x.at(value[0]), self.y.at(value[1])]
    }

    fn axes(&mut self, x_title: &str, x_ticks: Option<&[f64]>) {
        let ([left, right], [bottom, top]) = (self.x.pixels(), self.y.pixels());
        let given = |values: &[f64]| {
            let tick = |&value: &f64| Tick { value, label: Some(Label::plain(value)) };
            values.iter().map(tick).collect()
        };
        let mut used = f64::NEG_INFINITY;
        for tick in x_ticks.map_or_else(|| self.x.ticks(), given) {
            let x = self.x.at(tick.value);
            let label = tick.label.filter(|label| {
                // Labels that would touch are left out.
                let half =
                    (NUMBERS.width(&label.text) + 0.7 * NUMBERS.width(&label.exponent)) / 2.0;
                let fits = x - half > used + 5.0;
                if fits {
                    used = x + half;
                }
                fits
            });
            self.tick([x, bottom], [x, top], [0.0, 1.0], label.is_some());
            if let Some(label) = label {
                self.label([x, bottom + 18.0], label, Anchor::Middle);
            }
        }
        for tick in self.y.ticks() {
            let y = self.y.at(tick.value);
            self.tick([left, y], [right, y], [-1.0, 0.0], tick.label.is_some());
            if let Some(label) = tick.label {
                self.label([left - 8.0, y + 4.0], label, Anchor::End);
            }
        }
        let frame = vec![[left, top], [left, bottom], [right, bottom]];
        self.canvas.line("axis", frame, Stroke::solid(Ink::Soft, 1.0));
        let middle = [(left + right) / 2.0, bottom + 35.0];
        self.canvas.text(middle, x_title, (NUMBERS, Anchor::Middle, Ink::Soft));
    }

    /// A tick at the axis, outwards; those with a label have a line through the plot.
    fn tick(&mut self, at: [f64; 2], end: [f64; 2], out: [f64; 2], labelled: bool) {
        if labelled {
            self.canvas.line("grid", vec![at, end], Stroke::solid(Ink::Grid, 1.0));
        }
        let length = if labelled { 5.0 } else { 3.0 };
        let tip = [at[0] + length * out[0], at[1] + length * out[1]];
        self.canvas.line("tick", vec![at, tip], Stroke::solid(Ink::Soft, 1.0));
    }

    fn label(&mut self, at: [f64; 2], Label { text, exponent }: Label, anchor: Anchor) {
        let (font, ink) = (NUMBERS, Ink::Soft);
        self.canvas.shapes.push(Shape::Text(Text { at, text, exponent, font, anchor, ink }));
    }

    /// The least error for each time: steps through the dots on the front.
    fn front(&mut self, series: &[Series]) {
        let dots = series.iter().flat_map(|series| &series.dots).filter(|dot| dot.on_front);
        let mut corners: Vec<[f64; 2]> = dots.map(|dot| self.at(dot.at)).collect();
        corners.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut steps: Vec<[f64; 2]> = Vec::new();
        for corner in corners {
            if let Some(&[_, y]) = steps.last() {
                steps.push([corner[0], y]);
            }
            steps.push(corner);
        }
        if let Some(&[_, y]) = steps.last() {
            steps.push([self.x.pixels()[1], y]);
            let steps = thin(&steps, 0.5);
            self.canvas.line("front", steps, Stroke::solid(Ink::Front, 7.0));
        }
    }

    /// Lines that are no method's, and in a corner what they are.
    fn guides(&mut self, guides: &[Guide], front: bool, series: &[Series]) {
        let ([left, right], [bottom, top]) = (self.x.pixels(), self.y.pixels());
        // Curves mostly fall: the lower left corner is free, or else the upper right one.
        let corner = |dot: &Dot| {
            let [x, y] = self.at(dot.at);
            x < left + KEY[0] && y > bottom - KEY[1]
        };
        let taken = series.iter().flat_map(|series| &series.dots).any(corner);
        let (left, mut row, step) = match taken {
            false => (left + 8.0, bottom - 9.0, -14.0),
            true => (right - KEY[0], top + 12.0, 14.0),
        };
        let mut explain = |canvas: &mut Canvas, name: &str, stroke: Stroke| {
            let sample = vec![[left, row - 4.0], [left + 22.0, row - 4.0]];
            canvas.line("sample", sample, stroke);
            canvas.text([left + 28.0, row], name, (Font::regular(11.0), Anchor::Start, Ink::Soft));
            row += step;
        };
        if front {
            explain(self.canvas, "Pareto front", Stroke::solid(Ink::Front, 7.0));
        }
        for guide in guides {
            if let Some(ends) = self.clip(guide.ends) {
                self.canvas.line("guide", ends.to_vec(), guide.stroke);
                explain(self.canvas, &guide.name, guide.stroke);
            }
        }
    }

    /// The part of a line that is within the heights of the plot, in pixels.
    fn clip(&self, ends: [[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
        let [start, end] = ends.map(|end| self.at(end));
        let [bottom, top] = self.y.pixels();
        let inside = |y: f64| (top..=bottom).contains(&y);
        if !inside(start[1]) && (!inside(end[1]) || start[1] == end[1]) {
            return None;
        }
        let at_height = |y: f64| {
            let share = (y - start[1]) / (end[1] - start[1]);
            [start[0] + share * (end[0] - start[0]), y]
        };
        let clipped = |end: [f64; 2]| {
            if inside(end[1]) { end } else { at_height(end[1].clamp(top, bottom)) }
        };
        Some([clipped(start), clipped(end)])
    }

    /// Methods without a name: thin, with small marks, none upon another; as far as they are
    /// within the plot.
    fn muted(&mut self, series: &[Series]) {
        let mut taken = BTreeSet::new();
        for Series { style, dots, .. } in series.iter().filter(|series| series.style.is_muted()) {
            let mut line: Vec<[f64; 2]> = Vec::new();
            for pair in dots.windows(2) {
                let Some([start, end]) = self.clip([pair[0].at, pair[1].at]) else { continue };
                if line.last() != Some(&start) {
                    self.path(&line, style);
                    line = vec![start];
                }
                line.push(end);
            }
            self.path(&line, style);
            for dot in dots.iter().filter(|dot| self.y.contains(dot.at[1])) {
                let at = self.at(dot.at);
                // Cells of four pixels, about as large as a mark.
                if taken.insert(at.map(|pixel| (pixel / 4.0).floor() as i64)) {
                    let marker = (style.marker, style.radius);
                    self.canvas.marker(marker, at, style.ink, Some(dot.label.clone()));
                }
            }
        }
    }

    fn path(&mut self, places: &[[f64; 2]], style: &Style) {
        let stroke = Stroke { ink: style.ink, width: style.width, dash: style.dash };
        if places.len() > 1 {
            self.canvas.line("curve", thin(places, 0.5), stroke);
        }
    }

    fn curve(&mut self, Series { style, dots, .. }: &Series) {
        let places: Vec<_> = dots.iter().map(|dot| self.at(dot.at)).collect();
        self.path(&places, style);
        let mut last = [f64::NEG_INFINITY; 2];
        for dot in dots {
            let [x, y] = self.at(dot.at);
            if (x - last[0]).hypot(y - last[1]) < 1.5 {
                continue;
            }
            last = [x, y];
            if dot.on_front {
                self.canvas.ring([x, y], style.radius + 2.8);
            }
            if let Some(interval) = dot.interval {
                let [low, high] = interval.map(|end| self.y.at(self.y.clamp(end)));
                let stroke = Stroke::solid(style.ink, 1.2);
                self.canvas.line("interval", vec![[x, low], [x, high]], stroke);
                for (end, y) in interval.into_iter().zip([low, high]) {
                    if self.y.contains(end) {
                        self.canvas.line("cap", vec![[x - 3.0, y], [x + 3.0, y]], stroke);
                    }
                }
            }
            let marker = (style.marker, style.radius);
            self.canvas.marker(marker, [x, y], style.ink, Some(dot.label.clone()));
        }
    }

    /// The methods' names beside the ends of their curves, none upon another.
    fn names(&mut self, series: &[Series]) {
        let ([_, right], [bottom, top]) = (self.x.pixels(), self.y.pixels());
        let named = series.iter().filter(|series| !series.style.is_muted());
        let mut ends: Vec<_> =
            named.filter_map(|it| Some((self.at(it.dots.last()?.at), it))).collect();
        ends.sort_by(|a, b| a.0[1].total_cmp(&b.0[1]));
        let wanted: Vec<f64> = ends.iter().map(|(end, _)| end[1]).collect();
        let rows = spread(&wanted, LINE, [top, bottom]);
        for ((end, Series { name, style, .. }), y) in ends.into_iter().zip(rows) {
            let x = right + 14.0;
            let leader = vec![[end[0] + 6.0, end[1]], [x - 7.0, y]];
            if leader[0][0] < leader[1][0] {
                self.canvas.line("leader", leader, Stroke::solid(Ink::Muted, 0.7));
            }
            self.canvas.marker((style.marker, style.radius), [x, y], style.ink, None);
            let text = NAMES.shorten_middle(name, RIGHT - 24.0);
            self.canvas.text([x + 9.0, y + 4.0], text, (NAMES, Anchor::Start, Ink::Text));
        }
    }
}

/// The places nearest to the wanted ones (by least squares), in their order, at least `gap`
/// apart and within the limits, if there is room.
fn spread(wanted: &[f64], gap: f64, [low, high]: [f64; 2]) -> Vec<f64> {
    // Without the gaps, places must not fall: neighbours that would are pooled, as in isotonic
    // regression. Each pool has a sum and a count.
    let mut pools: Vec<(f64, usize)> = Vec::new();
    let mean = |(sum, count): (f64, usize)| sum / count as f64;
    for (i, place) in wanted.iter().enumerate() {
        let mut pool = (place - gap * i as f64, 1);
        while let Some(before) = pools.pop_if(|before| mean(*before) > mean(pool)) {
            pool = (pool.0 + before.0, pool.1 + before.1);
        }
        pools.push(pool);
    }
    let most = high - gap * wanted.len().saturating_sub(1) as f64;
    let places = pools.into_iter().flat_map(|pool| std::iter::repeat_n(mean(pool), pool.1));
    places.enumerate().map(|(i, place)| place.min(most).max(low) + gap * i as f64).collect()
}

/// The first and last point, and of the others those that are at least `gap` from the one
/// before.
fn thin(points: &[[f64; 2]], gap: f64) -> Vec<[f64; 2]> {
    let mut kept: Vec<[f64; 2]> = Vec::new();
    for (i, &point) in points.iter().enumerate() {
        let far = |last: &[f64; 2]| (point[0] - last[0]).hypot(point[1] - last[1]) >= gap;
        if kept.last().is_none_or(far) || i + 1 == points.len() {
            kept.push(point);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_do_not_overlap() {
        let limits = [0.0, 100.0];
        assert_eq!(spread(&[10.0, 50.0], 15.0, limits), [10.0, 50.0]);
        // In the middle of what both want.
        assert_eq!(spread(&[10.0, 12.0, 60.0], 15.0, limits), [3.5, 18.5, 60.0]);
        assert_eq!(spread(&[-3.0, 98.0, 99.0, 99.0], 15.0, limits), [0.0, 70.0, 85.0, 100.0]);
        // Too many: they stay in order.
        let many = spread(&[50.0; 20], 15.0, limits);
        assert!(many.windows(2).all(|pair| pair[1] - pair[0] >= 14.9), "{many:?}");
    }

    #[test]
    fn lines_keep_their_ends() {
        let points: Vec<_> = (0..=1000).map(|i| [f64::from(i) * 0.1, 0.0]).collect();
        let kept = thin(&points, 10.0);
        assert_eq!((kept[0], kept[kept.len() - 1]), ([0.0, 0.0], [100.0, 0.0]));
        assert!((10..13).contains(&kept.len()), "{}", kept.len());
        assert_eq!(thin(&[[1.0, 2.0]], 10.0), [[1.0, 2.0]]);
    }
}

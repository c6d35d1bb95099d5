//! What a chart consists of: a list of shapes, from the lowest to the highest, which is written
//! as SVG and painted as PNG; and the places of its marks.

use super::{
    font::Font,
    palette::{Ink, Marker},
};

/// A mark of a chart with what it stands for.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Mark {
    /// Pixels from the left, in the SVG's own units.
    pub(crate) x: f64,
    /// Pixels from the top.
    pub(crate) y: f64,
    /// The method, and its values.
    pub(crate) label: String,
}

/// Where lines run; lengths are in pixels.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Geometry {
    Line(Vec<[f64; 2]>),
    Polygon(Vec<[f64; 2]>),
    Disc([f64; 2], f64),
}

/// The line of a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stroke {
    pub(super) ink: Ink,
    pub(super) width: f64,
    pub(super) dash: &'static [f64],
}

impl Stroke {
    pub(super) fn solid(ink: Ink, width: f64) -> Self {
        Self { ink, width, dash: &[] }
    }
}

/// Which end of a text stands at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// A line of text.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Text {
    /// On the baseline.
    pub(super) at: [f64; 2],
    pub(super) text: String,
    /// Smaller and higher, after the text.
    pub(super) exponent: String,
    pub(super) font: Font,
    pub(super) anchor: Anchor,
    pub(super) ink: Ink,
}

/// A part of the picture.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    Figure {
        geometry: Geometry,
        stroke: Option<Stroke>,
        fill: Option<Ink>,
        /// What it is, in the SVG.
        class: &'static str,
        /// Shown by browsers under the pointer.
        title: Option<String>,
    },
    Text(Text),
}

/// A picture that is being made.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Canvas {
    /// Width and height in pixels.
    pub(super) size: [f64; 2],
    pub(super) shapes: Vec<Shape>,
    pub(super) marks: Vec<Mark>,
}

impl Canvas {
    /// An empty one; its height grows with what is drawn.
    pub(super) fn new(width: f64) -> Self {
        Self { size: [width, 0.0], shapes: Vec::new(), marks: Vec::new() }
    }

    pub(super) fn line(&mut self, class: &'static str, points: Vec<[f64; 2]>, stroke: Stroke) {
        self.shapes.push(Shape::Figure {
            geometry: Geometry::Line(points),
            stroke: Some(stroke),
            fill: None,
            class,
            title: None,
        });
    }

    pub(super) fn rectangle(&mut self, class: &'static str, x: [f64; 2], y: [f64; 2], fill: Ink) {
        let corners = vec![[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]];
        self.shapes.push(Shape::Figure {
            geometry: Geometry::Polygon(corners),
            stroke: None,
            fill: Some(fill),
            class,
            title: None,
        });
    }

    /// A marker; with a label it is a mark that readers can ask for its values.
    pub(super) fn marker(
        &mut self,
        (marker, radius): (Marker, f64),
        center: [f64; 2],
        ink: Ink,
        label: Option<String>,
    ) {
        let geometry = match marker {
            Marker::Disc => Geometry::Disc(center, radius),
            other => Geometry::Polygon(other.corners(center, radius)),
        };
        if let Some(label) = &label {
            self.marks.push(Mark { x: center[0], y: center[1], label: label.clone() });
        }
        self.shapes.push(Shape::Figure {
            geometry,
            // Keeps marks apart that overlap.
            stroke: Some(Stroke::solid(Ink::Paper, 0.8)),
            fill: Some(ink),
            class: if label.is_some() { "mark" } else { "sample" },
            title: label,
        });
    }

    pub(super) fn ring(&mut self, center: [f64; 2], radius: f64) {
        self.shapes.push(Shape::Figure {
            geometry: Geometry::Disc(center, radius),
            stroke: Some(Stroke::solid(Ink::Soft, 1.1)),
            fill: None,
            class: "ring",
            title: None,
        });
    }

    pub(super) fn text(
        &mut self,
        at: [f64; 2],
        text: impl Into<String>,
        (font, anchor, ink): (Font, Anchor, Ink),
    ) {
        let (text, exponent) = (text.into(), String::new());
        self.shapes.push(Shape::Text(Text { at, text, exponent, font, anchor, ink }));
    }
}

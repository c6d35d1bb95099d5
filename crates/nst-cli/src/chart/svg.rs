//! A canvas as SVG. Colours are those of light paper; a style turns them into others for
//! readers who prefer dark.

use std::io;

use quick_xml::{
    Writer,
    events::{BytesText, Event},
};

use super::{
    canvas::{Anchor, Canvas, Geometry, Shape, Stroke, Text},
    font::{FAMILY, SUPERSCRIPT},
    palette::Ink,
};

type Out = Writer<Vec<u8>>;

/// Writes a canvas; `name` says what the picture shows, `description` what it says.
pub(super) fn write(canvas: &Canvas, name: &str, description: &str) -> String {
    let written = document(canvas, name, description).expect("memory can be written to");
    String::from_utf8(written).expect("all texts are UTF-8")
}

fn document(canvas: &Canvas, name: &str, description: &str) -> io::Result<Vec<u8>> {
    // Indents would become part of texts with exponents; each shape has a line of its own.
    let mut out = Writer::new(Vec::new());
    let [width, height] = canvas.size.map(number);
    out.create_element("svg")
        .with_attributes([
            ("xmlns", "http://www.w3.org/2000/svg"),
            ("class", "nst-chart"),
            ("viewBox", &format!("0 0 {width} {height}")),
            ("width", &width),
            ("height", &height),
            ("font-family", FAMILY),
            ("stroke-linejoin", "round"),
            ("role", "img"),
            ("aria-label", &legal(name)),
        ])
        .write_inner_content(|out| {
            // Tells nst that it may replace the file.
            let program = concat!("nst ", env!("CARGO_PKG_VERSION"));
            out.create_element("metadata").write_text_content(BytesText::new(program))?;
            out.create_element("desc").write_text_content(BytesText::new(&legal(description)))?;
            out.create_element("style").write_text_content(BytesText::new(&dark_style()))?;
            for shape in &canvas.shapes {
                out.write_event(Event::Text(BytesText::new("\n")))?;
                write_shape(out, shape)?;
            }
            Ok(())
        })?;
    let mut bytes = out.into_inner();
    bytes.push(b'\n');
    Ok(bytes)
}

/// The rules that turn every colour into its dark twin.
fn dark_style() -> String {
    let rules = Ink::all().flat_map(|ink| {
        ["fill", "stroke"].map(|property| {
            let (light, dark) = (ink.light(), ink.dark());
            format!(".nst-chart [{property}='{light}']{{{property}:{dark}}}")
        })
    });
    let rules: Vec<String> = rules.collect();
    format!("@media (prefers-color-scheme:dark){{{}}}", rules.join("\n"))
}

fn write_shape(out: &mut Out, shape: &Shape) -> io::Result<()> {
    match shape {
        Shape::Text(text) => write_text(out, text),
        Shape::Figure { geometry, stroke, fill, class, title } => {
            let (name, mut attributes) = outline(geometry);
            attributes.push(("class", (*class).to_owned()));
            attributes.push(("fill", fill.map_or("none", Ink::light).to_owned()));
            attributes.extend(stroke.iter().flat_map(stroke_attributes));
            let attributes = attributes.iter().map(|(key, value)| (*key, value.as_str()));
            let element = out.create_element(name).with_attributes(attributes);
            match title {
                None => element.write_empty()?,
                Some(title) => element.write_inner_content(|out| {
                    let text = legal(title);
                    let title = out.create_element("title");
                    title.write_text_content(BytesText::new(&text)).map(drop)
                })?,
            };
            Ok(())
        }
    }
}

/// The name of the element, and its place.
fn outline(geometry: &Geometry) -> (&'static str, Vec<(&'static str, String)>) {
    let path = |points: &[[f64; 2]]| {
        let points = points.iter().map(|[x, y]| format!("{},{}", number(*x), number(*y)));
        points.collect::<Vec<_>>().join(" ")
    };
    match geometry {
        Geometry::Line(points) => ("polyline", vec![("points", path(points))]),
        Geometry::Polygon(points) => ("polygon", vec![("points", path(points))]),
        Geometry::Disc([x, y], radius) => {
            ("circle", vec![("cx", number(*x)), ("cy", number(*y)), ("r", number(*radius))])
        }
    }
}

fn stroke_attributes(stroke: &Stroke) -> Vec<(&'static str, String)> {
    let mut attributes =
        vec![("stroke", stroke.ink.light().to_owned()), ("stroke-width", number(stroke.width))];
    if !stroke.dash.is_empty() {
        let lengths: Vec<_> = stroke.dash.iter().copied().map(number).collect();
        attributes.push(("stroke-dasharray", lengths.join(" ")));
    }
    attributes
}

fn write_text(out: &mut Out, text: &Text) -> io::Result<()> {
    let ([x, y], size) = (text.at.map(number), number(text.font.size));
    let anchor = match text.anchor {
        Anchor::Start => "start",
        Anchor::Middle => "middle",
        Anchor::End => "end",
    };
    let mut attributes = vec![
        ("x", x.as_str()),
        ("y", &y),
        ("font-size", &size),
        ("text-anchor", anchor),
        ("fill", text.ink.light()),
    ];
    if text.font.bold {
        attributes.push(("font-weight", "bold"));
    }
    let element = out.create_element("text").with_attributes(attributes);
    if text.exponent.is_empty() {
        return element.write_text_content(BytesText::new(&legal(&text.text))).map(drop);
    }
    let (share, rise) = SUPERSCRIPT;
    let [dy, smaller] = [-rise * text.font.size, share * text.font.size].map(number);
    element
        .write_inner_content(|out| {
            out.write_event(Event::Text(BytesText::new(&legal(&text.text))))?;
            out.create_element("tspan")
                .with_attributes([("dy", dy.as_str()), ("font-size", &smaller)])
                .write_text_content(BytesText::new(&text.exponent))
                .map(drop)
        })
        .map(drop)
}

/// Hundredths of a pixel are enough.
fn number(value: f64) -> String {
    // Without "-0".
    ((value * 100.0).round() / 100.0 + 0.0).to_string()
}

/// A text without the characters that XML 1.0 does not allow.
fn legal(text: &str) -> String {
    let allowed = |letter: char| matches!(letter, '\t' | '\n' | '\r' | ' '..='\u{d7ff}' | '\u{e000}'..='\u{fffd}' | '\u{10000}'..);
    let replaced = |letter| if allowed(letter) { letter } else { char::REPLACEMENT_CHARACTER };
    text.chars().map(replaced).collect()
}

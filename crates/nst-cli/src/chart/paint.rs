//! A canvas as pixels, on light paper.

use tiny_skia::{
    FillRule, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke as Pen, StrokeDash, Transform,
};
use ttf_parser::OutlineBuilder;

use super::{
    canvas::{Anchor, Canvas, Geometry, Shape, Stroke, Text},
    font::{Font, SUPERSCRIPT},
    palette::Ink,
};

/// Paints a canvas in `scale` times its size: width and height, and bytes `[y][x][rgb]`.
/// `None` if the picture would be too large.
pub(super) fn paint(canvas: &Canvas, scale: f64) -> Option<([u32; 2], Vec<u8>)> {
    let size = canvas.size.map(|length| (length * scale).ceil() as u32);
    let mut pixels = Pixmap::new(size[0], size[1])?;
    let view = Transform::from_scale(scale as f32, scale as f32);
    for shape in &canvas.shapes {
        match shape {
            Shape::Text(text) => paint_text(&mut pixels, view, text),
            Shape::Figure { geometry, stroke, fill, .. } => {
                let Some(path) = path(geometry) else { continue };
                if let Some(ink) = fill {
                    pixels.fill_path(&path, &color(*ink), FillRule::Winding, view, None);
                }
                if let Some(stroke) = stroke {
                    pixels.stroke_path(&path, &color(stroke.ink), &pen(stroke), view, None);
                }
            }
        }
    }
    // The paper covers all, so that nothing is transparent.
    let rgb = pixels.data().chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]);
    Some((size, rgb.collect()))
}

fn color(ink: Ink) -> Paint<'static> {
    let [red, green, blue] = ink.rgb();
    let mut paint = Paint::default();
    paint.set_color_rgba8(red, green, blue, 255);
    paint.anti_alias = true;
    paint
}

fn pen(stroke: &Stroke) -> Pen {
    let lengths: Vec<f32> = stroke.dash.iter().map(|&length| length as f32).collect();
    Pen {
        width: stroke.width as f32,
        line_join: LineJoin::Round,
        dash: StrokeDash::new(lengths, 0.0),
        ..Pen::default()
    }
}

fn path(geometry: &Geometry) -> Option<Path> {
    let mut builder = PathBuilder::new();
    let points = match geometry {
        Geometry::Disc([x, y], radius) => {
            builder.push_circle(*x as f32, *y as f32, *radius as f32);
            return builder.finish();
        }
        Geometry::Line(points) | Geometry::Polygon(points) => points,
    };
    let (first, rest) = points.split_first()?;
    builder.move_to(first[0] as f32, first[1] as f32);
    for [x, y] in rest {
        builder.line_to(*x as f32, *y as f32);
    }
    if matches!(geometry, Geometry::Polygon(_)) {
        builder.close();
    }
    builder.finish()
}

fn paint_text(pixels: &mut Pixmap, view: Transform, text: &Text) {
    let (share, rise) = SUPERSCRIPT;
    let small = Font { size: share * text.font.size, ..text.font };
    let width = text.font.width(&text.text);
    let start = match text.anchor {
        Anchor::Start => 0.0,
        Anchor::Middle => (width + small.width(&text.exponent)) / 2.0,
        Anchor::End => width + small.width(&text.exponent),
    };
    let at = [text.at[0] - start, text.at[1]];
    let mut glyphs = Glyphs(PathBuilder::new());
    text.font.outline(&text.text, at, &mut glyphs);
    small.outline(&text.exponent, [at[0] + width, at[1] - rise * text.font.size], &mut glyphs);
    if let Some(path) = glyphs.0.finish() {
        pixels.fill_path(&path, &color(text.ink), FillRule::Winding, view, None);
    }
}

/// Outlines of letters as a path.
struct Glyphs(PathBuilder);

impl OutlineBuilder for Glyphs {
    fn move_to(&mut self, x: f32, y: f32) {
        self.0.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.0.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.0.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.0.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.0.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_have_their_colors_and_places() {
        let mut canvas = Canvas::new(20.0);
        canvas.size[1] = 10.0;
        canvas.rectangle("paper", [0.0, 20.0], [0.0, 10.0], Ink::Paper);
        canvas.rectangle("bar", [0.0, 5.0], [0.0, 10.0], Ink::Method(1));
        canvas.line("line", vec![[10.0, 0.0], [10.0, 10.0]], Stroke::solid(Ink::Text, 2.0));
        canvas.text([12.0, 9.0], "█", (Font::regular(10.0), Anchor::Start, Ink::Text));
        let (size, bytes) = paint(&canvas, 2.0).expect("a small picture");
        assert_eq!((size, bytes.len()), ([40, 20], 40 * 20 * 3));
        let pixel = |x: usize, y: usize| &bytes[(y * 40 + x) * 3..][..3];
        assert_eq!(pixel(9, 10), [0xD5, 0x5E, 0x00]);
        assert_eq!(pixel(11, 10), [255; 3]);
        assert_eq!(pixel(20, 10), [0x1B, 0x1F, 0x24]);
        assert_ne!(pixel(20, 10), pixel(9, 10));
        // A letter that the font lacks is a box.
        assert!((26..36).any(|x| pixel(x, 10) != [255; 3]));
    }
}

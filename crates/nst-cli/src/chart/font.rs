//! The font of charts: how wide a text is, where its lines end, and its outlines.
//!
//! It is part of the program, so that a PNG does not depend on the fonts of the machine. Its
//! widths are those of Arial and Helvetica, which stand in the SVG.

use std::sync::LazyLock;

use ttf_parser::{Face, OutlineBuilder};

/// What the SVG asks for.
pub(super) const FAMILY: &str = "Arial, Helvetica, 'Liberation Sans', Arimo, sans-serif";

/// Superscripts are this much smaller than their text, and this share of its size higher.
pub(super) const SUPERSCRIPT: (f64, f64) = (0.72, 0.4);

static REGULAR: LazyLock<Face> =
    LazyLock::new(|| face(include_bytes!("fonts/ChartSans-Regular.ttf")));
static BOLD: LazyLock<Face> = LazyLock::new(|| face(include_bytes!("fonts/ChartSans-Bold.ttf")));

fn face(bytes: &'static [u8]) -> Face<'static> {
    Face::parse(bytes, 0).expect("the font of this program is sound")
}

/// A size in pixels, and whether it is bold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Font {
    pub(super) size: f64,
    pub(super) bold: bool,
}

impl Font {
    pub(super) const fn regular(size: f64) -> Self {
        Self { size, bold: false }
    }

    pub(super) const fn bold(size: f64) -> Self {
        Self { size, bold: true }
    }

    fn face(self) -> &'static Face<'static> {
        if self.bold { &BOLD } else { &REGULAR }
    }

    /// Pixels per unit of the font.
    fn scale(self) -> f64 {
        self.size / f64::from(self.face().units_per_em())
    }

    fn advance(self, letter: char) -> f64 {
        let glyph = self.face().glyph_index(letter).unwrap_or_default();
        f64::from(self.face().glyph_hor_advance(glyph).unwrap_or_default()) * self.scale()
    }

    /// The width of a text in pixels.
    pub(super) fn width(self, text: &str) -> f64 {
        text.chars().map(|letter| self.advance(letter)).sum()
    }

    /// The text, or as much of its start as fits into `width`, with an ellipsis.
    pub(super) fn shorten(self, text: &str, width: f64) -> String {
        if self.width(text) <= width {
            return text.to_owned();
        }
        let room = width - self.advance('…');
        let mut used = 0.0;
        let fits = |letter: &char| {
            used += self.advance(*letter);
            used <= room
        };
        text.chars().take_while(fits).chain(['…']).collect()
    }

    /// The text, or as much of its start and its end as fits into `width`, with an ellipsis
    /// between: names often differ at their ends.
    pub(super) fn shorten_middle(self, text: &str, width: f64) -> String {
        let letters: Vec<char> = text.chars().collect();
        let cut = |kept: usize| -> String {
            let (start, end) = (kept.div_ceil(2), letters.len() - kept / 2);
            letters[..start].iter().chain(&['…']).chain(&letters[end..]).collect()
        };
        if self.width(text) <= width {
            return text.to_owned();
        }
        // No letter is narrower than a pixel.
        let most = letters.len().saturating_sub(1).min(width as usize);
        let fits = |text: &String| self.width(text) <= width;
        (0..=most).rev().map(cut).find(fits).unwrap_or_else(|| "…".to_owned())
    }

    /// The text in lines that are no wider than `width`, at most `most`; the last one says if
    /// there is more.
    pub(super) fn wrap(self, text: &str, width: f64, most: usize) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        let mut line = String::new();
        for word in text.split_whitespace() {
            let longer = if line.is_empty() { word.to_owned() } else { format!("{line} {word}") };
            if self.width(&longer) <= width {
                line = longer;
                continue;
            }
            if lines.len() == most {
                break;
            }
            if !line.is_empty() {
                lines.push(line);
            }
            // A word that is too wide by itself.
            line = self.shorten(word, width);
        }
        lines.push(line);
        if lines.len() > most {
            lines.truncate(most);
            if let Some(last) = lines.last_mut() {
                *last = self.shorten(&format!("{last} ………"), width);
            }
        }
        lines
    }

    /// Passes the outlines of a text to a builder that gets them in pixels, with y downwards;
    /// the text begins at `at`, on its baseline.
    pub(super) fn outline(self, text: &str, at: [f64; 2], builder: &mut impl OutlineBuilder) {
        let mut placed = Placed { at, scale: self.scale(), builder };
        for letter in text.chars() {
            let glyph = self.face().glyph_index(letter).unwrap_or_default();
            // A space has no outline.
            let _ = self.face().outline_glyph(glyph, &mut placed);
            placed.at[0] += self.advance(letter);
        }
    }
}

/// Moves and scales outlines.
struct Placed<'a, B> {
    at: [f64; 2],
    scale: f64,
    builder: &'a mut B,
}

impl<B> Placed<'_, B> {
    fn map(&self, x: f32, y: f32) -> (f32, f32) {
        let (x, y) = (f64::from(x) * self.scale, f64::from(y) * self.scale);
        ((self.at[0] + x) as f32, (self.at[1] - y) as f32)
    }
}

impl<B: OutlineBuilder> OutlineBuilder for Placed<'_, B> {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.map(x, y);
        self.builder.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.map(x, y);
        self.builder.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.map(x1, y1), self.map(x, y));
        self.builder.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.map(x1, y1), self.map(x2, y2), self.map(x, y));
        self.builder.curve_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.builder.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Helvetica's widths in thousandths of its size (Adobe's font metrics): H 722, i 222; bold
    /// i 278.
    #[test]
    fn widths_are_helveticas() {
        let [regular, bold] = [Font::regular(1000.0), Font::bold(1000.0)];
        assert!((regular.width("Hi") - 944.0).abs() < 1.0, "{}", regular.width("Hi"));
        assert!((bold.width("i") - 278.0).abs() < 1.0, "{}", bold.width("i"));
        assert!((regular.width("H") - 944.0).abs() > 100.0);
    }

    #[test]
    fn long_texts_get_an_ellipsis() {
        let font = Font::regular(12.0);
        assert_eq!(font.shorten("short", 100.0), "short");
        let short = font.shorten(&"wide ".repeat(1000), 100.0);
        assert!(short.starts_with("wide") && short.ends_with('…') && font.width(&short) <= 100.0);
        assert_eq!(font.shorten_middle("short", 100.0), "short");
        let middle = font.shorten_middle("teapot-diffuse-halton", 100.0);
        assert!(middle.starts_with("teapot") && middle.ends_with("halton"), "{middle}");
        assert!(font.width(&middle) <= 100.0 && font.width(&middle) > 85.0, "{middle}");
        assert_eq!(font.shorten_middle(&"x".repeat(100_000), 5.0), "…");
    }

    #[test]
    fn lines_are_as_wide_as_allowed() {
        let font = Font::regular(12.0);
        let text = "one two three four five six seven eight";
        let lines = font.wrap(text, 80.0, 9);
        assert!(lines.len() > 2 && lines.iter().all(|line| font.width(line) <= 80.0), "{lines:?}");
        assert_eq!(lines.join(" "), text);
        let cut = font.wrap(text, 80.0, 2);
        assert!(cut.len() == 2 && cut[1].ends_with('…') && font.width(&cut[1]) <= 80.0, "{cut:?}");
        let long = font.wrap(&"x".repeat(100), 80.0, 2);
        assert!(long.len() == 1 && long[0].ends_with('…'), "{long:?}");
        assert_eq!(font.wrap("", 80.0, 2), [""]);
    }
}

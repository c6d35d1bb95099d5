//! Colours, marks and dashes, for eyes that do not see all colours, and for grey prints.

/// What is drawn, by its part in the chart; each has a colour on light and on dark paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ink {
    Paper,
    Text,
    /// Text of less weight.
    Soft,
    Grid,
    /// Methods that are not named.
    Muted,
    /// The Pareto front.
    Front,
    /// Where methods are better than the plain estimate.
    Better,
    /// A named method, by its place among them.
    Method(usize),
}

/// By place: the colours of Okabe and Ito (2008) without yellow, which white paper swallows,
/// and lighter ones of the same hues for dark paper.
const METHODS: [[&str; 2]; NAMED] = [
    ["#0072B2", "#4DA3E0"],
    ["#D55E00", "#F08040"],
    ["#009E73", "#2FC79B"],
    ["#CC79A7", "#E39CC4"],
    ["#E69F00", "#F2B631"],
    ["#56B4E9", "#9AD9FA"],
];

/// How many methods have a colour of their own, beside the plain estimate.
pub(super) const NAMED: usize = 6;

impl Ink {
    pub(super) fn all() -> impl Iterator<Item = Self> {
        let parts = [
            Self::Paper,
            Self::Text,
            Self::Soft,
            Self::Grid,
            Self::Muted,
            Self::Front,
            Self::Better,
        ];
        parts.into_iter().chain((0..NAMED).map(Self::Method))
    }

    /// On light paper and on dark, as `#RRGGBB`. No two are alike on light paper: the SVG turns
    /// one into the other by their values.
    fn colors(self) -> [&'static str; 2] {
        match self {
            Self::Paper => ["#FFFFFF", "#15181D"],
            Self::Text => ["#1B1F24", "#E6E8EB"],
            Self::Soft => ["#57606A", "#A9B1BB"],
            Self::Grid => ["#E4E7EA", "#2B3138"],
            Self::Muted => ["#B4BAC1", "#565E68"],
            Self::Front => ["#F3E2AE", "#5C4E1F"],
            Self::Better => ["#F1F7F3", "#1A221F"],
            Self::Method(place) => METHODS[place],
        }
    }

    pub(super) fn light(self) -> &'static str {
        self.colors()[0]
    }

    pub(super) fn dark(self) -> &'static str {
        self.colors()[1]
    }

    /// Red, green and blue on light paper.
    pub(super) fn rgb(self) -> [u8; 3] {
        let byte = |at: usize| u8::from_str_radix(&self.light()[at..at + 2], 16);
        [1, 3, 5].map(|at| byte(at).expect("colours are #RRGGBB"))
    }
}

/// The shape of a mark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Marker {
    Disc,
    Square,
    Up,
    Diamond,
    Down,
    Pentagon,
    Cross,
}

impl Marker {
    /// The corners around `center`; none for a disc. All have about the same area.
    pub(super) fn corners(self, center: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
        // Angles in parts of a circle, from the top, clockwise.
        let polygon = |corners: usize, turn: f64, stretch: f64| -> Vec<[f64; 2]> {
            let corner = |i: usize| {
                let angle = std::f64::consts::TAU * (turn + i as f64 / corners as f64);
                let radius = radius * stretch;
                [center[0] + radius * angle.sin(), center[1] - radius * angle.cos()]
            };
            (0..corners).map(corner).collect()
        };
        match self {
            Self::Disc => Vec::new(),
            Self::Square => polygon(4, 0.125, 1.2),
            Self::Diamond => polygon(4, 0.0, 1.3),
            Self::Up => polygon(3, 0.0, 1.45),
            Self::Down => polygon(3, 0.5, 1.45),
            Self::Pentagon => polygon(5, 0.0, 1.2),
            Self::Cross => {
                let (long, short) = (1.2 * radius, 0.42 * radius);
                let arm = [
                    [-short, -long],
                    [short, -long],
                    [short, -short],
                    [long, -short],
                    [long, short],
                    [short, short],
                    [short, long],
                    [-short, long],
                    [-short, short],
                    [-long, short],
                    [-long, -short],
                    [-short, -short],
                ];
                arm.map(|[x, y]| [center[0] + x, center[1] + y]).to_vec()
            }
        }
    }
}

/// How a method is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Style {
    pub(super) ink: Ink,
    pub(super) marker: Marker,
    /// Radius of marks in pixels.
    pub(super) radius: f64,
    /// Width of lines in pixels.
    pub(super) width: f64,
    /// Lengths of dashes and gaps in pixels; none for a solid line.
    pub(super) dash: &'static [f64],
}

impl Style {
    pub(super) const PLAIN: Self =
        Self { ink: Ink::Text, marker: Marker::Disc, radius: 4.0, width: 2.2, dash: &[] };

    /// Of methods without a name in the chart.
    pub(super) const MUTED: Self =
        Self { ink: Ink::Muted, marker: Marker::Disc, radius: 1.8, width: 1.0, dash: &[] };

    /// Of a named method by its place, below [`NAMED`].
    pub(super) fn named(place: usize) -> Self {
        const MARKERS: [Marker; NAMED] = [
            Marker::Square,
            Marker::Up,
            Marker::Diamond,
            Marker::Down,
            Marker::Pentagon,
            Marker::Cross,
        ];
        const DASHES: [&[f64]; NAMED] = [
            &[],
            &[8.0, 3.0],
            &[2.5, 2.5],
            &[9.0, 3.0, 2.0, 3.0],
            &[5.0, 2.0],
            &[9.0, 2.5, 2.0, 2.5, 2.0, 2.5],
        ];
        Self {
            ink: Ink::Method(place),
            marker: MARKERS[place],
            radius: 3.8,
            width: 1.8,
            dash: DASHES[place],
        }
    }

    pub(super) fn is_muted(&self) -> bool {
        self.ink == Ink::Muted
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn no_two_are_alike() {
        let light: BTreeSet<_> = Ink::all().map(Ink::light).collect();
        assert_eq!(light.len(), Ink::all().count());
        let dark: BTreeSet<_> = Ink::all().map(Ink::dark).collect();
        assert_eq!(dark.len(), Ink::all().count());
        let styles: Vec<_> = (0..NAMED).map(Style::named).collect();
        for (i, a) in styles.iter().enumerate() {
            for b in &styles[..i] {
                assert!(a.marker != b.marker && a.dash != b.dash && a.ink != b.ink);
            }
        }
        assert_eq!(Ink::Method(0).rgb(), [0, 0x72, 0xb2]);
    }

    /// Contrast by WCAG 2.2: 4.5 for text (1.4.3), 3 for what carries meaning (1.4.11). The two
    /// lightest of Okabe and Ito's colours have less on white: marks and dashes carry it there.
    #[test]
    fn colors_can_be_seen() {
        let luminance = |color: &str| -> f64 {
            let part = |at: usize| {
                let byte = u8::from_str_radix(&color[at..at + 2], 16).expect("#RRGGBB");
                let x = f64::from(byte) / 255.0;
                if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
            };
            0.2126 * part(1) + 0.7152 * part(3) + 0.0722 * part(5)
        };
        let contrast = |a: &str, b: &str| {
            let (a, b) = (luminance(a), luminance(b));
            (a.max(b) + 0.05) / (a.min(b) + 0.05)
        };
        for ink in [Ink::Text, Ink::Soft] {
            for paper in [Ink::Paper, Ink::Better] {
                assert!(contrast(ink.light(), paper.light()) > 4.5, "{ink:?}");
                assert!(contrast(ink.dark(), paper.dark()) > 4.5, "{ink:?}");
            }
        }
        for place in 0..NAMED {
            let ink = Ink::Method(place);
            let least = if place < 3 { 3.0 } else { 2.0 };
            assert!(contrast(ink.light(), Ink::Paper.light()) > least, "{ink:?}");
            assert!(contrast(ink.dark(), Ink::Paper.dark()) > 4.5, "{ink:?}");
        }
        assert!(contrast("#F0E442", Ink::Paper.light()) < 2.0, "yellow on white");
    }
}

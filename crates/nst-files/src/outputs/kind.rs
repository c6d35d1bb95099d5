//! What kind of file is at a path, and whether `nst` wrote it.

use std::{fs::File, io::Read, path::Path};

use crate::{
    Error, dataset, guard_table,
    header::{ExrHeader, is_exr},
    output_file::SOFTWARE,
    png,
};

/// Who chose the name of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Name {
    /// The user: a file of the same kind may be replaced.
    Given,
    /// The program: a file of the same kind may be replaced if `nst` wrote it.
    Default,
}

/// A kind of file that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// An EXR file without a sequence.
    Picture,
    /// An EXR file with a sequence.
    Sequence,
    /// A PNG file.
    Png,
    /// A safetensors file with runs for training.
    Dataset,
    /// A safetensors file with what the guard sees of a picture, for training.
    GuardTable,
    /// A table as text.
    Csv,
    /// A document as text.
    Markdown,
    /// A page for browsers, which names the program that wrote it in its first 4 KiB.
    Html,
    /// A drawing as text.
    Svg,
}

/// What was found at a path.
struct Found {
    /// `None` for a kind that `nst` does not write.
    kind: Option<Kind>,
    /// Whether the file says that `nst` wrote it.
    ours: bool,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Picture => "an EXR picture",
            Self::Sequence => "a sequence",
            Self::Png => "a PNG picture",
            Self::Dataset => "a dataset",
            Self::GuardTable => "a table for training the guard",
            Self::Csv => "a CSV table",
            Self::Markdown => "a Markdown document",
            Self::Html => "an HTML page",
            Self::Svg => "an SVG drawing",
        }
    }

    /// Fails if there is a file at `path` that one of this kind must not replace.
    pub(super) fn check(self, path: &Path, name: Name) -> Result<(), Error> {
        match std::fs::metadata(path) {
            // Nothing is lost with an empty file.
            Ok(file) if file.len() > 0 => {}
            Ok(_) => return Ok(()),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
            Err(error) => return Err(Error::io("read", path, error)),
        }
        let found = Found::at(path)?;
        if found.kind != Some(self) {
            let there = found.kind.map_or("another kind of file", Self::name);
            let message =
                format!("{there} is there, and this is {}; give another name", self.name());
            return Err(Error::output(path, message));
        }
        if name == Name::Default && !found.ours {
            let message = "there is a file that nst did not write; move it away, or choose \
                           another name with --output";
            return Err(Error::output(path, message));
        }
        Ok(())
    }
}

impl Found {
    fn at(path: &Path) -> Result<Self, Error> {
        let failed = |error| Error::io("read", path, error);
        // Enough for the first line of a table.
        let mut start = Vec::new();
        File::open(path).map_err(failed)?.take(1 << 12).read_to_end(&mut start).map_err(failed)?;
        if is_exr(path)? {
            // Nobody knows what a damaged file was.
            let Ok(header) = ExrHeader::read(path) else {
                return Ok(Self { kind: Some(Kind::Picture), ours: false });
            };
            let attribute = |name: &str| header.parts[0].attributes.get(name);
            let sequence = attribute("nst.terms").is_some();
            let ours = attribute("software").is_some_and(|by| is_ours(by));
            let kind = if sequence { Kind::Sequence } else { Kind::Picture };
            return Ok(Self { kind: Some(kind), ours });
        }
        if start.starts_with(&png::SIGNATURE) {
            let ours = png::software(path).is_some_and(|by| is_ours(&by));
            return Ok(Self { kind: Some(Kind::Png), ours });
        }
        let tensors = match dataset::safetensors_format(path).as_deref() {
            Ok(dataset::FORMAT) => Some(Kind::Dataset),
            Ok(guard_table::FORMAT) => Some(Kind::GuardTable),
            _ => None,
        };
        if tensors.is_some() {
            return Ok(Self { kind: tensors, ours: true });
        }
        // A text does not say who wrote it. Scenes begin with remarks, too: the name must
        // agree.
        let named =
            |wanted: &str| path.extension().is_some_and(|it| it.eq_ignore_ascii_case(wanted));
        let text = text_at(&start);
        if is_svg(text) && named("svg") {
            // As charts say near their beginning.
            let program = text.split_once("<metadata>").map_or("", |(_, rest)| rest);
            return Ok(Self { kind: Some(Kind::Svg), ours: is_ours(program) });
        }
        let first_line = text.lines().next().unwrap_or_default();
        if first_line.trim().eq_ignore_ascii_case("<!doctype html>") {
            return Ok(Self { kind: Some(Kind::Html), ours: generator(text).is_some_and(is_ours) });
        }
        let kind = if first_line.starts_with("# ") && named("md") {
            Some(Kind::Markdown)
        } else if first_line.contains(',') && named("csv") {
            Some(Kind::Csv)
        } else {
            None
        };
        Ok(Self { kind, ours: false })
    }
}

/// The text that a file begins with; empty if it is not a text.
fn text_at(start: &[u8]) -> &str {
    let text = match std::str::from_utf8(start) {
        Ok(text) => text,
        // The last character may go on beyond what was read.
        Err(error) if error.error_len().is_none() => {
            std::str::from_utf8(&start[..error.valid_up_to()]).unwrap_or_default()
        }
        Err(_) => "",
    };
    if text.contains('\0') { "" } else { text }
}

/// The program that a page says has written it.
fn generator(page: &str) -> Option<&str> {
    page.split_once("<meta name=\"generator\" content=\"")?.1.split_once('"').map(|(name, _)| name)
}

/// Whether a text begins as an SVG drawing.
fn is_svg(text: &str) -> bool {
    text.starts_with("<svg") || (text.starts_with("<?xml") && text.contains("<svg"))
}

/// Whether a text names this program, in any version.
fn is_ours(software: &str) -> bool {
    let name = |text: &str| text.split_whitespace().next().map(str::to_owned);
    name(software) == name(SOFTWARE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        ColorModel,
        output_file::OutputFile,
        outputs::Outputs,
        picture_writer::{PictureInfo, write_exr},
    };

    fn write(path: &Path, kind: Kind) -> Result<(), Error> {
        let mut output = OutputFile::create(path)?;
        match kind {
            Kind::Picture => {
                let layers: [(&str, &[f32]); 1] = [("", &[1.0])];
                write_exr(&mut output, [1, 1], ColorModel::Mono, &layers, &PictureInfo::default())?;
            }
            Kind::Png => png::write(&mut output, [1, 1], &[0.0; 3])?,
            _ => unreachable!("not a picture"),
        }
        output.commit()
    }

    #[test]
    fn other_kinds_are_not_replaced() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        for (file, content, allowed) in [
            ("x", "", &[Kind::Picture, Kind::Csv, Kind::Dataset][..]),
            ("x.csv", "method,spp\nS,1\n", &[Kind::Csv]),
            ("x.md", "# Stability\n", &[Kind::Markdown]),
            ("x.html", "<!DOCTYPE html>\n<p>a, b", &[Kind::Html]),
            ("x.html", "<p>a, b", &[]),
            ("x.svg", "<?xml version=\"1.0\"?>\n<svg>a, b</svg>\n", &[Kind::Svg]),
            ("x.csv", "<svg a,b", &[Kind::Csv]),
            ("x.svg", "# a, b\n", &[]),
            ("x.obj", "# Blender 4.2, of a box\nv 1 2 3\n", &[]),
            ("x.toml", "size = [1, 2]\n", &[]),
            ("x.csv", "a,\0b", &[]),
            ("x.csv", "scene,spp\n\u{fffd},1\n", &[Kind::Csv]),
        ] {
            let path = folder.path().join(file);
            let open = |kind, name| Outputs::default().open(&path, kind, name).map(drop);
            std::fs::write(&path, content)?;
            for kind in
                [Kind::Picture, Kind::Csv, Kind::Markdown, Kind::Html, Kind::Dataset, Kind::Svg]
            {
                let allowed = content.is_empty() || allowed.contains(&kind);
                assert_eq!(open(kind, Name::Given).is_ok(), allowed, "{kind:?} over {content:?}");
            }
        }
        let path = folder.path().join("x");
        let open = |kind, name| Outputs::default().open(&path, kind, name).map(drop);
        for written in [Kind::Picture, Kind::Png] {
            std::fs::remove_file(&path)?;
            write(&path, written)?;
            for kind in [Kind::Picture, Kind::Png, Kind::Sequence, Kind::Csv] {
                assert_eq!(open(kind, Name::Given).is_ok(), kind == written, "{kind:?}");
                assert_eq!(open(kind, Name::Default).is_ok(), kind == written, "{kind:?}");
            }
        }
        Ok(())
    }

    #[test]
    fn text_may_be_cut_within_a_character() {
        for (start, expected) in
            [(&b"a,\xc3"[..], "a,"), (b"a,\xc3\xa4", "a,ä"), (b"a,\xff", ""), (b"a,\0", "")]
        {
            assert_eq!(text_at(start), expected);
        }
    }

    #[test]
    fn drawings_say_who_wrote_them() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("x.svg");
        for (program, ours) in [(SOFTWARE, true), ("nstar 2", false)] {
            std::fs::write(&path, format!("<svg>\n <metadata>{program}</metadata>\n</svg>"))?;
            let open = |name| Outputs::default().open(&path, Kind::Svg, name);
            assert_eq!(open(Name::Default).is_ok(), ours, "{program}");
            assert!(open(Name::Given).is_ok());
        }
        Ok(())
    }

    /// A texture in the model's folder, say.
    #[test]
    fn files_of_others_keep_their_default_names() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("model.png");
        let mut bytes = Vec::new();
        let mut encoder = ::png::Encoder::new(&mut bytes, 1, 1);
        encoder.add_text_chunk("Software".into(), "nstar 2".into())?;
        encoder.write_header()?.write_image_data(&[0])?;
        std::fs::write(&path, bytes)?;
        assert!(Outputs::default().open(&path, Kind::Png, Name::Default).is_err());
        assert!(Outputs::default().open(&path, Kind::Png, Name::Given).is_ok());
        let path = folder.path().join("model.html");
        for (content, ours) in [
            ("", false),
            ("<meta name=\"generator\" content=\"nstar 2\">", false),
            ("<meta name=\"generator\" content=\"nst 0.0.9\">", true),
        ] {
            std::fs::write(&path, format!("<!doctype html>\n{content}"))?;
            let open = |name| Outputs::default().open(&path, Kind::Html, name).is_ok();
            assert_eq!((open(Name::Given), open(Name::Default)), (true, ours), "{content}");
        }
        Ok(())
    }
}

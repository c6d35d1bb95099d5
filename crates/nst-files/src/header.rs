//! What an EXR file of any program contains, read from its headers alone.

use std::{collections::BTreeMap, fs::File, io::BufReader, path::Path};

use exr::{
    block::{self, reader::Reader},
    meta::{BlockDescription, attribute::AttributeValue, header::Header as RawHeader},
    prelude::{Compression, SampleType},
};

pub use crate::window::Window;
use crate::{
    Error, blender::combined, limits::MOST_DEFLATED, magic, rows::text, window::check_not_empty,
};

/// The most samples that a byte of a file may decode to; a header that promises more is
/// malformed. DWA stores a block of 8 by 8 equal samples in two bytes, and deflates these.
fn most_samples_per_byte(compression: Compression) -> u64 {
    match compression {
        Compression::DWAA(_) | Compression::DWAB(_) => MOST_DEFLATED * 64 / 2,
        _ => MOST_DEFLATED,
    }
}

/// The headers of an EXR file; at least one.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrHeader {
    /// Its parts, in the order of the file.
    pub parts: Vec<Part>,
}

/// One part of an EXR file.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Its name; files of one part need none.
    pub name: Option<String>,
    /// Which eye of a stereo pair it shows, or which of several cameras, as in `left`.
    pub view: Option<String>,
    /// Width and height of the data window, in pixels.
    pub size: [u32; 2],
    /// The left upper corner of the data window.
    pub position: [i32; 2],
    /// What is to be seen: the picture's frame, of which the data window may be a part.
    pub display: Window,
    /// Red, green, blue and white in CIE xy, where the file says it.
    pub chromaticities: Option<[[f32; 2]; 4]>,
    /// How its pixels are compressed, and whether in scan lines or tiles.
    pub storage: String,
    /// Whether it is deep: each pixel has its own number of samples.
    pub deep: bool,
    /// The channels, sorted by name.
    pub channels: Vec<Channel>,
    /// The attributes that are text or a number.
    pub attributes: BTreeMap<String, String>,
}

/// One channel of a part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// `LAYER.NAME`, or `NAME`.
    pub name: String,
    /// `f16`, `f32` or `u32`.
    pub kind: &'static str,
    /// Whether it has a sample for each pixel; subsampled channels have fewer.
    pub full_resolution: bool,
}

/// Channels that make up a picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layer {
    /// The name that users give; empty for the R, G, B or Y of a file of one part.
    pub name: String,
    /// Index into [`ExrHeader::parts`].
    pub part: usize,
    /// Indices into [`Part::channels`]: R, G and B, or a single one.
    pub channels: Vec<usize>,
}

/// The name of a layer in messages.
pub(crate) fn title(layer: &str) -> &str {
    if layer.is_empty() { "the main picture" } else { layer }
}

/// Whether a file starts as EXR files do.
///
/// # Errors
/// [`Error::Io`] if it cannot be read.
pub fn is_exr(path: &Path) -> Result<bool, Error> {
    let start = magic::start(path).map_err(|error| Error::io("read", path, error))?;
    Ok(start == magic::EXR)
}

impl ExrHeader {
    /// Reads the headers of a file.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Malformed`] names the file and what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let length = std::fs::metadata(path).map_err(|error| Error::io("read", path, error))?.len();
        let reader = open(path)?;
        let parts: Vec<_> = reader.headers().iter().map(part).collect();
        for (part, header) in parts.iter().zip(reader.headers()) {
            let [width, height] = part.size.map(u64::from);
            let samples = width.saturating_mul(height).saturating_mul(part.channels.len() as u64);
            if samples > length.saturating_mul(most_samples_per_byte(header.compression)) {
                let message = format!(
                    "damaged: a file of {length} bytes cannot contain {width} by {height} pixels"
                );
                return Err(Error::malformed(path, message));
            }
        }
        Ok(Self { parts })
    }

    /// Whether it is a sequence file of this program.
    #[must_use]
    pub fn is_sequence(&self) -> bool {
        self.parts.first().is_some_and(|part| part.attributes.contains_key("nst.terms"))
    }

    /// All layers that are pictures: R, G and B, or Y, or any channel that is alone in its
    /// layer.
    #[must_use]
    pub fn layers(&self) -> Vec<Layer> {
        let mut layers = Vec::new();
        for (index, part) in self.parts.iter().enumerate() {
            for (prefix, group) in part.groups() {
                let Some((single, channels)) = picture(&group) else { continue };
                let prefix = if prefix.is_empty() { single } else { prefix };
                layers.push(Layer { name: self.full_name(part, prefix), part: index, channels });
            }
        }
        layers
    }

    /// All layers with these channels, whatever the case of their names.
    pub(crate) fn layers_with(&self, channels: &[&str]) -> Vec<Layer> {
        let mut layers = Vec::new();
        for (index, part) in self.parts.iter().enumerate() {
            for (prefix, group) in part.groups() {
                let find = |wanted: &&str| {
                    let mut of_name =
                        group.iter().filter(|(name, _)| name.eq_ignore_ascii_case(wanted));
                    of_name.next().map(|&(_, index)| index)
                };
                let channels = channels.iter().map(find).collect::<Option<Vec<_>>>();
                let name = self.full_name(part, prefix);
                layers.extend(channels.map(|channels| Layer { name, part: index, channels }));
            }
        }
        layers
    }

    /// Finds the layer of a name. Without a name, it is the main picture, or the only layer,
    /// or the only one of R, G and B, or `Combined`, as Blender names the picture beside its
    /// passes.
    ///
    /// # Errors
    /// What is wrong, and which layers there are.
    pub fn choose(&self, name: Option<&str>) -> Result<Layer, String> {
        let mut layers = self.layers();
        let names: Vec<_> = layers.iter().map(|layer| title(&layer.name)).collect();
        let names = listed(&names);
        let Some(name) = name else {
            if let Some(main) = layers.iter().position(|layer| layer.name.is_empty()) {
                return Ok(layers.swap_remove(main));
            }
            if layers.is_empty() {
                let channels = listed(&self.channel_names());
                let has = |name: &str| self.all_channels().any(|c| self.channel(c).ends_with(name));
                return Err(if has("RY") && has("BY") {
                    format!(
                        "luminance and chroma ({channels}) are not supported; save it as R, G and B"
                    )
                } else {
                    format!(
                        "no channels R, G and B, nor Y alone; name one of its channels: {channels}"
                    )
                });
            }
            if layers.len() > 1 {
                // Depth, masks and the like, which are single channels, accompany a picture.
                layers.retain(|layer| layer.channels.len() == 3);
            }
            let several =
                |names: &str| Err(format!("it has several layers, name one of them: {names}"));
            return match (layers.len(), &combined(layers.iter().map(|layer| &*layer.name))[..]) {
                (1, _) => Ok(layers.swap_remove(0)),
                (_, []) => several(&names),
                (_, &[combined]) => Ok(layers.swap_remove(combined)),
                (_, all) => {
                    let all: Vec<_> = all.iter().map(|&i| layers[i].name.as_str()).collect();
                    several(&all.join(", "))
                }
            };
        };
        if let Some(found) = layers.iter().position(|layer| layer.name == name) {
            return Ok(layers.swap_remove(found));
        }
        // Any channel by its whole name.
        for (part, channel) in self.all_channels() {
            if self.full_name(&self.parts[part], &self.parts[part].channels[channel].name) == name {
                return Ok(Layer { name: name.to_owned(), part, channels: vec![channel] });
            }
        }
        Err(format!(
            "no layer '{name}'; its layers are {names}; its channels are {}",
            listed(&self.channel_names())
        ))
    }

    fn all_channels(&self) -> impl Iterator<Item = (usize, usize)> {
        let channels = |(index, part): (usize, &Part)| {
            (0..part.channels.len()).map(move |channel| (index, channel))
        };
        self.parts.iter().enumerate().flat_map(channels)
    }

    fn channel(&self, (part, channel): (usize, usize)) -> &str {
        &self.parts[part].channels[channel].name
    }

    fn channel_names(&self) -> Vec<String> {
        self.all_channels()
            .map(|(part, channel)| {
                let part = &self.parts[part];
                self.full_name(part, &part.channels[channel].name)
            })
            .collect()
    }

    /// Puts the part's name before a layer's or a channel's, where several parts need it.
    fn full_name(&self, part: &Part, name: &str) -> String {
        let Some(own) = part.name.as_ref().filter(|_| self.parts.len() > 1) else {
            return name.to_owned();
        };
        // Some programs repeat the part's name in its channels; Blender does so without the
        // view, as parts `V.Combined-left` and `V.Combined-right` of channels `V.Combined.R`.
        let without = part.view.as_ref().and_then(|view| own.strip_suffix(view)?.strip_suffix('-'));
        match name.strip_prefix(without.unwrap_or(own)) {
            Some(rest) if rest.is_empty() || rest.starts_with('.') => format!("{own}{rest}"),
            _ if name.is_empty() => own.clone(),
            _ => format!("{own}.{name}"),
        }
    }
}

/// The most names in a message; Blender's files have some dozens.
const MOST_LISTED: usize = 100;

/// Names as text; of a very long list, the middle is left out.
fn listed(names: &[impl AsRef<str>]) -> String {
    let names: Vec<_> = names.iter().map(AsRef::as_ref).collect();
    match names.len() {
        0 => "none".to_owned(),
        1..=MOST_LISTED => names.join(", "),
        count => {
            let [start, end] = [&names[..MOST_LISTED / 2], &names[count - MOST_LISTED / 2..]];
            format!("{}, …, {} ({count} in all)", start.join(", "), end.join(", "))
        }
    }
}

impl Part {
    /// The channels, grouped by the part of their names before the last dot.
    fn groups(&self) -> BTreeMap<&str, Vec<(&str, usize)>> {
        let mut groups = BTreeMap::<_, Vec<_>>::new();
        for (index, channel) in self.channels.iter().enumerate() {
            let (prefix, name) = channel.name.rsplit_once('.').unwrap_or(("", &channel.name));
            groups.entry(prefix).or_default().push((name, index));
        }
        groups
    }
}

/// The channels of a group that make a picture. A single channel other than Y comes with
/// its name.
fn picture<'a>(group: &[(&'a str, usize)]) -> Option<(&'a str, Vec<usize>)> {
    let find = |wanted: &str| {
        group.iter().find(|(name, _)| name.eq_ignore_ascii_case(wanted)).map(|&(_, index)| index)
    };
    if let (Some(r), Some(g), Some(b)) = (find("R"), find("G"), find("B")) {
        return Some(("", vec![r, g, b]));
    }
    // Beside X or Z it is a coordinate, beside RY and BY the luminance of a colour.
    let other = ["X", "Z", "RY", "BY"].into_iter().any(|name| find(name).is_some());
    match (find("Y"), group) {
        (Some(y), _) if !other => Some(("", vec![y])),
        (None, &[(name, index)]) => Some((name, vec![index])),
        _ => None,
    }
}

/// Reads the headers, ready to go on with the pixels.
pub(crate) fn open(path: &Path) -> Result<Reader<BufReader<File>>, Error> {
    check_not_empty(path)?;
    let file = File::open(path).map_err(|error| Error::io("read", path, error))?;
    block::read(BufReader::new(file), false).map_err(|error| Error::exr("read", path, error))
}

fn part(header: &RawHeader) -> Part {
    let window = header.data_window();
    let display = header.shared_attributes.display_window;
    let tiled = matches!(header.blocks, BlockDescription::Tiles(_));
    let channels = header.channels.list.iter().map(|channel| Channel {
        name: text(&channel.name),
        kind: match channel.sample_type {
            SampleType::F16 => "f16",
            SampleType::F32 => "f32",
            SampleType::U32 => "u32",
        },
        full_resolution: channel.sampling.x() == 1 && channel.sampling.y() == 1,
    });
    let attributes = header.all_named_attributes().filter_map(|(name, value)| {
        let value = match value {
            AttributeValue::Text(value) => text(&value),
            AttributeValue::I32(number) => number.to_string(),
            AttributeValue::F32(number) => number.to_string(),
            AttributeValue::F64(number) => number.to_string(),
            _ => return None,
        };
        Some((text(&exr::meta::attribute::Text::from_slice_unchecked(name)), value))
    });
    let own = &header.own_attributes;
    Part {
        name: own.layer_name.as_ref().map(text).filter(|name| !name.is_empty()),
        view: own.view_name.as_ref().map(text),
        // The library refuses windows beyond 2³⁰.
        size: [window.size.x() as u32, window.size.y() as u32],
        position: [window.position.x(), window.position.y()],
        display: Window {
            position: [display.position.x(), display.position.y()],
            size: [display.size.x() as u32, display.size.y() as u32],
        },
        chromaticities: header
            .shared_attributes
            .chromaticities
            .map(|c| [c.red, c.green, c.blue, c.white].map(|point| [point.x(), point.y()])),
        storage: format!("{}, {}", header.compression, if tiled { "tiles" } else { "scan lines" }),
        deep: header.deep,
        channels: channels.collect(),
        attributes: attributes.collect(),
    }
}

#[cfg(test)]
impl Part {
    /// A part without channels and attributes, for tests.
    pub(crate) fn of_one_pixel() -> Self {
        Self {
            name: None,
            view: None,
            size: [1, 1],
            position: [0, 0],
            display: Window { position: [0, 0], size: [1, 1] },
            chromaticities: None,
            storage: String::new(),
            deep: false,
            channels: Vec::new(),
            attributes: BTreeMap::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(parts: &[(Option<&str>, &[&str])]) -> ExrHeader {
        let channel =
            |name: &&str| Channel { name: (*name).to_owned(), kind: "f32", full_resolution: true };
        let part = |&(name, channels): &(Option<&str>, &[&str])| Part {
            name: name.map(str::to_owned),
            channels: channels.iter().map(channel).collect(),
            ..Part::of_one_pixel()
        };
        ExrHeader { parts: parts.iter().map(part).collect() }
    }

    fn names(header: &ExrHeader) -> Vec<String> {
        header.layers().into_iter().map(|layer| layer.name).collect()
    }

    #[test]
    fn layers_of_one_part() {
        let file = header(&[(None, &["B", "G", "R", "S.B", "S.G", "S.R", "Z"])]);
        assert_eq!(names(&file), ["", "S"]);
        assert_eq!(file.choose(None).expect("main").channels, [2, 1, 0]);
        assert_eq!(file.choose(Some("S")).expect("S").channels, [5, 4, 3]);
        assert_eq!(file.choose(Some("Z")).expect("Z").channels, [6]);
        assert_eq!(file.choose(Some("S.G")).expect("S.G").channels, [4]);
        assert!(file.choose(Some("T")).is_err_and(|e| e.contains("'T'") && e.contains("S.R")));
    }

    #[test]
    fn a_channel_alone_is_a_picture_and_coordinates_are_none() {
        assert_eq!(names(&header(&[(None, &["Y"])])), [""]);
        assert_eq!(names(&header(&[(None, &["A", "Y"])])), [""]);
        assert_eq!(names(&header(&[(None, &["depth"])])), ["depth"]);
        assert_eq!(header(&[(None, &["depth"])]).choose(None).expect("depth").channels, [0]);
        assert_eq!(names(&header(&[(None, &["depth.T", "n.X", "n.Y", "n.Z"])])), ["depth"]);
        let luminance = header(&[(None, &["BY", "RY", "Y"])]);
        let error = luminance.choose(None).expect_err("no picture");
        assert!(error.contains("chroma (BY, RY, Y)") && error.contains("R, G and B"), "{error}");
    }

    #[test]
    fn without_a_main_picture_there_must_be_one_of_colors() {
        let of = |name: &str| ["B", "G", "R"].map(|channel| format!("{name}.{channel}"));
        let [combined, diffuse, gloss] = ["View.Combined", "View.Diffuse", "View.Gloss"].map(of);
        let names = |lists: &[&[String]]| lists.concat();
        let choose = |channels: &[String]| {
            let channels: Vec<_> = channels.iter().map(String::as_str).collect();
            header(&[(None, &channels)]).choose(None).map(|layer| layer.name)
        };
        assert_eq!(choose(&combined).expect("one layer"), "View.Combined");
        let depth = ["View.Depth.Z".to_owned(), "View.Mist.V".to_owned()];
        assert_eq!(choose(&names(&[&combined, &depth])).expect("one of colors"), "View.Combined");
        assert_eq!(choose(&names(&[&combined, &diffuse])).expect("combined"), "View.Combined");
        let several = "name one of them: View.Diffuse, View.Gloss";
        assert!(choose(&names(&[&diffuse, &gloss])).is_err_and(|e| e.contains(several)));
        let data = "name one of them: View.Depth, View.Mist";
        assert!(choose(&depth).is_err_and(|e| e.contains(data)));
    }

    #[test]
    fn blenders_picture_needs_no_name() {
        let rgba: &[&str] = &["A", "B", "G", "R"];
        fn choose(parts: &[(Option<&str>, &[&str])]) -> Result<String, String> {
            header(parts).choose(None).map(|layer| layer.name)
        }
        let view = |name| (Some(name), rgba);
        let passes = [view("ViewLayer.Combined"), view("ViewLayer.Normal")];
        assert_eq!(choose(&passes), Ok("ViewLayer.Combined".into()));
        let composite = [view("Composite.Combined"), passes[0], passes[1]];
        assert_eq!(choose(&composite), Ok("ViewLayer.Combined".into()));
        let composited = [composite[0], view("Composite.Mist")];
        assert_eq!(choose(&composited), Ok("Composite.Combined".into()));
        let one_part: &[&str] = &["V.Combined.B", "V.Combined.G", "V.Combined.R", "V.Depth.Z"];
        assert_eq!(choose(&[(None, one_part)]), Ok("V.Combined".into()));
        let two = [passes[0], view("Other.Combined")];
        assert!(choose(&two).is_err_and(|e| e.contains("ViewLayer.Combined, Other.Combined")));
        assert!(choose(&[view("Uncombined"), view("Normal")]).is_err());
    }

    #[test]
    fn layers_of_several_parts() {
        let rgb: &[&str] = &["B", "G", "R"];
        let file = header(&[(Some("beauty"), rgb), (Some("aov"), &["aov.V", "mist.V"])]);
        assert_eq!(names(&file), ["beauty", "aov", "aov.mist"]);
        assert_eq!(file.choose(None).expect("the only one of colors").name, "beauty");
        assert_eq!(file.choose(Some("aov.mist")).expect("mist").part, 1);
        assert_eq!(file.choose(Some("beauty.G")).expect("G").channels, [1]);
    }
}

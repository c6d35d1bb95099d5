//! EXR files: sequences and pictures.

use std::{borrow::Cow, collections::BTreeMap, fmt, path::Path};

use nst_files::{
    header::{ExrHeader, Layer, Part},
    picture::Picture,
    sequence_file::SequenceReader,
};
use serde::Serialize;

use super::{Content, or_unknown};
use crate::{
    error::Error,
    words::{counted, list, numbers, on_one_line},
};

#[derive(Serialize)]
pub(super) struct PictureReport {
    bytes: u64,
    parts: Vec<PartReport>,
    notes: Vec<String>,
}

#[derive(Serialize)]
pub(super) struct SequenceReport {
    width: u32,
    height: u32,
    channels: &'static [&'static str],
    sample_counts: Vec<u32>,
    side_channels: Vec<String>,
    scene: String,
    sampler: String,
    seeds: Vec<u64>,
    render_seconds: f32,
    resumable: bool,
    #[serde(flatten)]
    picture: PictureReport,
}

#[derive(Serialize)]
struct PartReport {
    name: Option<String>,
    width: u32,
    height: u32,
    position: [i32; 2],
    storage: String,
    deep: bool,
    layers: Vec<String>,
    /// The channels that are in none of these.
    #[serde(skip)]
    others: Vec<usize>,
    channels: Vec<Channel>,
    attributes: BTreeMap<String, String>,
}

#[derive(Serialize)]
struct Channel {
    name: String,
    #[serde(rename = "type")]
    kind: &'static str,
}

pub(super) fn read(path: &Path) -> Result<Content, Error> {
    let header = ExrHeader::read(path)?;
    let bytes = std::fs::metadata(path).map(|file| file.len()).unwrap_or_default();
    let layers = header.layers();
    let parts = header.parts.iter().enumerate().map(|(index, part)| {
        PartReport::new(part, layers.iter().filter(|layer| layer.part == index))
    });
    let note = Picture::open(path, None).ok().and_then(|picture| picture.primaries_note());
    let picture =
        PictureReport { bytes, parts: parts.collect(), notes: note.into_iter().collect() };
    if !header.is_sequence() {
        return Ok(Content::Picture(picture));
    }
    let reader = SequenceReader::open(path)?;
    let info = reader.info();
    Ok(Content::Sequence(SequenceReport {
        width: info.size[0],
        height: info.size[1],
        channels: info.model.channels(),
        sample_counts: info.sample_counts.clone(),
        side_channels: info.sides.iter().map(ToString::to_string).collect(),
        scene: info.scene.clone(),
        sampler: info.sampler.clone(),
        seeds: info.seeds.clone(),
        render_seconds: info.render_seconds,
        resumable: info.resume.is_some(),
        picture,
    }))
}

impl PartReport {
    /// Of a part, and the pictures in it.
    fn new<'a>(part: &Part, layers: impl Iterator<Item = &'a Layer>) -> Self {
        let (mut names, mut others) = (Vec::new(), vec![true; part.channels.len()]);
        for layer in layers {
            names.push(layer.name.clone());
            layer.channels.iter().for_each(|&channel| others[channel] = false);
        }
        let channel = |channel: &nst_files::header::Channel| Channel {
            name: channel.name.clone(),
            kind: channel.kind,
        };
        Self {
            name: part.name.clone(),
            width: part.size[0],
            height: part.size[1],
            position: part.position,
            storage: part.storage.clone(),
            deep: part.deep,
            layers: names,
            others: (0..others.len()).filter(|&channel| others[channel]).collect(),
            channels: part.channels.iter().map(channel).collect(),
            attributes: part.attributes.clone(),
        }
    }
}

impl fmt::Display for SequenceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "sequence (EXR), {} bytes", self.picture.bytes)?;
        writeln!(f, "terms       of {} samples per pixel", numbers(&self.sample_counts))?;
        writeln!(f, "beside them {}", list(&self.side_channels, "nothing"))?;
        writeln!(f, "scene       {}", or_unknown(&self.scene))?;
        let seeds: Vec<_> = self.seeds.iter().map(u64::to_string).collect();
        let seeds = list(&seeds, "not recorded");
        writeln!(f, "sampler     {}, seed {seeds}", or_unknown(&self.sampler))?;
        let can = if self.resumable { "can" } else { "cannot" };
        let time = match self.render_seconds {
            // As other renderers' files do not say it.
            0.0 => "of unknown time".to_owned(),
            seconds => format!("{seconds:.2} s"),
        };
        writeln!(f, "rendering   {time}, {can} be continued")?;
        self.picture.write_parts(f)
    }
}

impl fmt::Display for PictureReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "picture (EXR), {} bytes", self.bytes)?;
        self.write_parts(f)
    }
}

impl PictureReport {
    fn write_parts(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for part in &self.parts {
            writeln!(f, "{}", part.headline())?;
            let layers = part.layers.iter().map(|name| match &**name {
                "" => Cow::Borrowed("(main)"),
                name => on_one_line(name),
            });
            let names: Vec<_> = layers.collect();
            writeln!(f, "layers      {}", list(&names, "none that is a picture"))?;
            if !part.others.is_empty() {
                let name = |&channel: &usize| on_one_line(&part.channels[channel].name);
                let names: Vec<_> = part.others.iter().map(name).collect();
                writeln!(f, "others      {}", list(&names, ""))?;
            }
            for (name, value) in &part.attributes {
                let [name, value] = [name, value].map(|text| on_one_line(text));
                writeln!(f, "attribute   {name} = {value}")?;
            }
        }
        self.notes.iter().try_for_each(|note| writeln!(f, "note        {note}"))
    }
}

impl PartReport {
    fn headline(&self) -> String {
        let Self { width, height, position: [x, y], .. } = self;
        let name =
            self.name.as_ref().map(|name| format!("'{}' ", on_one_line(name))).unwrap_or_default();
        let at = if [*x, *y] == [0, 0] { String::new() } else { format!(" from ({x}, {y})") };
        let mut kinds: Vec<_> = self.channels.iter().map(|channel| channel.kind).collect();
        kinds.sort_unstable();
        kinds.dedup();
        format!(
            "part        {name}{width}x{height} pixels{at}, {} of {}, {}{}",
            counted(self.channels.len(), "channel"),
            kinds.join(" and "),
            self.storage,
            if self.deep { ", deep" } else { "" }
        )
    }
}

//! `nst pack`: other renderers' pictures → a sequence, or sequences → a dataset.

mod counts;
mod runs;

use std::{fmt, path::Path};

use nst_files::{
    header::ExrHeader,
    output::{Kind, Name, Outputs},
    pack::{self, FeatureNames, Pack, Packer},
    sequence_file::{SequenceInfo, SequenceWriter},
};
use serde::Serialize;

use crate::{
    args::{PackArgs, PackAs, has_extension},
    error::Error,
    progress::Progress,
    report::Done,
    words::{counted, list, numbers},
};
use counts::{Source, samples_each, samples_of_estimates, sort};

pub(super) fn run(args: &PackArgs) -> Result<Done, Error> {
    check(args)?;
    match args.kind() {
        PackAs::Runs => runs::run(args).map(Done::whole),
        PackAs::Samples | PackAs::Estimates => sequence(args).map(Done::whole),
    }
}

/// Checks what clap cannot: which options belong to which kind.
fn check(args: &PackArgs) -> Result<(), Error> {
    let wrong = |message: &str| Err(Error::Usage(message.to_owned()));
    if args.spp.is_some() && args.kind() != PackAs::Samples {
        return wrong("--spp is for --as samples; --as estimates takes --spp-list");
    }
    if args.spp_list.is_some() && args.kind() != PackAs::Estimates {
        return wrong("--spp-list is for --as estimates; --as samples takes --spp");
    }
    let runs = args.kind() == PackAs::Runs;
    if runs && (args.layer.is_some() || args.scene.is_some() || args.seed.is_some()) {
        return wrong("--layer, --scene and --seed are not for --as runs: the sequences have them");
    }
    if runs && (args.albedo.is_some() || args.normal.is_some() || args.emission.is_some()) {
        return wrong("--albedo, --normal and --emission are not for --as runs");
    }
    let extension = if runs { "safetensors" } else { "exr" };
    if !has_extension(&args.output, extension) {
        return wrong(&format!(
            "--output '{}': the name must end in .{extension}",
            args.output.display()
        ));
    }
    match &args.spp_list {
        Some(list) if list.len() != args.files.len() => wrong(&format!(
            "--spp-list has {} for {}; name one number for each file",
            counted(list.len(), "number"),
            counted(args.files.len(), "file")
        )),
        _ => Ok(()),
    }
}

/// The pictures, and the sequence that was made from them.
#[derive(Serialize)]
struct Report {
    /// In the order of the sequence.
    files: Vec<String>,
    width: u32,
    height: u32,
    /// The upper left corner of the pictures' data windows; the sequence begins at (0, 0).
    position: [i32; 2],
    layer: String,
    channels: Vec<String>,
    sample_counts: Vec<u32>,
    samples_from: Source,
    side_channels: Vec<String>,
    /// The features that were found, each with the layers that it is of.
    features: Vec<(String, Vec<String>)>,
    /// Files with values that are not finite, and how many.
    nonfinite: Vec<(String, u64)>,
    notes: Vec<String>,
    /// Whether the terms are means, which leave these values out.
    #[serde(skip)]
    means: bool,
    output: String,
}

fn sequence(args: &PackArgs) -> Result<Report, Error> {
    let mut outputs = Outputs::of_inputs(&args.files);
    let mut output = outputs.open(&args.output, Kind::Sequence, Name::Given)?;
    let mut pictures = pack::open(&args.files, args.layer.as_deref())?;
    // A folder's *.exr often has both.
    if args.kind.is_none() {
        args.files.iter().try_for_each(|path| check_no_sequence(path))?;
    }
    let (pack, samples_from) = match args.kind() {
        PackAs::Samples => {
            let (spp, source) = samples_each(args.spp, &pictures)?;
            (Pack::Samples(spp), source)
        }
        _ => {
            let (counts, source) = samples_of_estimates(args.spp_list.as_deref(), &pictures)?;
            let counts = sort(&mut pictures, counts)?;
            (Pack::Estimates(counts), source)
        }
    };
    let files = pictures.iter().map(|picture| picture.path().display().to_string()).collect();
    let first = pictures[0].clone();
    let names = FeatureNames {
        albedo: args.albedo.as_deref(),
        normal: args.normal.as_deref(),
        emission: args.emission.as_deref(),
    };
    let (features, mut notes) = pack::find_features(&pictures, names)?;
    let taken = features.iter().map(|it| (it.side().to_string(), it.layers().to_vec())).collect();
    let mut packer = Packer::new(pictures, pack)?.with_features(features);
    let info = SequenceInfo {
        size: packer.size(),
        model: packer.model(),
        sample_counts: packer.sample_counts().to_vec(),
        sides: packer.sides(),
        scene: args.scene.clone().unwrap_or_default(),
        sampler: String::new(),
        seeds: args.seed.into_iter().collect(),
        render_seconds: 0.0,
        resume: None,
    };
    let mut writer = SequenceWriter::create(&mut output, &info)?;
    let before = format!("reading {}", counted(args.files.len(), "picture"));
    let progress = Progress::count(&before, "pack", info.size[1].into(), &args.common);
    for rows in packer.strips() {
        let height = u64::from(rows.end - rows.start);
        writer.push(&packer.read(rows)?, None)?;
        progress.advance(height);
    }
    writer.finish()?;
    notes.extend(packer.feature_notes());
    let nonfinite = packer.finish()?;
    drop(progress);
    output.commit()?;
    Ok(Report {
        files,
        width: info.size[0],
        height: info.size[1],
        position: first.position,
        layer: first.layer.clone(),
        channels: first.channel_names.clone(),
        sample_counts: info.sample_counts,
        samples_from,
        features: taken,
        side_channels: info.sides.iter().map(ToString::to_string).collect(),
        nonfinite: nonfinite.into_iter().map(|(path, n)| (path.display().to_string(), n)).collect(),
        notes: first
            .primaries_note()
            .into_iter()
            .chain(first.denoised_note())
            .chain(notes)
            .collect(),
        means: args.kind() == PackAs::Samples,
        output: args.output.display().to_string(),
    })
}

fn check_no_sequence(path: &Path) -> Result<(), Error> {
    if !ExrHeader::read(path)?.is_sequence() {
        return Ok(());
    }
    Err(Error::Unlike(format!(
        "'{}' is a sequence, not a picture; nst merge joins sequences, and --as samples takes \
         its last term for a picture",
        path.display()
    )))
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, position: [x, y], .. } = self;
        let stored = match [x, y] {
            [0, 0] => String::new(),
            _ => format!("; stored from (0, 0) instead of ({x}, {y})"),
        };
        writeln!(
            f,
            "pictures   {} of {width}x{height} pixels, channels {}{stored}",
            self.files.len(),
            self.channels.join(", ")
        )?;
        let counts = numbers(&self.sample_counts);
        writeln!(f, "terms      of {counts} samples per pixel ({})", self.samples_from)?;
        writeln!(f, "order      {}", list(&self.files, ""))?;
        for (feature, layers) in &self.features {
            writeln!(f, "feature    {feature} from {}", layers.join(" + "))?;
        }
        let left_out = if self.means { ", and left out of the means" } else { "" };
        for (path, count) in &self.nonfinite {
            let are = if *count == 1 { "value is" } else { "values are" };
            writeln!(f, "note       {count} {are} not finite in '{path}'{left_out}")?;
        }
        for note in &self.notes {
            writeln!(f, "note       {note}")?;
        }
        write!(f, "wrote      {}", self.output)
    }
}

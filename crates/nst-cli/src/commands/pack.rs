//! `nst pack`: other renderers' pictures → a sequence, or sequences → a dataset.

use std::path::Path;

use nst_render::{
    dataset::{DatasetInfo, DatasetWriter},
    output::OutputFile,
    pack::{self, Pack, Packer, samples_in_name},
    picture::Picture,
    sequence_file::{SequenceFile, SequenceInfo, SequenceReader, SequenceWriter},
};
use serde_json::{Value, json};

use super::{numbers, set_threads};
use crate::{
    args::{PackArgs, PackAs, has_extension},
    error::Error,
};

pub(crate) fn run(args: &PackArgs) -> Result<(), Error> {
    set_threads(&args.common)?;
    check(args)?;
    match args.kind {
        PackAs::Runs => runs(args),
        PackAs::Samples | PackAs::Estimates => sequence(args),
    }
}

/// What clap cannot say: which options belong to which kind.
fn check(args: &PackArgs) -> Result<(), Error> {
    let wrong = |message: &str| Err(Error::Usage(message.to_owned()));
    if args.spp.is_some() && args.kind != PackAs::Samples {
        return wrong("--spp is for --as samples; --as estimates takes --spp-list");
    }
    if args.spp_list.is_some() && args.kind != PackAs::Estimates {
        return wrong("--spp-list is for --as estimates; --as samples takes --spp");
    }
    let runs = args.kind == PackAs::Runs;
    if runs && (args.channels.is_some() || args.scene.is_some() || args.seed.is_some()) {
        return wrong(
            "--channels, --scene and --seed are not for --as runs: the sequences have them",
        );
    }
    let extension = if runs { "safetensors" } else { "exr" };
    if !has_extension(&args.output, extension) {
        return wrong(&format!(
            "--output '{}': the name must end in .{extension}",
            args.output.display()
        ));
    }
    match &args.spp_list {
        Some(list) if list.len() != args.files.len() => {
            wrong(&format!("--spp-list has {} numbers for {} files", list.len(), args.files.len()))
        }
        _ => Ok(()),
    }
}

/// How the numbers of samples became known, in words.
type Source = &'static str;

fn sequence(args: &PackArgs) -> Result<(), Error> {
    let mut pictures = pack::open(&args.files, args.channels.as_deref())?;
    let (pack, source) = match args.kind {
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
    let order: Vec<_> = pictures.iter().map(|p| p.path().display().to_string()).collect();
    let (layer, channels) = (pictures[0].layer.clone(), pictures[0].channel_names.clone());
    let ([width, height], position) = (pictures[0].size, pictures[0].position);
    let mut packer = Packer::new(pictures, pack)?;
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

    let mut output = OutputFile::create(&args.output)?;
    let mut writer = SequenceWriter::create(&mut output, &info)?;
    for rows in packer.strips() {
        writer.push(&packer.read(rows)?, None)?;
    }
    writer.finish()?;
    let nonfinite = packer.finish()?;
    output.commit()?;

    let json = json!({
        "files": order,
        "width": width,
        "height": height,
        "layer": layer,
        "channels": channels,
        "sample_counts": info.sample_counts,
        "samples_from": source,
        "side_channels": info.sides,
        "nonfinite": nonfinite.iter().map(|(path, count)| json!([path, count])).collect::<Vec<_>>(),
        "output": args.output,
    });
    let mut lines = vec![format!(
        "pictures   {} of {width}x{height} pixels, channels {}{}",
        order.len(),
        channels.join(", "),
        if position == [0, 0] {
            String::new()
        } else {
            format!("; stored from (0, 0) instead of ({}, {})", position[0], position[1])
        }
    )];
    lines.push(format!("samples    {} per pixel ({source})", numbers(&info.sample_counts)));
    lines.push(format!("order      {}", super::list(&order, "")));
    lines.extend(nonfinite.iter().map(|(path, count)| {
        format!("warning    {count} values of '{}' are not finite", path.display())
    }));
    say(args, &json, lines);
    Ok(())
}

/// The samples behind each of some independent renderings.
fn samples_each(spp: Option<u32>, pictures: &[Picture]) -> Result<(u32, Source), Error> {
    if let Some(spp) = spp {
        return Ok((spp, "--spp, each"));
    }
    let first = &pictures[0];
    for picture in pictures {
        let path = picture.path().display();
        let Some(spp) = picture.samples_per_pixel else {
            return Err(Error::Usage(format!(
                "'{path}' does not say with how many samples per pixel it was rendered (attribute \
                 samplesPerPixel); say it with --spp"
            )));
        };
        if Some(spp) != first.samples_per_pixel {
            return Err(Error::Files(format!(
                "'{path}' has {spp} samples per pixel, but '{}' has {}; independent renderings \
                 must have equally many",
                first.path().display(),
                first.samples_per_pixel.unwrap_or_default()
            )));
        }
    }
    Ok((first.samples_per_pixel.unwrap_or(1), "attribute samplesPerPixel, each"))
}

/// The samples behind each snapshot of a progressive rendering.
fn samples_of_estimates(
    list: Option<&[u32]>,
    pictures: &[Picture],
) -> Result<(Vec<u32>, Source), Error> {
    if let Some(list) = list {
        return Ok((list.to_vec(), "--spp-list"));
    }
    let from = |of: &dyn Fn(&Picture) -> Option<u32>| pictures.iter().map(of).collect();
    if let Some(counts) = from(&|picture| picture.samples_per_pixel) {
        return Ok((counts, "attribute samplesPerPixel"));
    }
    if let Some(counts) = from(&|picture| samples_in_name(picture.path())) {
        return Ok((counts, "the files' names"));
    }
    let unknown = pictures.iter().find(|picture| samples_in_name(picture.path()).is_none());
    Err(Error::Usage(format!(
        "'{}' does not say how many samples per pixel it shows, neither in the attribute \
         samplesPerPixel nor in its name; list the numbers with --spp-list",
        unknown.unwrap_or(&pictures[0]).path().display()
    )))
}

/// Sorts pictures by their sample counts, which must differ.
fn sort(pictures: &mut Vec<Picture>, counts: Vec<u32>) -> Result<Vec<u32>, Error> {
    let mut sorted: Vec<(u32, Picture)> = counts.into_iter().zip(pictures.drain(..)).collect();
    sorted.sort_by_key(|(count, _)| *count);
    if let Some(pair) = sorted.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        let [(count, first), (_, second)] = pair else { unreachable!("a window of two") };
        return Err(Error::Files(format!(
            "'{}' and '{}' both have {count} samples per pixel; the snapshots of one rendering \
             have different numbers (--spp-list gives them)",
            first.path().display(),
            second.path().display()
        )));
    }
    let (counts, sorted): (Vec<u32>, Vec<Picture>) = sorted.into_iter().unzip();
    *pictures = sorted;
    Ok(counts)
}

/// Sequences of independent renderings become a dataset for training, one at a time.
fn runs(args: &PackArgs) -> Result<(), Error> {
    let infos = args
        .files
        .iter()
        .map(|path| Ok((path.as_path(), SequenceReader::open(path)?.info().clone())))
        .collect::<Result<Vec<_>, Error>>()?;
    let (first_path, first) = &infos[0];
    for (path, info) in &infos {
        check_run((path, info), (first_path, first))?;
    }
    let seeds: Vec<u64> = infos.iter().flat_map(|(_, info)| info.seeds.iter().copied()).collect();
    if let Some((i, j)) = equal_pair(&seeds).filter(|_| seeds.len() == infos.len()) {
        return Err(Error::Files(format!(
            "'{}' and '{}' both have the seed {}; runs must be independent",
            infos[i].0.display(),
            infos[j].0.display(),
            seeds[i]
        )));
    }
    let consecutive = seeds.len() == infos.len()
        && seeds.windows(2).all(|pair| pair[0].checked_add(1) == Some(pair[1]));
    let info = DatasetInfo {
        size: first.size,
        channels: first.model.channels().len() as u32,
        runs: infos.len() as u32,
        sample_counts: first.sample_counts.clone(),
        scene: first.scene.clone(),
        sampler: first.sampler.clone(),
        first_seed: seeds.first().copied().filter(|_| consecutive),
    };
    let mut writer = DatasetWriter::new(OutputFile::create(&args.output)?, info)?;
    for path in &args.files {
        writer.push(&SequenceFile::read(path)?.batch)?;
    }
    writer.finish()?;
    let json = json!({
        "files": args.files,
        "runs": infos.len(),
        "sample_counts": first.sample_counts,
        "output": args.output,
    });
    let [width, height] = first.size;
    let lines = vec![
        format!("runs       {} of {width}x{height} pixels", infos.len()),
        format!("samples    {} per pixel", numbers(&first.sample_counts)),
    ];
    say(args, &json, lines);
    Ok(())
}

fn check_run(
    (path, info): (&Path, &SequenceInfo),
    (first_path, first): (&Path, &SequenceInfo),
) -> Result<(), Error> {
    let different = if info.size != first.size {
        "sizes"
    } else if info.model != first.model {
        "channels"
    } else if info.sample_counts != first.sample_counts {
        "terms (nst.terms)"
    } else if info.scene != first.scene {
        "scenes (nst.scene)"
    } else if info.sampler != first.sampler {
        "samplers (nst.sampler)"
    } else {
        return Ok(());
    };
    Err(Error::Files(format!(
        "'{}' and '{}' have different {different}; the runs of a dataset must agree in them",
        first_path.display(),
        path.display()
    )))
}

fn equal_pair(seeds: &[u64]) -> Option<(usize, usize)> {
    let mut order: Vec<usize> = (0..seeds.len()).collect();
    order.sort_by_key(|&i| seeds[i]);
    let pair = order.windows(2).find(|pair| seeds[pair[0]] == seeds[pair[1]])?;
    Some((pair[0], pair[1]))
}

fn say(args: &PackArgs, json: &Value, mut lines: Vec<String>) {
    if args.common.json {
        println!("{json}");
    } else if !args.common.quiet {
        lines.push(format!("wrote      {}", args.output.display()));
        println!("{}", lines.join("\n"));
    }
}

//! `nst info`: what is in a file.

use std::path::Path;

use nst_core::{BUILTIN, Network};
use nst_render::{
    Scene,
    dataset::{self, DatasetInfo},
    exr_header::{ExrHeader, Part, is_exr},
    sequence_file::SequenceReader,
};
use serde_json::{Value, json};

use super::{list, numbers};
use crate::{
    args::{InfoArgs, has_extension},
    error::Error,
};

/// The same facts for programs and for people.
struct Info {
    json: Value,
    /// The first is the headline.
    lines: Vec<String>,
}

pub(crate) fn run(args: &InfoArgs) -> Result<(), Error> {
    let path = &args.file;
    let info = if has_extension(path, "obj") {
        scene(path)?
    } else if has_extension(path, "safetensors") {
        match dataset::safetensors_format(path)?.as_str() {
            dataset::FORMAT => dataset_of_runs(path)?,
            // Anything else is judged by the reader of weights, which says what it misses.
            _ => weights(path)?,
        }
    } else if is_exr(path)? {
        exr(path)?
    } else {
        return Err(Error::Files(format!(
            "'{}' is no EXR file, and its name ends neither in .obj (a scene) nor in .safetensors \
             (weights or a dataset)",
            path.display()
        )));
    };
    if args.json {
        let mut json = info.json;
        json["file"] = path.display().to_string().into();
        println!("{json}");
    } else {
        println!("{}: {}", path.display(), info.lines.join("\n"));
    }
    Ok(())
}

fn scene(path: &Path) -> Result<Info, Error> {
    let scene = Scene::load(path)?;
    let lights =
        scene.triangles.iter().filter(|t| scene.materials[t.material as usize].emits()).count();
    let [width, height] = scene.size;
    let fingerprint = scene.fingerprint();
    let networks = trained_on(&fingerprint)?;
    let (low, high) = scene.bounds();
    let camera = &scene.camera;
    let mut lines = vec![
        format!(
            "scene, {} triangles, {lights} of them lights, {} materials",
            scene.triangles.len(),
            scene.materials.len()
        ),
        format!("fingerprint {fingerprint}"),
        format!("networks    {}", list(&networks, "none of the built-in ones was trained on it")),
        format!("film        {width}x{height}, paths of up to {} vertices", scene.max_depth),
        format!(
            "camera      at {}, towards {}, {} degrees high",
            camera.position, camera.target, camera.vertical_fov
        ),
        format!("bounds      {low} to {high}"),
    ];
    lines.extend(scene.notes.iter().map(|note| format!("note        {note}")));
    let json = json!({
        "kind": "scene",
        "fingerprint": fingerprint,
        "networks": networks,
        "triangles": scene.triangles.len(),
        "lights": lights,
        "materials": scene.materials.len(),
        "width": width,
        "height": height,
        "max_depth": scene.max_depth,
        "camera": {
            "position": camera.position.to_array(),
            "target": camera.target.to_array(),
            "up": camera.up.to_array(),
            "vertical_fov": camera.vertical_fov,
        },
        "bounds": [low.to_array(), high.to_array()],
        "notes": scene.notes,
    });
    Ok(Info { json, lines })
}

fn weights(path: &Path) -> Result<Info, Error> {
    let network =
        Network::read(path).map_err(|source| Error::Weights { path: path.to_owned(), source })?;
    let metadata = network.metadata();
    let parameters: usize =
        network.layers().iter().map(|layer| layer.weight.len() + layer.bias.len()).sum();
    let (first, last) = metadata.samples;
    let lines = vec![
        format!("weights of a network, {} wide, {parameters} parameters", network.shape()),
        format!("reads       the last {} terms", metadata.window),
        format!("trained on  {}, {first} to {last} samples", metadata.trained_on.join(", ")),
        format!(
            "training    loss {}, {} epochs, seed {}",
            metadata.loss, metadata.epochs, metadata.seed
        ),
    ];
    let json = json!({
        "kind": "weights",
        "shape": network.shape().to_string(),
        "parameters": parameters,
        "window": metadata.window,
        "trained_on": metadata.trained_on,
        "samples": [first, last],
        "sampler": metadata.sampler,
        "loss": metadata.loss,
        "epochs": metadata.epochs,
        "seed": metadata.seed,
        "config": metadata.config,
    });
    Ok(Info { json, lines })
}

fn dataset_of_runs(path: &Path) -> Result<Info, Error> {
    let info = DatasetInfo::read(path)?;
    let [width, height] = info.size;
    let seeds = info.first_seed.map_or_else(
        || "not recorded".to_owned(),
        |first| format!("{first} to {}", first.wrapping_add(u64::from(info.runs) - 1)),
    );
    let lines = vec![
        format!(
            "dataset, {} runs of {} terms, {width}x{height} pixels, {} channels",
            info.runs,
            info.sample_counts.len(),
            info.channels
        ),
        format!("samples     {}", numbers(&info.sample_counts)),
        format!("scene       {}", or_unknown(&info.scene)),
        format!("sampler     {}, seeds {seeds}", or_unknown(&info.sampler)),
    ];
    let json = json!({
        "kind": "dataset",
        "runs": info.runs,
        "sample_counts": info.sample_counts,
        "width": width,
        "height": height,
        "channels": info.channels,
        "scene": info.scene,
        "sampler": info.sampler,
        "first_seed": info.first_seed,
    });
    Ok(Info { json, lines })
}

fn exr(path: &Path) -> Result<Info, Error> {
    let header = ExrHeader::read(path)?;
    let bytes = std::fs::metadata(path).map(|file| file.len()).unwrap_or_default();
    let mut info = if header.parts[0].attributes.contains_key("nst.terms") {
        sequence(path)?
    } else {
        Info { json: json!({ "kind": "picture" }), lines: vec!["picture".to_owned()] }
    };
    info.lines[0] += &format!(" (EXR), {bytes} bytes");
    info.json["bytes"] = bytes.into();
    let layers = header.layers();
    for (index, part) in header.parts.iter().enumerate() {
        let layers: Vec<_> = layers.iter().filter(|layer| layer.part == index).collect();
        let names: Vec<_> = layers
            .iter()
            .map(|layer| if layer.name.is_empty() { "(main)" } else { &layer.name })
            .collect();
        info.lines.push(part_line(part));
        info.lines.push(format!("layers      {}", list(&names, "none that is a picture")));
        for (name, value) in &part.attributes {
            info.lines.push(format!("attribute   {name} = {value}"));
        }
        let channels: Vec<_> = part
            .channels
            .iter()
            .map(|channel| json!({ "name": channel.name, "type": channel.kind }))
            .collect();
        let part = json!({
            "name": part.name,
            "width": part.size[0],
            "height": part.size[1],
            "position": part.position,
            "storage": part.storage,
            "deep": part.deep,
            "layers": layers.iter().map(|layer| &layer.name).collect::<Vec<_>>(),
            "channels": channels,
            "attributes": part.attributes,
        });
        match &mut info.json["parts"] {
            Value::Array(parts) => parts.push(part),
            none => *none = json!([part]),
        }
    }
    Ok(info)
}

fn sequence(path: &Path) -> Result<Info, Error> {
    let reader = SequenceReader::open(path)?;
    let info = reader.info();
    let seeds: Vec<_> = info.seeds.iter().map(u64::to_string).collect();
    let lines = vec![
        "sequence".to_owned(),
        format!("terms       {}", numbers(&info.sample_counts)),
        format!("beside them {}", list(&info.sides, "nothing")),
        format!("scene       {}", or_unknown(&info.scene)),
        format!("sampler     {}, seed {}", or_unknown(&info.sampler), list(&seeds, "not recorded")),
        format!(
            "rendering   {} s, {}",
            info.render_seconds,
            if info.resume.is_some() { "can be continued" } else { "cannot be continued" }
        ),
    ];
    let json = json!({
        "kind": "sequence",
        "width": info.size[0],
        "height": info.size[1],
        "channels": info.model.channels(),
        "sample_counts": info.sample_counts,
        "side_channels": info.sides,
        "scene": info.scene,
        "sampler": info.sampler,
        "seeds": info.seeds,
        "render_seconds": info.render_seconds,
        "resumable": info.resume.is_some(),
    });
    Ok(Info { json, lines })
}

fn part_line(part: &Part) -> String {
    let ([width, height], [x, y]) = (part.size, part.position);
    let name = part.name.as_ref().map(|name| format!(" '{name}'")).unwrap_or_default();
    let at = if [x, y] == [0, 0] { String::new() } else { format!(" from ({x}, {y})") };
    let deep = if part.deep { ", deep" } else { "" };
    let mut kinds: Vec<_> = part.channels.iter().map(|channel| channel.kind).collect();
    kinds.sort_unstable();
    kinds.dedup();
    format!(
        "part{name:8}{width}x{height} pixels{at}, {} channels of {}, {}{deep}",
        part.channels.len(),
        kinds.join(" and "),
        part.storage
    )
}

/// The built-in networks that were trained on a scene.
fn trained_on(fingerprint: &str) -> Result<Vec<&'static str>, Error> {
    let mut names = Vec::new();
    for (name, bytes) in BUILTIN {
        let network = Network::from_bytes(bytes)?;
        if network.metadata().trained_on.contains(&format!("scene:{fingerprint}")) {
            names.push(*name);
        }
    }
    Ok(names)
}

fn or_unknown(text: &str) -> &str {
    if text.is_empty() { "not recorded" } else { text }
}

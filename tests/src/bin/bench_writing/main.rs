//! How fast pictures are written, beside the exr crate's own writer, which compresses on all
//! cores, too; in a program of its own, so that nobody installs with `nst` what only a
//! measurement needs.

use std::{
    error::Error,
    fs::File,
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use clap::Parser;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer,
    LayerAttributes, LineOrder, SmallVec, WritableImage, read_first_flat_layer_from_file,
};
use nst_core::{Estimates, FurtherPowers, Keep, MlpCpu, Network, Side, Transform};
use nst_files::{
    ColorModel,
    output::{OutputFile, commit},
    picture_writer::{PictureInfo, write_exr},
    png,
};
use nst_render::{RenderSettings, SamplerKind, Scene, render};
use serde::Serialize;

type Checked<T> = Result<T, Box<dyn Error>>;

/// Time the writing of a picture with the layers S and Variance, by turns with the exr crate.
#[derive(Debug, Parser)]
struct Args {
    /// Width and height of the picture, a rendering of the Cornell box with eight samples per
    /// pixel.
    #[arg(long, default_value_t = 4000, value_parser = clap::value_parser!(u32).range(1..=8000))]
    size: u32,
    /// Turns of each; the median counts.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    runs: u32,
    /// CSV file to write.
    #[arg(short, long, value_name = "CSV")]
    output: Option<PathBuf>,
}

/// What is timed, from floats in memory to a file on the disk.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Writer {
    /// The EXR picture, and the PNG beside it, as `nst render` writes them.
    Both,
    Exr,
    Png,
    /// The exr crate's writer of whole images.
    Crate(Compression),
    /// The bytes of nst's EXR file, as they are.
    Copy,
}

impl Writer {
    /// In an order in which there is something to copy.
    const ALL: [Self; 7] = [
        Self::Both,
        Self::Exr,
        Self::Png,
        Self::Crate(Compression::ZIP16),
        Self::Crate(Compression::PIZ),
        Self::Crate(Compression::Uncompressed),
        Self::Copy,
    ];

    fn name(self) -> String {
        match self {
            Self::Both => "nst, EXR and PNG".into(),
            Self::Exr => "nst, EXR".into(),
            Self::Png => "nst, PNG".into(),
            Self::Crate(Compression::ZIP16) => "exr crate, zip".into(),
            Self::Crate(compression) => format!("exr crate, {compression:?}").to_lowercase(),
            Self::Copy => "copy of nst's EXR".into(),
        }
    }
}

/// The median of the turns.
#[derive(Debug, Serialize)]
struct Row {
    what: String,
    seconds: f64,
    /// How many times as fast as the exr crate with the same compression.
    ratio: f64,
    bytes: u64,
}

/// A picture in memory.
struct Picture {
    size: [u32; 2],
    /// The estimates, the plain ones, and their variance, as planar lanes.
    layers: [(&'static str, Vec<f32>); 3],
}

fn main() -> ExitCode {
    nst_tests::exit_code(run(&Args::parse()))
}

fn run(args: &Args) -> Checked<()> {
    let picture = Picture::render(args.size)?;
    let folder = tempfile::tempdir()?;
    let mut times = vec![Vec::new(); Writer::ALL.len()];
    let mut bytes = vec![0; Writer::ALL.len()];
    for run in 0..args.runs {
        for (i, writer) in Writer::ALL.into_iter().enumerate() {
            let (seconds, length) = picture.write(writer, folder.path())?;
            times[i].push(seconds);
            bytes[i] = length;
            if run == 0 && writer != Writer::Png {
                picture.check(&folder.path().join("x.exr"), writer)?;
            }
        }
    }
    let medians: Vec<f64> = times.iter_mut().map(|times| median(times)).collect();
    let theirs = Writer::ALL.iter().position(|&it| it == Writer::Crate(Compression::ZIP16));
    let theirs = medians[theirs.expect("it is one of them")];
    let rows = Writer::ALL.iter().zip(medians).zip(bytes).map(|((writer, seconds), bytes)| Row {
        what: writer.name(),
        seconds,
        ratio: theirs / seconds,
        bytes,
    });
    let rows: Vec<Row> = rows.collect();
    for Row { what, seconds, ratio, bytes } in &rows {
        println!("{what:26} {seconds:7.3} s  {ratio:5.2}  {:7.1} MB", *bytes as f64 / 1e6);
    }
    if let Some(output) = &args.output {
        let mut output = csv::Writer::from_path(output)?;
        rows.iter().try_for_each(|row| output.serialize(row))?;
        output.flush()?;
    }
    Ok(())
}

impl Picture {
    /// The Cornell box, by the network that was trained on it.
    fn render(size: u32) -> Checked<Self> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/cornell/cornell.obj");
        let scene = Scene { size: [size; 2], ..Scene::load(&path)? };
        let keep = Keep::Window(8);
        let settings = RenderSettings {
            spp: 8,
            sampler: SamplerKind::Random,
            seed: 0,
            keep,
            powers: FurtherPowers::NONE,
            features: false,
        };
        let batch = render(&scene, &settings, &|_| {})?.batch();
        let network = Network::builtin("cornell").ok_or("there is no network 'cornell'")??;
        let mut estimates = Estimates::default();
        MlpCpu::new(network).transform(&batch, &mut estimates)?;
        let variance = batch.side(&Side::Variance).ok_or("eight samples have a variance")?;
        let layers = [("", estimates.values()), ("S", batch.last()), ("Variance", variance)];
        Ok(Self { size: scene.size, layers: layers.map(|(name, lanes)| (name, lanes.to_vec())) })
    }

    /// The channels by name, as planes.
    fn channels(&self) -> impl Iterator<Item = (String, &[f32])> {
        self.layers.iter().flat_map(|(layer, lanes)| {
            let planes = lanes.chunks(lanes.len() / 3).zip(["R", "G", "B"]);
            planes.map(move |(plane, channel)| {
                let dot = if layer.is_empty() { "" } else { "." };
                (format!("{layer}{dot}{channel}"), plane)
            })
        })
    }

    /// Writes `x.exr`, or `x.png`, or both; returns the seconds until all is on the disk, and
    /// the size.
    fn write(&self, writer: Writer, folder: &Path) -> Checked<(f64, u64)> {
        let [exr, png] = ["x.exr", "x.png"].map(|name| folder.join(name));
        let length = |path: &Path| path.metadata().map(|data| data.len());
        let seconds = |job: &mut dyn FnMut() -> Checked<()>| {
            let begin = Instant::now();
            job()?;
            Ok::<_, Box<dyn Error>>(begin.elapsed().as_secs_f64())
        };
        match writer {
            Writer::Both => {
                let seconds = seconds(&mut || {
                    let [mut exr, mut png] = [OutputFile::create(&exr)?, OutputFile::create(&png)?];
                    let (a, b) = rayon::join(|| self.exr(&mut exr), || self.png(&mut png));
                    a.and(b)?;
                    Ok(commit([exr, png])?)
                })?;
                Ok((seconds, length(&exr)? + length(&png)?))
            }
            Writer::Exr | Writer::Png => {
                let path = if writer == Writer::Exr { &exr } else { &png };
                let seconds = seconds(&mut || {
                    let mut file = OutputFile::create(path)?;
                    if writer == Writer::Exr { self.exr(&mut file) } else { self.png(&mut file) }?;
                    Ok(file.commit()?)
                })?;
                Ok((seconds, length(path)?))
            }
            Writer::Crate(compression) => {
                let image = self.image(compression);
                let seconds = seconds(&mut || {
                    image.write().to_file(&exr)?;
                    Ok(File::open(&exr)?.sync_all()?)
                })?;
                Ok((seconds, length(&exr)?))
            }
            Writer::Copy => {
                self.write(Writer::Exr, folder)?;
                let bytes = std::fs::read(&exr)?;
                let seconds = seconds(&mut || {
                    std::fs::write(&exr, &bytes)?;
                    Ok(File::open(&exr)?.sync_all()?)
                })?;
                Ok((seconds, bytes.len() as u64))
            }
        }
    }

    fn exr(&self, file: &mut OutputFile) -> Result<(), nst_files::Error> {
        let layers = self.layers.each_ref().map(|(name, lanes)| (*name, &lanes[..]));
        write_exr(file, self.size, ColorModel::Rgb, &layers, &PictureInfo::default())
    }

    fn png(&self, file: &mut OutputFile) -> Result<(), nst_files::Error> {
        png::write(file, self.size, &self.layers[0].1)
    }

    /// The picture as the exr crate has it.
    fn image(&self, compression: Compression) -> Image<Layer<AnyChannels<FlatSamples>>> {
        let channels = self
            .channels()
            .map(|(name, plane)| AnyChannel::new(name.as_str(), FlatSamples::F32(plane.to_vec())));
        let channels = AnyChannels::sort(channels.collect::<SmallVec<_>>());
        let line_order = LineOrder::Increasing;
        let encoding = Encoding { compression, blocks: Blocks::ScanLines, line_order };
        let [width, height] = self.size.map(|length| length as usize);
        let size = (width, height);
        Image::from_layer(Layer::new(size, LayerAttributes::default(), encoding, channels))
    }

    /// Fails if the file, as the exr crate reads it, differs from the picture in any bit.
    fn check(&self, path: &Path, writer: Writer) -> Checked<()> {
        let read = read_first_flat_layer_from_file(path)?.layer_data.channel_data;
        let mut expected: Vec<_> = self.channels().collect();
        expected.sort_by(|a, b| a.0.cmp(&b.0));
        let same = expected.len() == read.list.len()
            && expected.iter().zip(&read.list).all(|((name, plane), found)| {
                let FlatSamples::F32(values) = &found.sample_data else { return false };
                let bits = |values: &[f32]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                found.name == *name.as_str() && bits(values) == bits(plane)
            });
        if same { Ok(()) } else { Err(format!("{}: other values come back", writer.name()).into()) }
    }
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

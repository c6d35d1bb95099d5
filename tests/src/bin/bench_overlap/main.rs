//! What it gains that a method works on finished rows while others are still traced: the time of
//! the whole job both ways, and when each band of rows was traced, handed over and done. Both
//! ways must give the same bits.

use std::{
    error::Error,
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use clap::Parser;
use nst_core::{
    Estimates, FurtherPowers, Keep, MlpCpu, Network, Transform,
    gpu::{AdapterKind, Gpu, MlpGpu},
    guard::Guard,
};
use nst_render::{
    Band, Consumer, Control, Estimator, RenderSettings, SamplerKind, Scene, render_to,
};
use serde::Serialize;

type Checked<T> = Result<T, Box<dyn Error>>;

/// Time a rendering of the Cornell box and what a method makes of it, with and without overlap.
#[derive(Debug, Parser)]
struct Args {
    /// Width and height of the picture.
    #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=8000))]
    size: u32,
    /// Samples per pixel.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(8..))]
    spp: u32,
    /// Turns of each; the medians are printed.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    runs: u32,
    /// CSV file for the times of the jobs; the bands of the first run go to a file beside it,
    /// whose name ends in `-bands.csv`.
    #[arg(short, long, value_name = "CSV")]
    output: Option<PathBuf>,
}

/// One job; seconds since it began.
#[derive(Debug, Serialize)]
struct Row {
    method: String,
    overlap: bool,
    run: u32,
    traced_seconds: f64,
    total_seconds: f64,
    /// Bands that were done while others were traced.
    bands: usize,
}

/// A band; seconds since its job began.
#[derive(Debug, Serialize)]
struct BandRow {
    method: String,
    first_row: u32,
    traced_seconds: f64,
    handed_seconds: f64,
    done_seconds: f64,
}

/// What a job gives.
struct Job {
    traced: f64,
    total: f64,
    /// First row; traced, handed, done.
    bands: Vec<(u32, [f64; 3])>,
    /// In the order in which they were made.
    estimates: Vec<(usize, Vec<f32>)>,
}

fn main() -> ExitCode {
    nst_tests::exit_code(run(&Args::parse()))
}

fn run(args: &Args) -> Checked<()> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/cornell/cornell.obj");
    let scene = Scene { size: [args.size; 2], ..Scene::load(&path)? };
    let methods = methods()?;
    let (mut rows, mut bands) = (Vec::new(), Vec::new());
    for run in 0..args.runs {
        for (method, transform) in &methods {
            let mut both = Vec::new();
            for overlap in [false, true] {
                let Job { traced, total, bands: of_job, estimates } =
                    job(&scene, args.spp, &**transform, overlap)?;
                both.push(picture(&estimates, args.size));
                let (method, count) = (method.clone(), of_job.len());
                let [traced_seconds, total_seconds] = [traced, total];
                if run == 0 {
                    bands.extend(of_job.into_iter().map(|(first_row, [traced, handed, done])| {
                        let [traced_seconds, handed_seconds, done_seconds] = [traced, handed, done];
                        let method = method.clone();
                        BandRow { method, first_row, traced_seconds, handed_seconds, done_seconds }
                    }));
                }
                rows.push(Row {
                    method,
                    overlap,
                    run,
                    traced_seconds,
                    total_seconds,
                    bands: count,
                });
            }
            if both[0] != both[1] {
                return Err(format!("{method}: overlap changes the estimates").into());
            }
        }
    }
    print(&methods, &rows);
    let Some(output) = &args.output else { return Ok(()) };
    write(output, &rows)?;
    write(&output.with_file_name(beside(output)), &bands)
}

/// The name of the file of bands.
fn beside(output: &Path) -> String {
    format!("{}-bands.csv", output.file_stem().unwrap_or_default().to_string_lossy())
}

fn write<T: Serialize>(path: &Path, rows: &[T]) -> Checked<()> {
    let mut output = csv::Writer::from_path(path)?;
    rows.iter().try_for_each(|row| output.serialize(row))?;
    Ok(output.flush()?)
}

/// The guard, and a network on the CPU and, if there is one, on a GPU.
fn methods() -> Checked<Vec<(String, Box<dyn Transform>)>> {
    let network = || Network::builtin("cornell").ok_or("there is no network 'cornell'");
    let mut methods: Vec<(String, Box<dyn Transform>)> = vec![
        ("guard".into(), Box::new(Guard::default())),
        ("cornell on the CPU".into(), Box::new(MlpCpu::new(network()??))),
    ];
    match Gpu::open(AdapterKind::Any) {
        Ok(gpu) => {
            let name = format!("cornell on {}", gpu.name());
            methods.push((name, Box::new(MlpGpu::new(gpu, network()??)?)));
        }
        Err(error) => eprintln!("without a GPU: {error}"),
    }
    Ok(methods)
}

/// Renders, and makes estimates, at once or one after the other.
fn job(scene: &Scene, spp: u32, transform: &dyn Transform, overlap: bool) -> Checked<Job> {
    let window = transform.requires().window as u32;
    let (sampler, keep) = (SamplerKind::Random, Keep::Window(window));
    let settings = RenderSettings {
        spp,
        sampler,
        seed: 0,
        keep,
        powers: FurtherPowers::NONE,
        features: false,
    };
    let begin = Instant::now();
    let since = |moment: Instant| moment.duration_since(begin).as_secs_f64();
    let (mut estimates, mut bands, mut failure) = (Vec::new(), Vec::new(), None);
    let put = |rows: std::ops::Range<usize>, made: &Estimates| {
        estimates.push((rows.start, made.values().to_vec()));
    };
    let mut estimator = Estimator::new(transform, put)?;
    let sides = estimator.sides().filter(|_| overlap);
    let mut take = |Band { rows, traced }: Band| {
        let handed = Instant::now();
        failure = failure.take().or(estimator.add(&rows).err());
        let first = rows.grid().map_or(0, nst_core::Grid::first_row);
        bands.push((first, [traced, handed, Instant::now()].map(since)));
    };
    let consumer = sides.map(|sides| Consumer { sides, take: &mut take });
    let control = Control { progress: &|_| {}, stop: &|| false };
    let rendering = render_to(consumer, None, scene, &settings, control)?;
    let traced = since(Instant::now());
    if let Some(error) = failure {
        return Err(error.into());
    }
    estimator.finish(&rendering)?;
    Ok(Job { traced, total: since(Instant::now()), bands, estimates })
}

/// Planar lanes of a square picture, of estimates that came some rows at a time.
fn picture(estimates: &[(usize, Vec<f32>)], size: u32) -> Vec<u32> {
    let (width, pixels) = (size as usize, size as usize * size as usize);
    let mut picture = vec![f32::NAN.to_bits(); 3 * pixels];
    for (first, values) in estimates {
        let planes = picture.chunks_exact_mut(pixels).zip(values.chunks_exact(values.len() / 3));
        for (plane, values) in planes {
            let place = &mut plane[first * width..][..values.len()];
            place.iter_mut().zip(values).for_each(|(place, value)| *place = value.to_bits());
        }
    }
    picture
}

fn print(methods: &[(String, Box<dyn Transform>)], rows: &[Row]) {
    println!("{:40} {:8} {:>9} {:>9} {:>6}", "method", "overlap", "traced s", "total s", "bands");
    for (method, _) in methods {
        for overlap in [false, true] {
            let same: Vec<&Row> =
                rows.iter().filter(|row| row.method == *method && row.overlap == overlap).collect();
            let median = |of: fn(&Row) -> f64| {
                let mut values: Vec<f64> = same.iter().map(|row| of(row)).collect();
                values.sort_by(f64::total_cmp);
                values[values.len() / 2]
            };
            let [traced, total] =
                [median(|row| row.traced_seconds), median(|row| row.total_seconds)];
            let bands = median(|row| row.bands as f64);
            println!("{method:40} {overlap:8} {traced:9.3} {total:9.3} {bands:6}");
        }
    }
}

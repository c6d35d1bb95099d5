//! `nst bench inference`: how fast networks are evaluated, beside the matrix product
//! that bounds it.

mod network;
mod peak;

use std::{fmt, time::Instant};

use ndarray::Array2;
use nst_core::{
    Estimates, Instructions, MlpCpu, Network, SequenceBatch, Status, Transform,
    gpu::{AdapterKind, Gpu, GpuOptions, Kernel, MlpGpu, Precision},
};
use nst_files::output::{Kind, Name, OutputFile, Outputs};
use serde::Serialize;

use crate::{
    args::{BenchInferenceArgs, InferenceBackend},
    error::Error,
    report::{complain, say},
};
use network::{random_network, random_window, worst_error};
use peak::Product;

/// Lanes that are compared with f64 before anything is timed, from either end.
const CHECKED: usize = 128;

/// How long a backend's turn takes at least, in seconds.
const TURN: f64 = 0.02;

/// The largest error, relative to the sum of magnitudes of the output layer.
const TOLERANCE: f64 = 1e-5;

/// The same, where weights are rounded to f16.
const TOLERANCE_F16: f64 = 5e-3;

/// A backend on a network and a number of lanes; times are medians over runs.
#[derive(Clone, Debug, Serialize)]
struct Row {
    /// `cpu`, `gpu`, or `gemm`: the matrix product alone.
    backend: String,
    /// The GPU and its kernel; for the CPU, the instructions.
    adapter: String,
    /// Hidden layers.
    layers: usize,
    /// The widest hidden layer.
    hidden: usize,
    lanes: usize,
    /// From sequences in memory to estimates in memory.
    milliseconds: f64,
    gflops: f64,
    /// Of the rate of `gemm` on the CPU, measured in turns with this.
    share_of_peak: f64,
    /// Threads of the CPU.
    threads: usize,
}

/// What can be timed, by name.
struct Backend {
    name: &'static str,
    adapter: String,
    tolerance: f64,
    transform: Box<dyn Transform>,
    seconds: Vec<f64>,
}

/// All that was measured.
#[derive(Serialize)]
pub(super) struct Report {
    rows: Vec<Row>,
    output: Option<String>,
}

pub(super) fn run(args: &BenchInferenceArgs) -> Result<Report, Error> {
    let mut outputs = Outputs::of_inputs(&args.weights);
    let output = args.output.as_deref().map(|path| outputs.open(path, Kind::Csv, Name::Given));
    let output = output.transpose()?;
    let networks = match &args.weights {
        Some(path) => vec![
            Network::read(path).map_err(|source| Error::Weights { path: path.clone(), source })?,
        ],
        None => {
            args.shapes.iter().map(|shape| random_network(shape.layers, shape.hidden)).collect()
        }
    };
    let open = if args.variants { Gpu::open_experimental } else { Gpu::open };
    let gpu = match args.backend {
        InferenceBackend::Cpu => None,
        InferenceBackend::Gpu => Some(open(AdapterKind::Any).map_err(Error::Gpu)?),
        InferenceBackend::All => open(AdapterKind::Any)
            .inspect_err(|error| {
                complain(&format!("warning: {error}; measuring the CPU alone"));
            })
            .ok(),
    };
    let mut rows = Vec::new();
    for network in &networks {
        for lanes in args.lanes() {
            for row in measure(network, lanes, args, gpu.as_ref())? {
                say(&row.to_string(), &args.common)?;
                rows.push(row);
            }
        }
    }
    let written = output.as_ref().map(|output| output.path().display().to_string());
    output.map(|output| write_csv(output, &rows)).transpose()?;
    Ok(Report { rows, output: written })
}

fn write_csv(mut output: OutputFile, rows: &[Row]) -> Result<(), Error> {
    let path = output.path().to_owned();
    let mut writer = csv::Writer::from_writer(output.file());
    rows.iter()
        .try_for_each(|row| writer.serialize(row))
        .and_then(|()| Ok(writer.flush()?))
        .map_err(|source| Error::Csv { path, source })?;
    drop(writer);
    Ok(output.commit()?)
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { backend, adapter, layers, hidden, lanes, milliseconds, gflops, .. } = self;
        write!(
            f,
            "{backend:5} {adapter:40} {layers:>2}x{hidden:<4} {lanes:>8} lanes \
             {milliseconds:>10.3} ms {gflops:>8.2} GFLOP/s {:>6.2} of gemm",
            self.share_of_peak
        )
    }
}

/// The rows have been said as they came.
impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.output {
            Some(path) => write!(f, "wrote {path}"),
            None => write!(f, "--output writes a CSV file"),
        }
    }
}

fn backends(
    network: &Network,
    args: &BenchInferenceArgs,
    gpu: Option<&Gpu>,
) -> Result<Vec<Backend>, Error> {
    let mut backends = Vec::new();
    let mut add = |name, adapter: String, tolerance, transform: Box<dyn Transform>| {
        backends.push(Backend { name, adapter, tolerance, transform, seconds: Vec::new() });
    };
    if args.backend != InferenceBackend::Gpu {
        let best = [Instructions::detect()];
        let all = Instructions::available();
        for &instructions in if args.variants { &all[..] } else { &best[..] } {
            let mlp = MlpCpu::with_instructions(network.clone(), instructions);
            add("cpu", instructions.to_string(), TOLERANCE, Box::new(mlp));
        }
    }
    let Some(gpu) = gpu else { return Ok(backends) };
    let mut kernels = vec![Kernel::Tiled];
    if args.variants {
        kernels.push(Kernel::Naive);
        kernels.extend(gpu.has_cooperative_matrices().then_some(Kernel::Cooperative));
    }
    for kernel in kernels {
        for precision in [Precision::F32, Precision::F16] {
            let runs = match precision {
                Precision::F32 => kernel != Kernel::Cooperative,
                Precision::F16 => args.variants && gpu.has_f16(),
            };
            if !runs {
                continue;
            }
            let options = GpuOptions { kernel, precision };
            let mlp = match MlpGpu::with_options(gpu.clone(), network.clone(), options) {
                // Experimental: no reason to leave out the others.
                Err(error) if kernel == Kernel::Cooperative => {
                    eprintln!("warning: {error}; left out");
                    continue;
                }
                mlp => mlp.map_err(Error::Gpu)?,
            };
            let adapter = format!("{}, {kernel}, {precision}", gpu.name());
            let tolerance = if precision == Precision::F16 { TOLERANCE_F16 } else { TOLERANCE };
            add("gpu", adapter, tolerance, Box::new(mlp));
        }
    }
    Ok(backends)
}

/// Checks every backend, then lets them and the matrix product take turns.
fn measure(
    network: &Network,
    lanes: usize,
    args: &BenchInferenceArgs,
    gpu: Option<&Gpu>,
) -> Result<Vec<Row>, Error> {
    let window = random_window(network.metadata().window, lanes);
    let counts = (1..=window.nrows() as u32).collect();
    let batch = SequenceBatch::new(window.clone(), counts)?;
    let mut estimates = Estimates::default();
    let mut backends = backends(network, args, gpu)?;
    for backend in &backends {
        backend.transform.transform(&batch, &mut estimates)?;
        check(network, &window, &estimates, backend)?;
    }
    let mut product = Product::new(lanes);
    let mut peak = Vec::new();
    for _ in 0..args.runs {
        peak.extend(turn(|| {
            product.multiply();
            Ok(())
        })?);
        for backend in &mut backends {
            let seconds = turn(|| backend.transform.transform(&batch, &mut estimates));
            backend.seconds.extend(seconds?);
        }
    }
    let peak_seconds = median(peak);
    let peak = product.flops() / peak_seconds / 1e9;
    let hidden = &network.layers()[..network.layers().len() - 1];
    let threads = rayon::current_num_threads();
    let mut rows = vec![Row {
        backend: "gemm".to_owned(),
        adapter: format!("{0}x{0}", peak::SIZE),
        layers: 1,
        hidden: peak::SIZE,
        lanes: product.lanes(),
        milliseconds: 1e3 * peak_seconds,
        gflops: peak,
        share_of_peak: 1.0,
        threads,
    }];
    for Backend { name, adapter, seconds, .. } in backends {
        let seconds = median(seconds);
        let gflops = (network.flops_per_lane() * lanes) as f64 / seconds / 1e9;
        rows.push(Row {
            backend: name.to_owned(),
            adapter,
            layers: hidden.len(),
            hidden: hidden.iter().map(|layer| layer.outputs()).max().unwrap_or(0),
            lanes,
            milliseconds: 1e3 * seconds,
            gflops,
            share_of_peak: gflops / peak,
            threads,
        });
    }
    Ok(rows)
}

/// The seconds of each call of a turn, after one that is not timed: it finds the caches
/// full of another backend's data, and threads asleep.
fn turn(mut call: impl FnMut() -> Result<(), nst_core::Error>) -> Result<Vec<f64>, Error> {
    call()?;
    let mut seconds = Vec::new();
    while seconds.iter().sum::<f64>() < TURN {
        let start = Instant::now();
        call()?;
        seconds.push(start.elapsed().as_secs_f64());
    }
    Ok(seconds)
}

/// Compares both ends of the batch with the network in f64.
fn check(
    network: &Network,
    window: &Array2<f32>,
    estimates: &Estimates,
    backend: &Backend,
) -> Result<(), Error> {
    let lanes = window.ncols();
    let error = (0..CHECKED.min(lanes))
        .flat_map(|i| [i, lanes - 1 - i])
        .map(|lane| worst_error(network, window.column(lane), estimates.values()[lane]))
        .fold(0.0, f64::max);
    let skipped = lanes - estimates.count(Status::Ok);
    if error <= backend.tolerance && skipped == 0 {
        return Ok(());
    }
    Err(Error::Unlike(format!(
        "{} ({}) is wrong on {}: relative error {error:e}, {skipped} lanes not evaluated",
        backend.name,
        backend.adapter,
        network.shape()
    )))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

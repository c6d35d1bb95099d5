//! How fast networks are evaluated, beside the matrix product that bounds it; in a program
//! of its own, so that nobody installs with `nst` what only a measurement needs.

mod args;
mod backends;
mod product;

use std::{error::Error, process::ExitCode, time::Instant};

use clap::Parser;
use nst_core::{
    Estimates, Network, SequenceBatch,
    gpu::{AdapterKind, Gpu},
};
use nst_tests::{random_network, random_window};
use serde::Serialize;

use args::{Args, Backends};
use backends::{Backend, backends, check};
use product::Product;

/// Terms that random networks read.
const WINDOW: usize = 8;

/// How long a backend's turn takes at least, in seconds.
const TURN: f64 = 0.02;

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

fn main() -> ExitCode {
    nst_tests::exit_code(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), Box<dyn Error>> {
    if let Some(threads) = args.threads {
        rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads)).build_global()?;
    }
    let mut output = args.output.as_deref().map(csv::Writer::from_path).transpose()?;
    let networks = match &args.weights {
        Some(path) => {
            vec![Network::read(path).map_err(|error| format!("{}: {error}", path.display()))?]
        }
        None => (0..)
            .zip(&args.shapes)
            .map(|(seed, shape)| {
                random_network(&[&[WINDOW][..], &vec![shape.hidden; shape.layers]].concat(), seed)
            })
            .collect(),
    };
    let open = if args.variants { Gpu::open_experimental } else { Gpu::open };
    let gpu = match args.backend {
        Backends::Cpu => None,
        Backends::Gpu => Some(open(AdapterKind::Any)?),
        Backends::All => open(AdapterKind::Any)
            .inspect_err(|error| eprintln!("warning: {error}; measuring the CPU alone"))
            .ok(),
    };
    for network in &networks {
        for &lanes in &args.lanes {
            for row in measure(network, lanes as usize, args, gpu.as_ref())? {
                if !args.quiet {
                    print(&row);
                }
                if let Some(output) = &mut output {
                    output.serialize(row)?;
                    output.flush()?;
                }
            }
        }
    }
    Ok(())
}

fn print(row: &Row) {
    println!(
        "{:5} {:40} {:>2}x{:<4} {:>8} lanes {:>10.3} ms {:>8.2} GFLOP/s {:>6.2} of gemm",
        row.backend,
        row.adapter,
        row.layers,
        row.hidden,
        row.lanes,
        row.milliseconds,
        row.gflops,
        row.share_of_peak
    );
}

/// Checks every backend, then lets them and the matrix product take turns.
fn measure(
    network: &Network,
    lanes: usize,
    args: &Args,
    gpu: Option<&Gpu>,
) -> Result<Vec<Row>, Box<dyn Error>> {
    let window = random_window(network.metadata().window, lanes, lanes as u64);
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
    Ok(rows(network, lanes, &product, median(peak), backends))
}

fn rows(
    network: &Network,
    lanes: usize,
    product: &Product,
    product_seconds: f64,
    backends: Vec<Backend>,
) -> Vec<Row> {
    let peak = product.flops() / product_seconds / 1e9;
    let hidden = &network.layers()[..network.layers().len() - 1];
    let threads = rayon::current_num_threads();
    let mut rows = vec![Row {
        backend: "gemm".to_owned(),
        adapter: format!("{0}x{0}", product::SIZE),
        layers: 1,
        hidden: product::SIZE,
        lanes: product.lanes(),
        milliseconds: 1e3 * product_seconds,
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
    rows
}

/// The seconds of each call of a turn, after one that is not timed: it finds the caches
/// full of another backend's data, and threads asleep.
fn turn(
    mut call: impl FnMut() -> Result<(), nst_core::Error>,
) -> Result<Vec<f64>, nst_core::Error> {
    call()?;
    let mut seconds = Vec::new();
    while seconds.iter().sum::<f64>() < TURN {
        let start = Instant::now();
        call()?;
        seconds.push(start.elapsed().as_secs_f64());
    }
    Ok(seconds)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

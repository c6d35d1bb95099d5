//! What can be timed, and whether it is right.

use std::error::Error;

use ndarray::{Array2, s};
use nst_core::{
    Estimates, Instructions, MlpCpu, Network, Status, Transform,
    gpu::{Gpu, GpuOptions, Kernel, MlpGpu, Precision},
};
use nst_tests::{TOLERANCE, TOLERANCE_F16, forward_f64, worst_error};

use crate::args::{Args, Backends};

/// Lanes that are compared with f64 before anything is timed, from either end.
const CHECKED: usize = 128;

/// An evaluation of a network, with its times.
pub(crate) struct Backend {
    pub(crate) name: &'static str,
    pub(crate) adapter: String,
    tolerance: f64,
    pub(crate) transform: Box<dyn Transform>,
    pub(crate) seconds: Vec<f64>,
}

impl Backend {
    fn new(
        name: &'static str,
        adapter: String,
        tolerance: f64,
        transform: impl Transform + 'static,
    ) -> Self {
        Self { name, adapter, tolerance, transform: Box::new(transform), seconds: Vec::new() }
    }
}

pub(crate) fn backends(
    network: &Network,
    args: &Args,
    gpu: Option<&Gpu>,
) -> Result<Vec<Backend>, nst_core::Error> {
    let mut backends = Vec::new();
    if args.backend != Backends::Gpu {
        let best = [Instructions::detect()];
        let all = Instructions::available();
        for &instructions in if args.variants { &all[..] } else { &best[..] } {
            let mlp = MlpCpu::with_instructions(network.clone(), instructions);
            backends.push(Backend::new("cpu", instructions.to_string(), TOLERANCE, mlp));
        }
    }
    if let Some(gpu) = gpu {
        for options in gpu_options(gpu, args.variants) {
            backends.extend(on_gpu(gpu, network, options)?);
        }
    }
    Ok(backends)
}

/// The kernels and precisions that the adapter has.
fn gpu_options(gpu: &Gpu, variants: bool) -> Vec<GpuOptions> {
    let mut options = vec![GpuOptions { kernel: Kernel::Tiled, precision: Precision::F32 }];
    if variants {
        options.push(GpuOptions { kernel: Kernel::Naive, precision: Precision::F32 });
        let kernels = [Kernel::Tiled, Kernel::Naive].into_iter().filter(|_| gpu.has_f16());
        let cooperative = gpu.has_cooperative_matrices().then_some(Kernel::Cooperative);
        let half = |kernel| GpuOptions { kernel, precision: Precision::F16 };
        options.extend(kernels.chain(cooperative).map(half));
    }
    options
}

fn on_gpu(
    gpu: &Gpu,
    network: &Network,
    options: GpuOptions,
) -> Result<Option<Backend>, nst_core::Error> {
    let GpuOptions { kernel, precision } = options;
    let mlp = match MlpGpu::with_options(gpu.clone(), network.clone(), options) {
        // Experimental: no reason to leave out the others.
        Err(error) if kernel == Kernel::Cooperative => {
            eprintln!("warning: {error}; left out");
            return Ok(None);
        }
        mlp => mlp?,
    };
    let adapter = format!("{}, {kernel}, {precision}", gpu.name());
    let tolerance = if precision == Precision::F16 { TOLERANCE_F16 } else { TOLERANCE };
    Ok(Some(Backend::new("gpu", adapter, tolerance, mlp)))
}

/// Compares both ends of the batch with the network in f64.
pub(crate) fn check(
    network: &Network,
    window: &Array2<f32>,
    estimates: &Estimates,
    backend: &Backend,
) -> Result<(), Box<dyn Error>> {
    let lanes = window.ncols();
    let count = CHECKED.min(lanes);
    let error = [0..count, lanes - count..lanes].map(|end| {
        let expected = forward_f64(network, window.slice(s![.., end.clone()]));
        worst_error(&estimates.values()[end], &expected)
    });
    let error = f64::max(error[0], error[1]);
    let skipped = lanes - estimates.count(Status::Ok);
    if error <= backend.tolerance && skipped == 0 {
        return Ok(());
    }
    Err(format!(
        "{} ({}) is wrong on {}: relative error {error:e}, {skipped} lanes not evaluated",
        backend.name,
        backend.adapter,
        network.shape()
    )
    .into())
}

#[cfg(test)]
mod tests {
    use nst_core::SequenceBatch;
    use nst_tests::{random_network, random_window};

    use super::*;

    /// The estimates of another network, and a lane that is not evaluated, are not timed.
    #[test]
    fn wrong_backends_are_refused() {
        let network = random_network(&[8, 16, 16], 1);
        let mut window = random_window(8, 300, 2);
        let result = |network: &Network, evaluated: &Network, window: &Array2<f32>| {
            let backend =
                Backend::new("cpu", "x".into(), TOLERANCE, MlpCpu::new(evaluated.clone()));
            let batch = SequenceBatch::new(window.clone(), (1..=8).collect()).expect("a batch");
            let mut estimates = Estimates::default();
            backend.transform.transform(&batch, &mut estimates).expect("the CPU works");
            check(network, window, &estimates, &backend)
        };
        assert!(result(&network, &network, &window).is_ok());
        let other = random_network(&[8, 16, 16], 3);
        let error = result(&network, &other, &window).expect_err("another network");
        assert!(error.to_string().contains("is wrong on 8-16-16-1"), "{error}");
        window.column_mut(150).fill(0.5);
        let error = result(&network, &network, &window).expect_err("a constant lane");
        assert!(error.to_string().contains("1 lanes not evaluated"), "{error}");
    }
}

//! Every kernel is compared with the CPU before it is used: drivers have compiled right
//! shaders to wrong programs.

use std::sync::Arc;

use half::f16;
use ndarray::{Array2, ArrayView2};

use super::{
    device::Gpu,
    options::{Kernel, Precision},
};
use crate::{Error, Layer, MlpCpu, Network};

/// Lanes that are compared: no multiple of any tile.
const COMPARED: usize = 333;

/// How far a kernel may be off, relative to the largest estimate; a wrong one is off by
/// about 1. Rounding to f32 is some 10⁻⁶, and more where a network's terms cancel.
const LARGEST_DIFFERENCE: f32 = 1e-3;

/// The same for activations in f16, whose rounding is some 10⁻³.
const LARGEST_DIFFERENCE_F16: f32 = 2e-2;

/// Fails if `evaluate`, on the GPU, does not compute what the CPU does, on some windows
/// `[term][lane]` in [0, 1). It stays on this thread: the others may be busy with the job
/// for which the GPU is being opened.
pub(super) fn compare_with_cpu(
    gpu: &Gpu,
    network: &Arc<Network>,
    (kernel, precision): (Kernel, Precision),
    evaluate: impl FnOnce(ArrayView2<'_, f32>, &mut [f32]) -> Result<(), Error>,
) -> Result<(), Error> {
    let terms = network.metadata().window;
    let window = Array2::from_shape_fn((terms, COMPARED), |(term, lane)| {
        // Multiples of the golden ratio are spread evenly, and no two are equal.
        ((1 + term * COMPARED + lane) as f32 * 0.618_034).fract()
    });
    let (on_cpu_network, bound) = match (kernel, precision) {
        (Kernel::Cooperative, _) => (Arc::clone(network), LARGEST_DIFFERENCE_F16),
        (_, Precision::F32) => (Arc::clone(network), LARGEST_DIFFERENCE),
        (_, Precision::F16) => (Arc::new(in_f16(network)?), LARGEST_DIFFERENCE),
    };
    let (mut on_gpu, mut on_cpu) = ([0.0; COMPARED], [0.0; COMPARED]);
    evaluate(window.view(), &mut on_gpu)?;
    MlpCpu::new(on_cpu_network).evaluate_here(window.view(), &mut on_cpu);
    let finite = on_cpu.iter().filter(|cpu| cpu.is_finite());
    let scale = finite.map(|cpu| cpu.abs()).fold(0.0, f32::max);
    let right = |gpu: f32, cpu: f32| {
        // A lane that was not written is a NaN, which is close to nothing.
        let close = (gpu - cpu).abs() <= bound * scale;
        close || !(gpu.is_finite() || cpu.is_finite())
    };
    match on_gpu.into_iter().zip(on_cpu).find(|&(gpu, cpu)| !right(gpu, cpu)) {
        None => Ok(()),
        Some((wrong, cpu)) => {
            let what = format!("the {kernel} kernel's results are wrong: {wrong:e}, not {cpu:e}");
            Err(gpu.error(what))
        }
    }
}

/// The network with the weights that a kernel has in f16.
fn in_f16(network: &Network) -> Result<Network, Error> {
    let round = |x: f32| f16::from_f32(x).to_f32();
    let layers = network.layers().iter();
    let layers = layers
        .map(|Layer { weight, bias }| Layer { weight: weight.mapv(round), bias: bias.mapv(round) });
    Network::new(layers.collect(), network.metadata().clone())
}

#[cfg(test)]
pub(super) mod tests {
    use std::{
        sync::atomic::{AtomicBool, AtomicUsize, Ordering},
        thread,
        time::{Duration, Instant},
    };

    use super::*;
    use crate::{
        compact::Selection,
        gpu::{AdapterKind, MlpGpu, kernel::Variant},
    };

    /// An adapter that `open` opens, as the environment variable NST_GPU allows; says so if there is none.
    pub(in crate::gpu) fn adapter(open: impl FnOnce() -> Result<Gpu, Error>) -> Option<Gpu> {
        let mode = std::env::var("NST_GPU").unwrap_or_else(|_| "auto".to_owned());
        let gpu = match mode.as_str() {
            "off" => Err("NST_GPU=off".to_owned()),
            "auto" | "require" => open().map_err(|error| error.to_string()),
            _ => panic!("NST_GPU is '{mode}', not require, auto or off"),
        };
        match gpu {
            Ok(gpu) => Some(gpu),
            Err(error) if mode == "require" => panic!("NST_GPU=require: {error}"),
            Err(error) => {
                eprintln!("skipped: {error}");
                None
            }
        }
    }

    /// Faults that each kernel's source can have: what stands there, and what instead.
    const DAMAGE: [(&str, &str); 3] = [
        // Another slope.
        ("params.negative_slope", "0.5"),
        // Another term.
        ("terms[t * params.lanes + lane]", "terms[lane]"),
        // The last lanes are not written.
        ("< params.lanes {", "+ 1u < params.lanes {"),
    ];

    #[test]
    fn wrong_kernels_are_refused() {
        let Some(gpu) = adapter(|| Gpu::open_experimental(AdapterKind::Any)) else { return };
        let network = Network::builtin("families").expect("it is in the crate");
        let network = Arc::new(network.expect("it is readable"));
        for (kernel, precision) in [
            (Kernel::Tiled, Precision::F32),
            (Kernel::Naive, Precision::F32),
            (Kernel::Tiled, Precision::F16),
            (Kernel::Naive, Precision::F16),
            (Kernel::Cooperative, Precision::F16),
        ] {
            let variant = match Variant::new(&gpu, &network, kernel, precision) {
                Ok(variant) => variant,
                Err(error) => {
                    assert!(
                        precision == Precision::F16 && !gpu.has_f16()
                            || kernel == Kernel::Cooperative
                    );
                    eprintln!("skipped: {kernel}, {precision}: {error}");
                    continue;
                }
            };
            let check = |source: String| {
                let mlp = MlpGpu::compile(gpu.clone(), Arc::clone(&network), &variant, source);
                let mlp = mlp.expect("it compiles");
                compare_with_cpu(&gpu, &network, (kernel, precision), |window, out| {
                    mlp.evaluate(window, Selection::From(0), out, None)
                })
            };
            let right = variant.source();
            check(right.clone()).expect("it is right");
            for (good, bad) in DAMAGE {
                let wrong = right.replace(good, bad);
                assert_ne!(wrong, right, "{good}");
                let error = check(wrong).expect_err(bad).to_string();
                assert!(error.contains(&format!("{kernel} kernel")), "{error}");
            }
        }
    }

    /// All of rayon's threads are busy, as while a picture is being rendered.
    #[test]
    fn opening_waits_for_no_other_thread() {
        /// Much longer than opening takes, much shorter than a test may.
        const PATIENCE: Duration = Duration::from_secs(10);
        let Some(gpu) = adapter(|| Gpu::open(AdapterKind::Any)) else { return };
        let network = Network::builtin("families").expect("it is in the crate");
        let network = network.expect("it is readable");
        let (busy, opened) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicBool::new(false)));
        let (too_late, waiting) = (Arc::new(AtomicBool::new(false)), Arc::clone(&busy));
        let (seen, late) = (Arc::clone(&opened), Arc::clone(&too_late));
        rayon::spawn_broadcast(move |_| {
            waiting.fetch_add(1, Ordering::SeqCst);
            let start = Instant::now();
            while !seen.load(Ordering::SeqCst) && !late.load(Ordering::SeqCst) {
                late.fetch_or(start.elapsed() > PATIENCE, Ordering::SeqCst);
                thread::sleep(Duration::from_millis(1));
            }
        });
        while busy.load(Ordering::SeqCst) < rayon::current_num_threads() {
            thread::sleep(Duration::from_millis(1));
        }
        MlpGpu::new(gpu, network).expect("it is right");
        opened.store(true, Ordering::SeqCst);
        assert!(!too_late.load(Ordering::SeqCst), "it waited for the other threads");
    }
}

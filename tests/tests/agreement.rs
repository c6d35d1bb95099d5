//! PyTorch, CPU and WGSL agree on the same weights and inputs.

use std::{path::Path, sync::Arc};

use half::f16;
use ndarray::Array2;
use nst_core::{
    Estimates, Instructions, Layer, MlpCpu, Network, SequenceBatch, Status, Transform,
    gpu::{AdapterKind, Gpu, GpuOptions, Kernel, LowerLimits, MlpGpu, Precision},
};
use nst_tests::{
    Expected, TOLERANCE, TOLERANCE_F16, forward_f64, gpu, random_network, random_window,
    worst_error,
};
use proptest::{prelude::*, test_runner::RngSeed};
use safetensors::SafeTensors;

/// A transformation of a network, and how far it may be from f64.
struct Backend {
    name: String,
    tolerance: f64,
    /// Rounds activations to f16, too.
    half: bool,
    transform: Box<dyn Transform>,
}

/// All that can evaluate a network here: every instruction set, every kernel.
fn backends(network: &Arc<Network>) -> Vec<Backend> {
    let mut backends = Vec::new();
    let mut add = |name: String, tolerance, half, transform| {
        backends.push(Backend { name, tolerance, half, transform });
    };
    for instructions in Instructions::available() {
        let mlp = MlpCpu::with_instructions(Arc::clone(network), instructions);
        add(format!("CPU, {instructions}"), TOLERANCE, false, Box::new(mlp) as Box<dyn Transform>);
    }
    let Some(gpu) = gpu() else { return backends };
    for kernel in [Kernel::Tiled, Kernel::Naive, Kernel::Cooperative] {
        for precision in [Precision::F32, Precision::F16] {
            let options = GpuOptions { kernel, precision };
            let mlp = MlpGpu::with_options(gpu.clone(), Arc::clone(network), options);
            let half = precision == Precision::F16;
            match refusal(&gpu, network, options) {
                None => add(
                    format!("GPU, {kernel}, {precision}"),
                    if half { TOLERANCE_F16 } else { TOLERANCE },
                    kernel == Kernel::Cooperative,
                    Box::new(mlp.expect("the adapter runs this network")),
                ),
                Some(words) => {
                    let error = mlp.expect_err(words).to_string();
                    assert!(error.contains(words), "{kernel}, {precision}: {error}");
                    eprintln!("skipped, as refused: {kernel}, {precision}: {error}");
                }
            }
        }
    }
    backends
}

/// What must be said of a kernel that cannot run: here, or ever.
fn refusal(gpu: &Gpu, network: &Network, options: GpuOptions) -> Option<&'static str> {
    let half = options.precision == Precision::F16;
    let cooperative = options.kernel == Kernel::Cooperative;
    let deep = network.layers().len() > 1 && network.metadata().window <= 32;
    [
        (cooperative && !half, "cooperative matrices are in f16 only"),
        (half && !gpu.has_f16(), "it has no f16"),
        (cooperative && !gpu.has_cooperative_matrices(), "it has no cooperative matrices"),
        (cooperative && !deep, "the kernel takes hidden layers"),
    ]
    .into_iter()
    .find_map(|(refused, words)| refused.then_some(words))
}

fn batch(window: &Array2<f32>) -> SequenceBatch {
    let counts = (1..=window.nrows() as u32).collect();
    SequenceBatch::new(window.clone(), counts).expect("the window is a batch")
}

fn apply(transform: &dyn Transform, batch: &SequenceBatch) -> Estimates {
    let mut estimates = Estimates::default();
    transform.transform(batch, &mut estimates).expect("the backend works");
    estimates
}

fn assert_agrees(network: Network, window: &Array2<f32>) {
    let network = Arc::new(network);
    let expected = forward_f64(&network, window.view());
    let expected_of_f16 = forward_f64(&in_f16(&network), window.view());
    // Through a layer of a few neurons, cancellation can magnify the rounding of weights,
    // and of activations where they are in f16.
    let wide = network.layers().iter().all(|layer| layer.inputs() >= 8);
    for Backend { name, tolerance, half, transform } in backends(&network) {
        let estimates = apply(&*transform, &batch(window));
        assert_eq!(estimates.count(Status::Ok), window.ncols(), "{name}");
        if half && !wide {
            continue;
        }
        if tolerance == TOLERANCE_F16 {
            let error = worst_error(estimates.values(), &expected_of_f16);
            let tolerance = if half { TOLERANCE_F16 } else { TOLERANCE };
            assert!(error <= tolerance, "{name}, {}: {error:e} of f16", network.shape());
            if !wide {
                continue;
            }
        }
        let error = worst_error(estimates.values(), &expected);
        assert!(error <= tolerance, "{name}, {}: relative error {error:e}", network.shape());
    }
}

/// The network whose weights are rounded to f16.
fn in_f16(network: &Network) -> Network {
    let round = |x: f32| f16::from_f32(x).to_f32();
    let layers = network
        .layers()
        .iter()
        .map(|layer| Layer { weight: layer.weight.mapv(round), bias: layer.bias.mapv(round) })
        .collect();
    Network::new(layers, network.metadata().clone()).expect("the same shapes")
}

/// The tensor `name` of a fixture, as f64.
fn numbers(fixture: &SafeTensors<'_>, name: &str) -> Vec<f64> {
    let tensor = fixture.tensor(name).expect("the fixture has this tensor");
    let data = tensor.data();
    match tensor.dtype() {
        safetensors::Dtype::F32 => {
            data.as_chunks().0.iter().map(|&b| f64::from(f32::from_le_bytes(b))).collect()
        }
        safetensors::Dtype::F64 => {
            data.as_chunks().0.iter().map(|&b| f64::from_le_bytes(b)).collect()
        }
        other => panic!("{name} is {other:?}"),
    }
}

#[test]
fn pytorch_fixtures() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/fixtures");
    let mut fixtures = 0;
    for entry in std::fs::read_dir(&folder).expect("fixtures are part of the repository") {
        let path = entry.expect("a readable folder").path();
        if path.to_string_lossy().ends_with(".io.safetensors") {
            continue;
        }
        fixtures += 1;
        let network = Arc::new(Network::read(&path).expect("PyTorch's export is readable"));
        let bytes =
            std::fs::read(path.with_extension("io.safetensors")).expect("inputs and outputs");
        let io = SafeTensors::deserialize(&bytes).expect("a safetensors file");
        let shape = io.tensor("input").expect("an input").shape().to_vec();
        let input = numbers(&io, "input").into_iter().map(|x| x as f32).collect();
        let window = Array2::from_shape_vec((shape[0], shape[1]), input).expect("[term][lane]");

        let oracle = forward_f64(&network, window.view());
        let torch: Vec<_> = numbers(&io, "output_f64")
            .into_iter()
            .zip(&oracle)
            .map(|(value, oracle)| Expected { value, ..*oracle })
            .collect();
        let check = |name: &str, values: &[f32], tolerance: f64| {
            let error = worst_error(values, &torch);
            assert!(error <= tolerance, "{name}, {}: {error:e}", path.display());
        };
        // The oracle itself must be what PyTorch computes in f64, but for the
        // slope of the leaky ReLU, which is 0.01 rounded to f32 here.
        for (oracle, torch) in oracle.iter().zip(&torch) {
            assert!((oracle.value - torch.value).abs() <= 1e-7 * torch.magnitude);
        }
        let in_f32: Vec<_> = numbers(&io, "output").into_iter().map(|x| x as f32).collect();
        check("PyTorch in f32", &in_f32, TOLERANCE);
        for Backend { name, tolerance, transform, .. } in backends(&network) {
            check(&name, apply(&*transform, &batch(&window)).values(), tolerance);
        }
    }
    assert!(fixtures >= 4, "{fixtures} fixtures");
}

/// The comparison must see a wrong lane, a lane that was not written, and lanes in the wrong order.
#[test]
fn wrong_outputs_are_found() {
    let network = random_network(&[8, 16, 16], 3);
    let window = random_window(8, 100, 4);
    let expected = forward_f64(&network, window.view());
    let right: Vec<f32> = expected.iter().map(|e| e.value as f32).collect();
    assert!(worst_error(&right, &expected) <= TOLERANCE);

    let damage: [fn(&mut Vec<f32>); 4] = [
        |values| values[50] *= 1.01,
        |values| values[99] = f32::NAN,
        |values| values[0] = f32::INFINITY,
        |values| values.swap(10, 11),
    ];
    for (case, damage) in damage.iter().enumerate() {
        let mut wrong = right.clone();
        damage(&mut wrong);
        assert!(worst_error(&wrong, &expected) > TOLERANCE, "case {case}");
    }
    let other = forward_f64(&random_network(&[8, 16, 16], 5), window.view());
    assert!(worst_error(&right, &other) > TOLERANCE);
}

#[test]
fn the_papers_networks() {
    for depth in [2, 4] {
        let widths = [&[8][..], &vec![256; depth]].concat();
        assert_agrees(random_network(&widths, 1), &random_window(8, 777, 2));
    }
}

/// More lanes than one submission takes, and not a multiple of anything.
#[test]
fn lanes_beyond_one_chunk() {
    let lanes = (1 << 20) + 12_345;
    assert_agrees(random_network(&[3, 5], 7), &random_window(3, lanes, 8));
}

/// No result depends on which lanes are evaluated beside it.
#[test]
fn lanes_are_independent() {
    let network = Arc::new(random_network(&[8, 24, 24], 11));
    let window = random_window(8, 300, 12);
    for Backend { name, transform, .. } in backends(&network) {
        let all = apply(&*transform, &batch(&window));
        let few = apply(&*transform, &batch(&window.slice(ndarray::s![.., 130..171]).to_owned()));
        assert_eq!(few.values(), &all.values()[130..171], "{name}");
    }
}

#[test]
fn lanes_that_cannot_be_transformed_hold_s_n() {
    let network = Arc::new(random_network(&[4, 8], 13));
    let mut window = random_window(4, 6, 14);
    window.column_mut(1).fill(0.25);
    window[[0, 2]] = f32::NAN;
    window[[3, 3]] = f32::INFINITY;
    // Finite, but the network's sums overflow.
    window.column_mut(4).assign(&ndarray::array![3e38, -3e38, 3e38, -3e38]);
    for Backend { name, transform, .. } in backends(&network) {
        let estimates = apply(&*transform, &batch(&window));
        use Status::{Constant, NotFinite, Ok};
        let status = [Ok, Constant, NotFinite, NotFinite, NotFinite, Ok];
        assert_eq!(estimates.status(), status, "{name}");
        for lane in [1, 2, 3, 4] {
            assert_eq!(estimates.values()[lane], window[[3, lane]], "{name}, lane {lane}");
        }
        let short = batch(&window.slice(ndarray::s![1.., ..]).to_owned());
        let estimates = apply(&*transform, &short);
        assert_eq!(estimates.count(Status::TooShort), 6, "{name}");
        assert_eq!(estimates.values()[0], window[[3, 0]], "{name}");
    }
}

/// Constant lanes, and lanes that are not finite, skip the network, and change no bit
/// of those that remain.
#[test]
fn lanes_that_remain_have_the_same_bits() {
    let network = Arc::new(random_network(&[8, 20, 33], 31));
    let window = random_window(8, 1000, 32);
    let mut sparse = window.clone();
    for lane in 0..1000 {
        match (lane * lane) % 7 {
            0..3 => sparse.column_mut(lane).fill(lane as f32),
            3 => sparse[[lane % 8, lane]] = f32::NAN,
            _ => {}
        }
    }
    let none = ndarray::Array2::from_elem((8, 70), 0.5);
    for Backend { name, transform, .. } in backends(&network) {
        let all = apply(&*transform, &batch(&window));
        let some = apply(&*transform, &batch(&sparse));
        for lane in 0..1000 {
            let (status, value) = match (lane * lane) % 7 {
                0..3 => (Status::Constant, sparse[[7, lane]]),
                3 => (Status::NotFinite, sparse[[7, lane]]),
                _ => (Status::Ok, all.values()[lane]),
            };
            assert_eq!(some.status()[lane], status, "{name}, lane {lane}");
            assert_eq!(some.values()[lane].to_bits(), value.to_bits(), "{name}, lane {lane}");
        }
        let none = apply(&*transform, &batch(&none));
        assert_eq!(none.count(Status::Constant), 70, "{name}");
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let network = Arc::new(random_network(&[8, 64, 64], 41));
    let window = batch(&random_window(8, 5000, 42));
    for instructions in Instructions::available() {
        let mlp = MlpCpu::with_instructions(Arc::clone(&network), instructions);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("a few threads").install(|| apply(&mlp, &window))
        };
        let one = with(1);
        assert_eq!(one, with(2), "{instructions:?}");
        assert_eq!(one, with(5), "{instructions:?}");
    }
}

/// Slopes for which the leaky ReLU is a maximum, and one for which it is a minimum.
#[test]
fn slopes_of_the_leaky_relu() {
    for slope in [0.0, 0.3, 1.0, 1.5, -0.2] {
        let network = random_network(&[8, 12, 12], 51);
        let mut metadata = network.metadata().clone();
        metadata.negative_slope = slope;
        let network = Network::new(network.layers().to_vec(), metadata).expect("the same shapes");
        assert_agrees(network, &random_window(8, 100, 52));
    }
}

/// A network that is too large for a device is refused, and the next one on the same device
/// is not.
#[test]
fn a_refused_network_fails_alone() {
    let Some(gpu) = gpu() else { return };
    let network = Arc::new(random_network(&[8, 40], 61));
    let window = random_window(8, 500, 62);
    let expected = forward_f64(&network, window.view());
    for _ in 0..2 {
        let error = MlpGpu::new(gpu.clone(), random_network(&[8, 300], 63)).expect_err("too wide");
        assert!(error.to_string().contains("widths of up to 256"), "{error}");
        let mlp = MlpGpu::new(gpu.clone(), Arc::clone(&network)).expect("it fits");
        assert!(worst_error(apply(&mlp, &batch(&window)).values(), &expected) <= TOLERANCE);
    }
}

/// An adapter that is too small for a network says so; one that is merely small is used
/// in more turns.
#[test]
fn limits_of_the_adapter() {
    let Some(_) = gpu() else { return };
    let network = Arc::new(random_network(&[8, 40], 61));
    let window = random_window(8, 9000, 62);
    let expected = forward_f64(&network, window.view());
    let open = |limits| Gpu::open_with(AdapterKind::Any, &limits).expect("it opens");
    let small = [
        LowerLimits { workgroups: Some(3), ..Default::default() },
        LowerLimits { binding_bytes: Some(20_000), ..Default::default() },
    ];
    for limits in small {
        let mlp = MlpGpu::new(open(limits), Arc::clone(&network)).expect("it is large enough");
        let error = worst_error(apply(&mlp, &batch(&window)).values(), &expected);
        assert!(error <= TOLERANCE, "{limits:?}: {error:e}");
    }
    let too_small = [
        LowerLimits { workgroup_bytes: Some(256), ..Default::default() },
        LowerLimits { invocations: Some(2), ..Default::default() },
        LowerLimits { binding_bytes: Some(256), ..Default::default() },
    ];
    for limits in too_small {
        let error = MlpGpu::new(open(limits), Arc::clone(&network)).expect_err("it is too small");
        assert!(matches!(error, nst_core::Error::Gpu(_)), "{limits:?}: {error}");
    }
    let gpu = open(LowerLimits { without_f16: true, ..Default::default() });
    let options = GpuOptions { precision: Precision::F16, ..Default::default() };
    let error = MlpGpu::with_options(gpu.clone(), Arc::clone(&network), options);
    let error = error.expect_err("f16 is left out").to_string();
    assert!(!gpu.has_f16() && error.contains("it has no f16"), "{error}");
    let wide = random_network(&[8, 300], 63);
    for kernel in [Kernel::Tiled, Kernel::Naive] {
        let options = GpuOptions { kernel, ..Default::default() };
        let gpu = open(LowerLimits::default());
        assert!(MlpGpu::with_options(gpu, wide.clone(), options).is_err(), "{kernel:?}");
    }
}

/// A device that is lost between two batches is an error, not a panic and not a result.
#[test]
fn a_lost_device_is_an_error() {
    let Some(gpu) = gpu() else { return };
    let mlp = MlpGpu::new(gpu.clone(), random_network(&[8, 16], 71)).expect("it runs");
    let window = batch(&random_window(8, 100, 72));
    let mut estimates = apply(&mlp, &window);
    gpu.lose();
    let error = mlp.transform(&window, &mut estimates).expect_err("there is no device");
    assert!(matches!(error, nst_core::Error::Gpu(_)), "{error}");
    assert!(MlpGpu::new(gpu, random_network(&[8, 16], 71)).is_err());
}

/// Widths that are no multiple of the shader's blocks of four, down to one.
#[test]
fn narrow_networks() {
    let shapes: [&[usize]; 6] = [&[1], &[2, 1], &[1, 3], &[3, 2, 5], &[8, 1, 7], &[9, 13, 6, 2]];
    for widths in shapes {
        assert_agrees(random_network(widths, 21), &random_window(widths[0], 333, 22));
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        // Each case compiles a shader, which takes lavapipe a tenth of a second.
        cases: 24,
        rng_seed: RngSeed::Fixed(1),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    /// From eight neurons on: through a narrower layer, cancellation inside the
    /// network can magnify rounding beyond any fixed tolerance.
    #[test]
    fn random_networks(
        widths in prop::collection::vec(8_usize..100, 1..6),
        lanes in 1_usize..700,
        seed in any::<u64>(),
    ) {
        assert_agrees(random_network(&widths, seed), &random_window(widths[0], lanes, seed ^ 1));
    }
}

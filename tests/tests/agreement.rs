//! PyTorch, CPU and WGSL agree on the same weights and inputs.

use std::{path::Path, sync::Arc};

use ndarray::Array2;
use nst_core::{Estimates, MlpCpu, Network, SequenceBatch, Status, Transform, gpu::MlpGpu};
use nst_tests::{Expected, forward_f64, gpu, random_network, random_window, worst_error};
use proptest::{prelude::*, test_runner::RngSeed};
use safetensors::SafeTensors;

/// f32 rounding of sums of up to 256 terms in up to five layers stays well below it.
const TOLERANCE: f64 = 1e-5;

/// The transformations of a network, by the name of what runs them.
fn backends(network: &Arc<Network>) -> Vec<(&'static str, Box<dyn Transform>)> {
    let mut backends: Vec<(_, Box<dyn Transform>)> =
        vec![("CPU", Box::new(MlpCpu::new(Arc::clone(network))))];
    if let Some(gpu) = gpu() {
        let mlp = MlpGpu::new(gpu, Arc::clone(network)).expect("the adapter runs this network");
        backends.push(("GPU", Box::new(mlp)));
    }
    backends
}

fn batch(window: &Array2<f32>) -> SequenceBatch {
    let counts = (1..=window.nrows() as u32).collect();
    SequenceBatch::new(window.clone(), counts).expect("the window is a batch")
}

fn apply(transform: &dyn Transform, batch: &SequenceBatch) -> Estimates {
    let mut estimates = Estimates::default();
    transform.apply(batch, &mut estimates).expect("the backend works");
    estimates
}

fn assert_agrees(network: Network, window: &Array2<f32>) {
    let network = Arc::new(network);
    let expected = forward_f64(&network, window.view());
    for (name, transform) in backends(&network) {
        let estimates = apply(&*transform, &batch(window));
        assert_eq!(estimates.count(Status::Ok), window.ncols(), "{name}");
        let error = worst_error(estimates.values(), &expected);
        assert!(error <= TOLERANCE, "{name}, {}: relative error {error:e}", network.shape());
    }
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
        let check = |name, values: &[f32]| {
            let error = worst_error(values, &torch);
            assert!(error <= TOLERANCE, "{name}, {}: {error:e}", path.display());
        };
        // The oracle itself must be what PyTorch computes in f64, but for the
        // slope of the leaky ReLU, which is 0.01 rounded to f32 here.
        for (oracle, torch) in oracle.iter().zip(&torch) {
            assert!((oracle.value - torch.value).abs() <= 1e-7 * torch.magnitude);
        }
        let in_f32: Vec<_> = numbers(&io, "output").into_iter().map(|x| x as f32).collect();
        check("PyTorch in f32", &in_f32);
        for (name, transform) in backends(&network) {
            check(name, apply(&*transform, &batch(&window)).values());
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
    for (name, transform) in backends(&network) {
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
    for (name, transform) in backends(&network) {
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

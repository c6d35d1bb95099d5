//! Networks that weigh the guard's experts: PyTorch, CPU and WGSL agree on the same weights and inputs.

use std::{fs, path::PathBuf};

use ndarray::Array2;
use nst_core::{GuardNetwork, guard::GuardMlp};
use nst_tests::gpu;
use safetensors::{Dtype, SafeTensors};

/// Weights are at most 1. Outputs are sums of at most 18 products of the order of 1, which agree to about
/// 18 ε = 2e-6 in f32 in any order, and weights change by at most a quarter of that.
const TOLERANCE: f64 = 1e-5;

/// Experts that take part.
const LISTS: [&[&str]; 4] =
    [&["lane", "filter", "oidn"], &["lane", "filter"], &["filter", "oidn"], &["oidn"]];

/// A network, and what PyTorch makes of some rows of inputs.
struct Fixture {
    network: GuardNetwork,
    bytes: Vec<u8>,
}

impl Fixture {
    fn all() -> Vec<Self> {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("data/guard-fixtures");
        let files = fs::read_dir(folder).expect("fixtures are part of the repository");
        let paths = files.map(|entry| entry.expect("a readable folder").path());
        let networks = paths.filter(|path| !path.to_string_lossy().ends_with(".io.safetensors"));
        let fixtures: Vec<_> = networks.map(|path| Self::read(&path)).collect();
        assert!(fixtures.len() >= 2, "{} fixtures", fixtures.len());
        fixtures
    }

    fn read(path: &std::path::Path) -> Self {
        let network = GuardNetwork::read(path).expect("PyTorch's export is readable");
        let bytes = fs::read(path.with_extension("io.safetensors")).expect("inputs and outputs");
        Self { network, bytes }
    }

    /// A tensor of two axes.
    fn tensor(&self, name: &str) -> Array2<f64> {
        let io = SafeTensors::deserialize(&self.bytes).expect("a safetensors file");
        let tensor = io.tensor(name).expect("the fixture has this tensor");
        let data = tensor.data();
        let numbers = match tensor.dtype() {
            Dtype::F32 => {
                data.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b).into()).collect()
            }
            Dtype::F64 => data.as_chunks().0.iter().map(|&b| f64::from_le_bytes(b)).collect(),
            other => panic!("{name} is {other:?}"),
        };
        let [rows, columns] = tensor.shape() else { panic!("{name} has two axes") };
        Array2::from_shape_vec((*rows, *columns), numbers).expect("its shape")
    }

    /// The largest difference from PyTorch's weights in f64, of all lists.
    fn error(&self, mlp: &GuardMlp) -> f64 {
        let narrow = |tensor: Array2<f64>| tensor.mapv(|x| x as f32);
        // As `[input][row]`.
        let inputs =
            narrow(self.tensor("inputs")).reversed_axes().as_standard_layout().into_owned();
        let closed = self.tensor("closed");
        let mut worst = 0.0_f64;
        for experts in LISTS {
            let slot = |name: &&str| self.network.experts().iter().position(|it| it == name);
            let slots: Vec<_> =
                experts.iter().map(|name| slot(name).expect("it knows it")).collect();
            let of_experts = narrow(closed.select(ndarray::Axis(1), &slots));
            let weights = mlp.weights(experts, inputs.view(), of_experts.view());
            let weights = weights.expect("it evaluates").mapv(f64::from);
            let expected = self.tensor(&format!("weights_f64-{}", experts.join("-")));
            let differences = (&weights - &expected).mapv(f64::abs);
            worst = differences.iter().fold(worst, |worst, x| worst.max(*x));
        }
        worst
    }
}

#[test]
fn all_processors_agree_with_pytorch() {
    for fixture in Fixture::all() {
        let network = || fixture.network.clone();
        let mut processors = vec![GuardMlp::new(network())];
        processors.extend(gpu().map(|gpu| GuardMlp::on_gpu(network(), &gpu).expect("it runs it")));
        for mlp in &processors {
            let error = fixture.error(mlp);
            assert!(error < TOLERANCE, "{error}: {mlp:?}");
        }
    }
}

/// The comparison notices a network whose outputs are in another order.
#[test]
fn other_weights_are_noticed() {
    for fixture in Fixture::all() {
        let layers = fixture.network.outputs().iter().rev().map(|output| output.layers().to_vec());
        let mut layers: Vec<_> = layers.collect();
        let lasts: Vec<_> =
            layers.iter_mut().map(|layers| layers.pop().expect("a layer")).collect();
        let mut hidden = layers.swap_remove(0);
        let weights: Vec<_> = lasts.iter().map(|last| last.weight.row(0)).collect();
        hidden.push(nst_core::Layer {
            weight: ndarray::stack(ndarray::Axis(0), &weights).expect("rows"),
            bias: lasts.iter().map(|last| last.bias[0]).collect(),
        });
        let metadata = fixture.network.metadata().clone();
        let experts = fixture.network.experts().to_vec();
        let wrong = GuardNetwork::new(hidden, metadata, experts, fixture.network.floor());
        let wrong = GuardMlp::new(wrong.expect("it fits"));
        assert!(fixture.error(&wrong) > 100.0 * TOLERANCE);
    }
}

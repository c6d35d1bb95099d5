//! Times a network in Burn, with its wgpu backend, from inputs to outputs in host memory.

mod network;

use std::error::Error;
use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use burn::tensor::activation::leaky_relu;
use burn::tensor::module::linear;
use burn::tensor::{Device, Tensor, TensorData};

use network::Network;

/// Relative to the sum of the magnitudes that the output layer adds up.
const TOLERANCE: f64 = 1e-5;

/// How many lanes are compared with the network in f64.
const CHECKED_LANES: usize = 256;

/// Untimed calls, in which Burn picks its kernels.
const WARM_UP_CALLS: usize = 5;

const TIMED_CALLS_AT_LEAST: usize = 3;

fn main() -> ExitCode {
    match run(&std::env::args_os().skip(1).collect::<Vec<_>>()) {
        Ok(line) => {
            println!("{line}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {}", error.to_string().replace('\n', " "));
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[OsString]) -> Result<String, Box<dyn Error>> {
    let [path, lanes, seconds] = arguments else {
        return Err("usage: nst-peer-burn NETWORK.safetensors LANES SECONDS".into());
    };
    let lanes: u32 = number(lanes, "LANES")?;
    let seconds: f64 = number(seconds, "SECONDS")?;
    if lanes == 0 || !seconds.is_finite() || seconds < 0.0 {
        return Err("LANES or SECONDS out of range".into());
    }
    let network = Network::read(Path::new(path))
        .map_err(|error| format!("{}: {error}", Path::new(path).display()))?;

    let (device, setup) = Device::wgpu_options().init_with_setup()?;
    let adapter = setup.adapter.get_info().name.replace([';', '\n'], " ");
    let needed = (4 * lanes as usize * network.width()) as u64;
    let limit = setup.device.limits().max_storage_buffer_binding_size;
    if needed > limit {
        return Err(format!("a layer needs {needed} bytes, a buffer has {limit} at most").into());
    }
    let inputs = random_inputs(network.window, lanes as usize);
    let model = Model::upload(&network, &device);
    let call = || {
        let data = TensorData::new(inputs.clone(), [lanes as usize, network.window]);
        let start = Instant::now();
        let values = model.evaluate(data)?;
        Ok::<_, Box<dyn Error>>((start.elapsed().as_secs_f64(), values))
    };

    check(&network, &inputs, &call()?.1)?;
    for _ in 0..WARM_UP_CALLS {
        call()?;
    }
    let mut times = Vec::new();
    let start = Instant::now();
    loop {
        let (time, values) = call()?;
        times.push(time);
        if times.len() >= TIMED_CALLS_AT_LEAST && start.elapsed().as_secs_f64() >= seconds {
            check(&network, &inputs, &values)?;
            break;
        }
    }
    Ok(format!("{adapter};{:.6}", 1e3 * median(times)))
}

fn number<T: std::str::FromStr>(text: &OsString, name: &str) -> Result<T, String> {
    let number = text.to_str().and_then(|text| text.parse().ok());
    number.ok_or_else(|| format!("{name} is no such number: {}", text.display()))
}

/// The network's weights on a device.
struct Model {
    /// Per layer: weight `[in, out]`, bias `[out]`.
    layers: Vec<(Tensor<2>, Tensor<1>)>,
    slope: f64,
    device: Device,
}

impl Model {
    fn upload(network: &Network, device: &Device) -> Self {
        let layers = network.layers.iter().map(|layer| {
            let outputs = layer.bias.len();
            let weight = transpose(&layer.weight, outputs, layer.inputs);
            let weight = TensorData::new(weight, [layer.inputs, outputs]);
            let bias = TensorData::new(layer.bias.clone(), [outputs]);
            (Tensor::from_data(weight, device), Tensor::from_data(bias, device))
        });
        Self { layers: layers.collect(), slope: network.slope.into(), device: device.clone() }
    }

    fn evaluate(&self, inputs: TensorData) -> Result<Vec<f32>, Box<dyn Error>> {
        let mut x = Tensor::<2>::from_data(inputs, &self.device);
        for (i, (weight, bias)) in self.layers.iter().enumerate() {
            if i > 0 {
                x = leaky_relu(x, self.slope);
            }
            x = linear(x, weight.clone(), Some(bias.clone()));
        }
        Ok(x.try_into_vec_as::<f32>()?)
    }
}

/// Compares the first lanes with the network in f64.
fn check(network: &Network, inputs: &[f32], values: &[f32]) -> Result<(), String> {
    let lanes = inputs.len() / network.window;
    if values.len() != lanes {
        return Err(format!("{} outputs for {lanes} lanes", values.len()));
    }
    if values.iter().any(|value| !value.is_finite()) {
        return Err("an output is not finite".to_owned());
    }
    let lanes = inputs.chunks_exact(network.window).zip(values).take(CHECKED_LANES);
    for (lane, (terms, &value)) in lanes.enumerate() {
        let (expected, magnitude) = network.evaluate(terms);
        let error = (f64::from(value) - expected).abs();
        if error > TOLERANCE * magnitude {
            return Err(format!("lane {lane} has a relative error of {:e}", error / magnitude));
        }
    }
    Ok(())
}

/// Uniform numbers, the same as in `inference.py`, here `[lane][term]`.
fn random_inputs(window: usize, lanes: usize) -> Vec<f32> {
    const GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;
    let mut state = mix(mix(GAMMA.wrapping_add(1)) ^ lanes as u64);
    let uniform = |_| {
        state = state.wrapping_add(GAMMA);
        ((mix(state) >> 11) as f64 / (1_u64 << 53) as f64) as f32
    };
    let terms: Vec<f32> = (0..window * lanes).map(uniform).collect();
    transpose(&terms, window, lanes)
}

/// The output function of SplitMix64 (Steele, Lea, Flood 2014).
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

fn transpose(matrix: &[f32], rows: usize, columns: usize) -> Vec<f32> {
    let column = |j| (0..rows).map(move |i| matrix[i * columns + j]);
    (0..columns).flat_map(column).collect()
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    (times[(times.len() - 1) / 2] + times[times.len() / 2]) / 2.0
}

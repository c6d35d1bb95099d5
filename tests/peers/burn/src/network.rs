//! The network of a safetensors file.

use std::error::Error;
use std::path::Path;

use safetensors::{Dtype, SafeTensors};

/// A dense layer.
pub(crate) struct Layer {
    /// `[out][in]`
    pub(crate) weight: Vec<f32>,
    /// One per output.
    pub(crate) bias: Vec<f32>,
    pub(crate) inputs: usize,
}

/// Dense layers with leaky ReLU between them; the last has one output.
pub(crate) struct Network {
    pub(crate) layers: Vec<Layer>,
    pub(crate) window: usize,
    pub(crate) slope: f32,
}

impl Network {
    pub(crate) fn read(path: &Path) -> Result<Self, Box<dyn Error>> {
        let bytes = std::fs::read(path)?;
        let (_, header) = SafeTensors::read_metadata(&bytes)?;
        let metadata = |key: &str| {
            let text = header.metadata().as_ref().and_then(|all| all.get(key));
            text.ok_or_else(|| format!("no metadata `{key}`"))
        };
        let window = metadata("window")?.parse().map_err(|_| "`window` is no number")?;
        let slope = metadata("negative_slope")?.parse();
        let slope = slope.map_err(|_| "`negative_slope` is no number")?;
        let tensors = SafeTensors::deserialize(&bytes)?;
        if tensors.len() < 2 || tensors.len() % 2 != 0 {
            return Err(format!("{} tensors, not a pair for each layer", tensors.len()).into());
        }
        let mut layers = Vec::new();
        let mut inputs = window;
        for i in 0..tensors.len() / 2 {
            let bias = floats(&tensors, &format!("layers.{i}.bias"), &[None])?;
            let outputs = bias.len();
            let shape = [Some(outputs), Some(inputs)];
            let weight = floats(&tensors, &format!("layers.{i}.weight"), &shape)?;
            layers.push(Layer { weight, bias, inputs });
            inputs = outputs;
        }
        if window == 0 || inputs != 1 || layers.iter().any(|layer| layer.bias.is_empty()) {
            return Err("not a network of one output, with neurons in each layer".into());
        }
        Ok(Self { layers, window, slope })
    }

    /// The most numbers per lane that any layer reads or writes.
    pub(crate) fn width(&self) -> usize {
        self.layers.iter().fold(self.window, |width, layer| width.max(layer.bias.len()))
    }

    /// The output, and the sum of the magnitudes that the output layer adds up, in f64.
    pub(crate) fn evaluate(&self, terms: &[f32]) -> (f64, f64) {
        let mut x: Vec<f64> = terms.iter().copied().map(f64::from).collect();
        let mut magnitude = 0.0;
        for (i, layer) in self.layers.iter().enumerate() {
            if i > 0 {
                x.iter_mut().filter(|x| **x < 0.0).for_each(|x| *x *= f64::from(self.slope));
            }
            let neuron = |(row, &bias): (&[f32], &f32)| {
                let bias = f64::from(bias);
                let products = || row.iter().zip(&x).map(|(&weight, x)| f64::from(weight) * x);
                magnitude = products().map(f64::abs).sum::<f64>() + bias.abs();
                products().sum::<f64>() + bias
            };
            x = layer.weight.chunks_exact(layer.inputs).zip(&layer.bias).map(neuron).collect();
        }
        (x[0], magnitude)
    }
}

/// The numbers of a tensor of f32; `None` in its shape is any length.
fn floats(
    tensors: &SafeTensors<'_>,
    name: &str,
    shape: &[Option<usize>],
) -> Result<Vec<f32>, Box<dyn Error>> {
    let tensor = tensors.tensor(name).map_err(|error| format!("`{name}`: {error}"))?;
    let fits = tensor.shape().len() == shape.len()
        && tensor.shape().iter().zip(shape).all(|(&got, want)| want.is_none_or(|want| got == want));
    if tensor.dtype() != Dtype::F32 || !fits {
        return Err(format!("`{name}` is {:?} {:?}", tensor.dtype(), tensor.shape()).into());
    }
    let (bytes, _) = tensor.data().as_chunks();
    Ok(bytes.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect())
}

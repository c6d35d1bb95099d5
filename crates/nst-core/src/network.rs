//! Networks and their files: safetensors, checked before anything is allocated.

use std::{collections::HashMap, path::Path};

use ndarray::{Array1, Array2};
use safetensors::{SafeTensors, tensor::{Dtype, TensorView}};

use crate::Error;

/// The value of the metadata key `format` in files that this version reads.
const FORMAT: &str = "nst-weights-1";

/// No layer may be wider than this; larger numbers are taken for damage.
const MAX_WIDTH: usize = 4096;

/// The networks inside the crate: a name and the bytes of the file.
pub const BUILTIN: &[(&str, &[u8])] = &[
    ("cornell", include_bytes!("../weights/cornell.safetensors")),
    ("families", include_bytes!("../weights/families.safetensors")),
];

/// One fully connected layer: y = weight · x + bias.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// `[out][in]`.
    pub weight: Array2<f32>,
    /// `[out]`.
    pub bias: Array1<f32>,
}

impl Layer {
    /// The number of inputs.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.weight.ncols()
    }

    /// The number of outputs.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.weight.nrows()
    }
}

/// What a weights file says about its network.
#[derive(Clone, Debug, PartialEq)]
pub struct Metadata {
    /// How many consecutive terms the network reads.
    pub window: usize,
    /// The slope of the leaky ReLU for negative arguments.
    pub negative_slope: f32,
    /// What it was trained on: `family:NAME` or `scene:NAME:FINGERPRINT`.
    pub trained_on: Vec<String>,
    /// The sample counts n it was trained on: first and last.
    pub samples: (u32, u32),
    /// The loss of the paper's equation 9: `L0` to `L3`.
    pub loss: String,
    /// How many times training went through its data.
    pub epochs: u32,
    /// The seed of training.
    pub seed: u64,
    /// The configuration of the training run, whole.
    pub config: String,
}

/// A multi-layer perceptron that maps a window of partial sums to one estimate
/// (§3.1 of the paper): leaky ReLU after every layer but the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    layers: Vec<Layer>,
    metadata: Metadata,
}

impl Network {
    /// Puts a network together, checking that the layers fit the window and each other.
    ///
    /// # Errors
    /// [`Error::Weights`] if the shapes do not chain from `metadata.window` to one
    /// output, or if a number is not finite.
    pub fn new(layers: Vec<Layer>, metadata: Metadata) -> Result<Self, Error> {
        if layers.is_empty() {
            return Err(Error::Weights("there is no layer".into()));
        }
        let mut width = metadata.window;
        for (i, layer) in layers.iter().enumerate() {
            let (outputs, inputs) = layer.weight.dim();
            if inputs != width || layer.bias.len() != outputs {
                return Err(Error::Weights(format!(
                    "layer {i} is [{outputs}, {inputs}] with {} biases, but {width} values reach it",
                    layer.bias.len()
                )));
            }
            if !(1..=MAX_WIDTH).contains(&outputs) || !(1..=MAX_WIDTH).contains(&inputs) {
                return Err(Error::Weights(format!(
                    "layer {i} is [{outputs}, {inputs}]; widths from 1 to {MAX_WIDTH} are supported"
                )));
            }
            if !layer.weight.iter().chain(&layer.bias).all(|x| x.is_finite()) {
                return Err(Error::Weights(format!("layer {i} holds a NaN or an infinity")));
            }
            width = outputs;
        }
        if width != 1 {
            return Err(Error::Weights(format!("the last layer has {width} outputs, not 1")));
        }
        let layers = layers
            .into_iter()
            .map(|Layer { weight, bias }| Layer {
                weight: weight.as_standard_layout().into_owned(),
                bias: bias.as_standard_layout().into_owned(),
            })
            .collect();
        Ok(Self { layers, metadata })
    }

    /// Reads a network from the bytes of a safetensors file.
    ///
    /// # Errors
    /// [`Error::Weights`] names the first defect.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        let bad = |error: safetensors::SafeTensorError| Error::Weights(error.to_string());
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(bad)?;
        let empty = HashMap::new();
        let fields = Fields(header.metadata().as_ref().unwrap_or(&empty));
        fields.expect("format", FORMAT)?;
        fields.expect("kind", "mlp")?;
        fields.expect("inputs", "window")?;
        fields.expect("activation", "leaky_relu")?;
        let metadata = Metadata {
            window: fields.number("window")?,
            negative_slope: fields.number("negative_slope")?,
            trained_on: fields.get("trained_on")?.split(',').map(|s| s.trim().to_owned()).collect(),
            samples: fields.range("samples")?,
            loss: fields.get("loss")?.to_owned(),
            epochs: fields.number("epochs")?,
            seed: fields.number("seed")?,
            config: fields.get("config")?.to_owned(),
        };
        if !metadata.negative_slope.is_finite() {
            return Err(Error::Weights("metadata 'negative_slope' is not finite".into()));
        }

        let tensors = SafeTensors::deserialize(bytes).map_err(bad)?;
        if tensors.is_empty() || !tensors.len().is_multiple_of(2) {
            return Err(Error::Weights(format!(
                "{} tensors; a weight and a bias per layer are needed",
                tensors.len()
            )));
        }
        let layers = (0..tensors.len() / 2)
            .map(|i| {
                let weight = tensors.tensor(&format!("layers.{i}.weight")).map_err(bad)?;
                let bias = tensors.tensor(&format!("layers.{i}.bias")).map_err(bad)?;
                let (&[outputs, inputs], &[_]) = (weight.shape(), bias.shape()) else {
                    return Err(Error::Weights(format!(
                        "layer {i} has shapes {:?} and {:?}; [out, in] and [out] are needed",
                        weight.shape(),
                        bias.shape()
                    )));
                };
                let weight = Array2::from_shape_vec((outputs, inputs), decode(&weight, i)?)
                    .map_err(|error| Error::Weights(error.to_string()))?;
                Ok(Layer { weight, bias: decode(&bias, i)?.into() })
            })
            .collect::<Result<_, Error>>()?;
        Self::new(layers, metadata)
    }

    /// Reads a network from a safetensors file.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read, [`Error::Weights`] if it is malformed.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::from_bytes(&std::fs::read(path)?)
    }

    /// A network that is part of the crate, by its name in [`BUILTIN`].
    #[must_use]
    pub fn builtin(name: &str) -> Option<Result<Self, Error>> {
        let (_, bytes) = BUILTIN.iter().find(|(builtin, _)| *builtin == name)?;
        Some(Self::from_bytes(bytes))
    }

    /// The layers, first to last.
    #[must_use]
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// What the weights file says about the network.
    #[must_use]
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The widths from window to output, as in `8-64-64-1`.
    #[must_use]
    pub fn shape(&self) -> String {
        let widths = self.layers.iter().map(|layer| format!("-{}", layer.outputs()));
        format!("{}{}", self.metadata.window, widths.collect::<String>())
    }
}

/// The metadata of a file, with errors that name the key.
struct Fields<'a>(&'a HashMap<String, String>);

impl Fields<'_> {
    fn get(&self, key: &str) -> Result<&str, Error> {
        let value = self.0.get(key).map(String::as_str);
        value.ok_or_else(|| Error::Weights(format!("metadata '{key}' is missing")))
    }

    fn expect(&self, key: &str, wanted: &str) -> Result<(), Error> {
        match self.get(key)? {
            found if found == wanted => Ok(()),
            found => Err(Error::Weights(format!(
                "metadata '{key}' is '{found}'; this version reads '{wanted}'"
            ))),
        }
    }

    fn number<T: std::str::FromStr>(&self, key: &str) -> Result<T, Error> {
        let text = self.get(key)?;
        let bad = |_| Error::Weights(format!("metadata '{key}' is '{text}', not a number in range"));
        text.parse().map_err(bad)
    }

    fn range(&self, key: &str) -> Result<(u32, u32), Error> {
        let text = self.get(key)?;
        text.split_once("..")
            .and_then(|(first, last)| Some((first.parse().ok()?, last.parse().ok()?)))
            .filter(|(first, last)| first <= last)
            .ok_or_else(|| Error::Weights(format!("metadata '{key}' is '{text}', not 'first..last'")))
    }
}

/// The numbers of a tensor, little-endian f32 or f16.
fn decode(tensor: &TensorView<'_>, layer: usize) -> Result<Vec<f32>, Error> {
    match tensor.dtype() {
        Dtype::F32 => {
            let (numbers, _) = tensor.data().as_chunks();
            Ok(numbers.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect())
        }
        Dtype::F16 => {
            let (numbers, _) = tensor.data().as_chunks();
            Ok(numbers.iter().map(|&bytes| half::f16::from_le_bytes(bytes).to_f32()).collect())
        }
        other => Err(Error::Weights(format!("layer {layer} is {other:?}; F32 and F16 are supported"))),
    }
}

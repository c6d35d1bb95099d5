//! Networks and their files: safetensors, checked before anything is allocated.

use std::{collections::HashMap, path::Path};

use ndarray::{Array1, Array2};
use safetensors::{
    SafeTensors,
    tensor::{Dtype, TensorView},
};

use crate::Error;

/// The value of the metadata key `format` in files that this version reads.
const FORMAT: &str = "nst-weights-1";

/// No layer may be wider than this; larger numbers are taken for damage.
const MAX_WIDTH: usize = 4096;

/// Names and files of networks in `weights/`; one more is one more name.
macro_rules! builtin {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_bytes!(concat!("../weights/", $name, ".safetensors")).as_slice())),*]
    };
}

/// The networks inside the crate: a name and the bytes of the file.
pub const BUILTIN: &[(&str, &[u8])] = &builtin!(
    "cornell",
    "families",
    "gaussian",
    "step",
    "gaussian-step",
    "plane-lambert",
    "plane-lambert-halton",
    "plane-ggx",
    "plane-ggx-halton",
    "teapot-diffuse",
    "teapot-diffuse-halton",
    "teapot-glossy",
    "teapot-glossy-halton",
    "cornell-direct",
    "cornell-direct-halton",
    "cornell-depth-8",
    "cornell-depth-8-halton",
);

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
    /// Which sampler drew the samples, for networks trained on renderings.
    pub sampler: Option<String>,
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
            sampler: fields.get("sampler").ok().map(str::to_owned),
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

    /// Multiplications and additions that one lane takes, without activations.
    #[must_use]
    pub fn flops_per_lane(&self) -> usize {
        self.layers.iter().map(|layer| 2 * layer.weight.len()).sum()
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
        let bad =
            |_| Error::Weights(format!("metadata '{key}' is '{text}', not a number in range"));
        text.parse().map_err(bad)
    }

    fn range(&self, key: &str) -> Result<(u32, u32), Error> {
        let text = self.get(key)?;
        text.split_once("..")
            .and_then(|(first, last)| Some((first.parse().ok()?, last.parse().ok()?)))
            .filter(|(first, last)| first <= last)
            .ok_or_else(|| {
                Error::Weights(format!("metadata '{key}' is '{text}', not 'first..last'"))
            })
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
        other => {
            Err(Error::Weights(format!("layer {layer} is {other:?}; F32 and F16 are supported")))
        }
    }
}

#[cfg(test)]
mod tests {
    use safetensors::serialize;

    use super::*;

    type Tensors = Vec<(String, (Dtype, Vec<usize>, Vec<u8>))>;

    /// A correct file, as tensors and metadata to be damaged.
    fn parts() -> (Tensors, HashMap<String, String>) {
        let tensor = |name: &str, shape: &[usize]| {
            let bytes = vec![0; 4 * shape.iter().product::<usize>()];
            (name.to_owned(), (Dtype::F32, shape.to_vec(), bytes))
        };
        let tensors = vec![
            tensor("layers.0.weight", &[5, 3]),
            tensor("layers.0.bias", &[5]),
            tensor("layers.1.weight", &[1, 5]),
            tensor("layers.1.bias", &[1]),
        ];
        let metadata = [
            ("format", FORMAT),
            ("kind", "mlp"),
            ("inputs", "window"),
            ("window", "3"),
            ("activation", "leaky_relu"),
            ("negative_slope", "0.01"),
            ("trained_on", "family:step, family:gaussian"),
            ("samples", "8..64"),
            ("loss", "L2"),
            ("epochs", "10"),
            ("seed", "1"),
            ("config", "name = \"x\""),
        ];
        (tensors, metadata.map(|(key, value)| (key.to_owned(), value.to_owned())).into())
    }

    fn read(tensors: &Tensors, metadata: &HashMap<String, String>) -> Result<Network, Error> {
        let views = tensors.iter().map(|(name, (dtype, shape, bytes))| {
            let view = TensorView::new(*dtype, shape.clone(), bytes).expect("sizes match");
            (name.as_str(), view)
        });
        let bytes = serialize(views, Some(metadata.clone())).expect("a safetensors file");
        Network::from_bytes(&bytes)
    }

    #[test]
    fn a_correct_file() -> Result<(), Error> {
        let (tensors, metadata) = parts();
        let network = read(&tensors, &metadata)?;
        assert_eq!(network.shape(), "3-5-1");
        assert_eq!(network.metadata().trained_on, ["family:step", "family:gaussian"]);
        assert_eq!(network.metadata().samples, (8, 64));
        assert_eq!(network.metadata().sampler, None);
        let (tensors, mut metadata) = parts();
        metadata.insert("sampler".into(), "halton".into());
        assert_eq!(read(&tensors, &metadata)?.metadata().sampler.as_deref(), Some("halton"));
        Ok(())
    }

    #[test]
    fn half_precision() -> Result<(), Error> {
        let (mut tensors, metadata) = parts();
        let values = [1.0, -2.0, 0.5, 65504.0, 6e-8].map(half::f16::from_f32);
        tensors[1].1 = (Dtype::F16, vec![5], values.iter().flat_map(|x| x.to_le_bytes()).collect());
        let network = read(&tensors, &metadata)?;
        assert_eq!(network.layers()[0].bias.to_vec(), values.map(half::f16::to_f32));
        Ok(())
    }

    #[test]
    fn defects_are_named() {
        type Damage = fn(&mut Tensors, &mut HashMap<String, String>);
        fn set(metadata: &mut HashMap<String, String>, key: &str, value: &str) {
            metadata.insert(key.to_owned(), value.to_owned());
        }
        let cases: [(&str, Damage); 17] = [
            ("'format'", |_, m| set(m, "format", "nst-weights-9")),
            ("'kind'", |_, m| set(m, "kind", "lstm")),
            ("'inputs'", |_, m| set(m, "inputs", "samples")),
            ("'activation'", |_, m| set(m, "activation", "tanh")),
            ("'trained_on'", |_, m| drop(m.remove("trained_on"))),
            ("'samples'", |_, m| set(m, "samples", "64..8")),
            ("'negative_slope'", |_, m| set(m, "negative_slope", "NaN")),
            ("'window'", |_, m| set(m, "window", "-3")),
            ("layer 0", |_, m| set(m, "window", "4")),
            ("layer 0", |t, _| t[1].1 = (Dtype::F32, vec![4], vec![0; 16])),
            ("layer 1", |t, _| t[2].1 = (Dtype::F32, vec![1, 4], vec![0; 16])),
            ("2 outputs", |t, _| {
                t[2].1 = (Dtype::F32, vec![2, 5], vec![0; 40]);
                t[3].1 = (Dtype::F32, vec![2], vec![0; 8]);
            }),
            ("shapes", |t, _| t[0].1.1 = vec![5, 3, 1]),
            ("I32", |t, _| t[0].1.0 = Dtype::I32),
            ("NaN", |t, _| t[0].1.2[..4].copy_from_slice(&f32::NAN.to_le_bytes())),
            ("infinity", |t, _| t[3].1.2[..4].copy_from_slice(&f32::INFINITY.to_le_bytes())),
            ("3 tensors", |t, _| drop(t.pop())),
        ];
        for (word, damage) in cases {
            let (mut tensors, mut metadata) = parts();
            damage(&mut tensors, &mut metadata);
            let error = read(&tensors, &metadata).expect_err(word).to_string();
            assert!(error.contains(word), "'{word}' is not in: {error}");
        }
    }

    #[test]
    fn builtin_networks_are_readable() -> Result<(), Error> {
        for (name, _) in BUILTIN {
            Network::builtin(name).expect("it is in the list")?;
        }
        assert!(Network::builtin("nothing").is_none());
        Ok(())
    }
}

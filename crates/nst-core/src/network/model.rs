//! A network: layers that fit each other, and how they were trained.

use ndarray::{Array1, Array2};

use crate::Error;

/// No layer may be wider than this. Its weights would take over 64 MiB; a file that says so
/// is probably damaged.
const MAX_WIDTH: usize = 4096;

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
    /// How many consecutive terms the network reads; of a
    /// [`SampleNetwork`](super::SampleNetwork), how many inputs it has.
    pub window: usize,
    /// The slope of the leaky ReLU for negative arguments.
    pub negative_slope: f32,
    /// What it was trained on: `family:NAME`, or `scene:FINGERPRINT` with the fingerprint
    /// of a scene, as in `scene:cornell:v2:a736c0a254dc9a84`.
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
    /// The configuration file of the training run, and which of its settings was used.
    pub config: String,
}

impl Metadata {
    /// Whether the network was trained on the scene with this fingerprint.
    #[must_use]
    pub fn trained_on_scene(&self, fingerprint: &str) -> bool {
        self.trained_on.iter().any(|it| it.strip_prefix("scene:") == Some(fingerprint))
    }
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
    /// output, if a number is not finite, or if samples per pixel begin with 0.
    pub fn new(layers: Vec<Layer>, metadata: Metadata) -> Result<Self, Error> {
        if layers.is_empty() {
            return Err(Error::Weights("there is no layer".into()));
        }
        if metadata.samples.0 == 0 {
            return Err(Error::Weights("'samples' must begin with 1 or more".into()));
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
                return Err(Error::Weights(format!("layer {i} contains a NaN or an infinity")));
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

    /// The number of multiplications and additions for one lane, without activations.
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

//! Files of networks: safetensors, checked before anything is allocated.

use std::{collections::HashMap, path::Path};

use ndarray::Array2;
use safetensors::{
    Dtype, SafeTensors,
    tensor::{Metadata as Header, TensorInfo},
};

use super::{
    guard::GuardNetwork,
    model::{Layer, Metadata, Network},
    samples::{SampleForm, SampleNetwork},
};
use crate::{Error, guard::INPUTS};

/// The value of the metadata key `format` in files that this version reads.
const FORMAT: &str = "nst-weights-1";

/// A safetensors file begins with the length of its header, a number of this many bytes.
const LENGTH_BYTES: usize = 8;

/// What a weights file contains: one of three kinds of network.
#[derive(Clone, Debug, PartialEq)]
pub enum Weights {
    /// One that reads a window of terms.
    Window(Network),
    /// One that sees samples.
    Samples(SampleNetwork),
    /// One that weighs the guard's experts.
    Guard(GuardNetwork),
}

impl Weights {
    /// Reads a network from the bytes of a safetensors file.
    ///
    /// # Errors
    /// [`Error::Weights`] names the first defect.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        let (length, header) =
            SafeTensors::read_metadata(bytes).map_err(|error| Error::Weights(error.to_string()))?;
        let empty = HashMap::new();
        let fields = Fields(header.metadata().as_ref().unwrap_or(&empty));
        fields.expect("format", FORMAT)?;
        fields.expect("kind", "mlp")?;
        fields.expect("activation", "leaky_relu")?;
        let tensors = Tensors { header: &header, data: &bytes[LENGTH_BYTES + length..] };
        match fields.get("inputs")? {
            "window" => {
                let metadata = fields.metadata(fields.number("window")?)?;
                Ok(Self::Window(Network::new(tensors.layers()?, metadata)?))
            }
            "samples" => {
                let form = fields.form()?;
                let metadata = fields.metadata(form.inputs())?;
                Ok(Self::Samples(SampleNetwork::new(tensors.layers()?, metadata, form)?))
            }
            "guard" => {
                let metadata = fields.metadata(INPUTS)?;
                let experts = fields.get("experts")?.split(',').map(|it| it.trim().to_owned());
                let (experts, floor) = (experts.collect(), fields.number("prior_floor")?);
                let network = GuardNetwork::new(tensors.layers()?, metadata, experts, floor)?;
                Ok(Self::Guard(network))
            }
            found => Err(Error::Weights(format!(
                "metadata 'inputs' is '{found}'; this version reads 'window', 'samples' and 'guard'"
            ))),
        }
    }

    /// Reads a network from a safetensors file.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read, [`Error::Weights`] if it is malformed.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::from_bytes(&std::fs::read(path)?)
    }

    /// Its layers; of one that reads no terms, their window is its inputs, and of one that weighs experts,
    /// they have the output of the first.
    #[must_use]
    pub fn layers(&self) -> &Network {
        match self {
            Self::Window(network) => network,
            Self::Samples(network) => network.layers(),
            Self::Guard(network) => &network.outputs()[0],
        }
    }

    /// The error where another kind is needed.
    fn unfit(&self) -> Error {
        let is = match self {
            Self::Window(_) => {
                "it reads a window of terms (metadata 'inputs'): it sees no samples, and weighs no \
                 experts"
            }
            Self::Samples(_) => {
                "it sees samples (metadata 'inputs'): it reads no window of terms, and weighs no \
                 experts, but can be one"
            }
            Self::Guard(_) => "it weighs the guard's experts (metadata 'inputs'): --guard takes it",
        };
        Error::Weights(is.into())
    }
}

impl Network {
    /// Reads a network from the bytes of a safetensors file.
    ///
    /// # Errors
    /// [`Error::Weights`] names the first defect, or says that the network sees samples.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        match Weights::from_bytes(bytes)? {
            Weights::Window(network) => Ok(network),
            other => Err(other.unfit()),
        }
    }

    /// Reads a network from a safetensors file.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read, and those of [`Self::from_bytes`].
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::from_bytes(&std::fs::read(path)?)
    }
}

impl SampleNetwork {
    /// Reads a network from the bytes of a safetensors file.
    ///
    /// # Errors
    /// [`Error::Weights`] names the first defect, or says that the network reads terms.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        match Weights::from_bytes(bytes)? {
            Weights::Samples(network) => Ok(network),
            other => Err(other.unfit()),
        }
    }

    /// Reads a network from a safetensors file.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read, and those of [`Self::from_bytes`].
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::from_bytes(&std::fs::read(path)?)
    }
}

impl GuardNetwork {
    /// Reads a network from the bytes of a safetensors file.
    ///
    /// # Errors
    /// [`Error::Weights`] names the first defect, or says that the network is of another kind.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        match Weights::from_bytes(bytes)? {
            Weights::Guard(network) => Ok(network),
            other => Err(other.unfit()),
        }
    }

    /// Reads a network from a safetensors file.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read, and those of [`Self::from_bytes`].
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::from_bytes(&std::fs::read(path)?)
    }
}

/// The metadata of a file, with errors that name the key.
struct Fields<'a>(&'a HashMap<String, String>);

impl Fields<'_> {
    /// What the header says about a network with this window, or this number of inputs.
    fn metadata(&self, window: usize) -> Result<Metadata, Error> {
        let trained_on = self.get("trained_on")?.split(',').map(|s| s.trim().to_owned()).collect();
        let metadata = Metadata {
            window,
            negative_slope: self.number("negative_slope")?,
            trained_on,
            samples: self.range("samples")?,
            sampler: self.get("sampler").ok().map(str::to_owned),
            loss: self.get("loss")?.to_owned(),
            epochs: self.number("epochs")?,
            seed: self.number("seed")?,
            config: self.get("config")?.to_owned(),
        };
        if !metadata.negative_slope.is_finite() {
            return Err(Error::Weights("metadata 'negative_slope' is not finite".into()));
        }
        Ok(metadata)
    }

    /// What it says about a network that sees samples.
    fn form(&self) -> Result<SampleForm, Error> {
        let powers = self.get("powers")?.split(',').map(str::parse).collect::<Result<_, _>>();
        let powers =
            powers.map_err(|error| Error::Weights(format!("metadata 'powers': {error}")))?;
        Ok(SampleForm {
            powers,
            floor: self.number("floor")?,
            scale_estimate: self.number("scale_estimate")?,
            scale_unit: self.number("scale_unit")?,
        })
    }

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

/// The tensors of a file whose header is sound: each is inside `data`, and as long as its
/// shape says.
struct Tensors<'a> {
    header: &'a Header,
    data: &'a [u8],
}

impl Tensors<'_> {
    fn layers(&self) -> Result<Vec<Layer>, Error> {
        match self.header.tensors().len() {
            count if count == 0 || !count.is_multiple_of(2) => Err(Error::Weights(format!(
                "{count} tensors; a weight and a bias per layer are needed"
            ))),
            count => (0..count / 2).map(|i| self.layer(i)).collect(),
        }
    }

    fn layer(&self, i: usize) -> Result<Layer, Error> {
        let weight = self.tensor(&format!("layers.{i}.weight"))?;
        let bias = self.tensor(&format!("layers.{i}.bias"))?;
        let (&[outputs, inputs], &[_]) = (&weight.shape[..], &bias.shape[..]) else {
            return Err(Error::Weights(format!(
                "layer {i} has shapes {:?} and {:?}; [out, in] and [out] are needed",
                weight.shape, bias.shape
            )));
        };
        let weight = Array2::from_shape_vec((outputs, inputs), self.numbers(weight, i)?)
            .map_err(|error| Error::Weights(error.to_string()))?;
        Ok(Layer { weight, bias: self.numbers(bias, i)?.into() })
    }

    fn tensor(&self, name: &str) -> Result<&TensorInfo, Error> {
        let info = self.header.info(name);
        info.ok_or_else(|| Error::Weights(format!("tensor '{name}' is missing")))
    }

    /// The numbers of a tensor, little-endian f32 or f16.
    fn numbers(&self, tensor: &TensorInfo, layer: usize) -> Result<Vec<f32>, Error> {
        let data = &self.data[tensor.data_offsets.0..tensor.data_offsets.1];
        match tensor.dtype {
            Dtype::F32 => {
                let (numbers, _) = data.as_chunks();
                Ok(numbers.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect())
            }
            Dtype::F16 => {
                let (numbers, _) = data.as_chunks();
                Ok(numbers.iter().map(|&bytes| half::f16::from_le_bytes(bytes).to_f32()).collect())
            }
            other => Err(Error::Weights(format!(
                "layer {layer} is {other:?}; F32 and F16 are supported"
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use safetensors::{serialize, tensor::TensorView};

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

    fn file(tensors: &Tensors, metadata: &HashMap<String, String>) -> Vec<u8> {
        let views = tensors.iter().map(|(name, (dtype, shape, bytes))| {
            let view = TensorView::new(*dtype, shape.clone(), bytes).expect("sizes match");
            (name.as_str(), view)
        });
        serialize(views, Some(metadata.clone())).expect("a safetensors file")
    }

    fn read(tensors: &Tensors, metadata: &HashMap<String, String>) -> Result<Network, Error> {
        Network::from_bytes(&file(tensors, metadata))
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
        let cases: [(&str, Damage); 20] = [
            ("'format'", |_, m| set(m, "format", "nst-weights-9")),
            ("'kind'", |_, m| set(m, "kind", "lstm")),
            ("'inputs'", |_, m| set(m, "inputs", "pixels")),
            ("'powers'", |_, m| set(m, "inputs", "samples")),
            ("'activation'", |_, m| set(m, "activation", "tanh")),
            ("'trained_on'", |_, m| drop(m.remove("trained_on"))),
            ("'samples'", |_, m| set(m, "samples", "64..8")),
            ("'samples'", |_, m| set(m, "samples", "0..8")),
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
            ("'layers.1.bias'", |t, _| t[3].0 = "layers.2.bias".to_owned()),
        ];
        for (word, damage) in cases {
            let (mut tensors, mut metadata) = parts();
            damage(&mut tensors, &mut metadata);
            let error = read(&tensors, &metadata).expect_err(word).to_string();
            assert!(error.contains(word), "'{word}' is not in: {error}");
        }
    }

    /// A correct file of a network that sees samples.
    fn parts_of_samples() -> (Tensors, HashMap<String, String>) {
        let (tensors, mut metadata) = parts();
        metadata.remove("window");
        for (key, value) in [
            ("inputs", "samples"),
            ("powers", "1"),
            ("floor", "0.001"),
            ("scale_estimate", "0"),
            ("scale_unit", "1.0"),
        ] {
            metadata.insert(key.to_owned(), value.to_owned());
        }
        (tensors, metadata)
    }

    #[test]
    fn networks_that_see_samples() {
        let bytes = |(tensors, metadata)| file(&tensors, &metadata);
        let network = SampleNetwork::from_bytes(&bytes(parts_of_samples())).expect("a network");
        assert_eq!((network.layers().shape(), network.metadata().window), ("3-5-1".into(), 3));
        assert_eq!(network.form().powers, [crate::Power::ONE]);
        // Each kind refuses the other, and says why.
        let error = Network::from_bytes(&bytes(parts_of_samples())).expect_err("samples");
        assert!(error.to_string().contains("it sees samples"), "{error}");
        let error = SampleNetwork::from_bytes(&bytes(parts())).expect_err("a window");
        assert!(error.to_string().contains("window of terms"), "{error}");

        for (word, key, value) in [
            ("'powers': '3' is not", "powers", "3"),
            ("'powers': '' is not", "powers", ""),
            ("'powers': 'x' is not", "powers", "1,x"),
            ("'powers' must be ascending", "powers", "2"),
            ("'powers' must be ascending", "powers", "2,1"),
            ("'powers' must be ascending", "powers", "1,1"),
            ("but 4 values reach it", "powers", "1,2"),
            ("'floor' must be above 0", "floor", "0"),
            ("'floor' must be above 0", "floor", "inf"),
            ("'floor' is 'x'", "floor", "x"),
            ("'scale_estimate' must be at least 0", "scale_estimate", "-1"),
            ("'scale_unit' must be at least 0", "scale_unit", "NaN"),
            ("'scale_unit' must be at least 0", "scale_unit", "0"),
            ("'samples' must begin with 1", "samples", "0..8"),
        ] {
            let (tensors, mut metadata) = parts_of_samples();
            metadata.insert(key.to_owned(), value.to_owned());
            let error = Weights::from_bytes(&file(&tensors, &metadata)).expect_err(word);
            assert!(error.to_string().contains(word), "'{word}' is not in: {error}");
        }
        for key in ["powers", "floor", "scale_estimate", "scale_unit", "samples"] {
            let (tensors, mut metadata) = parts_of_samples();
            metadata.remove(key);
            let error = Weights::from_bytes(&file(&tensors, &metadata)).expect_err(key);
            assert!(error.to_string().contains(&format!("'{key}' is missing")), "{error}");
        }
    }
}

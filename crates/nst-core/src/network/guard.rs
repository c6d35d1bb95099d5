//! Networks that weigh the guard's experts.
//!
//! What they read is defined where it is computed, in `guard/picture/learned/inputs.rs`. With the
//! closed form's weights c of the experts, and c_S = 1 − Σ c of the plain estimate, the
//! network's weights are
//!
//! ```text
//! w = softmax(o + ln(c + φ)),   o_S = 0,
//! ```
//!
//! over S and the experts that take part: an output of 0 leaves c as it is, but for the floor φ,
//! by which an expert may come in that the closed form has left out.

use std::sync::Arc;

use super::model::{Layer, Metadata, Network};
use crate::Error;

/// A multi-layer perceptron whose outputs correct the weights of the guard over neighbours
/// ([`PictureGuard::learned`](crate::guard::PictureGuard::learned)).
#[derive(Clone, Debug, PartialEq)]
pub struct GuardNetwork {
    /// `[expert]`: networks of one output, which share all layers but the last.
    outputs: Vec<Arc<Network>>,
    experts: Vec<String>,
    floor: f32,
}

impl GuardNetwork {
    /// The most experts that one can weigh: what it reads has so many slots.
    pub const MOST_EXPERTS: usize = 3;

    /// Puts a network together whose last layer has one output for each of `experts`, by their
    /// names; `floor` is φ.
    ///
    /// # Errors
    /// [`Error::Weights`] as for [`Network::new`], if the outputs are not as many as the experts, if
    /// these are too many, or one is there twice, or if the floor is not above 0.
    pub fn new(
        mut layers: Vec<Layer>,
        metadata: Metadata,
        experts: Vec<String>,
        floor: f32,
    ) -> Result<Self, Error> {
        let last = layers.pop().ok_or_else(|| Error::Weights("there is no layer".into()))?;
        let outputs = [last.outputs(), last.bias.len()];
        if outputs != [experts.len(); 2] || experts.is_empty() {
            let (outputs, count) = (last.outputs(), experts.len());
            let message = format!("the last layer has {outputs} outputs for {count} experts");
            return Err(Error::Weights(message));
        }
        if experts.len() > Self::MOST_EXPERTS {
            let (count, most) = (experts.len(), Self::MOST_EXPERTS);
            let message = format!("weights for {count} experts; at most {most} can be blended");
            return Err(Error::Weights(message));
        }
        if let Some(twice) = (1..experts.len()).find(|&i| experts[..i].contains(&experts[i])) {
            return Err(Error::Weights(format!("weights for '{}' twice", experts[twice])));
        }
        if !(floor > 0.0 && floor.is_finite()) {
            return Err(Error::Weights("'prior_floor' must be above 0".into()));
        }
        let outputs = (0..experts.len()).map(|expert| {
            let (weight, bias) = (last.weight.row(expert), last.bias[expert]);
            let weight = weight.to_owned().insert_axis(ndarray::Axis(0));
            let last = Layer { weight, bias: vec![bias].into() };
            let layers = layers.iter().cloned().chain([last]).collect();
            Ok(Arc::new(Network::new(layers, metadata.clone())?))
        });
        Ok(Self { outputs: outputs.collect::<Result<_, Error>>()?, experts, floor })
    }

    /// What the weights file says about the network. The window is the number of inputs.
    #[must_use]
    pub fn metadata(&self) -> &Metadata {
        self.outputs[0].metadata()
    }

    /// The names of the experts that it can weigh.
    #[must_use]
    pub fn experts(&self) -> &[String] {
        &self.experts
    }

    /// For each expert a network of one output, o; they share all layers but the last.
    #[must_use]
    pub fn outputs(&self) -> &[Arc<Network>] {
        &self.outputs
    }

    /// φ
    #[must_use]
    pub fn floor(&self) -> f32 {
        self.floor
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array1, Array2};

    use super::*;

    fn metadata() -> Metadata {
        Metadata {
            window: 2,
            negative_slope: 0.01,
            trained_on: vec!["scenes".into()],
            samples: (8, 1024),
            sampler: None,
            loss: "log".into(),
            epochs: 1,
            seed: 0,
            config: String::new(),
        }
    }

    fn network(outputs: usize, experts: &[&str], floor: f32) -> Result<GuardNetwork, Error> {
        let layer = |outputs: usize, inputs: usize| Layer {
            weight: Array2::from_shape_fn((outputs, inputs), |(i, j)| (10 * i + j) as f32),
            bias: Array1::from_iter((0..outputs).map(|i| i as f32)),
        };
        let experts = experts.iter().map(|&name| name.to_owned()).collect();
        GuardNetwork::new(vec![layer(3, 2), layer(outputs, 3)], metadata(), experts, floor)
    }

    #[test]
    fn each_expert_has_its_row_of_the_last_layer() -> Result<(), Error> {
        let network = network(2, &["lane", "filter"], 0.02)?;
        assert_eq!(network.experts(), ["lane", "filter"]);
        for (i, output) in network.outputs().iter().enumerate() {
            let last = &output.layers()[1];
            let first = 10.0 * i as f32;
            assert_eq!(last.weight.as_slice(), Some([first, first + 1.0, first + 2.0].as_slice()));
            assert_eq!((last.bias.to_vec(), output.shape()), (vec![i as f32], "2-3-1".to_owned()));
        }
        Ok(())
    }

    #[test]
    fn outputs_and_experts_fit() {
        for (outputs, experts, floor, word) in [
            (2, &["lane"][..], 0.02, "2 outputs for 1 experts"),
            (1, &["lane", "filter"], 0.02, "1 outputs for 2 experts"),
            (1, &["lane"], 0.0, "'prior_floor'"),
            (4, &["a", "b", "c", "d"], 0.02, "weights for 4 experts; at most 3"),
            (3, &["lane", "oidn", "lane"], 0.02, "weights for 'lane' twice"),
        ] {
            let error = network(outputs, experts, floor).expect_err(word).to_string();
            assert!(error.contains(word), "'{word}' is not in: {error}");
        }
    }
}

//! Files of tensors: weights of networks, and datasets.

use std::{fmt, path::Path};

use nst_core::Weights;
use nst_files::dataset::DatasetInfo;
use serde::Serialize;

use super::or_unknown;
use crate::{
    error::Error,
    networks::network_of,
    words::{counted, numbers, on_one_line},
};

#[derive(Serialize)]
pub(super) struct WeightsInfo {
    shape: String,
    parameters: usize,
    /// How many of the last terms it reads, if it reads terms.
    #[serde(skip_serializing_if = "Option::is_none")]
    window: Option<usize>,
    /// The powers of the samples whose means it reads, if it sees samples.
    #[serde(skip_serializing_if = "Option::is_none")]
    powers: Option<Vec<f64>>,
    /// The experts that it weighs, if it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    experts: Option<Vec<String>>,
    trained_on: Vec<String>,
    samples: [u32; 2],
    sampler: Option<String>,
    loss: String,
    epochs: u32,
    seed: u64,
    config: String,
}

impl WeightsInfo {
    pub(super) fn read(path: &Path) -> Result<Self, Error> {
        Ok(Self::of(&network_of(path)?))
    }

    pub(super) fn of(weights: &Weights) -> Self {
        let network = weights.layers();
        let (mut window, mut powers, mut experts) = (None, None, None);
        match weights {
            Weights::Window(network) => window = Some(network.metadata().window),
            Weights::Samples(network) => {
                powers = Some(network.form().powers.iter().map(|power| power.value()).collect());
            }
            Weights::Guard(network) => experts = Some(network.experts().to_vec()),
        }
        let metadata = network.metadata();
        let of_layers = network.layers().iter().map(|layer| layer.weight.len() + layer.bias.len());
        let (mut shape, mut parameters) = (network.shape(), of_layers.sum());
        if let Some(outputs) = experts.as_ref().map(Vec::len) {
            // Each expert has an output of its own.
            let last = network.layers().last().expect("a network has layers");
            parameters += (outputs - 1) * (last.inputs() + 1);
            shape.replace_range(shape.len() - 1.., &outputs.to_string());
        }
        Self {
            shape,
            parameters,
            window,
            powers,
            experts,
            trained_on: metadata.trained_on.clone(),
            samples: [metadata.samples.0, metadata.samples.1],
            sampler: metadata.sampler.clone(),
            loss: metadata.loss.clone(),
            epochs: metadata.epochs,
            seed: metadata.seed,
            config: metadata.config.clone(),
        }
    }
}

impl fmt::Display for WeightsInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { shape, parameters, samples: [first, last], .. } = self;
        let widths = shape.replace('-', ", ");
        writeln!(f, "weights of a network, {}", counted(*parameters, "parameter"))?;
        writeln!(f, "layers      {widths} wide, from the input to the output")?;
        let mut unit = " per pixel";
        if let Some(window) = self.window {
            writeln!(f, "reads       the last {}", counted(window, "term"))?;
        }
        if let Some(powers) = &self.powers {
            unit = "";
            let powers: Vec<_> = powers.iter().map(f64::to_string).collect();
            writeln!(f, "reads       means of the samples to the power {}", powers.join(", "))?;
        }
        if let Some(experts) = &self.experts {
            writeln!(f, "weighs      the guard's experts {}", experts.join(", "))?;
        }
        let (trained_on, loss) = (self.trained_on.join(", "), on_one_line(&self.loss));
        let trained_on = on_one_line(&trained_on);
        writeln!(f, "trained on  {trained_on}, {first} to {last} samples{unit}")?;
        let Self { epochs, seed, .. } = self;
        writeln!(f, "training    loss {loss}, {}, seed {seed}", counted(*epochs as usize, "epoch"))
    }
}

#[derive(Serialize)]
pub(super) struct DatasetReport {
    runs: u32,
    sample_counts: Vec<u32>,
    width: u32,
    height: u32,
    channels: u32,
    scene: String,
    sampler: String,
    first_seed: Option<u64>,
}

impl DatasetReport {
    pub(super) fn read(path: &Path) -> Result<Self, Error> {
        let info = DatasetInfo::read(path)?;
        Ok(Self {
            runs: info.runs,
            sample_counts: info.sample_counts,
            width: info.size[0],
            height: info.size[1],
            channels: info.channels,
            scene: info.scene,
            sampler: info.sampler,
            first_seed: info.first_seed,
        })
    }
}

impl fmt::Display for DatasetReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { runs, width, height, channels, sample_counts, .. } = self;
        writeln!(
            f,
            "dataset, {} of {}, {width}x{height} pixels, {}",
            counted(*runs as usize, "run"),
            counted(sample_counts.len(), "term"),
            counted(*channels as usize, "channel")
        )?;
        writeln!(f, "terms       of {} samples per pixel", numbers(sample_counts))?;
        writeln!(f, "scene       {}", or_unknown(&self.scene))?;
        let seeds = match self.first_seed {
            None => "not recorded".to_owned(),
            Some(first) => {
                format!("{first} to {}", u128::from(first) + u128::from(*runs).saturating_sub(1))
            }
        };
        writeln!(f, "sampler     {}, seeds {seeds}", or_unknown(&self.sampler))
    }
}
